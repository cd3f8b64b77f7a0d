"""Learned torque models from recordings: targets, training, error on unseen trajectories (paper section 4, Fig. 4)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mrwarp.enums import LstmState, ZStep
from mrwarp.identify.contradictions import refuse_contradictions
from mrwarp.identify.dataset import rms
from mrwarp.identify.law_fit import model_torque
from mrwarp.identify.replay import simulate
from mrwarp.model_file import Model, acting
from mrwarp.nn import network_file
from mrwarp.nn.models import SAMPLES, make_net
from mrwarp.nn.network_file import LearnedModel
from mrwarp.nn.training import FitCfg, History, Report, WindowSet, fit, rmse, split
from mrwarp.params import BoucWenParams
from mrwarp.recording.load import Recording, RecordingError

VALIDATION = 0.2
"""Share of the trajectories held for validation, table 1."""

COMPARISON = FitCfg(epochs=10, windows_per_epoch=8192, validation_windows=4096, patience=10)
"""Enough to compare two residuals; ``mrwarp learn`` trains one in full."""

SKIP = max(SAMPLES.values()) - 1
"""Samples at the start of each trajectory that no model is judged on: the longest window is not yet full."""


@dataclass(frozen=True, kw_only=True)
class Learned:
    """Result of a training."""

    model: LearnedModel
    history: History
    figures: dict[str, Any]
    """Plain values for ``result.json``."""


def learn(
    recording: Recording,
    *,
    kind: str,
    bouc_wen: Mapping[str, float] | None = None,
    physical: Model | None = None,
    baseline: Sequence[np.ndarray] | None = None,
    z_step: ZStep = ZStep.EXACT,
    cfg: FitCfg | None = None,
    report: Report | None = None,
) -> Learned:
    """Train one model on a recording.

    Args:
        recording: Fitting data, one sampling rate throughout.
        kind: ``mlp``, ``lstm`` or ``pg_rlstm``.
        bouc_wen: The frozen Bouc-Wen parameters in the recording's units but for ``q_neutral``; None: the paper's.
        physical: An identified joint in their place, with its hysteresis law and effects.
        baseline: Torque of another physical model along each trajectory, in place of Bouc-Wen's for ``pg_rlstm``; such
            a model predicts with that baseline only and does not run in the loop.
        z_step: Step of eq. 15 in tau_BW, which the simulation has to take too.
        cfg: The recipe; its seed also divides the trajectories and draws the weights.
        report: Called after every epoch.

    Raises:
        RecordingError: columns contradict each other, the sampling rates differ, or too few trajectories are long
            enough.
    """
    refuse_contradictions(recording)
    cfg, bouc_wen = cfg or FitCfg(), bench_parameters(physical.values if physical else bouc_wen)
    dt = sampling_interval(recording)
    samples = SAMPLES[kind]
    x, y = features(recording, bouc_wen), [run.torque for run in recording.trajectories]
    if kind == "pg_rlstm":  # eq. 17
        below = baseline or physical_torque(recording, bouc_wen, physical, z_step)
        y = [measured - tau for measured, tau in zip(y, below, strict=True)]
    long = [k for k in range(len(x)) if len(x[k]) >= samples]
    if len(long) < 2:
        raise RecordingError(
            f"{recording.source or 'recording'}: {len(long)} of {len(x)} trajectories have the {samples} samples of a "
            f"{kind} window; record at least two such"
        )
    x, y = [x[k] for k in long], [y[k] for k in long]
    training, held = split(len(x), cfg.seed, VALIDATION)
    train_set, validation_set = (
        WindowSet([x[i] for i in part], [y[i] for i in part], samples) for part in (training, held)
    )
    net = make_net(kind, cfg.seed)
    history = fit(net, train_set, validation_set, cfg, report)
    net.eval()
    figures = {
        "model": kind,
        "recipe": asdict(cfg),
        "trajectories": {"training": len(training), "validation": len(held)},
        "samples": sum(len(part) for part in x),
        "training_windows": len(train_set),
        "windows_seen": len(history.epoch) * min(cfg.windows_per_epoch, len(train_set)),
        "epochs": len(history.epoch),
        "best_epoch": history.best_epoch,
        "stopped": history.stopped,
        "seconds": history.seconds[-1] if history.seconds else 0.0,
        "validation_rmse": rmse(net, validation_set),
    }
    own_baseline = kind == "pg_rlstm" and baseline is not None
    model = LearnedModel(
        kind=kind,
        net=net,
        dt=dt,
        bouc_wen={} if own_baseline else bouc_wen,
        device={} if own_baseline else {name: bouc_wen[name] for name in network_file.DEVICE},
        trained_with=acting(physical.effects) if physical and kind == "pg_rlstm" and not own_baseline else {},
        z_step=z_step.value,
        source=str(recording.source or ""),
        seed=cfg.seed,
        training=figures,
    )
    return Learned(model=model, history=history, figures=figures)


def left_to_learn(
    recording: Recording,
    baseline: Sequence[np.ndarray],
    extended: Sequence[np.ndarray],
    *,
    recipe: FitCfg = COMPARISON,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Train a PG-RLSTM by one recipe on what each of two physical models leaves.

    ``baseline`` and ``extended`` are their torques along each trajectory; where they are the same, one is trained.

    Returns:
        Plain values for ``result.json``, pairs (baseline, extension): the RMS of what the learned model must add
        (``target``), RMSE without and with it on the trajectories of ``held_out`` (``physical``, ``with_learned``);
        ``less`` is how much smaller the target is with the extension [1].

    Raises:
        RecordingError: the trajectories are too short, too few or of several rates for windows.
        KeyboardInterrupt: a training was stopped.
    """
    runs, window = recording.trajectories, SAMPLES["pg_rlstm"]
    usable = [k for k, run in enumerate(runs) if len(run.t) >= window]
    held = [usable[k] for k in split(len(usable), recipe.seed, VALIDATION)[1]] if len(usable) > 1 else []
    target, physical, with_learned = [], [], []
    same = all(np.array_equal(a, b) for a, b in zip(baseline, extended, strict=True))
    for name, torque in (("baseline", baseline),) if same else (("baseline", baseline), ("extension", extended)):

        def report(history: History, cfg: FitCfg, name: str = name) -> None:
            progress(
                f"learning what the {name} leaves: epoch {history.epoch[-1]} of {cfg.epochs}, "
                f"validation {history.validation_rmse[-1]:.4g}"
            )

        learned = learn(recording, kind="pg_rlstm", baseline=torque, cfg=recipe, report=report)
        if learned.history.stopped == "interrupted":
            raise KeyboardInterrupt
        rest = [run.torque - tau for run, tau in zip(runs, torque, strict=True)]
        target.append(rms(np.concatenate(rest)))
        physical.append(rms(np.concatenate([rest[k][window - 1 :] for k in held])))
        with_learned.append(float(learned.figures["validation_rmse"]))
    if same:  # nothing was named: one training says both
        target, physical, with_learned = ([*x, *x] for x in (target, physical, with_learned))
    return {
        "target": target,
        "physical": physical,
        "with_learned": with_learned,
        "held_out": [runs[k].id for k in held],
        "recipe": asdict(recipe),
        "less": 1.0 - target[1] / target[0] if target[0] > 0.0 else 0.0,
    }


def sampling_interval(recording: Recording) -> float:
    """The sampling interval that all trajectories share [s].

    Raises:
        RecordingError: there is no trajectory, or two differ by more than 0.1 %.
    """
    where = recording.source or "recording"
    if not recording.trajectories:
        raise RecordingError(f"{where}: holds no trajectory")
    first = recording.trajectories[0]
    for run in recording.trajectories:
        if not math.isclose(run.dt, first.dt, rel_tol=1e-3):
            raise RecordingError(
                f"{where}: {first.id} is sampled at {1 / first.dt:g} Hz, {run.id} at {1 / run.dt:g} Hz; a window means "
                "one span of time, so resample them to one rate"
            )
    return round(first.dt, 9)


def bench_parameters(bouc_wen: Mapping[str, float] | None) -> dict[str, float]:
    """The Bouc-Wen entries of a set of parameters (None: the paper's) about the bench's own zero."""
    values = asdict(BoucWenParams()) if bouc_wen is None else bouc_wen
    known = {spec.name: float(values[spec.name]) for spec in BoucWenParams.specs() if spec.name in values}
    return known | {"q_neutral": 0.0}


def features(recording: Recording, bouc_wen: Mapping[str, float]) -> list[np.ndarray]:
    """(q_c, qd, current) of each trajectory, float32, shape (N_i, 3); q_c is about the bench's zero."""
    origin = bouc_wen.get("q_offset", 0.0) + bouc_wen.get("q_center", 0.0)
    return [
        np.stack([run.q - origin, run.qd, run.current], axis=1).astype(np.float32) for run in recording.trajectories
    ]


def bouc_wen_torque(
    recording: Recording, bouc_wen: Mapping[str, float], z_step: ZStep = ZStep.EXACT
) -> list[np.ndarray]:
    """tau_BW along each trajectory [N·m] by a step that holds the newest velocity: what the loop computes at 200 Hz."""
    return simulate(bench_parameters(bouc_wen), recording, exact=z_step is ZStep.EXACT, substeps=0)


def physical_torque(
    recording: Recording,
    bouc_wen: Mapping[str, float],
    physical: Model | None,
    z_step: ZStep = ZStep.EXACT,
) -> list[np.ndarray]:
    """Torque of a joint along each trajectory [N·m]: with its law and effects if it has any, else tau_BW."""
    if physical is not None and acting(physical.effects):
        return model_torque(physical, recording)
    return bouc_wen_torque(recording, bouc_wen, z_step)


def predict(
    model: LearnedModel,
    recording: Recording,
    baseline: Sequence[np.ndarray] | None = None,
    lstm_state: LstmState = LstmState.WINDOW,
) -> list[np.ndarray]:
    """Predicted torque along each trajectory [N·m], tau_BW included (eq. 16); NaN where the window is not full.

    Args:
        model: The model.
        recording: The motion.
        baseline: As in :func:`learn`, for a model that was trained with one.
        lstm_state: What an LSTM begins each sample with; with ``CARRIED``, its state since the trajectory's beginning.

    Raises:
        SamplingRateError: the recording has another rate than the model.
        ValueError: the model was trained on another baseline than plain Bouc-Wen, and none is given.
    """
    if model.is_residual and (model.trained_with or not model.bouc_wen) and baseline is None:
        raise ValueError("this pg_rlstm model was trained on another physical model; give its torque as baseline")
    model.check_rate(sampling_interval(recording))
    tau = [network_file.torque_of(model, x, lstm_state) for x in features(recording, model.bouc_wen)]
    if model.is_residual:
        physical = baseline or bouc_wen_torque(recording, model.bouc_wen, ZStep(model.z_step))
        tau = [a + b for a, b in zip(tau, physical, strict=True)]
    return tau


def errors(predicted: Sequence[np.ndarray], recording: Recording) -> dict[float, list[float]]:
    """RMSE of each trajectory [N·m] by its largest current, the first :data:`SKIP` samples left out for every model."""
    found: dict[float, list[float]] = {}
    for tau, run in zip(predicted, recording.trajectories, strict=True):
        mismatch = (tau - run.torque)[SKIP:]
        if len(mismatch):
            amps = round(float(np.abs(run.current).max()), 2)
            found.setdefault(amps, []).append(rms(mismatch))
    return dict(sorted(found.items()))


def summary(by_current: Mapping[float, Sequence[float]]) -> dict[str, Any]:
    """Mean and sample standard deviation of the RMSE per current, and the mean over the currents [N·m]."""
    rows = {}
    for amps, values in by_current.items():
        sd = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
        rows[f"{amps:g}"] = {"mean": float(np.mean(values)), "sd": sd, "trajectories": len(values)}
    return {"by_current": rows, "average": float(np.mean([row["mean"] for row in rows.values()]))}


def table(figures: Mapping[str, dict[str, Any]]) -> str:
    """RMSE per model and current as text; ``figures`` holds a :func:`summary` per model."""
    currents = list(next(iter(figures.values()))["by_current"])
    width = max(12, *(len(name) + 1 for name in figures))
    lines = ["RMSE [N·m]".ljust(width) + "".join(f"{amps + ' A':>16s}" for amps in currents) + "     average"]
    for name, row in figures.items():
        cells = (row["by_current"][amps] for amps in currents)
        text = "".join(f"{cell['mean']:8.3f} ± {cell['sd']:.3f}" for cell in cells)
        lines.append(name.ljust(width) + text + f"{row['average']:12.3f}")
    return "\n".join(lines)
