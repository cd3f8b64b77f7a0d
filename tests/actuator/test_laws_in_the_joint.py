"""A published hysteresis law in the joint: its torque, passive in both couplings; USD holds it and says so."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.enums import Coupling, ZStep
from mrwarp.model_file import Effect, load_model, make_effect
from mrwarp.usd.asset import load_robot
from mrwarp.usd.edit import edit_asset
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.record import LAW
from tests.actuator.test_newton_drive import Rig, fitted_scene, model_file
from tests.effects import along
from tests.effects.test_hysteresis_laws import NUMBERS

UNIT_LOOP = {"alpha": 0.0, "beta": 1.0, "gamma": 0.0, "K0": 0.2, "K1": 2.0, "D": 0.0, "C": 0.0, "I1": 0.0, "B": 0.05}
STEPS, DT = 400, 0.005


def swung(
    law: str, path: Path, coupling: Coupling, *before: Effect
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(q, qd, effort, bound) of a current-driven joint with 1 A along a sine."""
    file = model_file(path / f"{law}.json", (make_effect(law, NUMBERS[law]), *before), **UNIT_LOOP)
    gains = {"kp_base": 0.0, "kp_low": 0.0, "kd": 0.0, "eps_hold": 0.0}
    rig = Rig(fitted_scene(file, 1, z_step=ZStep.EXACT, coupling=coupling, **gains))
    control: Any = rig.control
    control.mr_foot_load = None
    w = 2.0 * np.pi * 1.3
    t = DT * np.arange(1, STEPS + 1)
    q, qd = 0.3 * np.sin(w * t), 0.3 * w * np.cos(w * t)
    efforts, bounds = [], []
    for angle, speed in zip(q, qd, strict=True):
        rig.write(q=np.array([angle]), qd=np.array([speed]), current=np.array([1.0]))
        efforts.append(rig.step()[0])
        bounds.append(rig.drive.brake_bound.numpy()[0] if coupling is Coupling.CONSTRAINT else 0.0)
    return q, qd, np.array(efforts), np.array(bounds)


@pytest.mark.parametrize("law", HYSTERESIS)
def test_a_law_is_passive_in_both_couplings(law: str, tmp_path: Path) -> None:
    """Explicit: no torque along the velocity. Constraint: dry friction with a bound that follows the current."""
    q, qd, effort, _ = swung(law, tmp_path, Coupling.EXPLICIT)
    assert np.isfinite(effort).all() and (effort * qd <= 0.0).all()
    assert 1.5 < np.abs(effort[100:]).max() < 6.0
    _, _, none, bound = swung(law, tmp_path, Coupling.CONSTRAINT)
    assert np.abs(none).max() == 0.0 and (bound >= 0.0).all() and np.isfinite(bound).all()
    fast = np.abs(qd) > 1.0
    np.testing.assert_allclose(bound[fast], np.abs(effort[fast]), rtol=1e-5)


def test_the_torque_is_the_laws(tmp_path: Path) -> None:
    """Kwok's law at 1 A, about the joint's neutral angle."""
    q, qd, effort, _ = swung("kwok", tmp_path, Coupling.EXPLICIT)
    q_c = q + 1.5  # q_neutral of the defaults
    h = np.tanh(NUMBERS["kwok"]["slope"] * qd + NUMBERS["kwok"]["width"] * np.sign(q_c))
    want = -np.sign(qd) * np.abs(0.05 * qd + 2.2 * h)
    np.testing.assert_allclose(effort, want, rtol=0, atol=2e-3)


@pytest.mark.parametrize("law", ["kwok", "dahl", "spencer"])
def test_behind_play_the_joint_bears_what_the_replay_says(law: str, tmp_path: Path) -> None:
    """Zero in the gap, then the law's torque: 19 of 20 samples within a tenth of the diagnosis' kernel."""
    gap = make_effect("backlash", {"half_gap": 0.03})
    q, qd, effort, _ = swung(law, tmp_path, Coupling.EXPLICIT, gap)
    t, w = DT * np.arange(1, STEPS + 1), 2.0 * np.pi * 1.3
    shaft = along.Shaft.steady(np.ones(STEPS), dt=DT)
    shaft = replace(shaft, q=q + 1.5, qd=qd, qdd=-0.3 * w * w * np.sin(w * t))
    base = {name: value for name, value in UNIT_LOOP.items() if value}
    want = along.torque(shaft, base, {law: NUMBERS[law], "backlash": {"half_gap": 0.03}})
    opposing = -np.sign(qd) * np.abs(want)
    assert np.quantile(np.abs(effort - opposing)[50:], 0.95) < 0.1 * np.abs(want).max()
    assert 0.08 < np.mean(np.abs(effort[50:]) < 0.02) < 0.5


def test_usd_holds_the_law(tmp_path: Path) -> None:
    """An applied model's law stands in the prim, runs on its joints, and cannot be renamed without its numbers."""
    file = model_file(tmp_path / "kwok.json", (make_effect("kwok", NUMBERS["kwok"]),), **UNIT_LOOP)
    out = tmp_path / "robot.usda"
    edit_asset(ASSETS / "mr_go.usda", "MRDevice", {}, model=load_model(file), out=out)
    text = out.read_text(encoding="utf-8")
    assert text.count(f"string {LAW} = 'kwok'") + text.count(f'string {LAW} = "kwok"') == 1
    calves = [a for a in load_robot(out, robot="mr_go").actuators if a.mr]
    assert calves and all(a.model is not None and a.model.law is not None for a in calves)
    renamed = text.replace(f"{LAW} = 'kwok'", f"{LAW} = 'dahl'").replace(f'{LAW} = "kwok"', f'{LAW} = "dahl"')
    assert renamed != text
    other = tmp_path / "renamed.usda"
    other.write_text(renamed, encoding="utf-8")
    with pytest.raises(AssetError, match=f"{LAW} = 'dahl'"):
        load_robot(other, robot="mr_go")
