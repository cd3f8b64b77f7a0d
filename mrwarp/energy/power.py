"""Power at the battery's terminals, and the battery's state of charge.

The power is electronics + copper loss + drive friction + mechanical power + coils + current controllers.

Per joint, with the motor's torque ``tau`` and mechanical power ``tau*qd`` at the joint:

    copper         = 3/2 R (tau/(g Kt))^2         three-phase winding, peak phase current, g = extra gear of the calf
    drive_friction = tau_f <|qd|>                 loss of motor and gear by turning, at any load
    mechanical     = <(tau*qd)+>/eta              what the motor drives, through a gear of efficiency eta
    regenerated    = rho*eta*<(tau*qd)->          what the joint gives back; rho = share that reaches the supply

and over the robot ``P = electronics + sum(copper + drive_friction + mechanical - regenerated) + coil/eta_coil
+ idle controllers``.

Validity: means over many strides. What one joint gives back feeds the others, so the battery itself is not charged
as long as the sum stays positive.

The state of charge is a linear gauge on energy. With nominal voltage V and internal resistance R_i the current at the
terminals' power P is ``I = (V - sqrt(V^2 - 4 R_i P))/(2 R_i)``, so the cells give ``V*I = P + R_i*I^2``; the state of
charge falls by ``V*I*t/capacity``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from mrwarp.paper import GRAVITY
from mrwarp.params import ParamGroup, param
from mrwarp.usd.robot import CALF_COLUMNS

NAME_PLATE = 129.6
"""Energy on Go1's name plate [W·h]: 21.6 V x 6 Ah, as usually quoted."""

GO1_LIMIT = 23.7
"""Torque limit of Go1's hips and thighs, whose motors the model was calibrated on [N·m]; its calves' have the same
motor behind another gear. Source: unitree_go1 of MuJoCo Menagerie."""


@dataclass(frozen=True, kw_only=True)
class ElectricalCfg(ParamGroup):
    """Numbers of the electrical model. Only ``winding_resistance/torque_constant**2`` acts, not each of the two."""

    electronics: float = param(
        34.0,
        "W",
        0.0,
        200.0,
        "calibrated on Go1: table 6 and its standby power, `mrwarp walk --calibrate`",
        "Computers, sensors and drives while the motors give no torque.",
    )
    winding_resistance: float = param(
        0.256,
        "Ohm",
        0.0,
        2.0,
        "calibrated on Go1: table 6 and its standby power, `mrwarp walk --calibrate`; a public motor of this size "
        "(Mini Cheetah's code) has 0.105 to 0.13: trained gaits load the motors less than the real robot's seems to",
        "Phase resistance of a motor with its drive, as if all that grows with torque squared were copper loss.",
    )
    drive_friction: float = param(
        1.75,
        "N·m",
        0.0,
        10.0,
        "calibrated on Go1: table 6 and its standby power, `mrwarp walk --calibrate`; MuJoCo Menagerie's Go1 has "
        "0.2, and a damping of 1 to 2 N·m·s/rad that is in part its controllers'",
        "Torque tau_f at the joint that motor and gear lose by turning: friction, iron, and every other loss of the "
        "drive that grows with motion and not with load.",
    )
    torque_constant: float = param(
        0.639,
        "N·m/A",
        0.45,
        0.75,
        "maker's figure of the GO-M8010-6 behind its gear, as usually quoted; Mini Cheetah's code: 0.45",
        "Torque at hip and thigh per ampere of peak phase current.",
    )
    calf_gear: float = param(
        1.5,
        "1",
        1.0,
        1.6,
        "torque limits of the public Go1 description: 35.55/23.7 N·m",
        "Extra gear ratio of the calf.",
    )
    gear_efficiency: float = param(
        0.9, "1", 0.75, 0.98, "assumed: one planetary stage, 0.85 to 0.95", "Efficiency eta of the gears, both ways."
    )
    regeneration: float = param(
        1.0,
        "1",
        0.0,
        1.0,
        "assumed: four-quadrant drives on one supply; 0 = a diode blocks it",
        "Share rho of the returned power that other loads use.",
    )
    coil_efficiency: float = param(
        0.85, "1", 0.5, 1.0, "assumed: small step-down converter, 0.8 to 0.95", "Efficiency of the current controllers."
    )
    controller_idle: float = param(
        0.25,
        "W",
        0.0,
        2.0,
        "assumed: microcontroller and driver at 5 V, 0.1 to 1 W",
        "What each of the four current controllers draws without current.",
    )
    copper_coefficient: float = param(
        0.00393, "1/K", 0.0, 0.01, "copper, handbooks", "Rise of the winding resistance per kelvin."
    )


@dataclass(frozen=True, kw_only=True)
class JointLoad:
    """Means of a robot's joints over a time; leading axes are free, J = 12 joints, M devices (0 without)."""

    torque_square: np.ndarray
    """Motor torque squared [(N·m)^2], shape (..., J)."""
    speed: np.ndarray
    """Mean of the joint speed's magnitude [rad/s], shape (..., J)."""
    work_out: np.ndarray
    """Positive part of the motors' mechanical power [W], shape (..., J)."""
    work_in: np.ndarray
    """Negative part, as a positive number [W], shape (..., J)."""
    coil: np.ndarray
    """Loss R*I^2 of the coils [W], shape (..., M)."""
    friction: np.ndarray
    """Power the devices turn into heat [W], shape (..., M)."""

    def mean(self) -> JointLoad:
        """Mean over the first axis."""
        return JointLoad(**{f.name: getattr(self, f.name).mean(axis=0) for f in fields(self)})

    def __getitem__(self, index: object) -> JointLoad:
        """Loads at an index into the leading axes."""
        return JointLoad(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


@dataclass(frozen=True, kw_only=True)
class Power:
    """Where the battery's power goes [W]; every part has the leading axes of the :class:`JointLoad` it came from."""

    electronics: np.ndarray
    copper: np.ndarray
    drive_friction: np.ndarray
    mechanical: np.ndarray
    regenerated: np.ndarray
    """Negative: what comes back."""
    coil: np.ndarray
    """Coils with the losses of their controllers."""
    controllers: np.ndarray
    """Controllers without current."""

    @property
    def total(self) -> np.ndarray:
        """Power at the battery's terminals [W]."""
        return sum(self.parts().values(), start=np.zeros(()))

    def parts(self) -> dict[str, np.ndarray]:
        """All parts by name [W]."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def copper_factor(cfg: ElectricalCfg, rise: np.ndarray | float = 0.0, joints: int = 12) -> np.ndarray:
    """Copper loss per torque squared of every joint [W/(N·m)^2], shape (..., J).

    ``rise``: temperature of the windings above that of the calibration [K], broadcast to (..., J). The calves' extra
    gear counts where there are 12 joints, as on the shipped robot.
    """
    gear = np.ones(joints)
    if joints == 12:
        gear[list(CALF_COLUMNS)] = cfg.calf_gear
    warm = 1.0 + cfg.copper_coefficient * np.asarray(rise)
    return 1.5 * cfg.winding_resistance * warm / (gear * cfg.torque_constant) ** 2


def copper_as_go1(limits: np.ndarray, power: float, cfg: ElectricalCfg) -> np.ndarray:
    """Copper loss per torque squared of motors as good as Go1's [W/(N·m)^2], shape (J,).

    At its joint's torque limit each loses what Go1's does at its own, times the robot's power relative to Go1's.

    Args:
        limits: Torque limits of the joints [N·m], shape (J,).
        power: Mass times speed of the robot relative to Go1's [1].
        cfg: Numbers of Go1's motors.
    """
    return power * copper_factor(replace(cfg, calf_gear=1.0), joints=len(limits)) * (GO1_LIMIT / limits) ** 2


def copper(joints: JointLoad, cfg: ElectricalCfg, rise: np.ndarray | float = 0.0) -> np.ndarray:
    """Copper loss of every joint [W], shape (..., J)."""
    return copper_factor(cfg, rise, joints.torque_square.shape[-1]) * joints.torque_square


def motor_heat(joints: JointLoad, cfg: ElectricalCfg, rise: np.ndarray | float = 0.0) -> np.ndarray:
    """Heat in every motor with its gear, of copper and drive friction [W], shape (..., J)."""
    return copper(joints, cfg, rise) + cfg.drive_friction * joints.speed


def battery_power(joints: JointLoad, cfg: ElectricalCfg, rise: np.ndarray | float = 0.0) -> Power:
    """Mean power at the battery and its parts, see the module's equations.

    ``rise``: temperature of the windings above that of the calibration [K]; 0 is the model without feedback.
    """
    devices = joints.coil.shape[-1]
    lead = joints.torque_square.shape[:-1]
    return Power(
        electronics=np.full(lead, cfg.electronics),
        copper=copper(joints, cfg, rise).sum(-1),
        drive_friction=(cfg.drive_friction * joints.speed).sum(-1),
        mechanical=joints.work_out.sum(-1) / cfg.gear_efficiency,
        regenerated=-cfg.regeneration * cfg.gear_efficiency * joints.work_in.sum(-1),
        coil=joints.coil.sum(-1) / cfg.coil_efficiency,
        controllers=np.full(lead, devices * cfg.controller_idle),
    )


def cost_of_transport(power: np.ndarray | float, mass: np.ndarray | float, speed: np.ndarray | float) -> np.ndarray:
    """COT of eq. 21 [1]: ``P/(m g v)``; infinite for a robot that stands still or walks backwards."""
    moving = np.maximum(np.asarray(speed, dtype=float), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(power) / (mass * GRAVITY * moving)


@dataclass(frozen=True, kw_only=True)
class BatteryCfg(ParamGroup):
    """Numbers of the battery."""

    capacity: float = param(
        109.2,
        "W·h",
        1.0,
        1e4,
        "calibrated on Go1's depletion of section 6.5, `mrwarp mission --calibrate`; name plate 21.6 V x 6 Ah = "
        f"{NAME_PLATE:g} W·h, as usually quoted for Go1",
        "Energy between full and empty on the gauge.",
    )
    voltage: float = param(21.6, "V", 1.0, 1000.0, "Go1: six cells of 3.6 V", "Nominal voltage.")
    resistance: float = param(
        0.06, "Ohm", 0.0, 1.0, "assumed: six cells of about 10 mOhm; 0.03 to 0.15", "Internal resistance."
    )


def cell_power(power: np.ndarray | float, cfg: BatteryCfg) -> np.ndarray:
    """Power that the cells give for a power at the terminals [W].

    Raises:
        ValueError: ``power`` exceeds the most the battery can give, V^2/(4 R).
    """
    power = np.asarray(power, dtype=float)
    if cfg.resistance == 0.0:
        return power
    rest = cfg.voltage**2 - 4.0 * cfg.resistance * power
    if np.any(rest < 0.0):
        most = cfg.voltage**2 / (4.0 * cfg.resistance)
        raise ValueError(f"{power.max():g} W asked of a battery that gives at most {most:g} W")
    return cfg.voltage * (cfg.voltage - np.sqrt(rest)) / (2.0 * cfg.resistance)


def depletion(power: np.ndarray | float, seconds: np.ndarray | float, cfg: BatteryCfg) -> np.ndarray:
    """Fall of the state of charge [percentage points] by a power [W] over a time [s]."""
    return 100.0 * cell_power(power, cfg) * seconds / 3600.0 / cfg.capacity
