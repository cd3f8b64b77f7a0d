"""Proof of the causes that were found, and the number that is named."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.robot_logs import robot_proof, robot_verdict
from mrwarp.robot_logs.selection import Found, Hypothesis, bounds_of, posterior, sizes
from tests.robot_logs.made_likelihood import made_likelihood, made_parameter


def test_a_cause_whose_interval_reaches_to_no_fault_is_a_suspect() -> None:
    """A gain that one of eight parts of the log asks for is not clear; one that all ask for is."""
    p = made_parameter()
    f = Found(hypothesis=Hypothesis(cause="kp", where="a", members=(0,)), z=9.0, alternatives=())

    def clear(asked: np.ndarray) -> bool:
        likelihood = made_likelihood(np.ones((64, 1, 1)), np.repeat(asked, 8)[:, None])
        size = sizes(likelihood.normal_equations(), [p], [f.hypothesis], *bounds_of([p]))
        alone = robot_proof.Sizes(size=size, lone=size, wider=1.0)
        found, rejected, *_ = robot_proof.clear_ones([f], likelihood, [p], lambda _: (alone, likelihood))
        assert len(found) + len(rejected) == 1
        return bool(found)

    assert clear(np.linspace(0.9, 1.1, 8))
    assert not clear(np.array([8.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]))


def test_of_limbs_that_do_not_move_each_other_one_cause_goes_at_a_time() -> None:
    """Two causes of each of two legs stand for each other: one of each leg goes, at once, and one of each stays."""
    parameters = [made_parameter(where=where) for where in ("a1", "a2", "b1", "b2")]
    found = [
        Found(hypothesis=Hypothesis(cause="kp", where=p.where, members=(k,)), z=9.0, alternatives=())
        for k, p in enumerate(parameters)
    ]
    likelihood, asked = made_likelihood(np.ones((40, 4, 4)), np.zeros((40, 4))), []

    def without(now: list[Found], tried: list[Found]) -> list[np.ndarray]:
        asked.append(len(tried))
        alone = [sum(f.hypothesis.where[0] == one.hypothesis.where[0] for f in now) == 1 for one in tried]
        return [np.full(40, 10.0 if x else -1.0 - k) for k, x in enumerate(alone)]

    limbs = {p.where: p.where[0] for p in parameters}
    kept, gone = robot_proof._certain(found, without, likelihood, parameters, limbs)
    assert sorted(f.hypothesis.where[0] for f in kept) == sorted(f.hypothesis.where[0] for f in gone) == ["a", "b"]
    assert asked == [4, 2]
    asked.clear()
    assert len(robot_proof._certain(found, without, likelihood, parameters)[0]) == 2
    assert asked == [4, 3, 1]


def test_windows_in_which_a_cause_could_not_act_have_no_say() -> None:
    """A coil that was asked for current in every third window: what the others lose or gain without it is chance."""
    p = made_parameter()
    f = Found(hypothesis=Hypothesis(cause="coil_dead", where="a", members=(0,)), z=9.0, alternatives=())
    acts = np.arange(60) % 3 == 0
    likelihood = made_likelihood(np.where(acts, 1.0, 1e-4)[:, None, None], np.zeros((60, 1)))

    def certain(gain: np.ndarray) -> bool:
        return bool(robot_proof._certain([f], lambda *_: [gain], likelihood, [p])[0])

    assert certain(np.where(acts, 10.0, -1.0))
    assert not certain(np.where(acts, np.where(np.arange(60) % 2, 10.0, -8.0), 5.0))


def test_many_unlikely_numbers_are_no_better_than_one_cause() -> None:
    """Twelve drives that all settle off their commands give the readings that one weight gives."""
    weight = Hypothesis(cause="kp", where="a", members=(0,))
    found = [Found(hypothesis=weight, z=9.0, alternatives=())]
    reading = np.array([1.0, *np.full(12, 1.0 / 12)])
    noise = np.random.default_rng(0).normal(size=64)
    likelihood = made_likelihood(np.tile(np.outer(reading, reading), (64, 1, 1)), (4.0 + noise)[:, None] * reading)

    def proven(spread: float) -> bool:
        drives = [made_parameter(cause="nuisance", field="shift", spread=spread) for _ in range(12)]
        return bool(robot_proof.cross_validated(found, likelihood, [made_parameter(spread=0.1), *drives])[0])

    assert proven(1.5)
    assert not proven(20.0)  # as drives are: then the log does not show it


@pytest.mark.parametrize("own", [0.3, 0.6])
def test_a_joint_s_gain_beside_that_of_all_joints_is_one_that_differs(own: float) -> None:
    """All joints' Kp is 0.3 off: one that is as much off is no cause of its own."""
    parameters = [made_parameter(where=where, spread=0.02, fault=0.3, least=0.02) for where in "abcd"]
    truth, a = np.array([own, 0.3, 0.3, 0.3]), np.tile(1e3 * np.eye(4), (64, 1, 1))
    noise = np.random.default_rng(0).normal(0.0, 3.0, (64, 4))
    likelihood = replace(made_likelihood(a, a @ truth + noise), square=np.full(64, truth @ a[0] @ truth))
    wide, one = (Hypothesis(cause="kp", where=w, members=m) for w, m in (("robot", (0, 1, 2, 3)), ("a", (0,))))
    found, _ = robot_proof.cross_validated(
        [Found(hypothesis=d, z=9.0, alternatives=()) for d in (wide, one)], likelihood, parameters
    )
    assert [f.hypothesis for f in found] == [wide, one][: 1 + (own != 0.3)]


def test_what_all_joints_have_in_common_is_told_without_the_one_that_differs() -> None:
    """Kp is 1.3 times the description's at all joints, but 1.6 times at the first."""
    parameters = [made_parameter(where=where, nominal=1.0) for where in "abcd"]
    truth, a = np.array([0.6, 0.31, 0.30, 0.29]), np.tile(1e3 * np.eye(4), (64, 1, 1))
    likelihood, free = made_likelihood(a, a @ truth), []
    for where, members in (("robot", (0, 1, 2, 3)), ("a", (0,))):
        free.append(Hypothesis(cause="kp", where=where, members=members))
    found = [Found(hypothesis=d, z=9.0, alternatives=()) for d in free]
    about = robot_proof.Sizes(size=truth, lone=truth, wider=1.0)
    named = [
        robot_verdict.named_cause(f, found, about, likelihood, parameters, posterior(likelihood, parameters, free))
        for f in found
    ]
    assert [c.parameters["factor"].value for c in named] == pytest.approx([1.3, 1.6])
