"""Learning from recordings: targets, errors on unseen trajectories, and the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.identify import learn
from mrwarp.identify.dataset import rms
from mrwarp.model_file import JOINT_UNITS, FittedOn, Model, Parameter, make_effect, parameter_unit, save_model
from mrwarp.nn import network_file as model_file
from mrwarp.nn.network_file import SamplingRateError
from mrwarp.nn.training import FitCfg
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording, RecordingError, Trajectory, load_recording, save_recording
from tests.messages import Refused

PAPER = learn.bench_parameters(None)
QUICK = FitCfg(epochs=3, windows_per_epoch=1500, batch=64, average=0.9)


def make_recording(count: int, seed: int, *, current: float | None = None, dt: float = 0.005) -> Recording:
    """Bouc-Wen torque of eqs. 14 and 15 plus a friction asymmetry of 0.3 N·m that the model does not have."""
    rng = np.random.default_rng(seed)
    runs = []
    for k in range(count):
        t = dt * np.arange(400)
        w, a, phase = 2 * np.pi * rng.uniform(0.5, 2.0), rng.uniform(0.2, 0.8), rng.uniform(0.0, 6.0)
        amps = rng.choice([0.0, 0.5, 1.0, 1.5]) if current is None else current
        runs.append(
            Trajectory(
                id=f"run{k}",
                t=t,
                q=a * np.sin(w * t + phase),
                qd=a * w * np.cos(w * t + phase),
                current=np.full_like(t, amps),
                torque=np.zeros_like(t),
            )
        )
    silent = Recording(trajectories=tuple(runs))
    tau = learn.bouc_wen_torque(silent, PAPER)
    measured = (replace(r, torque=x + 0.3 * np.tanh(r.qd / 0.02) ** 2) for r, x in zip(runs, tau, strict=True))
    return replace(silent, trajectories=tuple(measured))


def test_residual_target_of_a_perfect_model_is_learned_as_a_constant() -> None:
    """Bouc-Wen leaves the friction that it lacks: PG-RLSTM leaves a fifth of it at most on unseen trajectories."""
    learned = learn.learn(make_recording(10, seed=0), kind="pg_rlstm", cfg=QUICK)
    evaluation = make_recording(4, seed=1, current=1.2)
    physical = learn.summary(learn.errors(learn.bouc_wen_torque(evaluation, PAPER), evaluation))
    with_residual = learn.summary(learn.errors(learn.predict(learned.model, evaluation), evaluation))
    lacking = [0.3 * np.tanh(run.qd / 0.02) ** 2 for run in evaluation.trajectories]
    rounding = float(np.finfo(np.float32).eps) * max(np.abs(run.torque).max() for run in evaluation.trajectories)
    assert physical["average"] == pytest.approx(np.mean([rms(x[learn.SKIP :]) for x in lacking]), abs=rounding)
    assert with_residual["average"] < physical["average"] / 5.0
    assert list(physical["by_current"]) == ["1.2"] and physical["by_current"]["1.2"]["trajectories"] == 4
    assert learned.figures["trajectories"] == {"training": 8, "validation": 2}
    assert learned.model.bouc_wen["q_neutral"] == 0.0


def test_a_residual_on_a_law_and_an_effect(tmp_path: Path) -> None:
    """The rest of a model with Kwok's law is learned on top of it, to a quarter; the file keeps the law's numbers."""
    law, silent = {"slope": 3.0, "width": 0.4}, make_recording(6, seed=11)
    values = {**PAPER, "alpha": 0.0, "beta": 1.0, "gamma": 0.0, "K0": 0.4, "K1": 0.5}
    del values["q_neutral"]
    model = Model(
        parameters={name: Parameter(value=x, unit=parameter_unit(name, JOINT_UNITS)) for name, x in values.items()},
        effects=(make_effect("kwok", law),),
        fitted_on=FittedOn(source="test", trajectories=6, samples=2400, rate=200.0),
    )
    tau = learn.physical_torque(silent, PAPER, model)
    runs = tuple(replace(r, torque=x + 0.2) for r, x in zip(silent.trajectories, tau, strict=True))
    recording = replace(silent, trajectories=runs)
    learned = learn.learn(recording, kind="pg_rlstm", physical=model, cfg=QUICK)
    assert learned.model.trained_with == {"kwok": law} and learned.figures["validation_rmse"] < 0.2 / 4.0
    model_file.save(learned.model, tmp_path / "m.safetensors")
    again = model_file.load(tmp_path / "m.safetensors")
    predicted = learn.predict(again, recording, tau)
    worst = max(float(np.sqrt(np.nanmean((p - r.torque) ** 2))) for p, r in zip(predicted, runs, strict=True))
    assert worst < 0.2 / 4.0
    with pytest.raises(ValueError, match="another physical model"):
        learn.predict(again, recording)


def test_errors_leave_out_the_same_samples_for_every_model() -> None:
    """The first 49 samples do not count, with any content; the sample standard deviation is used."""
    recording = make_recording(2, seed=2, current=1.0)
    predicted = [run.torque + error for run, error in zip(recording.trajectories, (0.1, 0.3), strict=True)]
    for tau in predicted:
        tau[: learn.SKIP] = np.nan
    row = learn.summary(learn.errors(predicted, recording))["by_current"]["1"]
    assert row["mean"] == pytest.approx(0.2)
    assert row["sd"] == pytest.approx(0.2 / np.sqrt(2.0))


def test_learn_refuses_mixed_rates_and_too_few_trajectories() -> None:
    """One window is one span of time, and a division needs two trajectories."""
    a, b = make_recording(2, seed=3), make_recording(1, seed=4, dt=0.01)
    with pytest.raises(RecordingError, match="200 Hz.*100 Hz"):
        learn.learn(Recording(trajectories=a.trajectories + b.trajectories), kind="mlp", cfg=QUICK)
    with pytest.raises(RecordingError, match="at least two"):
        learn.learn(Recording(trajectories=a.trajectories[:1]), kind="lstm", cfg=QUICK)


def test_learn_command_writes_model_curves_and_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bench data in, four files out; the file's prediction is what the result says; the table is printed."""
    data, out = tmp_path / "data", tmp_path / "out"
    save_recording(make_recording(6, seed=7), data / "fit" / "run.csv")
    save_recording(make_recording(3, seed=8, current=1.2), data / "evaluation" / "run.csv")
    given = {**MrParams().to_dict(), "K1": 9.0}
    identified = {name: Parameter(value=given[name], unit=parameter_unit(name, JOINT_UNITS)) for name in PAPER}
    identified.pop("q_neutral")
    fitted_on = FittedOn(source="test", trajectories=6, samples=2400, rate=200.0)
    save_model(Model(parameters=identified, fitted_on=fitted_on), tmp_path / "model.json")
    arguments = ["--model", "mlp", "--epochs", "2", "--windows-per-epoch", "300", "--seed", "5"]
    files = [str(data), "--out", str(out), "--bouc-wen", str(tmp_path / "model.json")]
    assert main(["learn", *files, *arguments]) == 0
    assert {p.name for p in out.iterdir()} == {"model.safetensors", "model.onnx", "curves.png", "result.json"}
    result = json.loads((out / "result.json").read_text())
    model = model_file.load(out / "model.safetensors")
    assert model.device["K1"] == model.bouc_wen["K1"] == 9.0 and model.seed == result["seed"] == 5
    evaluation = load_recording(data / "evaluation")
    again = learn.summary(learn.errors(learn.predict(model, evaluation), evaluation))
    assert result["evaluation"]["mlp"] == again
    assert result["windows_seen"] == 600
    assert "bouc_wen" in capsys.readouterr().out


def test_residual_on_another_physical_model() -> None:
    """With a baseline of its own the residual is learned, to a twentieth, and predicted on it, at the same rate."""
    recording, evaluation = make_recording(6, seed=10), make_recording(2, seed=11, current=1.0)
    slower = make_recording(1, seed=6, dt=0.01)

    def baseline(part: Recording) -> list[np.ndarray]:
        return [run.torque - 2.0 for run in part.trajectories]

    learned = learn.learn(recording, kind="pg_rlstm", baseline=baseline(recording), cfg=replace(QUICK, epochs=8))
    tau = learn.predict(learned.model, evaluation, baseline(evaluation))
    assert learn.summary(learn.errors(tau, evaluation))["average"] < 2.0 / 20.0
    with pytest.raises(ValueError, match="give its torque as baseline"):
        learn.predict(learned.model, evaluation)
    with pytest.raises(SamplingRateError, match="200 Hz and cannot run at 100 Hz"):
        learn.predict(learned.model, slower, baseline(slower))


def test_a_turned_torque_is_refused(tmp_path: Path, refused: Refused) -> None:
    """As ``mrwarp fit`` refuses it: one line that says what to check, and nothing written."""
    runs = make_recording(4, seed=2).trajectories
    save_recording(Recording(trajectories=tuple(replace(r, torque=-r.torque) for r in runs)), tmp_path / "data")
    error = refused("learn", tmp_path / "data", "--out", tmp_path / "out")
    assert "drives the motion" in error and "turn a sign" in error
    assert not (tmp_path / "out").exists()
