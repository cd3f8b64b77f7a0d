"""Whole diagnoses of made-up devices with physics of their own: a geared brake, a servo with a pendulum."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.confusion.case import make_case
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.recording.load import load_recording

pytestmark = pytest.mark.slow
NOTCH = np.deg2rad(0.022)
"""Step of the brake's encoder [rad]."""


def written(folder: Path, name: str, columns: dict[str, np.ndarray]) -> None:
    """One run as a CSV file."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / f"{name}.csv", table, fmt="%.6g", delimiter=",", header=",".join(columns), comments="")


def geared_brake(folder: Path, rng: np.random.Generator) -> None:
    """Yield torque 0.15 + 4.3*tanh(1.9*I) N·m, coil 15 ms, play of 0.15 deg to each side, a spring of 600 N·m/rad.

    Nine runs of 3 s at 500 Hz with jitter, in degrees and milliamperes, without a velocity.
    """
    step, spring, play = 2e-4, 600.0, np.deg2rad(0.15)
    t = np.arange(15_000) * step
    for k in range(9):
        w, a, phase = 2.0 * np.pi * rng.uniform(0.4, 1.6, 3), rng.uniform(0.08, 0.25, 3), rng.uniform(0.0, 6.0, 3)
        q = (a[:, None] * np.sin(w[:, None] * t + phase[:, None])).sum(axis=0)
        levels = rng.choice(np.arange(0.0, 0.9, 0.1), 30)
        command = levels[np.searchsorted(np.cumsum(rng.uniform(0.15, 0.5, 29)), t)] if k % 3 else 0.0 * t + 0.1 * k
        flows, shaft, torque = command[0], q[0], np.empty(len(t))
        for i, (angle, asked) in enumerate(zip(q, command, strict=True)):
            flows = asked + (flows - asked) * np.exp(-step / 0.015)
            reach = play + (0.15 + 4.3 * np.tanh(1.9 * flows)) / spring
            shaft = min(max(shaft, angle - reach), angle + reach)
            torque[i] = spring * (angle - shaft - min(max(angle - shaft, -play), play))
        at = np.arange(0, len(t) - 10, 10) * step + rng.uniform(0.0, 2e-4, 1499)
        i = (at / step).astype(int)
        angle = np.rad2deg(np.round(np.interp(at, t, q) / NOTCH) * NOTCH)
        noisy = np.interp(at, t, torque) + 0.02 * rng.normal(size=len(at))
        written(folder, f"run{k}", {"t": at, "q": angle, "current": 1e3 * command[i], "torque": noisy})
    units = {"t": "s", "q": "deg", "current": "mA", "torque": "N·m"}
    (folder / "units.json").write_text(json.dumps(units), encoding="utf-8")


def test_a_geared_brake_has_play_and_a_spring(tmp_path: Path) -> None:
    """Play, spring, saturation and coil lag, and nothing else: each interval holds the truth.

    The half-gap, the smallest way of all, is known to a notch of the encoder at most, which is 15 % of it. Left are
    the noise of 0.02 N·m and, while the spring winds, a notch's rounding at 600 N·m/rad: 2 % of the torque at most.
    """
    geared_brake(tmp_path, np.random.default_rng(14))
    found = diagnose(load_recording(tmp_path))
    causes = {c.name: c for c in found.causes}
    assert set(causes) == {"backlash", "series_compliance", "current_saturation", "coil_lag"}
    truth = {
        ("backlash", "half_gap"): np.deg2rad(0.15), ("series_compliance", "compliance"): 1.0 / 600.0,
        ("current_saturation", "u"): 1.9, ("coil_lag", "time_constant"): 0.015,
    }  # fmt: skip
    for (cause, number), value in truth.items():
        ci95 = causes[cause].parameters[number].ci95
        assert ci95 is not None
        low, high = ci95
        assert low < value < high and high - low < 2.0 * NOTCH / np.deg2rad(0.15) * value
    assert found.extended.nrmse < 0.02


@pytest.mark.parametrize(("gap", "velocity"), [(1e-3, True), (4e-3, True), (1e-3, False)])
def test_play_is_sized_where_a_joint_turns_round_at_once(gap: float, velocity: bool) -> None:
    """A brake behind play, by other code at 10 kHz: the interval holds the half-gap, which is within an encoder's step.

    A smoother of 25 Hz knows no step's way there by less than 0.5 mrad, and names no play of 1 mrad.
    """
    about = {"strengths": {"backlash": gap}, "motion": "triangles", "truth_rate": 1e4, "velocity": velocity}
    case = make_case("backlash", level=0.0, seed=21, size="small", **about)
    truth = case.truth.parameters["backlash"]["value"]
    [cause] = diagnose(case.recording, effects=("backlash",)).causes
    low, high = cause.parameters["half_gap"].ci95 or (0.0, 0.0)
    assert low < truth < high
    assert cause.parameters["half_gap"].value == pytest.approx(truth, abs=case.noise.encoder)


def servo(folder: Path, rng: np.random.Generator) -> None:
    """A pendulum of 0.48 N·m and 0.0067 kg·m² on a servo whose gear rubs with 0.06 of what motor and load bear.

    Dry friction of 0.03 N·m comes to it, as much again at low speed. Six runs of 4 s at 200 Hz of a position law; the
    load torque is known, the torque is the motor's.
    """
    step, inertia, notch = 1e-4, 0.0067, 2.0 * np.pi / 4096
    t = np.arange(40_000) * step
    for gain in (3.0, 8.0):
        a, f = rng.uniform([0.5, 0.1], [0.9, 0.35]), rng.uniform([0.25, 0.8], [0.45, 1.6])
        goals = {
            "sines": a[0] * np.sin(2 * np.pi * f[0] * t) + a[1] * np.sin(2 * np.pi * f[1] * t),
            "lift": np.interp(t, [0.0, 2.0, 2.6, 3.4, 4.0], [0.0, -1.5, -1.5, 0.3, 0.0]),
            "up_and_down": np.interp(t % 2.5, [0.0, 1.0, 1.5, 2.5], [-0.4, 1.4, 1.4, -0.4]),
        }
        for name, goal in goals.items():
            q, v, log = float(goal[0]), 0.0, np.empty((len(t), 2))
            for i, aim in enumerate(goal):
                motor = min(max(gain * (aim - round(q / notch) * notch), -0.9), 0.9)
                load = 0.48 * np.sin(q)
                v += step / inertia * (motor - load - 0.06 * v)
                rubs = step / inertia * (0.03 + 0.03 * np.exp(-((v / 0.1) ** 2)) + 0.06 * abs(motor + load))
                v = v - rubs if v > rubs else v + rubs if v < -rubs else 0.0
                q += step * v
                log[i] = q, motor
            angle = np.round(log[::50, 0] / notch) * notch
            columns = {"t": t[::50], "q": angle, "current": 0.48 * np.sin(angle), "torque": log[::50, 1]}
            written(folder, f"{name}_{gain:g}", columns)
    units = {"t": "s", "q": "rad", "current": "N·m", "torque": "N·m"}
    (folder / "units.json").write_text(json.dumps(units), encoding="utf-8")


def test_a_servo_has_an_inertia_and_friction_that_grows_with_its_load(tmp_path: Path) -> None:
    """Intervals hold the truth next to the 0.03 N·m more at low speed, which the law lacks; no more may be left.

    Motor and load together press by once to twice the load: friction is between 0.06 and 0.12 of it.
    """
    servo(tmp_path, np.random.default_rng(2))
    found = diagnose(load_recording(tmp_path))
    causes = {c.name: c for c in found.causes}
    assert set(causes) == {"rotor_inertia", "load_friction"}
    inertia = causes["rotor_inertia"].parameters["inertia"].ci95 or (0.0, 0.0)
    friction = causes["load_friction"].parameters["F1"].ci95 or (0.0, 0.0)
    assert inertia[0] < 0.0067 < inertia[1] < 1.5 * inertia[0] and friction[0] < 0.06 < 0.12 < friction[1]
    assert 0.06 < causes["load_friction"].parameters["F1"].value < 0.12
    assert found.extended.rmse < 0.03 and any("a reversal" in note for note in found.notes)
