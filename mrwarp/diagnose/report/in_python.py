"""``mrwarp.fit`` and ``mrwarp.diagnose``: in one call what the commands of these names do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.report.diagnosis_page import render
from mrwarp.diagnose.report.overview_pictures import draw
from mrwarp.diagnose.report.printed import lines
from mrwarp.diagnose.result import Diagnosis
from mrwarp.identify import fit_report
from mrwarp.identify.fit import FitResult, read_holding
from mrwarp.identify.law_fit import fit_law
from mrwarp.identify.mechanics_fit import fit_joint
from mrwarp.model_file import Model, load_model, save_model
from mrwarp.recording.blocks import in_blocks
from mrwarp.recording.load import Recording, load_recording
from mrwarp.run_dir import write_bytes, write_text
from mrwarp.runtime import core_count
from mrwarp.sysid.settings import Settings
from mrwarp.sysid.verdict import Cause

COMMAND = "mrwarp.diagnose(...)"
"""Origin named in the report."""


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """An identified joint."""

    model: Model
    """Content of ``model.json``; :func:`mrwarp.save_model` writes it."""
    nrmse: float
    """RMS of measured minus simulated torque over the standard deviation of the measured one [1]."""
    result: FitResult
    """Every estimate with its interval, and errors by current and trajectory."""

    def __str__(self) -> str:
        return "\n".join(fit_report.lines(self.result))


def fit(
    data: str | Path | Recording,
    *,
    law: str = "bouc_wen",
    seed: int = 0,
    skip_bad: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Fitted:
    """Identify eqs. 14 and 15, or another hysteresis law, and eq. 18 where break-away torques lie next to the files.

    Example:
        >>> import mrwarp
        >>> found = mrwarp.fit("recordings")
        >>> found.nrmse < 0.25, found.model.parameters["K1"].unit
        (True, 'N·m/(rad·A)')

    Args:
        data: A CSV or Parquet file, a folder of them, or what :func:`mrwarp.load_recording` returned.
        law: One of ``mrwarp fit --law``.
        seed: Seed of the search's subset.
        skip_bad: Leave files of a folder out that would be refused.
        progress: Called with what is being done.

    Raises:
        RecordingError: the recording is refused; the message names file, row and column, and the remedy.
        ValueError: there is no such law.
    """
    log = progress or (lambda text: None)
    recording = data if isinstance(data, Recording) else load_recording(data, skip_bad=skip_bad)
    holding = None if isinstance(data, Recording) else read_holding(Path(data), recording, None, log)
    recording = in_blocks(recording)
    if law == "bouc_wen":
        result = fit_joint(recording, holding=holding, seed=seed, progress=log)
    else:
        result = fit_law(recording, law, holding=holding, seed=seed, progress=log)
    return Fitted(model=fit_report.to_model(result), nrmse=result.nrmse, result=result)


@dataclass(frozen=True, kw_only=True)
class Found:
    """A verdict with its reasons."""

    diagnosis: Diagnosis
    """All of it: suspects, alternatives, gain, account, what could not be known."""

    @property
    def verdict(self) -> str | None:
        """``none``, ``named``, ``unexplained``, ``named_and_unexplained``; None: the data cannot carry a verdict."""
        return self.diagnosis.verdict

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Named effects, each with its numbers and their intervals."""
        return self.diagnosis.causes

    @property
    def model(self) -> Model | None:
        """The model with the named effects; None without a verdict."""
        return self.diagnosis.model

    def report(self, out: str | Path) -> Path:
        """Write ``result.json``, ``model.json``, ``report.html`` and ``pictures/`` to a folder; returns the page."""
        out, d = Path(out), self.diagnosis
        if d.model is not None:
            save_model(d.model, out / "model.json")
        name = "model.json" if d.model is not None else ""
        d.write(out, COMMAND, {}, model_name=name)
        pictures, notes = draw(d)
        d = replace(d, notes=(*d.notes, *notes))
        for picture, data in pictures.items():
            write_bytes(out / "pictures" / f"{picture}.png", data)
        write_text(out / "report.html", render(d, COMMAND, pictures=pictures))
        return out / "report.html"

    def __str__(self) -> str:
        return "\n".join(lines(self.diagnosis, {}))


def diagnose_files(
    data: str | Path | Recording,
    *,
    model: str | Path | Model | None = None,
    settings: Settings | None = None,
    seed: int = 0,
    skip_bad: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Found:
    """Errors of a measured joint's simulation, their causes, and the model extended by them.

    Example:
        >>> import mrwarp
        >>> found = mrwarp.diagnose("recordings")
        >>> found.verdict, [cause.name for cause in found.causes]
        ('named', ['coil_lag'])
        >>> found.report("out").name
        'report.html'

    Args:
        data: A CSV or Parquet file, a folder of them, or what :func:`mrwarp.load_recording` returned.
        model: Nominal model, against which shifts of calibration count.
        settings: Numbers by which is decided, :class:`mrwarp.sysid.settings.Settings`; None: the defaults.
        seed: Seed of everything random.
        skip_bad: Leave files of a folder out that would be refused.
        progress: Called with what is being done.

    Raises:
        RecordingError: the recording is refused; the message names file, row and column, and the remedy.
        ModelFileError: the model file cannot be used.
    """
    log = progress or (lambda text: None)
    recording = data if isinstance(data, Recording) else load_recording(data, skip_bad=skip_bad)
    holding = None if isinstance(data, Recording) else read_holding(Path(data), recording, None, log)
    nominal = load_model(model) if isinstance(model, str | Path) else model
    return Found(
        diagnosis=diagnose(
            recording,
            model=nominal,
            holding=holding,
            settings=settings,
            seed=seed,
            progress=log,
            threads=min(core_count(), 8),
        )
    )
