"""The stance of legs: solved where a file has none, and what it takes to hold it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mrwarp.paper import GRAVITY
from mrwarp.robots.foreign import ForeignRobot, Joint, Shape
from mrwarp.robots.surfaces import SOLE, surface

CROUCH, UPRIGHT = 0.73, 0.90
"""Share of its reach at which a leg stands where the file has no keyframe: that of the shipped robot; a biped's, whose
knee bears half the weight, that of Unitree's H1 (hip 0.4, knee 0.8 rad: 0.89) and G1 (0.31, 0.67 rad: 0.91) in public
policies; with feet that reach forwards a straight leg has 0.96."""

NEARLY_LEVEL, BENT = 0.003, (0.4, 0.95)
"""Grounds of legs that differ by less than this are one [m]; and how far a leg bends or stretches so that its foot is
on the common ground, as a share of its reach."""

PARALLEL = 0.9
"""Cosine from which on two axes of a leg count as parallel: they bend it in one plane."""

MISSED = 0.02
"""Share of a leg's reach, or sine of a sole's angle, by which a search may miss before others are begun."""

TILT, UNEVEN = 0.035, 0.01
"""Faults of a stance, in addition to legs beyond :data:`BENT`: a sole tilted by more [rad], which is 2 degrees, and
feet that differ in height by more of the reach. A soft contact gives way as much."""

ASIDE = 0.25
"""How far the centre of mass may be outside the feet, as a share of the reach: two feet of points are held by gait."""

TRIES, SEED = 4, 0
"""Further beginnings of a search, at random within the limits, where none of the usual ones ends in a stance."""

MOST_STEPS = 40
"""Of such a search: those that end in a stance take 10."""


@dataclass(frozen=True, kw_only=True)
class Foot:
    """The contact with the ground: a sphere on a body of a leg, the first that reaches the ground."""

    body: int
    centre: np.ndarray
    """In the body's frame [m], shape (3,)."""
    radius: float
    """[m]"""
    friction: float
    shape: Shape | None
    """The file's own sphere; None: one was put where the leg is lowest."""
    sole: bool = False
    """Whether all shapes of the body, and of what it carries, bear the load."""
    box: Shape | None = None
    """The box that stands for a sole that is a mesh."""


class _Plane:
    """A leg as a chain that bends in a plane: joints about one axis, and others that turn the plane."""

    def __init__(self, robot: ForeignRobot, leg: Sequence[Joint], foot: Foot, stretched: Mapping[str, float]) -> None:
        self.robot, self.foot = robot, foot
        before = {joint.child: joint for joint in robot.joints}
        self.path: list[Joint] = []
        body = foot.body
        while body in before:
            self.path.insert(0, before[body])
            body = before[body].parent
        own = {joint.name for joint in leg}
        self.joints = [joint for joint in self.path if joint.name in own]
        self.before = {joint.name: joint.in_parent.as_matrix() for joint in self.path}
        poses = self.poses(stretched)
        axes = [(poses[j.parent] @ self.before[j.name])[:3, :3] @ j.axis for j in self.joints]
        parallel = [[abs(a @ b) > PARALLEL for b in axes] for a in axes]
        most = max(range(len(axes)), key=lambda k: (sum(parallel[k]), k))
        self.bends = [joint for joint, same in zip(self.joints, parallel[most], strict=True) if same]
        self.signs = {
            joint.name: float(np.sign(axis @ axes[most])) for joint, axis in zip(self.joints, axes, strict=True)
        }
        flat = axes[most] * (1.0, 1.0, 0.0)
        lateral = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 0.5 else np.array([0.0, 1.0, 0.0])
        self.lateral = lateral * (-1.0 if lateral[1] < -1e-6 else 1.0)
        self.forward = np.cross(self.lateral, [0.0, 0.0, 1.0])
        points = [*(self.point(poses, joint) for joint in self.bends), self.sole(poses)]
        self.hip = float(points[0][2])
        links = np.diff(points, axis=0)
        self.reach = float(np.linalg.norm(links - np.outer(links @ axes[most], axes[most]), axis=1).sum())
        self.offset = float((points[-1] - points[0]) @ self.lateral)
        self.up = poses[foot.body][2, :3]

    def poses(self, q: Mapping[str, float]) -> dict[int, np.ndarray]:
        """Of the leg's bodies as matrices; the other legs need not be followed."""
        return self.robot.matrices(q, self.path)

    def point(self, poses: Mapping[int, np.ndarray], joint: Joint) -> np.ndarray:
        """A joint's place [m]."""
        return poses[joint.parent][:3] @ self.before[joint.name][:, 3]

    def misses(self, q: Mapping[str, float], share: float) -> tuple[float, float, float]:
        """How far the foot is from its place, forwards, sideways and down, as shares of the reach."""
        poses = self.poses(q)
        away = (self.sole(poses) - self.point(poses, self.bends[0])) / self.reach
        side = float(away @ self.lateral) - self.offset / self.reach
        return float(away @ self.forward), side, -float(away[2]) - share

    def upwards(self, q: Mapping[str, float]) -> np.ndarray:
        """The axis that pointed up on the foot when the leg hung stretched, shape (3,)."""
        return self.poses(q)[self.foot.body][:3, :3] @ self.up

    def tilt(self, q: Mapping[str, float]) -> float:
        """Angle of the sole from level [rad]."""
        return float(np.arccos(np.clip(self.upwards(q)[2], -1.0, 1.0)))

    def sole(self, poses: Mapping[int, np.ndarray]) -> np.ndarray:
        """The foot's place [m]."""
        return poses[self.foot.body][:3] @ np.append(self.foot.centre, 1.0)


def _shares(planes: Sequence[_Plane]) -> list[float]:
    """Share of its reach at which each leg stands, so that all stand on one ground though their hips be not level."""
    share = UPRIGHT if len(planes) == 2 else CROUCH
    grounds = [plane.hip - share * plane.reach for plane in planes]
    if np.ptp(grounds) <= NEARLY_LEVEL:
        return [share] * len(planes)
    return [float(np.clip((plane.hip - np.mean(grounds)) / plane.reach, *BENT)) for plane in planes]


def solve_stance(
    robot: ForeignRobot,
    legs: Sequence[Sequence[Joint]],
    feet: Sequence[Foot],
    pose: Mapping[str, float],
    stretched: Mapping[str, float],
    chosen: Mapping[str, float],
) -> tuple[dict[str, float], Residuals]:
    """A stance: every foot below the first joint that bends its leg, at a share of the reach, see :data:`CROUCH`.

    Out of its plane the foot stays as far as stretched; a sole is level where the leg's joints allow it. Knees point
    inwards, on bipeds forwards and on sprawling legs outwards, if they can.

    Args:
        robot: The robot.
        legs: Joints of each leg, from the trunk.
        feet: Of each leg.
        pose: Angles of all joints to begin with [rad].
        stretched: Angles with which the legs hang stretched [rad].
        chosen: Angles that the user gave [rad].

    Returns:
        Angles [rad], and how well the robot stands with them.
    """
    pose = dict(pose)
    planes = [_Plane(robot, leg, foot, stretched) for leg, foot in zip(legs, feet, strict=True)]
    shares = _shares(planes)
    for plane, share in zip(planes, shares, strict=True):
        free = [joint for joint in plane.joints if joint.name not in chosen]
        if not free:
            continue
        found = _solve(plane, share, free, pose, level=plane.foot.shape is None)
        if plane.foot.shape is None and plane.tilt({**pose, **found}) > TILT and len(plane.bends) < 3:
            found = _solve(plane, share, free, pose, level=False)  # no ankle levels it
        pose.update({name: round(x, 3) + 0.0 for name, x in found.items()})
    return pose, residuals(robot, planes, shares, pose)


def _solve(
    plane: _Plane, share: float, free: Sequence[Joint], pose: Mapping[str, float], *, level: bool
) -> dict[str, float]:
    """Angles of a leg's free joints [rad]."""
    low = np.array([max(joint.limits[0] + 1e-3, -2.0) if joint.limits else -2.0 for joint in free])
    high = np.array([min(joint.limits[1] - 1e-3, 2.0) if joint.limits else 2.0 for joint in free])
    high = np.maximum(high, low + 1e-6)

    def angles(q: np.ndarray) -> dict[str, float]:
        return {**pose, **{joint.name: float(x) for joint, x in zip(free, q, strict=True)}}

    def miss(q: np.ndarray) -> np.ndarray:
        all_of = angles(q)
        along, side, below = plane.misses(all_of, share)
        up = plane.upwards(all_of)[:2] if level else []
        return np.array([along, side, below, *(0.02 * q), *up])

    def error(found: Any) -> float:
        """Of the foot, without the wish for small angles."""
        rest = found.fun[[0, 1, 2, *range(3 + len(free), len(found.fun))]]
        return float(np.abs(rest).max())

    guess = dict(zip((joint.name for joint in plane.bends), (0.7, -1.4, 0.7), strict=False))
    bend = np.array([guess.get(joint.name, 0.0) * plane.signs.get(joint.name, 1.0) for joint in free])
    starts = [bend, -bend, 0.5 * (low + high)]
    results = [least_squares(miss, np.clip(start, low, high), bounds=(low, high)) for start in starts]
    if min(map(error, results)) > MISSED:  # a leg of many joints, or with tight limits
        rng = np.random.default_rng(SEED)
        more = [rng.uniform(low, high) for _ in range(TRIES)]
        results += [least_squares(miss, start, bounds=(low, high), max_nfev=MOST_STEPS) for start in more]
    near = [result for result in results if result.cost < min(r.cost for r in results) + 1e-3]

    def knee(result: Any) -> float:
        """How far the knee points to where it should [m]."""
        poses = plane.poses(angles(result.x))
        first = plane.point(poses, plane.joints[0])
        hip, middle = (plane.point(poses, joint) for joint in (plane.bends * 2)[:2])
        bent = middle - 0.5 * (hip + plane.sole(poses))
        if abs(plane.lateral[1]) < 0.7:  # a sprawling leg
            return float(bent[:2] @ hip[:2])
        return float(bent[0] * (-1.0 if first[0] > 0.05 * plane.reach else 1.0))

    return {joint.name: float(x) for joint, x in zip(free, max(near, key=knee).x, strict=True)}


@dataclass(frozen=True, kw_only=True)
class Residuals:
    """How well a robot stands."""

    uneven: float
    """Largest difference of the feet's heights [m]."""
    tilt: float
    """Largest angle of a sole from level [rad]; 0 without soles."""
    reach: tuple[float, float]
    """Share of its reach at which the leg stands that is furthest from what was sought, and that share."""
    outside: float
    """How far the centre of mass is outside the feet's span along x or y [m]; negative: inside."""
    size: float
    """Shortest reach of a leg [m]."""

    @property
    def faults(self) -> list[str]:
        """Faults that keep it from a stance."""
        share, wanted = self.reach
        found = []
        if self.uneven > UNEVEN * self.size:
            found.append(f"the feet differ by {1e3 * self.uneven:.0f} mm in height")
        if self.tilt > TILT:
            found.append(f"a sole is tilted by {np.degrees(self.tilt):.0f}°")
        if not BENT[0] <= share <= BENT[1]:
            found.append(f"a leg stands at {share:.2f} of its reach, sought was {wanted:.2f}")
        if self.outside > ASIDE * self.size:
            found.append(f"the centre of mass is {1e3 * self.outside:.0f} mm outside the feet")
        return found

    @property
    def text(self) -> str:
        """All of them."""
        side = "inside" if self.outside < 0.0 else "outside"
        return (
            f"feet level to {1e3 * self.uneven:.1f} mm, soles to {np.degrees(self.tilt):.1f}°, at {self.reach[0]:.2f} "
            f"of the reach, centre of mass {1e3 * abs(self.outside):.0f} mm {side} the feet"
        )


def residuals(
    robot: ForeignRobot, planes: Sequence[_Plane], shares: Sequence[float], pose: Mapping[str, float]
) -> Residuals:
    """How well a robot stands with angles [rad]."""
    poses = robot.poses(dict(pose))
    soles = np.array([poses[plane.foot.body].apply(plane.foot.centre) for plane in planes])
    heights = soles[:, 2] - [plane.foot.radius for plane in planes]
    masses = np.array([body.mass for body in robot.bodies])
    centre = masses @ [place.apply(body.com) for place, body in zip(poses, robot.bodies, strict=True)] / masses.sum()
    missed = [share + plane.misses(pose, share)[2] for plane, share in zip(planes, shares, strict=True)]
    worst = int(np.argmax([abs(own - share) for own, share in zip(missed, shares, strict=True)]))
    points = [soles]
    for foot in [plane.foot for plane in planes if plane.foot.sole]:
        own = poses[foot.body].apply(surface(robot, foot.body))
        points.append(own[own[:, 2] < own[:, 2].min() + SOLE])
    low, high = (edge(np.concatenate(points), axis=0) for edge in (np.min, np.max))
    return Residuals(
        uneven=float(np.ptp(heights)),
        tilt=max(plane.tilt(pose) if len(plane.bends) > 2 and plane.foot.sole else 0.0 for plane in planes),
        reach=(missed[worst], shares[worst]),
        outside=float(np.maximum(low - centre, centre - high)[:2].max()),
        size=min(plane.reach for plane in planes),
    )


def standing_torques(robot: ForeignRobot, feet: Sequence[Foot], pose: Mapping[str, float]) -> dict[str, float]:
    """Torque of each joint that holds the stance [N·m], with the weight on all feet as evenly as balance allows."""
    poses = robot.poses(dict(pose))
    centres = np.array([place.apply(body.com) for place, body in zip(poses, robot.bodies, strict=True)])
    weights = GRAVITY * np.array([body.mass for body in robot.bodies])
    points = np.array([poses[foot.body].apply(foot.centre) for foot in feet])
    balance = np.stack([np.ones(len(points)), points[:, 0], points[:, 1]])
    wanted = np.array([weights.sum(), weights @ centres[:, 0], weights @ centres[:, 1]])
    even = np.full(len(points), weights.sum() / len(points))
    forces = even + np.linalg.lstsq(balance, wanted - balance @ even, rcond=None)[0]
    torques = {}
    for joint in robot.joints:
        carried = robot.carried(joint)
        frame = poses[joint.parent] * joint.in_parent
        moment = sum(np.cross(centres[b] - frame.translation, [0.0, 0.0, -weights[b]]) for b in carried)
        for foot, point, force in zip(feet, points, forces, strict=True):
            if foot.body in carried:
                moment = moment + np.cross(point - frame.translation, [0.0, 0.0, force])
        torques[joint.name] = float(abs(frame.rotation.apply(joint.axis) @ moment))
    return torques
