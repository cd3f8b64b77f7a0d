"""Battery: state of charge from the power drawn, with the loss in the battery itself.

A linear gauge on energy. At the terminals' power P and nominal voltage V with internal resistance R the current is
``I = (V - sqrt(V^2 - 4 R P))/(2 R)``, so the cells give ``V*I = P + R*I^2``; the state of charge falls by
``V*I*t/capacity``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.params import ParamGroup, param

CALIBRATED = ("capacity",)
"""Field of :class:`BatteryCfg` that is fitted to Go1's depletion; the others are assumed."""


NAME_PLATE = 129.6
"""Energy on Go1's name plate [W·h]: 21.6 V x 6 Ah, as usually quoted."""


@dataclass(frozen=True, kw_only=True)
class BatteryCfg(ParamGroup):
    """Numbers of the battery."""

    capacity: float = param(
        105.3, "W·h", 1.0, 1e4,
        "calibrated on Go1's depletion of section 6.5, `mrwarp mission --calibrate`; name plate 21.6 V x 6 Ah = "
        f"{NAME_PLATE:g} W·h, as usually quoted for Go1",
        "Energy between full and empty on the gauge.",
    )  # fmt: skip
    voltage: float = param(21.6, "V", 1.0, 1000.0, "Go1: six cells of 3.6 V", "Nominal voltage.")
    resistance: float = param(
        0.06, "Ohm", 0.0, 1.0, "assumed: six cells of about 10 mOhm; 0.03 to 0.15", "Internal resistance."
    )


class BatteryError(ValueError):
    """More power is asked for than the battery can give."""


def cell_power(power: np.ndarray | float, cfg: BatteryCfg) -> np.ndarray:
    """Power that the cells give for a power at the terminals [W].

    Raises:
        BatteryError: ``power`` exceeds the most the battery can give, V^2/(4 R).
    """
    power = np.asarray(power, dtype=float)
    if cfg.resistance == 0.0:
        return power
    rest = cfg.voltage**2 - 4.0 * cfg.resistance * power
    if np.any(rest < 0.0):
        most = cfg.voltage**2 / (4.0 * cfg.resistance)
        raise BatteryError(f"{power.max():g} W asked of a battery that gives at most {most:g} W")
    return cfg.voltage * (cfg.voltage - np.sqrt(rest)) / (2.0 * cfg.resistance)


def depletion(power: np.ndarray | float, seconds: np.ndarray | float, cfg: BatteryCfg) -> np.ndarray:
    """Fall of the state of charge [percentage points] by a power [W] over a time [s]."""
    return 100.0 * cell_power(power, cfg) * seconds / 3600.0 / cfg.capacity
