"""Needs of joints next to what devices bear: statics by another way, and warnings that name the weak and the busy."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.sim import robot_scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.model_file import make_effect
from mrwarp.params import MrParams
from mrwarp.trials.joint_need import SWITCHES, chatter, need_lines, needs, slides
from mrwarp.trials.power_meter import PowerMeter


def test_the_need_is_the_moment_about_the_joint() -> None:
    """Standing: the weights of what hangs on a calf, and its foot's share of all, about the knee; feet share evenly."""
    scene = robot_scene()
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = model.qpos0
    data.qpos[:3] = 0.0
    data.qpos[scene.q_adr] = scene.layout.default_q
    mujoco.mj_forward(model, data)
    weight = 9.81 * model.body_mass.sum()
    found = {need.joint: need for need in needs(scene)}
    assert len(found) == 4
    total = 0.0
    for leg, name in enumerate(scene.layout.leg_names):
        joint = scene.joints.index(f"{name}_calf")
        j = int(model.dof_jntid[scene.v_adr[joint]])
        body, anchor, axis = model.jnt_bodyid[j], data.xanchor[j], data.xaxis[j]
        carried = [b for b in range(model.nbody) if b == body or model.body_parentid[b] == body]
        own = sum(np.cross(data.xipos[b] - anchor, [0.0, 0.0, -9.81 * model.body_mass[b]]) @ axis for b in carried)
        per_newton = np.cross(scene.soles[leg] - anchor, [0.0, 0.0, 1.0]) @ axis
        share = (found[f"{name}_calf"].standing * np.sign(per_newton) - own) / per_newton
        assert share == pytest.approx(weight / 4, rel=0.15)
        total += share
    assert total == pytest.approx(weight, rel=1e-3)
    for need in found.values():
        assert 1.7 * need.standing < need.trotting < 2.3 * need.standing < need.pushed
        assert need.holds == pytest.approx(25.44, abs=0.01) and need.slides == pytest.approx(2.681, abs=0.001)


def test_a_weak_device_is_warned_of() -> None:
    """One that holds 6 N·m under a calf that needs more in a trot; the paper's is not."""
    scene = robot_scene()
    assert not any(line.startswith("warning") for line in need_lines(scene))
    actuators = tuple(replace(a, mr=a.mr.replace(T_max=6.3)) if a.mr else a for a in scene.actuators)
    first, second = need_lines(replace(scene, actuators=actuators))
    assert "the device holds 6.03 N·m and slides at 2.68 N·m" in first
    assert second.startswith("warning: FL_calf, FR_calf, RL_calf, RR_calf: the device holds less than")
    assert slides(MrParams(), (make_effect("current_saturation", {"u": 1.0}),)) < slides(MrParams(), ())


def test_gates_are_counted_and_chatter_is_warned_of() -> None:
    """A gate that changes in every torque step switches 200 times per second; four times a stride is a gait's."""
    env = WalkEnv(TaskCfg(num_envs=2, randomize="none"))
    meter = PowerMeter(env)
    meter.on.fill_(True)
    hold = env.view(env.actuator.m_hold)
    for step in range(40):
        hold.fill_(0.0)
        hold[1] = float(step % 2)
        meter.count()
    assert meter.switches[0].max() <= 200.0 / 40 and meter.switches[1].min() >= 0.97 * 200.0
    devices = env.sim.scene.actuators
    assert chatter(devices, 2.0 * SWITCHES * 1.5, 1.5) == "" == chatter((), 100.0, 1.5)
    assert "switch 100 times per second, a gait of 1.5 Hz asks for 6" in chatter(devices, 100.0, 1.5)
