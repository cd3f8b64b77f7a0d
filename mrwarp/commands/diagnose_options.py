"""Options and output that ``mrwarp diagnose joint`` and ``mrwarp diagnose robot`` share."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import Options
from mrwarp.run_dir import check_writable, write_bytes, write_text

EARLY = "result.json (not final)"
"""How a first answer is named where it is all that was written."""


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(Options):
    """Data, output folder, and where to stop."""

    engines = False  # before the data are read
    after_verdict: ClassVar[tuple[str, ...]] = ()
    """Options that need a verdict, which ``--quick`` does not reach."""

    data: opt.Data
    """recording or log"""
    out: opt.Folder = Path("runs/diagnose")
    """output folder"""
    skip_bad: opt.Flag = False
    """leave out files of a folder that cannot be used, by name"""
    seed: opt.Seed = 0
    """seed of everything random"""
    quick: opt.Flag = False
    """stop at the first answer, within seconds: result.json with "final": false and the likeliest causes under
    "suspects"; nothing is checked, no model, no report (exit code 0)"""

    def check_choice(self) -> None:
        """Refuse with ``--quick`` what needs a verdict, and an output folder that cannot be written.

        Raises:
            ValueError: an option needs a verdict; the message names it.
            FolderError: the folder cannot be written.
        """
        if self.quick and (name := next((name for name in self.after_verdict if getattr(self, name)), "")):
            raise ValueError(f"--{name}: needs a verdict, and --quick stops before it; leave one of them out")
        check_writable(self.out)

    def clear(self, pictures: Iterable[str], models: Iterable[str] = ()) -> None:
        """Remove page, pictures and ``models`` of an earlier diagnosis, which would be taken for this one's."""
        drawn = (f"pictures/{name}.png" for name in pictures)
        for path in (self.out / name for name in ("report.html", *drawn, *models)):
            path.unlink(missing_ok=True)

    def write_page(self, page: str, pictures: Mapping[str, bytes]) -> None:
        """Write the report, and its pictures as files too."""
        for name, data in pictures.items():
            write_bytes(self.out / "pictures" / f"{name}.png", data)
        write_text(self.out / "report.html", page)

    def print_early(self, lines: Iterable[str], seconds: float) -> int:
        """Print a first answer that ends a run, and where it is; the exit code."""
        print("\n".join(lines))
        print(f"\n{EARLY} in {self.out} ({seconds:.0f} s); without --quick it is checked")
        return 0

    @contextlib.contextmanager
    def stoppable(self) -> Iterator[list[str]]:
        """Give a list for the names of written files; Ctrl-C then says which of them it left."""
        written: list[str] = []
        try:
            yield written
        except KeyboardInterrupt:
            left = f"only {' and '.join(written)} in {self.out}" if written else "nothing"
            raise KeyboardInterrupt(f"{left} was written") from None


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Leave Ctrl-C unheard for the fraction of a second in which files are written: all of them or none."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
