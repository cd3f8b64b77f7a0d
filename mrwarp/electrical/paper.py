"""The paper's energy figures (tables 6, 7, section 6.5) as data, and what follows from them alone."""

from __future__ import annotations

from dataclasses import dataclass

from mrwarp.electrical.power import GRAVITY

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
    "go1": ((0, 0.3, 0.28, 4.297, 0.050), (0, 0.5, 0.49, 2.807, 0.054), (3, 0.3, 0.31, 4.249, 0.058),
            (3, 0.5, 0.53, 2.687, 0.055)),
    "mr_go": ((0, 0.3, 0.27, 4.323, 0.070), (0, 0.5, 0.48, 2.695, 0.044), (3, 0.3, 0.32, 4.109, 0.115),
              (3, 0.5, 0.52, 2.976, 0.054)),
    "mr_go_sal": ((0, 0.3, 0.26, 3.450, 0.060), (0, 0.5, 0.48, 2.121, 0.056), (3, 0.3, 0.33, 3.065, 0.044),
                  (3, 0.5, 0.52, 2.235, 0.033)),
}  # fmt: skip

TABLE_6 = {
    (robot, payload, command): CotRow(robot=robot, payload=payload, command=command, speed=speed, cot=cot, sd=sd)
    for robot, rows in _TABLE_6.items()
    for payload, command, speed, cot, sd in rows
}
"""Cost of transport by robot, payload [kg] and commanded speed [m/s]."""

TABLE_7 = {
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
