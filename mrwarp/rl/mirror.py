"""Mirror symmetry of a legged robot: how observations and actions change when left and right are exchanged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.env import observations
from mrwarp.env.gait import legs_of
from mrwarp.env.vec_env import WalkEnv

PLACE = 0.02
"""Largest distance of a mirrored foot from its twin, as a share of the foot's distance from the plane: robots are drawn
symmetric to a millimetre, and another leg is a foot's width away."""

ANGLE = 1e-3
"""Largest difference of mirrored axes (unit vectors), neutral angles [rad] and gait phases: files hold five digits."""


class NoMirrorError(ValueError):
    """A robot is not its own mirror image; the message says where."""


@dataclass(frozen=True, kw_only=True)
class SignedPermutation:
    """A mirror image of a row of numbers: ``sign * row[index]``, its own inverse."""

    index: np.ndarray
    """Place of each number's source, int, shape (n,)."""
    sign: np.ndarray
    """1 or -1 for each, shape (n,)."""

    @classmethod
    def keep(cls, *signs: float) -> SignedPermutation:
        """Numbers that stay in place, with these signs."""
        return cls(index=np.arange(len(signs)), sign=np.array(signs))

    @classmethod
    def join(cls, *parts: SignedPermutation) -> SignedPermutation:
        """Rows side by side."""
        starts = np.cumsum([0, *(len(part.index) for part in parts)])
        index = [part.index + start for part, start in zip(parts, starts[:-1], strict=True)]
        return cls(index=np.concatenate(index), sign=np.concatenate([part.sign for part in parts]))


@dataclass(frozen=True, kw_only=True)
class Mirror:
    """The mirror image of what a policy sees and does, left for right; see :func:`mirror_of`."""

    actor: SignedPermutation
    """Of the actor's observation, shape (O,)."""
    critic: SignedPermutation
    """Of the critic's observation, shape (C,)."""
    action: SignedPermutation
    """Of the action, shape (A,)."""


def mirror_of(env: WalkEnv) -> Mirror:
    """The mirror of an environment's robot at the plane y = 0 of its trunk.

    Angular velocities are axial vectors: roll and yaw rates change their sign, as do lateral velocities and tilts. A
    joint takes the place of its twin on the other side, with the opposite sign where their axes are opposite mirror
    images. The gait clock is shifted by the phase between the two legs.

    Raises:
        NoMirrorError: a leg has no twin, a joint belongs to no leg, or the gait's phases are not shifted equally.
    """
    legs, layout = legs_of(env.sim.scene), env.layout
    feet, axes = legs.feet.numpy(), legs.axes.numpy()
    columns, phases = legs.columns.numpy(), legs.phases.numpy()
    twins = _twins(feet, layout.leg_names)
    joint, joint_sign = _joints(columns, axes, twins, np.array(layout.default_q), layout.joints)
    shift = (phases[twins] - phases) % 1.0
    half = np.round(2.0 * shift[0]) / 2.0
    if np.abs(((shift - half + 0.5) % 1.0) - 0.5).max() > ANGLE:
        raise NoMirrorError(f"gait phases {phases.tolist()} of the legs: left and right differ neither by 0 nor 0.5")
    clock = float(np.cos(2.0 * np.pi * half))

    joints = SignedPermutation(index=joint, sign=joint_sign)
    leg = SignedPermutation(index=twins, sign=np.ones(len(twins)))
    own = [int(k) for k in env.actuator.mr_joints]
    device = SignedPermutation(index=np.array([own.index(joint[k]) for k in own], dtype=int), sign=np.ones(len(own)))
    currents = device if env.num_actions > len(joint) else SignedPermutation.keep()
    action = SignedPermutation.join(joints, currents)
    keep = SignedPermutation.keep
    actor = SignedPermutation.join(
        *(keep(-1.0, 1.0, -1.0), keep(1.0, -1.0, 1.0), keep(1.0, -1.0, -1.0)),  # gyro, gravity, command
        *(joints, joints, action, keep(clock, clock)),
    )
    critic = SignedPermutation.join(
        *(actor, keep(1.0, -1.0, 1.0), keep(1.0), leg, keep(1.0)),  # velocity, height, feet, I_e
        *(joints, keep(1.0, 1.0), device, device, device),  # motors, friction and mass, gates and currents
    )
    assert len(actor.index) == env.arrays.actor.shape[1] and len(critic.index) == env.arrays.critic.shape[1]
    assert sum(observations.actor_terms(len(joint), len(currents.index)).values()) == len(actor.index)
    return Mirror(actor=actor, critic=critic, action=action)


def _twins(feet: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Place of each leg's mirror image; ``feet`` (L, 3) [m] with all joints at 0."""
    mirrored = feet * [1.0, -1.0, 1.0]
    distance = np.linalg.norm(mirrored[:, None] - feet[None], axis=2)
    twins = distance.argmin(axis=1)
    for k, twin in enumerate(twins):
        if distance[k, twin] > PLACE * max(abs(float(feet[k, 1])), 1e-3):
            raise NoMirrorError(f"leg {names[k]}: no leg stands at its mirror image")
    return twins


def _joints(
    columns: np.ndarray, axes: np.ndarray, twins: np.ndarray, neutral: np.ndarray, names: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Twin and sign of every joint, shapes (J,)."""
    index, sign = np.full(len(names), -1), np.zeros(len(names))
    for leg, twin in enumerate(twins):
        for own, other, axis, image in zip(columns[leg], columns[twin], axes[leg], axes[twin], strict=True):
            if (own < 0) != (other < 0):
                raise NoMirrorError(f"joint {names[max(own, other)]}: its leg and the mirrored one differ in joints")
            if own < 0:
                continue
            turned = float(np.dot(axis * [-1.0, 1.0, -1.0], image))
            if abs(abs(turned) - 1.0) > ANGLE:
                raise NoMirrorError(f"joint {names[own]}: its axis is no mirror image of that of {names[other]}")
            index[own], sign[own] = other, np.sign(turned)
    if (index < 0).any():
        raise NoMirrorError(f"joint {names[int(np.flatnonzero(index < 0)[0])]} belongs to no leg")
    off = np.abs(neutral - sign * neutral[index])
    if off.max() > ANGLE:
        worst = int(off.argmax())
        raise NoMirrorError(f"joint {names[worst]}: its neutral angle is not that of its twin {names[index[worst]]}")
    return index, sign
