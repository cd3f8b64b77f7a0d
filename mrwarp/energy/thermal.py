"""Temperatures: winding and housing of every motor, and the fluid of every MR device.

    C_w dT_w/dt = P_copper - (T_w - T_h)/R_wh
    C_h dT_h/dt = (T_w - T_h)/R_wh - (T_h - T_a)/R_ha
    C_f dT_f/dt = P_coil + P_friction - (T_f - T_a)/R_fa

with T_a the ambient temperature. Constant losses are stepped exactly, by the matrix exponential. The devices sit at the
knee, the calf motors at the hip end of the thigh: no heat flows between them. What the robot's software reports as a
motor's temperature is taken to be the housing's, where the drive's sensor sits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.optimize import least_squares

from mrwarp.params import ParamGroup, param


@dataclass(frozen=True, kw_only=True)
class ThermalCfg(ParamGroup):
    """Numbers of the thermal model."""

    winding_capacity: float = param(
        35.0, "J/K", 1.0, 1e4, "Mini Cheetah's public motor code: 1/0.02825 to 1/0.03125", "Heat capacity C_w."
    )
    winding_resistance: float = param(
        1.25, "K/W", 1e-3, 1e3, "Mini Cheetah's public motor code", "From winding to housing, R_wh."
    )
    housing_capacity: float = param(
        1170.0,
        "J/K",
        1.0,
        1e5,
        "calibrated on Go1's temperature rises of section 6.5, `mrwarp mission --calibrate`",
        "Heat capacity C_h of the housing and what warms up with it; the motor alone, 0.53 kg, has about 300.",
    )
    housing_resistance: float = param(
        7.436,
        "K/W",
        1e-3,
        1e6,
        "calibrated on Go1's temperature rises of section 6.5, `mrwarp mission --calibrate`",
        "From housing to air, R_ha.",
    )
    fluid_capacity: float = param(
        65.0, "J/K", 1.0, 1e4, "assumed: 0.14 kg device (asset) of steel at 460 J/(kg·K)", "Heat capacity C_f."
    )
    fluid_resistance: float = param(
        8.0, "K/W", 1e-3, 1e4, "assumed: 0.008 m2 of surface at 15 W/(m2·K); 4 to 15", "From fluid to air, R_fa."
    )
    yield_coefficient: float = param(
        0.002,
        "1/K",
        0.0,
        0.05,
        "assumed: MR fluids lose 5 to 20 % from 20 to 80 degC; 0.001 to 0.004",
        "Relative loss of yield stress per kelvin of the fluid.",
    )
    viscosity_coefficient: float = param(
        0.02,
        "1/K",
        0.0,
        0.2,
        "assumed: oil-based fluids halve over 30 to 40 K; 0.01 to 0.03",
        "Exponential loss of viscosity per kelvin of the fluid.",
    )


@dataclass(frozen=True, kw_only=True)
class Temperatures:
    """Temperatures above ambient [K]; leading axes are free."""

    winding: np.ndarray
    """Shape (..., J)."""
    housing: np.ndarray
    """Shape (..., J)."""
    fluid: np.ndarray
    """Shape (..., M)."""

    @classmethod
    def ambient(cls, lead: tuple[int, ...], joints: int, devices: int) -> Temperatures:
        """Everything at the temperature of the air."""
        return cls(
            winding=np.zeros((*lead, joints)), housing=np.zeros((*lead, joints)), fluid=np.zeros((*lead, devices))
        )


def step(
    now: Temperatures, motor_loss: np.ndarray, device_loss: np.ndarray, seconds: np.ndarray | float, cfg: ThermalCfg
) -> Temperatures:
    """Temperatures after constant losses, exactly.

    Args:
        now: Temperatures at the start.
        motor_loss: Heat in the windings [W], shape (..., J).
        device_loss: Heat in the devices [W], shape (..., M).
        seconds: Duration [s], a number or shape (...).
        cfg: The numbers.
    """
    # final state: all heat goes through both resistances
    end_h = motor_loss * cfg.housing_resistance
    end_w = end_h + motor_loss * cfg.winding_resistance
    w, h = now.winding - end_w, now.housing - end_h
    flow, loss = 1.0 / cfg.winding_resistance, 1.0 / cfg.housing_resistance
    rates = np.array([[-flow, flow], [flow, -(flow + loss)]]) / [[cfg.winding_capacity], [cfg.housing_capacity]]
    time = np.asarray(seconds)[..., None]
    matrix = linalg.expm(rates * time[..., None])
    (ww, wh), (hw, hh) = ([matrix[..., i, j, None] for j in (0, 1)] for i in (0, 1))
    end_f = device_loss * cfg.fluid_resistance
    decay = np.exp(-time / (cfg.fluid_resistance * cfg.fluid_capacity))
    return Temperatures(
        winding=end_w + ww * w + wh * h, housing=end_h + hw * w + hh * h, fluid=end_f + decay * (now.fluid - end_f)
    )


def derated(fluid: np.ndarray, cfg: ThermalCfg) -> tuple[np.ndarray, np.ndarray]:
    """Factors on yield torque and on viscous torque of devices whose fluid is so much above ambient [K]."""
    return np.maximum(1.0 - cfg.yield_coefficient * fluid, 0.0), np.exp(-cfg.viscosity_coefficient * fluid)


def calibrate(
    motor_loss: Mapping[str, np.ndarray],
    seconds: Mapping[str, float],
    measured: Mapping[str, float],
    calves: Sequence[int],
    cfg: ThermalCfg,
) -> tuple[ThermalCfg, dict[str, float]]:
    """Housing capacity and resistance that give the calves' measured rises, by bounded least squares.

    Args:
        motor_loss: Heat per motor [W] in the phases of a mission, each of shape (J,).
        seconds: Duration of each phase [s].
        measured: ``calf_walking`` and ``calf_standby``, see :func:`calf_rises` [K].
        calves: Columns of the calves.
        cfg: Other numbers and the start.

    Returns:
        The numbers, and the rises that they give.
    """
    names = ("housing_capacity", "housing_resistance")

    def at(x: np.ndarray) -> ThermalCfg:
        """Numbers at the logarithms of capacity and resistance."""
        return replace(cfg, **dict(zip(names, np.exp(x).tolist(), strict=True)))

    def mismatch(x: np.ndarray) -> list[float]:
        return [rise - measured[name] for name, rise in calf_rises(motor_loss, seconds, calves, at(x)).items()]

    bounds = np.log([[50.0, 0.5], [1e4, 1e3]])
    begin = np.clip(np.log([getattr(cfg, name) for name in names]), *bounds)
    fitted = at(least_squares(mismatch, begin, bounds=tuple(bounds)).x)
    return fitted, calf_rises(motor_loss, seconds, calves, fitted)


def calf_rises(
    motor_loss: Mapping[str, np.ndarray], seconds: Mapping[str, float], calves: Sequence[int], cfg: ThermalCfg
) -> dict[str, float]:
    """Mean rises of the calves [K] as in figure 11, over phases one after the other from ambient.

    Returns:
        ``calf_walking``, over all phases but the standby, and ``calf_standby``.
    """
    rises = {"calf_walking": 0.0, "calf_standby": 0.0}
    now = Temperatures.ambient((), len(next(iter(motor_loss.values()))), 0)
    for name, loss in motor_loss.items():
        after = step(now, loss, np.zeros(0), seconds[name], cfg)
        change = float((after.housing - now.housing)[list(calves)].mean())
        rises["calf_standby" if name == "standby" else "calf_walking"] += change
        now = after
    return rises
