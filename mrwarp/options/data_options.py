"""Options of the commands that make, read and fit recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from mrwarp.options.option_types import one

Data = Annotated[Path, one(Path, "DATA")]


@dataclass(frozen=True, kw_only=True)
class Check:
    """Explain a recording; 0 when it is good to use, 2 when it is refused."""

    data: Positional[Data]
    """CSV or Parquet file, or a folder of them"""
