"""Each reward term against an independent NumPy formula on hand-made states, its best value, and the total."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.env import rewards
from mrwarp.env.config.mdp_cfg import RewardCfg
from mrwarp.env.gait import Legs
from mrwarp.usd.robot import DEFAULT_Q

NUM_ENVS = 7


def make_state(seed: int) -> Any:
    """The arrays that the terms read and write: a random walking robot."""
    rng = np.random.default_rng(seed)

    def random(*shape: int, scale: float = 1.0) -> torch.Tensor:
        return torch.tensor(scale * rng.normal(size=shape), dtype=torch.float32)

    gravity = torch.tensor([0.0, 0.0, -1.0]) + random(NUM_ENVS, 3, scale=0.1)
    position = torch.tensor([0.0, 0.0, 0.32]) + random(NUM_ENVS, 3, scale=0.02)
    return SimpleNamespace(
        cfg=RewardCfg(),
        terms=torch.zeros(NUM_ENVS, len(rewards.TERMS)),
        total=torch.zeros(NUM_ENVS),
        default_q=torch.tensor(DEFAULT_Q),
        gravity=gravity / gravity.norm(dim=1, keepdim=True),
        root_pos=position,
        height=position[:, 2],
        foot_ground=torch.zeros(NUM_ENVS, 4),
        root_vel=random(NUM_ENVS, 3, scale=0.3),
        root_ang=random(NUM_ENVS, 3, scale=0.3),
        body_velocity=random(NUM_ENVS, 3, scale=0.3),
        command=random(NUM_ENVS, 3, scale=0.3),
        q=torch.tensor(DEFAULT_Q) + random(NUM_ENVS, 12, scale=0.2),
        qd=random(NUM_ENVS, 12, scale=3.0),
        last_qd=random(NUM_ENVS, 12, scale=3.0),
        action=random(NUM_ENVS, 12),
        last_action=random(NUM_ENVS, 12),
        effort=random(NUM_ENVS, scale=50.0).abs(),
        power=random(NUM_ENVS, scale=100.0).abs(),
        leg_phase=torch.tensor(rng.uniform(size=(NUM_ENVS, 4)), dtype=torch.float32),
        clock_match=torch.tensor(rng.uniform(size=(NUM_ENVS, 4)) < 0.5),
    )


def term(name: str, state: Any) -> torch.Tensor:
    """One term of a state, shape (E,)."""
    rewards.reward(state, state.cfg, 0.02, go1())()
    return state.terms[:, list(rewards.TERMS).index(name)].clone()


def total(state: Any) -> torch.Tensor:
    """The reward of a state, shape (E,)."""
    rewards.reward(state, state.cfg, 0.02, go1())()
    return state.total.clone()


def go1() -> Legs:
    """The Go1's legs."""
    legs = Legs()
    legs.planar = 1
    legs.hip_x, legs.hip_y, legs.offset, legs.thigh, legs.calf = 0.1881, 0.04675, 0.08, 0.213, 0.213
    legs.radii = wp.full(4, 0.023, dtype=float, device="cpu")
    legs.hips = wp.array([1.0, 0.0, 0.0] * 4, dtype=float, device="cpu")
    return legs


def rotate(axis: str, angle: float) -> np.ndarray:
    """Rotation matrix about x or y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if axis == "x" else [[c, 0, s], [0, 1, 0], [-s, 0, c]])


def foot_heights(s: Any) -> np.ndarray:
    """Height of the feet [m] by a chain of rotations, Go1 lengths, shape (E, 4)."""
    found = np.empty((NUM_ENVS, 4))
    for env in range(NUM_ENVS):
        up = -s.gravity[env].double().numpy()
        for leg, (front, side) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)]):
            hip, thigh, calf = s.q[env, 3 * leg : 3 * leg + 3].double().numpy()
            below = np.array([0.0, 0.0, -0.213])
            knee_to_foot = rotate("y", thigh) @ (below + rotate("y", calf) @ below)
            foot = np.array([front * 0.1881, side * 0.04675, 0.0])
            foot = foot + rotate("x", hip) @ (np.array([0.0, side * 0.08, 0.0]) + knee_to_foot)
            found[env, leg] = float(s.root_pos[env, 2]) + up @ foot - 0.023
    return found


def swing_height(s: Any) -> np.ndarray:
    """Squared clearance error over the feet in swing."""
    phase = s.leg_phase.double().numpy()
    wanted = 0.06 * np.sin(np.pi * (2 * phase - 1))
    return np.where(phase >= 0.5, (foot_heights(s) - wanted) ** 2, 0.0).sum(1)


def tracking(error: torch.Tensor, width: float) -> np.ndarray:
    """exp(-|error|^2/width)."""
    return np.exp(-(error.double().numpy() ** 2).sum(1) / width)


def squares(values: torch.Tensor) -> np.ndarray:
    """Sum of squares over the columns."""
    return (values.double().numpy() ** 2).sum(1)


FORMULAS: dict[str, Callable[[Any], np.ndarray]] = {
    "track_velocity": lambda s: tracking(s.body_velocity[:, :2] - s.command[:, :2], s.cfg.velocity_width),
    "track_yaw": lambda s: tracking(s.root_ang[:, 2:] - s.command[:, 2:], s.cfg.yaw_width),
    "contact_clock": lambda s: s.clock_match.numpy().sum(1) / 4 - 0.5,
    "swing_height": swing_height,
    "height": lambda s: squares(s.root_pos[:, 2:] - s.cfg.target_height),
    "tilt": lambda s: squares(s.gravity[:, :2]),
    "bounce": lambda s: squares(s.root_vel[:, 2:]),
    "roll_pitch_rate": lambda s: squares(s.root_ang[:, :2]),
    "posture": lambda s: squares(s.q - torch.tensor(DEFAULT_Q)),
    "hip_posture": lambda s: squares(s.q[:, [0, 3, 6, 9]]),
    "effort": lambda s: s.effort.numpy(),
    "power": lambda s: s.power.numpy(),
    "action_rate": lambda s: squares(s.action - s.last_action),
    "joint_acceleration": lambda s: squares((s.qd - s.last_qd) / 0.02),
}


def make_best(s: Any) -> None:
    """Edit a state so that every term has its best value."""
    s.body_velocity[:, :2], s.root_ang[:, 2] = s.command[:, :2], s.command[:, 2]
    s.clock_match[:] = True
    s.root_pos[:, 2] = s.cfg.target_height
    s.gravity[:] = torch.tensor([0.0, 0.0, -1.0])
    s.root_vel[:, 2], s.root_ang[:, :2], s.effort[:], s.power[:] = 0.0, 0.0, 0.0, 0.0
    s.q[:] = s.default_q
    s.action[:], s.qd[:] = s.last_action, s.last_qd
    s.leg_phase[:] = 0.2  # all in stance: no clearance wanted


def weights(cfg: RewardCfg) -> dict[str, float]:
    """The weights by name."""
    return {name: rewards.weight(cfg, name) for name in rewards.TERMS}


def test_every_term_says_what_it_is_and_has_a_formula_here() -> None:
    """Listed terms and this file's formulas are the same."""
    assert list(rewards.TERMS) == list(rewards.flat(RewardCfg()))[: len(rewards.TERMS)] and set(rewards.TERMS) == set(
        FORMULAS
    )
    assert all(term.says for term in rewards.TERMS.values())
    cfg = RewardCfg().weighing(tilt=-100.0).weighing(height=-1.0)
    assert tuple(rewards.weight(cfg, name) for name in ("tilt", "height", "bounce")) == (-100.0, -1.0, -1.0)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", FORMULAS)
def test_term_equals_its_formula(name: str, seed: int) -> None:
    """One value per environment, equal to the NumPy formula up to float32 (relative 1e-5, sums of 12 squares)."""
    state = make_state(seed)
    found = term(name, state)
    assert found.shape == (NUM_ENVS,) and found.dtype == torch.float32
    # foot clearances are differences of 0.3 m lengths: 1e-6 m of rounding times 2*0.1 m
    np.testing.assert_allclose(found.numpy(), FORMULAS[name](state), rtol=1e-5, atol=4e-7)


@pytest.mark.parametrize("name", FORMULAS)
def test_term_is_best_where_it_should_be(name: str) -> None:
    """Tracking 1 and clock 0.5 at no error, all penalties 0; no random state does better."""
    state = make_state(2)
    worse = term(name, state)
    make_best(state)
    best = term(name, state)
    ideal = {"track_velocity": 1.0, "track_yaw": 1.0, "contact_clock": 0.5}.get(name, 0.0)
    assert torch.equal(best, torch.full((NUM_ENVS,), ideal))
    sign = np.sign(weights(state.cfg)[name])
    assert bool((sign * worse <= sign * ideal).all()) and bool((worse != ideal).any())


def test_weights_pull_towards_the_best_values() -> None:
    """Rewards are weighted positively, penalties (squares, power) negatively or, power by default, not at all."""
    signs = {name: value > 0 for name, value in weights(RewardCfg()).items()}
    assert {name for name, positive in signs.items() if positive} == {"track_velocity", "track_yaw", "contact_clock"}


def test_total_is_the_weighted_sum_over_one_policy_step() -> None:
    """sum(weight*term)*20 ms; a weight of its own for every term, so that none can be swapped."""
    state = make_state(5)
    rng = np.random.default_rng(6)
    own = {name: float(rng.normal()) for name in weights(RewardCfg())}
    state.cfg = state.cfg.weighing(**own)
    expected = 0.02 * sum(own[name] * formula(state) for name, formula in FORMULAS.items())
    scale = 0.02 * sum(np.abs(own[name] * formula(state)) for name, formula in FORMULAS.items())
    error = np.abs(total(state).double().numpy() - expected)
    assert (error <= 1e-5 * scale).all()
