"""The mirror image of a robot moves as the mirror says; what has none is refused with the reason."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from mrwarp.enums import CurrentCommand
from mrwarp.env.cfg import TaskCfg, make_play_cfg
from mrwarp.env.gait import legs_of
from mrwarp.env.vec_env import WalkEnv
from mrwarp.rl.mirror import Mirror, NoMirrorError, SignedPermutation, _joints, _twins, mirror_of
from tests.env.env_bench import random_actions

STEPS = 10
"""Policy steps that are compared, from the stance on: 0.2 s, in which all feet stand and the trunk tilts."""

BOUND = 2e-4
"""Largest difference of an observation. The solver stops at a relative improvement of 1e-8 of its cost, which leaves
forces equal to its root, 1e-4; summed over left and right in another order they differ by that."""


def image(values: torch.Tensor, of: SignedPermutation) -> torch.Tensor:
    """The mirror image of rows (E, n)."""
    return values[:, torch.from_numpy(of.index)] * torch.from_numpy(of.sign).to(values.dtype)


def even_masses(spec: mujoco.MjSpec) -> None:
    """Put the trunk's and the calves' masses into their planes; the real trunk's lies 2 mm to the left."""
    for body in spec.bodies:
        if body.name.endswith(("trunk", "calf")):
            body.ipos = [body.ipos[0], 0.0, body.ipos[2]]
            body.iquat, body.inertia = [1.0, 0.0, 0.0, 0.0], sorted(body.inertia, reverse=True)


def mirrored_pair(env: WalkEnv, mirror: Mirror) -> None:
    """Give the second environment the mirror image of the first one's pose, both at rest, half a stride shifted."""
    state = env.state()
    for name, value in state.items():
        if name.startswith("sim/q") or name in ("sim/root_vel", "sim/root_ang", "last_qd"):
            value.zero_()
    for name, signs in (("sim/root_pos", (1, -1, 1)), ("sim/root_quat", (1, -1, 1, -1))):
        state[name][1] = state[name][0] * torch.tensor(signs)
    state["sim/q"] = env.q.clone()
    state["sim/q"][1:] = image(state["sim/q"][:1], mirror.action)
    state["sim/qpos"][:, :3], state["sim/qpos"][:, 3:7] = state["sim/root_pos"], state["sim/root_quat"]
    state["sim/qpos"][:, env.sim.scene.q_adr] = state["sim/q"].double()
    state["phase"][1] = (state["phase"][0] + 0.5) % 1.0
    for name in ("sim/f_foot", "command", "action", "last_action"):
        state[name].zero_()
    env.load_state(state)


@pytest.mark.parametrize("robot", ["mr_go", "go1"])
def test_the_mirrored_robot_makes_the_mirrored_motion(robot: str) -> None:
    """Mirrored actions from the stance give mirrored observations of actor and critic, by the physics itself."""
    cfg = TaskCfg(num_envs=2, robot=robot, actuator="none" if robot == "go1" else "bouc_wen")
    env = WalkEnv(make_play_cfg(cfg), edit=even_masses)
    mirror = mirror_of(env)
    env.current_e.fill_(1.0)
    mirrored_pair(env, mirror)
    worst = 0.0
    for action in random_actions(STEPS, 1, scale=0.8, seed=3):
        both = torch.cat([action, image(action, mirror.action)])
        observations = env.step(both)[0]
        for group in ("actor", "critic"):
            seen = observations[group]
            difference = seen[1:] - image(seen[:1], getattr(mirror, group))
            worst = max(worst, float(difference.abs().max()))
    moved = float((env.q[0] - env.default_q).abs().max())
    assert moved > 0.05 and worst < BOUND, (moved, worst)


def test_the_mirror_is_its_own_inverse_and_covers_commanded_coils() -> None:
    """Of every robot's observation and action; a policy that commands coils mirrors their currents too."""
    env = WalkEnv(replace(TaskCfg(num_envs=1), current_by=CurrentCommand.LEARNED))
    mirror = mirror_of(env)
    assert len(mirror.action.index) == 16 and list(mirror.action.index[12:]) == [13, 12, 15, 14]
    for part in (mirror.actor, mirror.critic, mirror.action):
        values = torch.arange(1.0, len(part.index) + 1.0)[None]
        assert torch.equal(image(image(values, part), part), values)


def test_a_robot_without_a_mirror_image_is_refused() -> None:
    """A leg without a twin, and a joint whose axis or neutral angle is not the mirrored one."""
    env = WalkEnv(TaskCfg(num_envs=1))
    legs = legs_of(env.sim.scene)
    feet, axes, columns = (np.array(values.numpy()) for values in (legs.feet, legs.axes, legs.columns))
    names, neutral = env.layout.joints, np.array(env.layout.default_q)
    twins = _twins(feet, env.layout.leg_names)
    assert list(twins) == [1, 0, 3, 2]
    shifted = feet.copy()
    shifted[2, 0] += 0.02
    with pytest.raises(NoMirrorError, match="leg RL: no leg stands at its mirror image"):
        _twins(shifted, env.layout.leg_names)
    tilted = axes.copy()
    tilted[0, 1] = [0.1, 0.99498744, 0.0]
    with pytest.raises(NoMirrorError, match="joint FL_thigh: its axis is no mirror image of that of FR_thigh"):
        _joints(columns, tilted, twins, neutral, names)
    bent = neutral.copy()
    bent[1] += 0.1
    with pytest.raises(NoMirrorError, match="joint F[LR]_thigh: its neutral angle is not that of its twin"):
        _joints(columns, axes, twins, bent, names)
    longer = np.where(columns == 5, -1, columns)
    with pytest.raises(NoMirrorError, match="differ in joints"):
        _joints(longer, axes, twins, neutral, names)
