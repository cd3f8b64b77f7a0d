"""A folder of calibration records, one after another: found and counted before any is read."""

from __future__ import annotations

from pathlib import Path

from mrwarp.recording.data import RecordingError
from mrwarp.recording.tables import KINDS, is_recording


def records_of(folder: Path) -> list[Path]:
    """The records of a folder in order of their names: each a file, or a folder of files.

    Raises:
        RecordingError: it is no folder, or holds none.
    """
    if not folder.is_dir():
        raise RecordingError(f"{folder}: is no folder; name one that holds a calibration record after another")
    found = [p for p in sorted(folder.iterdir()) if p.is_dir() or is_recording(p)]
    found = [p for p in found if not p.name.startswith((".", "holding"))]
    if not found:
        raise RecordingError(
            f"{folder}: holds no record; put a file ({', '.join(KINDS)}), or a folder, per calibration"
        )
    return found


def check_count(count: int, baseline: int, where: str = "") -> None:
    """Refuse records that are no more than the baseline has.

    Raises:
        RecordingError: they are too few; ``where`` stands in front of the message.
    """
    if count <= baseline:
        raise RecordingError(
            f"{where}{': ' if where else ''}{count} record{'s' * (count != 1)}; needs more than {baseline}: the first "
            f"{baseline} are the baseline of a healthy device, the next ones are judged; record more or lower "
            "--baseline"
        )
