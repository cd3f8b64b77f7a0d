"""Which numbers of a robot are causes, by derivatives alone."""

import numpy as np
import pytest

from mrwarp.robot_logs.selection import (
    Hypothesis,
    bounds_of,
    bounds_without,
    half_width,
    posterior,
    prior_of,
    select,
    sizes,
)
from tests.robot_logs.made_likelihood import made_likelihood, made_parameter


def test_a_known_strength_of_all_motors_is_the_torque_scale() -> None:
    """Where it is free the session's own scale is held, for one number would be split in two."""
    cause = {"nuisance": "scale", "motor_strength": "strength"}
    parameters = [made_parameter(cause=name, field=field, spread=0.1) for name, field in cause.items()]
    strength = Hypothesis(cause="motor_strength", where="robot", members=(1,))
    assert prior_of(parameters, [])[0, 0] == pytest.approx(100.0)
    assert prior_of(parameters, [strength])[0, 0] > 1e7


def test_more_drag_than_described_is_dry_friction_or_it() -> None:
    """Nothing in a log distinguishes a device's drag from a joint's dry friction."""
    dry = made_parameter(cause="coulomb_friction", spread=0.5, fault=0.5, lowest=0.0)
    drag = made_parameter(cause="device_drag", spread=0.05, step=-0.05, fault=0.5, highest=0.0)
    (found,) = select(made_likelihood(np.full((64, 2, 2), 4e3), np.full((64, 2), 4e3 * 0.8)), [dry, drag])
    assert (found.hypothesis.cause, [d.cause for d in found.alternatives]) == ("coulomb_friction", ["device_drag"])


def test_intervals_cover_where_neighbouring_windows_err_alike() -> None:
    """Eight windows at a time share one error: 95 % intervals hold the truth in 90 to 98 of a hundred logs."""
    p = made_parameter()
    d, rng, held = Hypothesis(cause="kp", where="a", members=(0,)), np.random.default_rng(0), []
    for _ in range(400):
        error = np.repeat(rng.normal(size=8), 8) + 0.3 * rng.normal(size=64)
        likelihood = made_likelihood(np.ones((64, 1, 1)), error[:, None])
        now = posterior(likelihood, [p], [])
        size = float(sizes(likelihood.normal_equations(), [p], [d], *bounds_of([p]))[0])
        held.append(abs(size) < half_width(d.members, size, now, [p], lone=size))
    assert 0.90 <= np.mean(held) <= 0.98


def test_a_weight_on_the_trunk_is_no_heavy_hip() -> None:
    """A hip's mass is nearly what a weight on the trunk is, by one number in place of two; a heavy hip stays one."""
    names = (("trunk_mass", "mass"), ("trunk_com", "x"), ("link_mass", "mass"))
    parameters = [made_parameter(cause=c, name=n, spread=0.02, fault=1.0) for c, n in names]
    readings = np.array([[1.0, 0.0, 0.8], [0.0, 1.0, 0.8]])

    def named(truth: tuple[float, ...]) -> list[tuple[str, str]]:
        a = np.tile(readings.T @ readings * 100.0, (64, 1, 1))
        noise = 10.0 * np.random.default_rng(0).normal(size=(64, 2)) @ readings
        found = select(made_likelihood(a, a[0] @ truth + noise), parameters)
        return [(f.hypothesis.cause, parameters[f.hypothesis.members[0]].name) for f in found]

    assert named((1.0, 0.5, 0.0)) == [("trunk_mass", "mass"), ("trunk_com", "x")]
    assert named((0.0, 0.0, 1.0)) == [("link_mass", "mass")]


@pytest.mark.parametrize("confirmed", [[], [1]])
def test_a_drive_s_cause_is_the_one_that_the_replay_needed(confirmed: list[int]) -> None:
    """Derivatives ask for Kp; the fit by the replay was as good with the motor's strength alone, and it stands."""
    names = ("kp", "motor_strength")
    parameters = [made_parameter(cause=name, spread=0.01, fault=1.0, least=0.01) for name in names]
    both = [Hypothesis(cause=name, where="a", members=(k,)) for k, name in enumerate(names)]
    a = np.tile(1e5 * np.array([[1.0, 0.999], [0.999, 1.0]]), (16, 1, 1))
    found = select(made_likelihood(a, a @ np.array([0.2, 0.0])), parameters, [both[k] for k in confirmed])
    assert [f.hypothesis for f in found] == [both[k] for k in confirmed or [0]]


def test_a_delay_that_is_a_fault_is_no_part_of_the_error_before() -> None:
    """Every session has one, within a row: the error without the cause is that of the latest that is no fault."""
    p = made_parameter(cause="command_delay", field="delay", usual=(0.0, 0.006), always_free=True)
    d = Hypothesis(cause="command_delay", where="robot", members=(0,))
    likelihood = made_likelihood(np.ones((64, 1, 1)), np.full((64, 1), 0.012))
    before, after = (
        sizes(likelihood.normal_equations(), [p], own, *bounds)[0]
        for own, bounds in (([], bounds_without([p], [d])), ([d], bounds_of([p])))
    )
    assert (before, after) == (pytest.approx(0.006), pytest.approx(0.012))
