"""Coils and magnetorheological devices of joints."""

from __future__ import annotations

from mrwarp.robot_logs.causes.cause import Cause, Shown
from mrwarp.robot_logs.causes.edits import UsdEdit
from mrwarp.robot_logs.causes.places import Place

SWEPT = Shown("turn the joint at several speeds with the devices switched on", {"chirp": 15.0})


def _there(at: Place) -> bool:
    return at.device


def _says_coil(share: float, _: str) -> str:
    percent = max(100.0 * share, 0.0)
    return f"coil {'dead' if percent < 10.0 else 'weak'}, {percent:.0f} % of its current"


def _usd_coil(edit: UsdEdit, j: int, x: float) -> None:
    """A coil that gets a share of its current: the laws' numbers per ampere; without any the device holds nothing."""
    drive, share = edit.drive(j), max(1.0 + x, 0.0)
    factors = {"K1": share, "I1": share, **({"T_max": 0.0} if share < 0.05 else {"K": 1.0 / share})}
    for name, factor in factors.items():
        attribute = drive.GetAttribute(f"newton:mr:{name}")
        attribute.Set(max(attribute.Get() * factor, 1e-6) if name == "T_max" else attribute.Get() * factor)


def _usd_lag(edit: UsdEdit, j: int, x: float) -> None:
    lag = edit.drive(j).GetAttribute("newton:mr:coil_time_constant")
    lag.Set(lag.Get() + x)


CAUSES = (
    Cause(
        name="coil_dead",
        title="coil dead",
        field="coil",
        place="joint",
        there=_there,
        number="current_share",
        unit="1",
        step=0.2,
        spread=0.02,
        least=0.5,
        fault=1.0,
        nominal=1.0,
        lowest=-1.3,
        highest=0.0,
        change="relative",
        least_share=0.0,
        shared=True,
        needs_current=True,
        shown=Shown("walk with the devices switched on", {"walk": 10.0}),
        shown_by_arm=SWEPT,
        says=_says_coil,
        usd=_usd_coil,
    ),
    Cause(
        name="coil_lag",
        title="coil lag",
        field="coil_lag",
        place="joint",
        there=_there,
        number="time_constant",
        unit="s",
        step=0.004,
        spread=0.001,
        least=0.003,
        fault=0.02,
        lowest=0.0,
        shared=True,
        needs_current=True,
        shown=Shown("walk with the devices switched on and the coils' current in the log", {"walk": 10.0}),
        shown_by_arm=Shown("sweep the joint with changing currents of the devices, and log them", {"chirp": 15.0}),
        usd=_usd_lag,
    ),
    Cause(
        name="device_strength",
        title="device strength",
        field="device",
        place="joint",
        there=_there,
        number="factor",
        unit="1",
        step=0.1,
        spread=0.03,
        least=0.06,
        fault=0.3,
        nominal=1.0,
        lowest=-0.95,
        change="relative",
        shared=True,
        needs_current=True,
        shown=Shown("walk with the devices switched on", {"walk": 20.0}),
        shown_by_arm=SWEPT,
        usd=lambda edit, j, x: edit.scale_drive(j, ("K1", "T_max"), 1.0 + x),
    ),
    Cause(
        name="device_drag",
        title="device drag",
        field="drag",
        place="joint",
        there=_there,
        number="torque",
        unit="N·m",
        mechanical=True,
        step=-0.2,
        spread=0.05,
        least=0.1,
        fault=0.5,
        highest=0.0,  # more drag than described is dry friction as any other, which looks like it
        shared=True,
        shown=Shown("turn the joint slowly with the device and then without it", {"slow": 10.0}),
        rubs="frictionloss",
    ),
)
