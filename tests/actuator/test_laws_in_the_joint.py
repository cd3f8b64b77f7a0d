"""A published hysteresis law in the joint: its torque, passive in both couplings; USD holds it and says so."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.enums import HYSTERESIS_LAWS, Coupling, ZStep
from mrwarp.model_file import Effect, load_model, make_effect
from mrwarp.params import MrParams
from mrwarp.usd.asset import load_robot
from mrwarp.usd.edit import edit_asset
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.record import LAW
from tests.actuator.actuator_bench import Joint, make_inputs
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
    rig.inputs.mr_foot_load = None
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
    """Kwok's law at 1 A, about the joint's zero."""
    q, qd, effort, _ = swung("kwok", tmp_path, Coupling.EXPLICIT)
    h = np.tanh(NUMBERS["kwok"]["slope"] * qd + NUMBERS["kwok"]["width"] * np.sign(q))
    want = -np.sign(qd) * np.abs(0.05 * qd + 2.2 * h)
    np.testing.assert_allclose(effort, want, rtol=0, atol=2e-3)


@pytest.mark.parametrize("law", ["kwok", "dahl", "spencer"])
def test_behind_play_the_joint_bears_what_the_replay_says(law: str, tmp_path: Path) -> None:
    """Zero in the gap, then the law's torque: 19 of 20 samples within a tenth of the diagnosis' kernel."""
    gap = make_effect("backlash", {"half_gap": 0.03})
    q, qd, effort, _ = swung(law, tmp_path, Coupling.EXPLICIT, gap)
    t, w = DT * np.arange(1, STEPS + 1), 2.0 * np.pi * 1.3
    shaft = along.Shaft.steady(np.ones(STEPS), dt=DT)
    shaft = replace(shaft, q=q, qd=qd, qdd=-0.3 * w * w * np.sin(w * t))
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


DEVICES = 200
"""Devices with random numbers in a batch."""


class RandomDevices:
    """Current-driven joints whose devices have one law and random numbers, up to the stiffness of dry friction.

    Attributes:
        speed: Largest speed of each motion, 0.02 to 30 rad/s [rad/s].
        frequency: 0.5 to 5 Hz.
    """

    def __init__(self, law: str, seed: int) -> None:
        self.law, self.rng = law, np.random.default_rng(seed)
        numbers = self._bouc_wen() if law == "bouc_wen" else self._numbers()
        self.unit = {"K0": 1.0, "K1": 0.0, "alpha": 0.0, "beta": 1.0, "gamma": 0.0}
        self.unit |= numbers if law == "bouc_wen" else {}
        self.numbers = {} if law == "bouc_wen" else numbers
        self.speed, self.frequency = self._spread(0.02, 30.0), self.rng.uniform(0.5, 5.0, DEVICES)
        self.current, self.size = self.rng.uniform(0.0, 2.0, DEVICES), self.rng.uniform(0.5, 10.0, DEVICES)
        self.viscosity = self.rng.uniform(0.0, 0.3, DEVICES)
        z_bound = 1.0 / (self.unit["beta"] + self.unit["gamma"])
        self.unit |= {"K0": 0.1 * self.size / z_bound, "K1": self.size / z_bound, "B": self.viscosity}
        self.yields = self.size * (0.1 + self.current)

    def _spread(self, low: float, high: float) -> np.ndarray:
        """Numbers whose logarithms are uniform."""
        return np.exp(self.rng.uniform(np.log(low), np.log(high), DEVICES))

    def _bouc_wen(self) -> dict[str, Any]:
        beta = self._spread(1.0, 5e3)  # 1/beta down to 0.2 mrad
        return {"beta": beta, "gamma": beta * self.rng.uniform(-0.95, 0.95, DEVICES), "alpha": self._some(2.0)}

    def _some(self, most: float) -> np.ndarray:
        """Uniform numbers, half of them 0."""
        return self.rng.uniform(0.0, most, DEVICES) * (self.rng.random(DEVICES) < 0.5)

    def _numbers(self) -> dict[str, np.ndarray]:
        rng, rate = self.rng, self._spread(1.0, 1e5)
        return {
            "kwok": {
                "slope": self._spread(0.01, 1e3), "width": rng.uniform(-3, 3, DEVICES), "rounding": self._some(0.5),
            },
            "arctangent": {
                "slope": self._spread(0.01, 1e3), "speed": rng.uniform(-5, 5, DEVICES), "rounding": self._some(100.0),
            },
            "biviscous": {"speed": self._spread(1e-3, 3.0)},
            "dahl": {"rate": rate},
            "lugre": {
                "rate": rate, "damping": self._some(2.0), "stribeck": rng.uniform(-0.9, 5, DEVICES),
                "stribeck_speed": self._spread(0.005, 1.0),
            },
            "bouc_wen_power": {
                "rate": rate, "unloading": rng.uniform(0, 5, DEVICES), "sharpness": rng.uniform(0, 9, DEVICES),
            },
            "spencer": {
                "rate": rate, "series": self._spread(0.01, 100.0), "inner": rng.uniform(0, 2, DEVICES),
                "spring": self._some(100.0), "fading": self._some(30.0), "unloading": rng.uniform(-0.5, 5, DEVICES),
            },
        }[self.law]  # fmt: skip

    def sliding(self, qd: np.ndarray) -> np.ndarray:
        """Torque of steady sliding at speeds of shape (T, N) [N·m], from the law's equation."""
        x, v = self.numbers, np.abs(qd)
        if self.law == "bouc_wen":
            h = 1.0 / (1.0 + self.unit["alpha"] * v)
        elif self.law == "kwok":
            h = np.tanh(x["slope"] * v + np.abs(x["width"]))
        elif self.law == "arctangent":
            h = 2.0 / np.pi * np.arctan(x["slope"] * (v + np.abs(x["speed"])))
        elif self.law == "biviscous":
            h = np.minimum(v / x["speed"], 1.0)
        elif self.law == "lugre":
            h = np.maximum(1.0 + x["stribeck"] * np.exp(-((v / x["stribeck_speed"]) ** 2)), 0.05)
        elif self.law == "spencer":
            series, inner, spring = (
                x[name] / (1.0 + x["fading"] * self.current) for name in ("series", "inner", "spring")
            )
            h = np.minimum(series * v, series * (1.0 + inner * v) / (series + inner))
            h = np.where(spring > 0.0, series * v, h)  # until the dashpot takes all of the speed
        else:
            h = np.ones_like(v)
        return self.yields * h + self.viscosity * v

    def moved(self, qd: np.ndarray, dt: float, coupling: Coupling) -> tuple[np.ndarray, np.ndarray]:
        """(tau_BW, torque or bound of the brake) along velocities that hold for a step, shapes (T, N)."""
        inputs = make_inputs(DEVICES, 1)
        inputs.current_e.assign(self.current.astype(np.float32))
        first = {name: float(values[0]) for name, values in self.numbers.items()}
        effects = (make_effect(self.law, first),) if first else ()
        mr = MrParams().replace(D=0.0, C=0.0, I1=0.0, q_neutral=0.0, q_offset=0.0, q_center=0.0, current_max=100.0)
        joint = Joint("joint", mr.replace(eps_hold=0.0), effects, kp=0.0, kd=0.0)
        cfg = MrActuatorCfg(coupling=coupling, gated=False)  # what a user gets who chooses nothing
        actuator = MrActuator([joint], [0], inputs, dt=dt, cfg=cfg, share_params=False)
        for name, values in self.unit.items():
            actuator.set_param(name, np.broadcast_to(values, DEVICES)[:, None])
        for name, values in self.numbers.items():
            assert actuator.effects is not None
            actuator.effects.value(self.law, name).assign(np.asarray(values, dtype=np.float32)[:, None])
        borne = actuator.bound if coupling is Coupling.CONSTRAINT else actuator.tau_mr
        way, found = dt * np.cumsum(qd, axis=0), []
        for q, speeds in zip(way - way.mean(axis=0), qd, strict=True):
            for array, values in ((inputs.q, q), (inputs.qd, speeds)):
                array.assign(values.astype(np.float32)[:, None])
            actuator.step()
            found.append((actuator.tau_dyn.numpy()[:, 0].copy(), borne.numpy()[:, 0].copy()))
        tau, acted = np.swapaxes(np.array(found), 0, 1)
        return tau, acted


ROUNDING = 2e-6
"""Relative rounding of a torque: a dozen operations in 32 bits of 6e-8 each, exponentials of 4 of them included."""


@pytest.mark.parametrize("coupling", list(Coupling))
@pytest.mark.parametrize("law", HYSTERESIS_LAWS)
def test_no_step_bears_more_than_the_law_slides_with(law: str, coupling: Coupling) -> None:
    """To and fro at constant speed: for any step, its torque and its bound stay below that of steady sliding.

    The default step; the paper's Euler step bears up to max(beta, beta + gamma)*|qd|*dt times as much. Along sines the
    same at each instant, for laws that follow a change of speed at once: all but Spencer's, whose spring remembers.
    """
    for seed, dt in enumerate((0.001, 0.005, 0.02)):
        devices = RandomDevices(law, seed)
        t = dt * np.arange(1, 121)[:, None]
        phase = devices.frequency * t
        fro = devices.speed * np.where(phase % 1.0 < 0.5, 1.0, -1.0)
        for qd in (fro, devices.speed * np.sin(2.0 * np.pi * phase))[: 1 if law == "spencer" else 2]:
            tau, acted = devices.moved(qd, dt, coupling)
            most = devices.sliding(qd) * (1.0 + ROUNDING)
            assert np.isfinite(tau).all() and (np.abs(tau) <= most).all() and (np.abs(acted) <= most).all()
            assert np.quantile(np.abs(tau).max(axis=0) / most.max(axis=0), 0.75) > 0.9  # and they do slide


@pytest.mark.parametrize("law", HYSTERESIS_LAWS)
def test_half_the_step_is_the_same_loop(law: str) -> None:
    """Work over the loops of sines with 1 to 20 ms and half of that: it differs by w*dt/2 of what sliding takes.

    A torque that holds for a step follows the motion by up to all of it, and halving the step takes half away: a phase
    of w*dt/2, in which a relay (Kwok, Guo) takes the full torque with the wrong sign where the joint is fastest.
    """
    for seed, dt in enumerate((0.001, 0.005, 0.02)):
        devices, work = RandomDevices(law, 10 + seed), []
        for parts in (1, 2):
            count = parts * round(max(0.5, 12 * dt) / dt)
            t = dt / parts * np.arange(1, count + 1)[:, None]
            qd = devices.speed * np.sin(2.0 * np.pi * devices.frequency * t)
            tau, _ = devices.moved(qd, dt / parts, Coupling.CONSTRAINT)
            work.append(np.abs(tau * qd).sum(axis=0) / (devices.sliding(qd) * np.abs(qd)).sum(axis=0))
        assert (np.abs(work[1] - work[0]) < 0.5 * 2.0 * np.pi * devices.frequency * dt).all()
