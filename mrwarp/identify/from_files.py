"""``mrwarp.fit``: identify a joint from recordings in one call, as ``mrwarp fit`` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mrwarp.identify import fit_report
from mrwarp.identify.fit import FitResult, read_holding
from mrwarp.identify.fit import fit as fit_eq14
from mrwarp.identify.law_fit import fit_law
from mrwarp.model_file import Model
from mrwarp.recording.load import Recording, load_recording


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """An identified joint."""

    model: Model
    """What ``model.json`` holds; :func:`mrwarp.save_model` writes it."""
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
    """Identify eqs. 14 and 15, or another hysteresis law, and eq. 18 where break-away torques lie beside the files.

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
    if law == "bouc_wen":
        result = fit_eq14(recording, holding=holding, seed=seed, progress=log)
    else:
        result = fit_law(recording, law, holding=holding, seed=seed, progress=log)
    return Fitted(model=fit_report.to_model(result), nrmse=result.nrmse, result=result)
