"""A picture of what each number of eqs. 14, 15 and 18 does: the loop or the holding curve with less and more of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.model_file import Model
from mrwarp.params import MrParams, with_unit
from mrwarp.runtime import panels

DT, AMPLITUDE, FREQUENCY = 0.005, 0.4, 1.0
"""Step [s], amplitude [rad] and frequency [Hz] of the motion that is drawn."""

ADDED = ("D", "B", "C", "I1")
"""Numbers of terms that add to the torque: each is changed until its term is a third of the loop's half height."""

LOOP = (*ADDED, "K0", "K1", "alpha", "beta", "gamma")
"""Numbers of eqs. 14 and 15."""

HOLDING = ("T_max", "K", "n")
"""Numbers of eq. 18."""


def number_picture(model: Model, path: Path, name: str) -> Path:
    """Draw a panel for each number, with the device's own value and with a smaller and a larger one.

    Beta and gamma change by half of their sum, which keeps it above 0; the others but :data:`ADDED` are halved and
    doubled. K0 is drawn without current, all else with the largest.

    Args:
        model: The device.
        path: PNG file to write.
        name: Name of the device, for the title.

    Raises:
        ModelFileError: the model is not in rad, A and N·m.
    """
    params = model.to_params().alone()
    plain, top = params.replace(D=0.0, C=0.0, I1=0.0), params.coil.current_max
    height = float(np.abs(loop(plain, top)[1]).max())
    figure, axes = panels((11, 8.2), 3, 4)
    for axis, number in zip(axes.flat, (*LOOP, *HOLDING), strict=True):
        for value, colour in zip(around(params, number, height), ("C0", "0.25", "C3"), strict=True):
            changed = params.replace(**{number: value})
            label = f"{value:.3g}{with_unit(MrParams.spec(number).unit)}"
            if number in HOLDING:
                current = np.linspace(0.0, top, 60)
                axis.plot(current, changed.hold.yield_torque(current), color=colour, lw=1.2, label=label)
            else:
                q, torque = loop(changed, 0.0 if number == "K0" else top)
                axis.plot(q, torque, color=colour, lw=1.2, label=label)
        _labels(axis, number, top)
    figure.suptitle(f"{name}: each number with less (blue) and more (red) of it, its own value in grey", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    return path


def around(params: MrParams, number: str, height: float) -> tuple[float, float, float]:
    """A smaller value of a number, its own and a larger one.

    Args:
        params: The device.
        number: Name of the number.
        height: Half height of its loop without the terms that add [N·m].
    """
    own, top = params.to_dict()[number], params.coil.current_max
    per_unit = {"D": 1.0, "B": 2.0 * np.pi * FREQUENCY * AMPLITUDE, "C": AMPLITUDE, "I1": top}
    if number in ADDED:
        step = height / 3.0 / per_unit[number]
        return max(own - step, MrParams.spec(number).low), own, own + step
    if number in ("beta", "gamma"):
        step = 0.5 / params.bouc_wen.z_bound
        return own - step, own, own + step
    return 0.5 * own, own, 2.0 * own


def loop(params: MrParams, current: float) -> tuple[np.ndarray, np.ndarray]:
    """Angle [rad] and torque [N·m] of the second of two periods of a sine at one current [A]."""
    joint = JointBatch(params, dt=DT)
    phase = 2.0 * np.pi * FREQUENCY * DT * np.arange(round(2.0 / FREQUENCY / DT) + 1)
    q, qd = AMPLITUDE * np.sin(phase), 2.0 * np.pi * FREQUENCY * AMPLITUDE * np.cos(phase)
    torque = np.array([joint.step(a, b, current)[0] for a, b in zip(q, qd, strict=True)])
    half = len(q) // 2
    return q[half:], torque[half:]


def _labels(axis: Axes, number: str, top: float) -> None:
    at = "holding, eq. 18" if number in HOLDING else f"loop at {0.0 if number == 'K0' else top:g} A"
    axis.set_title(f"{number}: {at}", fontsize=9)
    axis.set_xlabel("current [A]" if number in HOLDING else "angle [rad]", fontsize=8)
    axis.set_ylabel("torque [N·m]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.legend(fontsize=6.5)
