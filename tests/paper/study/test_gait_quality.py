"""Rules of good policies: feet that slide and robots that lean are measured as such; rules name what is broken."""

import numpy as np
import pytest
import torch

from mrwarp.enums import ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.trials.gait_rules import PostureMeter, Rules, broken
from mrwarp.trials.walking import make_env
from paper.study.gait_quality import UNITS, FootMeter, lines, spread_kept

GOOD = {"tilt_rms": 0.6, "roll": 0.1, "pitch": -0.2, "sides": 2.0, "slip": 0.02, "v_x_rmse": 0.02, "fell": 0.0}


def test_slip_is_the_speed_of_the_soles() -> None:
    """A robot that stands has none; one whose feet are carried along has that speed, in float32.

    Turned about the trunk's axis soles have its height for a lever, to a twentieth: they sink in, and their arms lean.
    """
    env = make_env(TaskCfg(actuator="none", z_step=ZStep.EULER), 1, 0)
    for _ in range(100):  # until it stands still
        env.step(torch.zeros(1, 12))
    feet, on = FootMeter(env), torch.ones(1, dtype=torch.bool)
    feet.add(on)
    env.step(torch.zeros(1, 12))
    feet.add(on)
    assert float(feet.figures()["slip"][0]) < 0.01
    velocity = env.qvel
    velocity[:] = 0.0
    velocity[0, 0] = 0.3  # the whole robot along x
    assert feet._sole_speeds(0) == pytest.approx(0.3, rel=float(np.finfo(np.float32).eps))
    velocity[0, 0], velocity[0, 3] = 0.0, 1.0  # and turned about the trunk's x axis: the soles move sideways
    assert feet._sole_speeds(0) == pytest.approx(float(env.root_pos[0, 2]), rel=0.05)


def test_rules_name_what_is_broken() -> None:
    """Each figure beyond its limit by itself, in either direction."""
    assert broken(GOOD) == [] and set(GOOD) == set(UNITS)
    for name, value in {"tilt_rms": 1.1, "roll": -0.6, "pitch": 0.6, "sides": -6.0, "slip": 0.06, "fell": 0.1}.items():
        assert broken({**GOOD, name: value}) == [name]
    assert broken({**GOOD, "tilt_rms": 1.1}, Rules(tilt_rms=2.0)) == []


def test_the_spread_of_seeds_is_a_rule_of_the_plant() -> None:
    """One policy has none; the printed lines name the plant and count the policies."""
    rows = [{"plant": "mlp", "seed": k, **GOOD, "v_x_rmse": v, "broken": []} for k, v in enumerate((0.02, 0.021))]
    assert spread_kept(rows) and spread_kept(rows[:1])
    text, kept = lines(rows)
    assert kept and text[-1] == "2 of 2 policies keep every rule"
    rows[1] = {**rows[1], "v_x_rmse": 0.05, "broken": ["slip"]}
    assert np.std([0.02, 0.05], ddof=1) > 0.3 * 0.035
    text, kept = lines(rows)
    assert not kept and text[-2] == "1 of 2 policies keep every rule" and text[-1].endswith("seeds of: mlp")


def test_posture_is_that_of_a_leaning_robot() -> None:
    """A trunk turned by 2 degrees about its x axis reads as roll, of RMS 2 degrees; the sides' torques are compared."""
    env = make_env(TaskCfg(actuator="none", z_step=ZStep.EULER), 2, 0)
    meter, on = PostureMeter(env), torch.tensor([True, False])
    for degrees in (2.0, 2.0):
        angle = np.radians(degrees)
        env.gravity[:] = torch.tensor([0.0, -np.sin(angle), -np.cos(angle)], dtype=torch.float32)
        torque = env.view(env.actuator.tau_motor)
        torque[:] = 1.0
        torque[:, :6] = 3.0  # two of the four legs
        meter.add()
    found = meter.figures(on)
    assert found["roll"] == pytest.approx(2.0, rel=1e-5) and found["pitch"] == pytest.approx(0.0, abs=1e-5)
    assert found["tilt_rms"] == pytest.approx(2.0, rel=1e-5)
    left = [leg.name.endswith("L") for leg in env.layout.legs]
    strong = [k < 2 for k in range(4)]
    sides = [
        np.mean([3.0 if s else 1.0 for s, is_left in zip(strong, left, strict=True) if is_left is side])
        for side in (True, False)
    ]
    assert found["sides"] == pytest.approx(200.0 * (sides[0] - sides[1]) / sum(sides))
    assert broken(found) == ["tilt_rms", "roll"]
