"""Sim: brake closed form, resets, masses, the solver's counter, refusals, and a USD edit that reaches the torque."""

import gc
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp

from benchmarks.verify.held_joint import bench_rig, stand_on_brakes
from benchmarks.verify.rigs import stance
from mrwarp.actuator import brake_constraint
from mrwarp.env.backend import BackendKind, MjBatchBackend
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim, Sim, robot_scene
from mrwarp.env.sim_model import Scene, build_scene
from mrwarp.params import MrParams
from mrwarp.usd.asset import load_robot
from mrwarp.usd.open_stage import ASSETS

K1 = "double newton:mr:K1 = 10.413315"


def f32(values: object) -> wp.array:
    """The values as a Warp array of float32."""
    return wp.array(np.asarray(values, dtype=np.float32), dtype=float, device="cpu")


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The robot on flat ground."""
    return robot_scene()


def test_sim_brake_stops_a_rotor_like_coulomb_friction():
    """A spinning rotor loses bound*dt/J per step, stops in the step in which that suffices, and stays.

    J*dqd/dt = -sgn(qd)*bound, so qd = 20 - 3/0.01*t until t = 0.0667 s: step 14 of 5 ms ends at rest. The sum of 14
    float64 steps is exact to 1e-12; the rotor's inertia is a float32 in USD, 2e-9 away from 0.01. At rest nothing but
    the creep of the regularised row is left, and without a load that decays to 0.
    """
    inertia, bound, start = float(np.float32(0.01)), 3.0, 20.0
    sim = Sim(bench_rig(), SimCfg(num_envs=1))
    sim.reset(None, qvel=f32([[start]]))
    tau, bounds = f32([[0.0]]), f32([[bound]])
    qd = []
    for _ in range(30):
        sim.step(tau, bounds)
        qd.append(float(sim.backend.field("qvel").numpy()[0, 0]))
    expected = start - bound / inertia * sim.dt * np.arange(1, 14)
    np.testing.assert_allclose(qd[:13], expected, rtol=0.0, atol=1e-7)
    # the row stops it but for creep*torque, and the torque that stopped it is at most the bound
    assert abs(qd[13]) <= brake_constraint.CREEP * bound
    assert abs(qd[-1]) < 1e-9


def test_a_joint_has_its_own_friction_and_damping():
    """A rotor loses (f + c*qd)*dt/J per step, here J = 0.01, f = 1 N·m, c = 0.02 N·m·s/rad, and then stands still.

    The torque of the damping is rounded to float32.
    """
    inertia, friction, damping = float(np.float32(0.01)), 1.0, 0.02
    sim = Sim(replace(bench_rig(), friction=np.array([friction]), damping=np.array([damping])), SimCfg(num_envs=1))
    sim.reset(None, qvel=f32([[20.0]]))
    expected, qd = [20.0], [20.0]
    for _ in range(60):
        sim.step(f32([[0.0]]), f32([[0.0]]))
        qd.append(float(sim.backend.field("qvel").numpy()[0, 0]))
        expected.append(max(expected[-1] - (friction + damping * expected[-1]) * sim.dt / inertia, 0.0))
    assert expected[-1] == 0.0 < expected[30]
    np.testing.assert_allclose(qd, expected, rtol=0.0, atol=2.0 * brake_constraint.CREEP)


def test_friction_and_damping_of_joints_come_from_their_file():
    """Newton's attributes of a joint; USD's damping of a hinge is per degree. Unmentioned joints have none."""
    asset = load_robot(robot="go1")
    joint = asset.actuators[4].joint
    prim = next(x for x in asset.stage.Traverse() if x.GetName() == joint and x.GetAttribute("newton:friction"))
    prim.GetAttribute("newton:friction").Set(0.3)
    prim.GetAttribute("newton:damping").Set(0.07 * np.pi / 180.0)
    found = build_scene(asset, dt=0.005)
    np.testing.assert_allclose(found.friction, 0.3 * (np.arange(12) == 4), rtol=1e-6)
    np.testing.assert_allclose(found.damping, 0.07 * (np.arange(12) == 4), rtol=1e-5)
    assert not found.model.dof_damping.any()


def test_a_forked_process_does_not_wait_for_threads_of_its_parent(scene):
    """Rubbish of the parent with a pool of two threads, collected in the child: it ends at once."""
    rubbish = [MjBatchBackend(scene.model, 4, threads=2)]
    rubbish[0].step()
    rubbish.append(rubbish)
    gc.disable()
    try:
        del rubbish
        pid = os.fork()
        if pid == 0:
            gc.collect()
            os._exit(0)
    finally:
        gc.enable()
    deadline, ended = time.monotonic() + 20.0, 0
    while not ended and time.monotonic() < deadline:
        time.sleep(0.02)
        ended = os.waitpid(pid, os.WNOHANG)[0]
    if not ended:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    assert ended == pid


def test_sim_kept_data_change_no_bits_and_are_asked_for(scene):
    """Whether each environment keeps its MjData changes nothing; the solver's rows are there only if kept."""
    kept, shared = (Sim(scene, SimCfg(num_envs=4, threads=2, keep_data=keep)) for keep in (True, False))
    rng, fields = np.random.default_rng(0), ("qpos", "qvel", "qacc", "sensordata", "M", "qfrc_constraint")
    for sim in (kept, shared):
        sim.reset(None, stance(scene, 4, lift=0.02))
    for _ in range(60):
        tau, bound = f32(rng.normal(0.0, 3.0, (4, 12))), f32(rng.uniform(0.0, 3.0, (4, 12)))
        for sim in (kept, shared):
            sim.step(tau, bound)
    for name in fields:
        np.testing.assert_array_equal(kept.backend.field(name).numpy(), shared.backend.field(name).numpy())
    data = mujoco.MjData(scene.model)
    assert isinstance(kept.backend, MjBatchBackend) and isinstance(shared.backend, MjBatchBackend)
    kept.backend.data(3, data)
    np.testing.assert_array_equal(data.qfrc_constraint, kept.backend.field("qfrc_constraint").numpy()[3])
    with pytest.raises(RuntimeError, match="keep_data"):
        shared.backend.data(3, data)


@pytest.mark.parametrize("kind", list(BackendKind))
def test_sim_mass_change_keeps_the_brake(scene, kind):
    """A heavier trunk changes masses and their constants per environment, but not the brakes' regularisation."""
    sim = Sim(scene, SimCfg(num_envs=2, backend=kind))
    nominal = sim.body_mass("trunk")
    sim.rescale_mass("trunk", np.array([nominal, nominal + 3.0]))
    masses = sim.backend.expand("body_mass").numpy().reshape(2, -1)
    np.testing.assert_allclose(masses[1].sum() - masses[0].sum(), 3.0, rtol=1e-5)  # float32: 2^-24 * 15 kg, summed
    calves = [v for v, a in zip(scene.v_adr, scene.actuators, strict=True) if a.mr]
    invweight = sim.backend.expand("dof_invweight0").numpy()
    np.testing.assert_allclose(invweight[:, calves], brake_constraint.invweight(sim.dt), rtol=1e-6)
    # the floating base is lighter to move with the lighter trunk: the constants were recomputed
    assert (invweight[1, :3] < invweight[0, :3]).all()


@pytest.mark.gpu
def test_a_gpu_steps_as_mujoco_warp_on_a_cpu(scene):
    """16 robots dropped from 5 cm on their brakes, 0.5 s: the same engine and precision, up to rounding.

    Contacts amplify roundings, so the tolerance is 2 mm and 5 mrad.
    """
    found = []
    for device in ("cpu", "cuda:0"):
        sim = Sim(scene, SimCfg(num_envs=16, backend=BackendKind.MJWARP, device=device))
        poses = stance(scene, 16, lift=0.05).numpy()
        poses[:, 2] += np.linspace(0.0, 0.02, 16)
        sim.reset(None, wp.array(poses, dtype=float, device=device))
        tau, bound = (wp.array(np.full((16, 12), x, dtype=np.float32), device=device) for x in (0.0, 20.0))
        for _ in range(100):
            sim.step(tau, bound)
        found.append(sim.backend.field("qpos").numpy().reshape(16, -1))
    assert found[0][:, 2].max() < poses[:, 2].max() - 0.03  # [m] they fell
    np.testing.assert_allclose(found[1][:, :3], found[0][:, :3], atol=2e-3)
    np.testing.assert_allclose(found[1][:, 7:], found[0][:, 7:], atol=5e-3)


def test_sim_counts_unsolved_steps():
    """Too few line-search iterations are never silent: the counter rises; with enough it stays at zero.

    The robot on its four brakes with calf motors off; 3 iterations are forced on the model past SolverCfg's check.
    """
    starved = stand_on_brakes(BackendKind.MJBATCH, seconds=0.5, ls_iterations=3)
    enough = stand_on_brakes(BackendKind.MJBATCH, seconds=0.5)
    assert starved.unsolved > 20
    assert np.abs(starved.calf - starved.calf[0]).max() > 0.1  # [rad] it collapsed
    assert enough.unsolved == 0


@pytest.mark.parametrize("kind", list(BackendKind))
def test_sim_counts_nan_as_unsolved(scene, kind, tmp_path, monkeypatch):
    """A state that is not a number shows, counts as unsolved in its own environment only, and a reset mends it.

    (MuJoCo by itself would put the environment back to the model's start and go on. It also writes a log file.)
    """
    monkeypatch.chdir(tmp_path)
    sim = Sim(scene, SimCfg(num_envs=2, backend=kind))
    sim.reset(None, stance(scene, 2, lift=0.1))
    tau, none = np.zeros((2, 12)), f32(np.zeros((2, 12)))
    tau[1, 0] = np.nan
    sim.step(f32(tau), none)
    assert sim.unsolved.numpy().tolist() == [0, 1]
    assert np.isnan(sim.q.numpy()[1]).any()
    assert np.isfinite(sim.q.numpy()[0]).all()
    sim.reset(wp.array([False, True], dtype=wp.bool, device="cpu"), stance(scene, 2, lift=0.1))
    sim.step(none, none)
    assert sim.unsolved.numpy().tolist() == [0, 1]
    assert np.isfinite(sim.q.numpy()).all()


def test_sim_cfg_chooses_the_engine():
    """CPU threads on the CPU, MuJoCo-Warp on a GPU; the CPU engine is refused on a GPU."""
    assert SimCfg().engine is BackendKind.MJBATCH
    assert SimCfg(device="cuda:0").engine is BackendKind.MJWARP
    assert SimCfg(backend=BackendKind.MJWARP).engine is BackendKind.MJWARP
    with pytest.raises(ValueError, match="mjbatch runs on the CPU, not on 'cuda:0'"):
        _ = SimCfg(device="cuda:0", backend=BackendKind.MJBATCH).engine


def test_sim_refuses_unknown_bodies_and_masses(scene):
    """A misspelt body is refused with the names there are; so is a mass that is not positive."""
    sim = Sim(scene, SimCfg(num_envs=1))
    with pytest.raises(ValueError, match="body 'trunc' stands 0 times .*trunk"):
        sim.body_mass("trunc")
    with pytest.raises(ValueError, match="mass of 'trunk' must be positive, got 0 kg"):
        sim.rescale_mass("trunk", np.array([0.0]))


def test_sim_usd_edit_doubles_the_current_dependent_torque(tmp_path: Path):
    """Doubling newton:mr:K1 in the USD file doubles what the current adds to the simulated torque, and the bound.

    Eq. 14: tau(I) - tau(0) = I1*I + K1*I/(1 + alpha*|qd|)*z, with the same z in both environments (it does not depend
    on the current). I1 is not edited, so its part is taken off first. Float32 torques of 3 N·m are exact to 2e-7 N·m.
    """
    text = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    assert text.count(K1) == 1
    path = tmp_path / "doubled.usda"
    path.write_text(text.replace(K1, "double newton:mr:K1 = 20.82663"), encoding="utf-8")
    current = 1.5
    gain = {name: _current_gain(file, current) for name, file in (("asset", None), ("doubled", path))}
    direct = MrParams().bouc_wen.I1 * current
    assert (np.abs(gain["asset"] - direct) > 0.3).all()  # [N·m] there is something to double
    np.testing.assert_allclose(gain["doubled"] - direct, 2.0 * (gain["asset"] - direct), rtol=1e-5)


def _current_gain(path: Path | None, current: float) -> np.ndarray:
    """tau_dyn(I) - tau_dyn(0) of the four calves after ten steps in a robot that is held in the air [N·m]."""
    scene = robot_scene(load_robot(path))
    robot = ActuatedSim(scene, SimCfg(num_envs=2))
    calves, sim = list(robot.actuator.mr_joints), robot.sim
    robot.current_e.assign(np.array([0.0, current], dtype=np.float32))
    qvel = np.zeros((2, scene.model.nv))
    qvel[:, scene.v_adr[calves]] = 4.0
    target = stance(scene, 2).numpy()[:, scene.q_adr]
    target[:, calves] -= 0.5  # behind the motion: the dynamic gate is open
    robot.q_des.assign(target.astype(np.float32))
    for _ in range(10):
        # both environments are put back into the same motion, so that only z and the current differ from a fresh start
        sim.reset(None, stance(scene, 2, lift=0.5), f32(qvel))
        sim.f_foot.fill_(50.0)
        robot.step()
    torque = robot.actuator.tau_dyn.numpy().astype(np.float64)
    assert robot.actuator.m_dyn.numpy().all()
    np.testing.assert_array_equal(robot.actuator.bound.numpy()[:, calves], np.abs(robot.actuator.tau_dyn.numpy()))
    return torque[1] - torque[0]
