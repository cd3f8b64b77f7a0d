"""The paper against itself: each closed form against a number that is computed another way."""

from dataclasses import asdict

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.identify.replay import simulate
from mrwarp.params import BoucWenParams
from mrwarp.recording.data import Recording, Trajectory
from paper.reproduce import paper_checks
from paper.reproduce.disturbance import two_knees


def figures(title: str) -> dict[str, float]:
    """Of the check whose title begins so."""
    return next(check.figures for check in paper_checks.all_checks() if check.title.startswith(title))


def test_impact_conserves_momentum() -> None:
    """10 kg at 1.5 m/s and 12.6 kg at rest go on at the paper's 0 A row; the row at 1.5 A asks for 4 N·m and more.

    To a hundredth of that row's spread.
    """
    assert (10.0 + 12.6) * paper_checks.plastic_impact() == pytest.approx(15.0)
    row = paper.TABLE_4["hardware"][0.0]["peak_down_velocity"]
    assert row.sd is not None and paper_checks.plastic_impact() == pytest.approx(-row.mean, abs=0.01 * row.sd)
    found = figures("Table 4, hardware")
    assert 4.0 < found["wanted"] < 5.0 and found["most"] < found["wanted"]


def test_lever_is_the_ratio_of_hip_and_knee() -> None:
    """A small step of the knee moves the hip by l*sin(knee/2) in its middle, to roundings of both ends."""
    knee, step = 1.4, 1e-5
    high, low = (2.0 * two_knees.LINK * np.cos(0.5 * x) + two_knees.SOLE for x in (knee, knee + step))
    assert paper_checks.lever(high, low) == pytest.approx(
        two_knees.LINK * np.sin(0.5 * (knee + 0.5 * step)), rel=8.0 * float(np.finfo(float).eps) / step
    )


def test_gain_is_what_the_law_slides_at() -> None:
    """Turned steadily at 3 rad/s, eq. 14 has that much more torque at 1.5 A than at 0 A but for I1, in float32."""
    t = 0.005 * np.arange(600)
    torque = {}
    for amps in (0.0, 1.5):
        run = Trajectory(
            id="a", t=t, q=3.0 * t, qd=np.full_like(t, 3.0), current=np.full_like(t, amps), torque=np.zeros_like(t)
        )
        torque[amps] = simulate(asdict(BoucWenParams()), Recording(trajectories=(run,)))[0][-1]
    direct = BoucWenParams().I1 * 1.5
    rounding = 8.0 * float(np.finfo(np.float32).eps) * torque[1.5]
    assert torque[1.5] - torque[0.0] - direct == pytest.approx(paper_checks.gain(1.5), abs=rounding)


@pytest.mark.parametrize("friction", [10.0, 18.0])
def test_friction_on_a_spring_is_read_from_drop_and_speed(friction: float) -> None:
    """A spring with a friction, stepped finely, gives the drop and the peak speed that the closed form inverts.

    To the step's first order: its share of the spring's own time.
    """
    stiffness, mass, force = 2.0 * 100.0 / 0.15, 12.6, 100.0
    x, v, peak, dt = 0.0, 0.0, 0.0, 1e-5
    while v >= 0.0:
        v += dt * (force - friction - stiffness * x) / mass
        x += dt * v
        peak = max(peak, v)
    first_order = force * dt * np.sqrt(stiffness / mass)
    assert force * (1.0 - x / 0.15) == pytest.approx(friction, abs=first_order)
    assert force * (1.0 - peak / paper_checks.undamped_speed(0.15)) == pytest.approx(friction, abs=first_order)


def test_rows_of_the_push_ask_for_a_constant_beyond_the_current() -> None:
    """Both columns agree within a fifth; without what K1 I adds the same torque is left at every current, to 0.06 N·m.

    The whole of eq. 14 is what the drop asks for at 1.5 A, to a twentieth.
    """
    for by_drop, by_speed in paper_checks.required_torque().values():
        assert by_speed == pytest.approx(by_drop, rel=0.2)
    found = figures("Table 4, simulation: the torque")
    assert found["least_left"] == pytest.approx(found["most_left"], abs=0.06)
    assert found["whole"] == pytest.approx(found["drop"], rel=0.05)
    assert found["torque"] == pytest.approx(-10.35, abs=0.3)  # section 3.2: 10.20 to 10.50 % less


def test_other_checks() -> None:
    """Eq. 18 at 1.5 A, the acceleration of row D, the fluctuation without bias, the energies of the mission."""
    assert figures("Holding")["eq18"] == pytest.approx(26.59697 / (1.0 + (0.51272 / 1.5) ** 2.87967))
    assert figures("Table 5")["D"] == pytest.approx(0.0852)
    assert figures("Table 2")["B"] == pytest.approx(np.sqrt(0.1020**2 - 0.0908**2))
    powers = {robot: paper.MISSION_POWER[robot] for robot in ("mr_go", "mr_go_sal")}
    joules = {r: 500.0 * (p["outbound"] + p["return"]) + 600.0 * p["standby"] for r, p in powers.items()}
    assert figures("Figure 10")["energy_ratio"] == pytest.approx(joules["mr_go_sal"] / joules["mr_go"])


def test_a_stance_of_one_metre_a_second_lies_within_the_leg() -> None:
    """Both ends of the stroke by thigh and calf, the calf at the end of its range."""
    found = figures("Section 7")
    thigh = np.linspace(-0.7, 4.5, 20001)
    calf = paper_checks.STRAIGHTEST
    down = two_knees.LINK * (np.cos(thigh) + np.cos(thigh + calf))
    along = two_knees.LINK * (np.sin(thigh) + np.sin(thigh + calf))
    hip, band = 0.334 - two_knees.SOLE, 2e-4
    level = along[np.abs(down - hip) < band]
    ends = 2.0 * (band * hip / level.max() + (thigh[1] - thigh[0]) * np.hypot(hip, level.max()))  # on a circle
    assert found["reach"] == pytest.approx(level.max() - level.min(), abs=ends)
    assert found["fast"] == pytest.approx(1.0 / 3.0) and found["slow"] < found["fast"] < found["reach"]
