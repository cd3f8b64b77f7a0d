"""Dahl's solid friction: ``dh/dt = rate*(qd - |qd|*h)``."""

import warp as wp

from mrwarp.effects.law import Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def dahl_path(h: float, path: float, rate: float) -> float:
    """h after a signed path in one direction, exactly."""
    end = wp.sign(path)
    return wp.where(path == 0.0, h, end + (h - end) * wp.exp(-rate * wp.abs(path)))


@wp.func
def dahl_law(
    s: Path,
    q_c: float,
    h: float,
    values: wp.array2d[float],
    row: int,
    at: int,
    memory: wp.array2d[float],
    line: int,
    slot: int,
) -> float:
    """The stress nears its end exponentially over the path."""
    return dahl_path(dahl_path(h, s.path_1, values[row, at]), s.path_2, values[row, at])


LAW = hysteresis_law(
    "dahl",
    "Dahl's law",
    "dh/dt = rate*(qd - |qd|*h)",
    "P. R. Dahl, Solid friction damping of mechanical vibrations, AIAA J. 14 (1976); with viscous for dampers: "
    "F. Ikhouane, S. J. Dyke, Smart Mater. Struct. 16 (2007)",
    dahl_law,
    rate("rate", "1/rad", -1, (1.0, 4.0, 16.0, 64.0, 300.0), "q"),
)
