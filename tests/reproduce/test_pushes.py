"""Readings of the push and figures of the drop: closed forms on made-up numbers."""

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from mrwarp.params import BoucWenParams, HoldParams
from mrwarp.reproduce import impacts, paper_checks, training_results
from mrwarp.reproduce.settings import PUSHED_GAINS, Settings
from mrwarp.trials.impact import ImpactTrace


def test_yield_and_required_torques_slide_at_theirs() -> None:
    """At the bound of z the sliding torque K1*I*z is eq. 18's, or what the paper's rows require, at any speed."""
    law, bound = HoldParams(), BoucWenParams().z_bound
    for torque in ("yield", "required"):
        reading = replace(impacts.GRID[0], torque=torque)
        for variant in impacts.config(reading, Settings()).variants[impacts.OPEN + 1 :]:
            wanted = law.T_max * variant.current**law.n / (law.K**law.n + variant.current**law.n)
            if torque == "required":
                wanted = np.mean(paper_checks.required_torque()[variant.current])
            assert variant.params["K1"] * variant.current * bound == pytest.approx(wanted)
            assert variant.params["alpha"] == 0.0


def test_open_gates_hold_nothing_at_zero_current() -> None:
    """That setting has a current that holds less than a millionth of what the loaded calf needs; SAL off has none."""
    variants = impacts.config(impacts.GRID[0], Settings()).variants
    law = HoldParams()
    assert variants[impacts.OFF].current == 0.0
    assert 0.0 < law.T_max * (variants[impacts.OPEN].current / law.K) ** law.n < 1e-5


def test_grid_crosses_every_choice_once() -> None:
    """All gains, stances and modes of 0 A; variations differ from the adopted reading in one choice."""
    assert len({reading.name for reading in impacts.GRID}) == len(impacts.GRID)
    assert len(impacts.GRID) == len(impacts.KP) * len(impacts.KD) * len(impacts.STANCES) * 2
    first, *others = impacts.variations(impacts.GRID[0])
    assert first == impacts.GRID[0]
    for other in others:
        differing = [f.name for f in fields(other) if getattr(other, f.name) != getattr(first, f.name)]
        assert differing and (len(differing) == 1 or set(differing) == {"holding", "soft_at_zero"})


def test_policies_that_know_the_push_are_tried_where_they_were_trained() -> None:
    """On the gains of their training, with either torque; on others they are no variation."""
    adopted = replace(impacts.GRID[0], kp=PUSHED_GAINS[0], kd=PUSHED_GAINS[1])
    knowing = [reading for reading in impacts.variations(adopted) if reading.pushed]
    assert [reading.torque for reading in knowing] == ["eq. 14", "required"]
    assert knowing[0].name == f"{adopted.name}, policies trained with it"
    assert not any(reading.pushed for reading in impacts.variations(impacts.GRID[0]))


def test_pushes_of_a_training_last_as_long_as_that_of_the_reading() -> None:
    """20 steps of 20 ms each at 100 N downward, one every few seconds, of each robot at its own times."""
    forces: list[np.ndarray] = []
    sim = SimpleNamespace(push=lambda body, force: forces.append(force))
    step, layout = SimpleNamespace(step_dt=0.02), SimpleNamespace(trunk="t")
    env: Any = SimpleNamespace(num_envs=8, cfg=step, sim=sim, layout=layout)
    pushes = training_results.Pushes(env, seed=0)
    for _ in range(2000):
        pushes()
    pushed = np.stack(forces)[..., 2] < 0.0
    assert set(np.unique(np.stack(forces))) == {-100.0, 0.0}
    starts = np.flatnonzero(~pushed[:-1, 0] & pushed[1:, 0])
    assert all(pushed[k + 1 : k + 21, 0].all() and not pushed[k + 21, 0] for k in starts[:-1])
    assert 2.0 < 40.0 / len(starts) < 8.0
    assert not np.array_equal(pushed[:, 0], pushed[:, 1])


def test_rule_takes_the_nearest_row_without_falls() -> None:
    """A nearer row in which robots fall comes after one in which none does."""
    shared = {"reading": impacts.GRID[0], "duration": 0.2, "lift": 0.0, "onset": 0.33, "drop": 0.15, "speed": 0.7}
    cells = [
        impacts.GridCell(score=score, fell=fell, **shared) for score, fell in ((0.1, 0.0), (0.0, 0.06), (0.2, 0.0))
    ]
    assert [cell.score for cell in sorted(cells, key=impacts.rank)] == [0.1, 0.2, 0.0]


def test_guided_policy_opens_the_knees_and_stops_answering() -> None:
    """Half of the knee's angle goes to the thigh; after two answers the last one stands."""
    calls = iter(range(5))
    policy = impacts.Guided(lambda obs: torch.full((1, 12), float(next(calls))), lift=0.1, scale=0.25, answers=2)
    first, second, third = (policy(None)[0] for _ in range(3))
    assert first[:3].tolist() == pytest.approx([0.0, -0.2, 0.4])
    assert second[0] == 1.0 and third.tolist() == second.tolist()


def test_undamped_speed_is_that_of_an_integrated_spring() -> None:
    """Stepped finely, the spring that 100 N press down by 0.15 m falls at that speed at most."""
    k = 2.0 * 100.0 / 0.15
    x, v, peak, lowest, dt = 0.0, 0.0, 0.0, 0.0, 1e-5
    for _ in range(60_000):
        v += dt * (100.0 - k * x) / 12.6
        x += dt * v
        peak, lowest = max(peak, v), max(lowest, x)
    assert lowest == pytest.approx(0.15, rel=1e-3)
    assert paper_checks.undamped_speed(0.15) == pytest.approx(peak, rel=1e-3)


def test_drop_is_measured_from_the_contact_on() -> None:
    """A torque that is 2 before the contact and 6 N·m after it has the mean 6; the trunk decelerates by 3 m/s^2."""
    t = np.arange(1, 81) * 0.005
    contact = np.array([[0.1, 0.2]])
    after = t > contact[..., None]
    legs = np.where(after, 6.0, 2.0)[..., None] * np.ones(4)
    velocity = np.where(after, -3.0 * (t - contact[..., None]), 0.0)
    trace = ImpactTrace(
        t=t, height=0.3 + np.zeros((1, 2, 80)), velocity=velocity, tau_motor=legs, tau_mr=legs, current=legs,
        m_dyn=legs, m_hold=legs, f_foot=legs, q=legs, qd=legs, qpos=np.zeros((1, 80, 19)), ledger=np.zeros((1, 2, 7)),
        fell=np.zeros((1, 2), dtype=bool), contact=contact,
    )  # fmt: skip
    found = impacts.measured(trace)
    np.testing.assert_allclose(found["FR"], 6.0)
    np.testing.assert_allclose(found["acceleration"], 3.0, rtol=1e-6)
    np.testing.assert_allclose(found["peak_down_velocity"], -3.0 * (t[-1] - contact))
