"""Fits with a published law: a foreign device comes back, its zeros per run too, and the model file holds it."""

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.identify import law_fit
from mrwarp.identify.dataset import Motion
from mrwarp.identify.fit_report import to_model
from mrwarp.identify.law_fit import LawSearch, fit_law, model_torque
from mrwarp.identify.parameters import Parameters, jacobian
from mrwarp.identify.replay import EffectReplay
from mrwarp.model_file import ModelFileError, load_model, model_from_dict, model_to_dict, save_model
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.recording.write import save_recording
from tests.messages import has_parts

TRUTH = {"slope": 60.0, "width": 0.3, "D": 20.0, "B": 300.0, "C": 900.0, "K0": 70.0, "K1": 180.0, "B1": 150.0}
UNITS = {"q": "m", "current": "V", "torque": "N"}


def kwok_damper(seed: int = 0, zeros: float = 0.0, runs: int = 10, lopsided: float = 0.0) -> Recording:
    """A damper of Kwok's law, 1 % noise, at 0, 1, 2 V.

    ``zeros`` is the spread of the sensor's zero from run to run. ``lopsided`` [N·s/m] damps one direction more, in runs
    of small to large strokes.
    """
    rng, found = np.random.default_rng(seed), []
    t = np.arange(800) / 200.0
    for k in range(runs):
        q, qd = np.zeros(len(t)), np.zeros(len(t))
        for _ in range(3):
            w, a, p = 2 * np.pi * rng.uniform(0.5, 2.0), rng.uniform(0.002, 0.008), rng.uniform(0, 2 * np.pi)
            q, qd = q + a * np.sin(w * t + p), qd + a * w * np.cos(w * t + p)
        if lopsided:
            q, qd = 0.2 * (k + 1) * q, 0.2 * (k + 1) * qd
        u = np.full(len(t), float(k % 3)) if k < 6 else np.repeat(rng.choice([0.0, 1.0, 2.0], 8), 100)
        h = np.tanh(TRUTH["slope"] * qd + TRUTH["width"] * np.sign(q))
        force = TRUTH["D"] + (TRUTH["B"] + TRUTH["B1"] * u) * qd + TRUTH["C"] * q + (TRUTH["K0"] + TRUTH["K1"] * u) * h
        force += 2.0 * rng.normal(size=len(t)) + zeros * rng.choice([-1.0, 1.0]) + lopsided * np.abs(qd)
        found.append(Trajectory(id=f"run{k}", t=t, q=q, qd=qd, current=u, torque=force))
    return Recording(trajectories=tuple(found), units=dict(UNITS))


@pytest.mark.parametrize("zeros", [0.0, 60.0])
def test_a_foreign_device_comes_back(zeros: float, tmp_path: Path) -> None:
    """Kwok's numbers within 5 %, the error at the noise; a zero that moves is listed; the file is lossless."""
    recording = kwok_damper(zeros=zeros)
    result = fit_law(recording, "kwok")
    law, effects = result.effects[0], {name: e.values for name, e in ((e.name, e) for e in result.effects[1:])}
    for name in ("slope", "width"):
        assert law.values[name] == pytest.approx(TRUTH[name], rel=0.05)
    for name in ("K0", "K1"):
        assert result.values[name] == pytest.approx(TRUTH[name], rel=0.05)
    assert effects["current_viscosity"]["B1"] == pytest.approx(TRUTH["B1"], rel=0.2)
    assert result.rmse < 5.0
    assert result.held_out is not None and result.held_out < 0.03
    assert bool(result.offsets) is bool(zeros) and (
        not zeros or has_parts("\n".join(result.warnings), "zero .. run to run")
    )
    if zeros:
        assert np.ptp(list(result.offsets.values())) == pytest.approx(2.0 * zeros, rel=0.1)
    model = to_model(result)
    assert model.law is not None and model.law.name == "kwok"
    again = load_model(save_model(model, tmp_path / "model.json"))
    assert again == model and "kwok" not in [e["name"] for e in model_to_dict(model)["effects"]]
    offsets = [result.offsets.get(run.id, 0.0) for run in recording.trajectories]
    for tau, zero, simulated in zip(model_torque(again, recording), offsets, result.simulated, strict=True):
        np.testing.assert_allclose(tau + zero, simulated, rtol=0, atol=0.2)


def test_a_lopsided_damper_has_no_moved_zeros() -> None:
    """A direction that is damped more moves the mean of each run, the faster the more; no sensor's zero has moved."""
    result = fit_law(kwok_damper(lopsided=600.0), "kwok")
    effects = {e.name: e.values for e in result.effects}
    assert not result.offsets and effects["friction_asymmetry"]["viscous"] == pytest.approx(600.0, rel=0.1)
    assert result.nrmse < 0.03


def test_laws_of_other_shape_fit_worse() -> None:
    """A rate-independent law cannot follow a tanh of the speed."""
    recording = kwok_damper()
    assert fit_law(recording, "dahl").nrmse > 4.0 * fit_law(recording, "kwok").nrmse


def test_one_level_of_the_control_input_needs_no_current(tmp_path: Path) -> None:
    """Without a control input the coefficients are constants."""
    runs = tuple(
        dataclasses.replace(run, current=np.zeros_like(run.current))
        for run in kwok_damper().trajectories
        if not run.current.any()
    )
    result = fit_law(Recording(trajectories=runs, units=dict(UNITS)), "kwok")
    assert [e.name for e in result.effects] == ["kwok"] and result.values["K1"] == 0.0
    assert result.nrmse < 0.05


def test_the_command_writes_the_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``fit --law`` writes model.json with it, though a picture fails, and refuses what it cannot combine or know."""

    def fails(*given):
        assert (tmp_path / "out/result.json").is_file() and (tmp_path / "out/model.json").is_file()
        raise ValueError("cannot convert float NaN to integer")

    monkeypatch.setattr("mrwarp.identify.fit_pictures.loops_picture", fails)
    save_recording(kwok_damper(runs=6), tmp_path / "data")
    assert main(["fit", str(tmp_path / "data"), "--law", "kwok", "--out", str(tmp_path / "out")]) == 0
    assert load_model(tmp_path / "out/model.json").law is not None
    said = capsys.readouterr().out
    assert "Kwok's law" in said and "note: loops.png was not drawn: cannot convert" in said
    assert (tmp_path / "out/residual.png").is_file()
    for extra in (["--law", "kwok", "--robust"], ["--law", "nobody"]):
        assert main(["fit", str(tmp_path / "data"), *extra, "--out", str(tmp_path / "no")]) == 2
    assert not (tmp_path / "no").exists()


def test_a_damaged_law_is_refused() -> None:
    """An unknown law, a missing number, a number without sense."""
    content = model_to_dict(to_model(fit_law(kwok_damper(runs=4), "kwok")))
    damages = (
        ({**content["law"], "name": "kwock"}, "did you mean 'kwok'"),
        ({**content["law"], "parameters": {}}, "slope is missing"),
        ({"name": "kwok", "parameters": {"slope": -1.0, "width": 0.0}}, "0 or more"),
        ("kwok", "an object"),
    )
    for law, message in damages:
        with pytest.raises(ModelFileError, match=message):
            model_from_dict({**content, "law": law})
    assert model_from_dict({**content, "law": None}).law is None


def test_a_torque_beyond_32_bits_ends_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A vector a step from which the torque overflows has an infinite error, and no search goes there."""
    motion = Motion.of(kwok_damper(runs=3))
    search = LawSearch(EffectReplay(motion), 0.0, offsets=False)
    layout = search.layout(["kwok"])
    x, far = search.starts(layout)[0], 1.5

    def overflows(replay: EffectReplay, p: Parameters, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        torque, slopes = jacobian(replay, p, y)
        slopes[-1] = np.inf if y[-1] > x[-1] + far else slopes[-1]
        return torque, slopes

    monkeypatch.setattr(law_fit, "jacobian", overflows)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert search.evaluate(layout, x + 2.0 * far).loss == np.inf
        found = search.descend(layout, x)
        assert found.x[-1] <= x[-1] + far and 0.0 < found.loss.sum() <= search.evaluate(layout, x).loss
        far = -np.inf
        assert (search.descend(layout, x).held_out == np.inf).all()  # from such a start there is no candidate
