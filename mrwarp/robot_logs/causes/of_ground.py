"""The ground, and how an inertial unit sits on the trunk that walks on it."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.cause import NUISANCE, Cause, Replayed, Shown
from mrwarp.robot_logs.causes.edits import MjcfEdit
from mrwarp.robot_logs.causes.places import Place

FLOORS = (-1.0, -0.5, 0.5, 1.0, 2.0, 4.0)
"""Changes of the floor that are tried, in those of a fault: feet that hardly slip or sink say nothing, by derivatives,
of how others would."""

TORQUE_SCALE = 0.1
"""Standard deviation of all drives' torque against all masses, of a robot that is held: nothing anchors
either there. A real Go2's legs droop 1.2 times as far as its description says."""

LARGEST_SCALE = 1.4
"""Factor within which it lies, either way: no joint of that Go2 droops more than 1.36 times as far. What is further off
is a fault of gains or motors."""

TURNS = Shown("walk and turn on a level floor", {"walk": 20.0})


def _free(at: Place) -> bool:
    return at.model.free


def _held(at: Place) -> bool:
    return not at.model.free


def _friction(at: Place) -> float:
    """Largest friction of a foot's shape in the description [1]."""
    return float(at.model.model.geom_friction[list(at.model.feet), 0].max()) if at.model.feet else 0.8


def _slippery(replay: Replayed, change: np.ndarray) -> None:
    """Friction of every contact, for feet meet the ground alone."""
    if not replay.robot.free:
        return
    friction = replay.model("geom_friction")
    friction[:] = replay.robot.model.geom_friction
    friction[:, :, 0] *= np.maximum(1.0 + change, 0.02)


def _mjcf_friction(edit: MjcfEdit, _: int, x: float) -> None:
    for geom in edit.spec.geoms:
        geom.friction = np.array(geom.friction) * [max(1.0 + x, 0.02), 1.0, 1.0]


CAUSES = (
    Cause(
        name="imu_tilt",
        title="imu tilt",
        field="tilt",
        place="lean",
        there=_free,
        unit="rad",
        step=0.01,
        spread=0.005,
        least=0.012,
        fault=0.04,
        through="imu",
        shown=TURNS,
    ),
    Cause(
        name="gyro_bias",
        title="gyro bias",
        field="bias",
        place="gyro",
        there=_free,
        unit="rad/s",
        step=0.02,
        spread=0.01,
        least=0.03,
        fault=0.1,
        through="imu",
        shown=TURNS,
    ),
    Cause(
        name="ground_friction",
        title="ground friction",
        field="mu",
        place="robot",
        there=_free,
        number="coefficient",
        unit="1",
        step=-0.1,
        spread=0.1,
        least=0.1,
        fault=0.4,
        nominal=_friction,
        change="relative",
        unsure=0.05,  # pyramids and cones of friction differ by as much where a foot slips
        of_session=lambda _: True,
        tried=FLOORS,
        through="ground",
        needs_slip=True,
        shown=Shown("walk or push off so hard that a foot slips", {"walk": 20.0}),
        acts=_slippery,
        mjcf=_mjcf_friction,
        read_back=False,
    ),
    Cause(
        name="ground_slope",
        title="ground slope",
        field="slope",
        place="lean",
        there=_free,
        unit="rad",
        step=0.01,
        spread=0.005,
        least=0.012,  # finished floors may lie 4 mm high at a distance of 1 m (DIN 18202, table 3, group 3)
        fault=0.06,
        through="ground",
        shown=Shown("walk and turn on that ground", {"walk": 20.0}),
    ),
    Cause(  # how a fixed base stands
        name=NUISANCE,
        title="lean of the base",
        field="slope",
        place="lean",
        there=_held,
        unit="rad",
        step=0.01,
        spread=0.02,
    ),
    Cause(
        name="ground_stiffness",
        title="ground stiffness",
        field="give",
        place="robot",
        there=_free,
        number="factor",
        unit="1",
        # feet sink as far as the ground gives, and no two floors and laws of contact agree on it: one that bears them
        # where they touch is as usual as one into which they sink twice as deep
        step=0.2,
        spread=0.5,
        least=1.0,
        fault=4.0,
        nominal=1.0,
        lowest=-0.95,
        change="inverse",
        of_session=lambda _: True,
        tried=FLOORS,
        through="ground",
        shown=Shown("walk, or land from small jumps", {"walk": 20.0}),
    ),
    Cause(  # torques of all drives against masses of all links where the trunk is held
        name=NUISANCE,
        title="torque of all drives",
        field="scale",
        place="robot",
        there=_held,
        number="torque_scale",
        unit="1",
        step=0.05,
        spread=TORQUE_SCALE,
        least=TORQUE_SCALE,
        lowest=1.0 / LARGEST_SCALE - 1.0,
        highest=LARGEST_SCALE - 1.0,
        of_all="motor_strength",
        unseen=f"up to some {200 * TORQUE_SCALE:.0f} % it would have looked like other masses of all links",
        measured_in="tau",
        central=True,
        remark=lambda value, _: (
            f"all drives' torques are {1.0 + value:.2f} times what gains and masses of the description make them: "
            "either may be off, and a robot that is held does not show which"
        ),
    ),
)
