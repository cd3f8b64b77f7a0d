"""NaN guard: every quantity that can go wrong is named, the environment starts over, the others do not notice."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from mrwarp.env import nan_guard
from mrwarp.env.backend import BackendKind, MjBatchBackend
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv

NAN, INF = float("nan"), float("inf")
BAD = 1
"""The environment that goes wrong."""

OTHERS = torch.tensor([True, False, True, True])
Inject = Callable[[WalkEnv, torch.Tensor, float], None]


@pytest.fixture(autouse=True)
def log(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo writes its warnings to MUJOCO_LOG.TXT in the working folder."""
    monkeypatch.chdir(tmp_path)


def make_env(backend: BackendKind = BackendKind.MJBATCH, **changes: Any) -> WalkEnv:
    """Four robots without draws in their steps."""
    cfg = TaskCfg(num_envs=4, seed=9, threads=1, backend=backend)
    return WalkEnv(replace(cfg, noise=None, randomize=None, **changes))


def action(step: int = 0) -> torch.Tensor:
    """Small random actions."""
    return torch.rand(4, 12, generator=torch.Generator().manual_seed(step)) - 0.5


def field(name: str, column: int) -> Inject:
    """Write into a field of the engine."""
    return lambda env, _, value: env.view(env.sim.backend.field(name))[BAD].__setitem__(column, value)


def device(name: str, column: int) -> Inject:
    """Write into an array of the actuator."""
    return lambda env, _, value: env.view(getattr(env.actuator, name))[BAD].__setitem__(column, value)


def gain(env: WalkEnv, _: torch.Tensor, value: float) -> None:
    """Write into a motor gain, which only the torque sees."""
    env.view(env.actuator.kp)[BAD, 3] = value


def act(env: WalkEnv, actions: torch.Tensor, value: float) -> None:
    """Write into the policy's action."""
    actions[BAD, 7] = value


def foot(env: WalkEnv, _: torch.Tensor, value: float) -> None:
    """Write into a foot force."""
    env.f_foot[BAD, 2] = value


INJECTED: dict[str, Inject] = {
    "position of FL_hip": field("qpos", 7),
    "position of RR_calf": field("qpos", 18),
    "position of trunk z": field("qpos", 2),
    "orientation of trunk x": field("qpos", 4),
    "velocity of trunk y": field("qvel", 1),
    "angular velocity of trunk z": field("qvel", 5),
    "velocity of RL_thigh": field("qvel", 13),
    "hysteresis state of FL_calf": device("z", 0),
    "action of": act,
    "foot force of": foot,
    "torque of": gain,
}
"""The broken number, and its name by the guard (the order of the robot's legs is the asset's own)."""


@pytest.fixture(scope="module")
def twins() -> tuple[WalkEnv, WalkEnv]:
    """Two equal batches, one to break."""
    return make_env(), make_env()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, NAN) for name in INJECTED),
        ("position of RR_calf", INF),
        ("velocity of trunk y", -INF),
        ("action of", INF),
    ],
)
def test_every_quantity_is_named_and_only_its_environment_starts_over(
    twins: tuple[WalkEnv, WalkEnv], name: str, value: float
) -> None:
    """NaN or infinity in one place of one environment: named, counted, reset with reward 0; the others go on."""
    env, twin = twins
    env.restart()
    twin.restart()
    before = env.nan_guard.divergences.clone()
    for step in range(3):
        env.step(action(step))
        twin.step(action(step))
    actions, kp = action(3), env.actuator.kp.numpy().copy()
    INJECTED[name](env, actions, value)
    obs, reward, done, extras = env.step(actions)
    env.actuator.kp.assign(kp)
    expected, expected_reward, _, _ = twin.step(action(3))
    assert env.diverged.tolist() == env.fallen.tolist() == done.tolist() == [False, True, False, False]
    assert not bool(extras["time_outs"].any()) and float(reward[BAD]) == 0.0
    assert torch.equal(reward[OTHERS], expected_reward[OTHERS])
    assert torch.equal(obs["actor"][OTHERS, 9:], expected["actor"][OTHERS, 9:])
    (found,) = env.nan_guard.take()
    joints = dict(zip(("action of", "torque of"), (env.sim.scene.joints[7], env.sim.scene.joints[3]), strict=True))
    assert not found.finite and found.env == BAD
    where = str(found.columns[found.column])
    assert where.startswith(name)
    if name in joints:
        assert where == f"{name} {joints[name]}"
    assert len(found.states) == 4 * 3 + 1 and found.time == pytest.approx(12 * 0.005)
    assert np.isfinite(found.states[:-1]).all()
    for step in range(4, 8):
        obs, reward, done, _ = env.step(action(step))
        assert all(bool(torch.isfinite(v).all()) for v in (obs["actor"], obs["critic"], reward))
        assert not bool(env.diverged.any()) and not bool(done.any())
    assert env.nan_guard.take() == [] and (env.nan_guard.divergences - before).tolist() == [0, 1, 0, 0]


def test_a_reward_that_is_no_number_is_named() -> None:
    """A term that is NaN in one environment, whose state is sound: the last thing that is checked."""
    env = make_env()
    env.step(action())
    env.command[1, 0] = NAN
    _, reward, done, _ = env.step(action(1))
    assert done.tolist() == [False, True, False, False] and bool(torch.isfinite(reward).all())
    (found,) = env.nan_guard.take()
    assert str(found.columns[found.column]) == "reward"
    assert not bool(env.step(action(2))[2].any())


@pytest.mark.parametrize(
    ("name", "column", "value", "said"),
    [
        ("qvel", 9, 1e4, "velocity of FR_hip"),
        ("qvel", 2, -50.0, "velocity of trunk z"),
        ("qvel", 4, 300.0, "angular velocity of trunk y"),
        ("qpos", 2, 50.0, "position of trunk z"),
        ("qpos", 8, 20.0, "position of"),
    ],
)
def test_a_state_beyond_what_a_robot_can_do_is_a_blow_up(name: str, column: int, value: float, said: str) -> None:
    """Numbers, but absurd ones: the episode ends, with the bound that was passed."""
    env = make_env()
    env.step(action())
    env.view(env.sim.backend.field(name))[BAD, column] = value
    _, reward, done, _ = env.step(action(1))
    assert done.tolist() == [False, True, False, False] and float(reward[BAD]) == 0.0
    (found,) = env.nan_guard.take()
    assert found.finite and found.value == pytest.approx(value)
    assert said in str(found) and "the physics blew up" in str(found)


def test_strong_random_actions_break_nothing() -> None:
    """Three times the action scale for 2 s, with falls: bounds and margins leave room for what robots really do."""
    env = make_env()
    falls = 0
    for step in range(100):
        falls += int(env.step(6.0 * action(step))[2].sum())
    assert falls > 0 and env.nan_guard.divergences.tolist() == [0] * 4
    assert env.nan_guard.take() == []
    assert env.nan_guard.warnings() == nan_guard.Warnings(beyond_limit=0, joint="", overflow=0)


def test_a_joint_beyond_its_limit_is_a_warning_and_goes_on() -> None:
    """0.4 rad past the stop of one calf: named, counted once, no reset."""
    env = make_env()
    env.step(action())
    joint = 5
    adr = int(env.sim.scene.q_adr[joint])
    model = env.sim.scene.model
    high = model.jnt_range[np.flatnonzero(model.jnt_qposadr == adr)[0]][1]
    env.view(env.sim.backend.field("qpos"))[BAD, adr] = high + 0.4
    env.step(action(1))
    assert not bool(env.diverged.any()) and env.nan_guard.take() == []
    warned = env.nan_guard.warnings()
    assert (warned.beyond_limit, warned.joint, warned.overflow) == (1, env.sim.scene.joints[joint], 0)


def test_the_last_hundred_states_are_kept_until_they_are_read() -> None:
    """100 torque steps, oldest first, equally spaced; a later break of the same environment does not replace them."""
    env = make_env()
    for step in range(40):
        env.step(0.1 * action(step))
    corrupt = INJECTED["velocity of RL_thigh"]
    corrupt(env, action(), NAN)
    env.step(action())
    for step in range(30):
        env.step(action(step))
    corrupt(env, action(), NAN)
    env.step(action())
    assert env.nan_guard.divergences.tolist() == [0, 2, 0, 0]
    (found,) = env.nan_guard.take()
    assert found.states.shape == (nan_guard.KEPT, len(found.columns))
    np.testing.assert_allclose(found.states[:, 0], 0.005 * np.arange(61, 161), atol=1e-6)
    assert np.isfinite(found.states[:-1]).all() and np.isnan(found.value)
    # read out: the next break is a new one, with a history of its own
    env.step(action())
    corrupt(env, action(), NAN)
    env.step(action())
    (second,) = env.nan_guard.take()
    assert len(second.states) == 5


def test_a_guarded_run_has_the_same_bits_and_the_history_is_the_run() -> None:
    """The kept rows are the states and torques of the run itself."""
    env = make_env()
    seen: list[torch.Tensor] = []
    env.substep_hooks.append(lambda: seen.append(env.view(env.actuator.tau).clone()))
    for step in range(5):
        env.step(action(step))
    INJECTED["velocity of RL_thigh"](env, action(), NAN)
    env.step(action())
    (found,) = env.nan_guard.take()
    columns = [i for i, c in enumerate(found.columns) if c.quantity == "torque"]
    np.testing.assert_array_equal(found.states[:20, columns], torch.stack(seen[:20])[:, BAD].numpy())


def test_the_reference_engine_is_guarded_too() -> None:
    """MuJoCo-Warp, stepped as one captured graph: same names, same reset."""
    env = make_env(BackendKind.MJWARP)
    for step in range(2):
        env.step(action(step))
    field("qvel", 13)(env, action(), NAN)
    _, _, done, _ = env.step(action())
    assert done.tolist() == [False, True, False, False]
    (found,) = env.nan_guard.take()
    assert "velocity of RL_thigh" in str(found)
    assert not bool(env.step(action())[2].any())


def test_dropped_contacts_are_counted_on_the_cpu_engine() -> None:
    """Too little memory for the contacts of ten boxes: the counters that the guard reads rise."""
    boxes = "".join(
        f"<body pos='{0.3 * i} 0 .09'><freejoint/><geom type='box' size='.1 .1 .1'/></body>" for i in range(10)
    )
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><size memory='30K'/><worldbody><geom type='plane' size='5 5 1'/>{boxes}</worldbody></mujoco>"
    )
    backend = MjBatchBackend(model, 2, threads=1)
    assert not backend.overflow.numpy().any()
    backend.step()
    assert backend.overflow.shape == (2, 2) and (backend.overflow.numpy().sum(1) == 1).all()


@pytest.mark.parametrize("backend", list(BackendKind))
def test_an_overflow_is_counted_by_environment(backend: BackendKind) -> None:
    """The engine's counter or flag of one environment rises: a warning, no reset."""
    env = make_env(backend)
    env.step(action())
    counter = env.sim.backend.overflow
    env.view(counter)[BAD, 0] = 1 if backend is BackendKind.MJBATCH else int(counter.dtype(1))
    env.step(action(1))
    assert env.nan_guard.warnings().overflow == 1 and not bool(env.diverged.any())
