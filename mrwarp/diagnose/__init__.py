"""Errors of a joint's simulation, and their causes: ``mrwarp diagnose``, and in Python ``mrwarp.diagnose(...)``."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from mrwarp.diagnose.pipeline import diagnose as diagnose
    from mrwarp.diagnose.report.in_python import Found as Found
    from mrwarp.diagnose.result import Diagnosis as Diagnosis
    from mrwarp.model_file import Model
    from mrwarp.recording.load import Recording
    from mrwarp.sysid.settings import Settings

_PLACES = {"Diagnosis": "result", "Found": "report.in_python", "diagnose": "pipeline"}
"""Module of each name: all of them together load pictures and pages, which a check of recordings does without."""

__all__ = ["Diagnosis", "Found", "diagnose"]


def __getattr__(name: str) -> Any:
    """Load a name when it is first asked for."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)


class _Callable(ModuleType):
    """The package is the public function too, for ``mrwarp.diagnose`` names both."""

    @staticmethod
    def __call__(
        data: str | Path | Recording,
        *,
        model: str | Path | Model | None = None,
        settings: Settings | None = None,
        seed: int = 0,
        skip_bad: bool = False,
        progress: Callable[[str], None] | None = None,
    ) -> Found:
        """Diagnose recordings, with arguments and errors of :func:`mrwarp.diagnose.report.in_python.diagnose_files`.

        Example:
            >>> import mrwarp
            >>> found = mrwarp.diagnose("recordings")
            >>> found.verdict, [cause.name for cause in found.causes]
            ('named', ['coil_lag'])
        """
        in_python = importlib.import_module(f"{__name__}.{_PLACES['Found']}")
        return in_python.diagnose_files(
            data, model=model, settings=settings, seed=seed, skip_bad=skip_bad, progress=progress
        )


sys.modules[__name__].__class__ = _Callable
