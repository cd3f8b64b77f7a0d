"""The paper's results as data, table by table, and what follows from its energy figures alone.

The only place where they are typed. Spreads are sample standard deviations as the paper gives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

GRAVITY = 9.81
"""[m/s^2]"""


@dataclass(frozen=True, kw_only=True)
class PaperValue:
    """One figure of the paper."""

    mean: float
    sd: float | None = None
    """Sample standard deviation; None where the paper gives none."""
    n: int | None = None
    """Trials or training seeds that it is over; None where the paper does not say."""


TRAJECTORIES, SEEDS, IMPACTS, WALKS = 10, 3, 10, 3
"""Repetitions behind the paper's spreads: unseen trajectories of figure 4 (section 6.1), training seeds of tables 2 and
3 (section 6.2), impacts of the hardware (section 6.3, table 5), walks and missions (table 6, figure 10)."""


def _over(n: int | None) -> Callable[[float, float], PaperValue]:
    return lambda mean, sd: PaperValue(mean=mean, sd=sd, n=n)


_m = _over(TRAJECTORIES)


FIGURE_4 = {
    "mlp": {1.0: _m(0.802, 0.503), 1.2: _m(0.802, 0.349), 1.5: _m(0.876, 0.244)},
    "bouc_wen": {1.0: _m(0.423, 0.268), 1.2: _m(0.640, 0.421), 1.5: _m(0.777, 0.474)},
    "lstm": {1.0: _m(0.429, 0.166), 1.2: _m(0.519, 0.299), 1.5: _m(0.662, 0.377)},
    "pg_rlstm": {1.0: _m(0.292, 0.181), 1.2: _m(0.422, 0.223), 1.5: _m(0.350, 0.199)},
}
"""RMSE of the predicted torque [N·m] by model and current [A] over ten unseen trajectories, section 6.1."""

FIGURE_4_AVERAGE = 0.355
"""Average RMSE of PG-RLSTM [N·m], section 6.1."""

HOLDING_CAPACITY = 26.15
"""Pre-yield braking torque at 1.5 A [N·m], section 2.2; eq. 18 gives another."""

FIGURE_4_REDUCTION = {"bouc_wen": 0.421, "lstm": 0.339, "mlp": 0.571}
"""Reduction of the average RMSE by PG-RLSTM relative to each other model, section 6.1."""

_m = _over(SEEDS)

TABLE_2 = {
    "A": {"v_x_rmse": _m(0.1062, 0.0077), "v_x_bias": _m(0.0779, 0.0122), "height": _m(0.3280, 0.0006)},
    "B": {"v_x_rmse": _m(0.1020, 0.0149), "v_x_bias": _m(0.0908, 0.0136), "height": _m(0.3285, 0.0015)},
    "C": {"v_x_rmse": _m(0.0642, 0.0057), "v_x_bias": _m(0.0098, 0.0110), "height": _m(0.3323, 0.0002)},
    "D": {"v_x_rmse": _m(0.0708, 0.0026), "v_x_bias": _m(-0.0150, 0.0058), "height": _m(0.3337, 0.0008)},
}
"""Forward tracking [m/s] and mean CoM height [m] at 0.5 m/s: A, B conventional, C, D actuator-aware; SAL on in B, D."""

TABLE_3 = {
    "mlp": {"v_x_rmse": _m(0.0851, 0.0071), "v_x_bias": _m(-0.0352, 0.0049), "height_rmse": _m(0.0143, 0.0004),
            "tilt_rms": _m(0.7237, 0.3241), "yaw_rate_rmse": _m(0.2602, 0.0194)},
    "bouc_wen": {"v_x_rmse": _m(0.0713, 0.0075), "v_x_bias": _m(-0.0351, 0.0048), "height_rmse": _m(0.0139, 0.0002),
                 "tilt_rms": _m(0.6706, 0.2919), "yaw_rate_rmse": _m(0.2581, 0.0033)},
    "lstm": {"v_x_rmse": _m(0.0703, 0.0072), "v_x_bias": _m(-0.0307, 0.0045), "height_rmse": _m(0.0143, 0.0005),
             "tilt_rms": _m(0.6043, 0.2223), "yaw_rate_rmse": _m(0.2524, 0.0052)},
    "pg_rlstm": {"v_x_rmse": _m(0.0606, 0.0075), "v_x_bias": _m(-0.0265, 0.0053), "height_rmse": _m(0.0134, 0.0005),
                 "tilt_rms": _m(0.5177, 0.3041), "yaw_rate_rmse": _m(0.2203, 0.0045)},
}  # fmt: skip
"""By the actuator model in training, at 0.5 m/s: [m/s], [m/s], [m], [deg], [rad/s]."""

_m, _pushed = _over(IMPACTS), _over(None)

TABLE_4 = {
    "hardware": {
        0.0: {"min_height": _m(0.1932, 0.0054), "peak_down_velocity": _m(-0.6626, 0.1647)},
        0.5: {"min_height": _m(0.1970, 0.0031), "peak_down_velocity": _m(-0.5957, 0.1673)},
        1.0: {"min_height": _m(0.2117, 0.0071), "peak_down_velocity": _m(-0.4427, 0.1276)},
        1.5: {"min_height": _m(0.2209, 0.0094), "peak_down_velocity": _m(-0.4279, 0.1008)},
    },
    "simulation": {
        0.0: {"min_height": _pushed(0.1851, 0.0011), "peak_down_velocity": _pushed(-0.7392, 0.0147)},
        0.5: {"min_height": _pushed(0.2030, 0.0005), "peak_down_velocity": _pushed(-0.6600, 0.0046)},
        1.0: {"min_height": _pushed(0.2072, 0.0003), "peak_down_velocity": _pushed(-0.6348, 0.0037)},
        1.5: {"min_height": _pushed(0.2124, 0.0009), "peak_down_velocity": _pushed(-0.5964, 0.0174)},
    },
}
"""Minimum CoM height [m] and peak downward velocity [m/s] by current [A]."""

IMPACT_CHANGE = {"min_height": {"push": 14.7, "drop": 14.3}, "peak_down_velocity": {"push": -19.3, "drop": -35.4}}
"""Change from 0 to 1.5 A [%], simulation (push) and hardware (drop), abstract."""

FIGURE_6_PUSH = {
    "FL": {"mean": 12.073, "peak": 23.015, "mean_change": -0.067, "peak_change": -0.145},
    "RR": {"mean": 17.266, "peak": 18.641, "mean_change": -0.029, "peak_change": -0.068},
}
"""Simulated calf motor torque [N·m] at 1.5 A while current flows, and its change from no current, section 6.3."""

FIGURE_6_HARDWARE = {"FR": {0.0: 8.962, 1.5: 7.661}, "RL": {0.0: 10.587, 1.5: 9.149}}
"""Mean calf motor torque of one impact of the hardware [N·m] while current flows, by current [A], section 6.3."""

IMPACTOR = {"mass": 10.0, "drop": 0.30, "speed": 1.5, "travel": 0.05, "window": 0.1}
"""The guided mass [kg], its fall [m], its speed at the contact [m/s], the depth to which it follows the robot [m], and
the time over which torques and accelerations are averaged [s], section 6.3."""

PUSH_FORCE = 100.0
"""Simulated push on the trunk, downward [N], section 6.3; its duration is not stated."""

FIGURE_7 = {
    "FR": {0.0: _m(18.73, 1.41), 1.5: _m(16.03, 1.52)},
    "RL": {0.0: _m(16.93, 1.76), 1.5: _m(13.52, 1.69)},
}
"""Mean calf motor torque of the hardware over 0.1 s [N·m] by current [A], section 6.3."""

TABLE_5 = {
    "A": {"acceleration": _m(5.216, 1.474), "FR": _m(20.84, 1.29), "RL": _m(17.98, 1.05)},
    "B": {"acceleration": _m(1.681, 1.668), "FR": _m(17.51, 1.84), "RL": _m(15.27, 1.23)},
    "C": {"acceleration": _m(4.893, 1.219), "FR": _m(18.73, 1.41), "RL": _m(16.93, 1.76)},
    "D": {"acceleration": _m(0.852, 1.372), "FR": _m(16.03, 1.52), "RL": _m(13.52, 1.69)},
}
"""Hardware over 0.1 s of the impact: mean |a_z - g| [m/s^2] and mean calf motor torques [N·m]."""

THRESHOLDS: dict[str, dict[str, tuple[float, float]]] = {
    "f_th": {"drop": (13.47, 15.25), "motor": (10.20, 10.50)},
    "eps_e": {"drop": (15.33, 12.61), "motor": (10.32, 8.82)},
    "eps_v": {"drop": (16.25, 13.19)},
}
"""Reductions of CoM drop and motor torque [%] over each threshold's range, section 3.2 (first to last value)."""

FASTEST = 0.6
"""Largest speed that the 1.5 Hz gait reaches reliably [m/s], section 7."""

ROBOTS = ("go1", "mr_go", "mr_go_sal")
"""Go1 has no MR devices; MR_Go carries them with SAL off; MR_Go-SAL has SAL on."""

NAMES = {"go1": "Go1", "mr_go": "MR_Go", "mr_go_sal": "MR_Go-SAL"}
"""As the paper writes them."""

MASS = {"go1": 12.0, "mr_go": 12.6, "mr_go_sal": 12.6}
"""Without payload [kg], section 6.4."""


@dataclass(frozen=True, kw_only=True)
class CotRow:
    """One row of table 6."""

    robot: str
    payload: float
    """[kg]"""
    command: float
    """Commanded speed [m/s]."""
    speed: float
    """Mean measured speed [m/s]."""
    cot: float
    """[1]"""
    sd: float
    """Sample standard deviation over three runs [1]."""

    @property
    def power(self) -> float:
        """Battery power that eq. 21 implies [W]."""
        return self.cot * (MASS[self.robot] + self.payload) * GRAVITY * self.speed

    @property
    def power_sd(self) -> float:
        """Its standard deviation if the speed were exact [W]."""
        return self.power * self.sd / self.cot


_TABLE_6 = {
    "go1": (
        (0, 0.3, 0.28, 4.297, 0.050),
        (0, 0.5, 0.49, 2.807, 0.054),
        (3, 0.3, 0.31, 4.249, 0.058),
        (3, 0.5, 0.53, 2.687, 0.055),
    ),
    "mr_go": (
        (0, 0.3, 0.27, 4.323, 0.070),
        (0, 0.5, 0.48, 2.695, 0.044),
        (3, 0.3, 0.32, 4.109, 0.115),
        (3, 0.5, 0.52, 2.976, 0.054),
    ),
    "mr_go_sal": (
        (0, 0.3, 0.26, 3.450, 0.060),
        (0, 0.5, 0.48, 2.121, 0.056),
        (3, 0.3, 0.33, 3.065, 0.044),
        (3, 0.5, 0.52, 2.235, 0.033),
    ),
}

TABLE_6: dict[tuple[str, float, float], CotRow] = {
    (robot, payload, command): CotRow(robot=robot, payload=payload, command=command, speed=speed, cot=cot, sd=sd)
    for robot, rows in _TABLE_6.items()
    for payload, command, speed, cot, sd in rows
}
"""Cost of transport by robot, payload [kg] and commanded speed [m/s]."""


def cot_reduction(payload: float, command: float) -> tuple[float, float]:
    """Reduction of the cost of transport by SAL against MR_Go [1], and its standard deviation, that of a ratio."""
    off, on = (TABLE_6[robot, payload, command] for robot in ("mr_go", "mr_go_sal"))
    return 1.0 - on.cot / off.cot, math.hypot(on.sd / off.cot, off.sd * on.cot / off.cot**2)


MEASURED_SPEED = {key: row.speed for key, row in TABLE_6.items()}
"""Mean speed that the paper measured in each row of table 6 [m/s], where it had commanded 0.3 or 0.5 m/s."""

COT_REDUCTION = (0.202, 0.254)
"""Least and largest reduction of the cost of transport by SAL against MR_Go over the four conditions [1], abstract."""

TABLE_7: dict[tuple[float, float], dict[str, float]] = {
    (0, 0.3): {"hardware": 0.2735, "simulation": 0.2228},
    (0, 0.5): {"hardware": 0.2020, "simulation": 0.1943},
    (3, 0.3): {"hardware": 0.3134, "simulation": 0.2640},
    (3, 0.5): {"hardware": 0.2606, "simulation": 0.2135},
}
"""Share of time with the holding gate open, mean over the calves, by payload and commanded speed."""

MISSION_POWER = {
    "go1": {"outbound": 189.9, "standby": 92.0, "return": 194.8},
    "mr_go": {"outbound": 198.3, "standby": 52.2, "return": 208.7},
    "mr_go_sal": {"outbound": 143.0, "standby": 51.8, "return": 152.4},
}
"""Mean power per phase [W], figure 10(b)."""

MISSION_DEPLETION = {"go1": (64.7, 1.2), "mr_go": (59.3, 1.5), "mr_go_sal": (52.5, 2.0)}
"""State-of-charge depletion, mean and SD [percentage points], figure 10(c)."""

MISSION_RISE = {
    "go1": {"calf_walking": 19.75, "calf_standby": 4.50, "all": 16.25},
    "mr_go": {"calf_walking": 22.25, "calf_standby": -0.25, "all": 15.17},
    "mr_go_sal": {"calf_walking": 11.50, "calf_standby": -1.00, "all": 13.00},
}
"""Temperature rise [K]: calf motors over both walks, over the standby, and all twelve over the task, figure 11."""

DISTANCE = 150.0
"""One way [m]."""

STANDBY = 600.0
"""Time of standing collection [s]."""


def condition_name(payload: float, command: float) -> str:
    """As every table names a condition: load on the back [kg] and commanded speed [m/s]."""
    return f"{payload:g} kg, {command:g} m/s"


def arm_load() -> float:
    """Load on the way out [kg] that Go1's own rows imply.

    The robots carry an arm, whose mass the paper does not state. At 0.3 m/s table 6 has Go1 at 141.6 W without
    payload and at 193.8 W with 3 kg; its 189.9 W on the way out lie between, linearly at 2.8 kg. Its 194.8 W on
    the way back equal the row with 3 kg, so that arm and item together are the 3 kg.
    """
    empty, loaded = (TABLE_6["go1", payload, 0.3].power for payload in (0, 3))
    return 3.0 * (MISSION_POWER["go1"]["outbound"] - empty) / (loaded - empty)


def proximal_rise(robot: str) -> float:
    """Mean rise of the eight hip and thigh motors over the task [K], from the calves' and all motors' means."""
    rise = MISSION_RISE[robot]
    return (12.0 * rise["all"] - 4.0 * (rise["calf_walking"] + rise["calf_standby"])) / 8.0
