"""Random numbers inside kernels: each a function of seed, policy step, environment and place, not of other draws.

So a robot's draws do not depend on who else falls, on the number of robots or on the order of threads, and a graph can
make them. Steele, Lea and Flood (OOPSLA 2014), "Fast splittable pseudorandom number generators": a counter times an odd
constant, mixed to 64 bits. Every draw of a seed has a counter of its own, so no two are the same number of the
sequence. ``wp.rand_init`` has 32 bits of state: chains that begin at so few places run into each other within a
training.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

import warp as wp

PUSH, COMMAND, POSE, DEVICE, LEVEL, NOISE = range(6)
"""Purposes of random draws: kicks, commands, poses and phases, devices, terrain levels, observation noise."""

WIDTH = 64
"""Numbers that one environment draws of a kind in a policy step; NOISE, the last kind, has three times as many, POSE
and DEVICE have further ones, see :func:`further`."""

MOST_JOINTS = 64
"""Most driven joints of a robot, for which all of these suffice: NOISE takes 134, POSE 71, DEVICE 256."""

_FURTHER = wp.constant(5 * WIDTH)
"""How far behind a kind's numbers its further ones begin: POSE's in the ninth row of numbers, DEVICE's from the tenth
on, where no kind is."""

SEED, STEP = range(2)
"""Entries of the key that the draws follow from: the environment's seed, and policy steps since its start."""

_INDEX_BITS = wp.constant(wp.uint64(10))
"""Bits of kind and number in the counter: 16 kinds."""
_ENV_BITS = wp.constant(wp.uint64(22))
"""Bits of the environment; 32 are left for the policy step: 2.7 years at 50 Hz."""
_GOLDEN = wp.constant(wp.uint64(0x9E3779B97F4A7C15))


def first_key(seed: int) -> list[int]:
    """Key of a new environment: its seed, modulo 2^64, as a signed number, and no steps."""
    return [(seed + 2**63) % 2**64 - 2**63, 0]


@wp.func
def mixed(x: wp.uint64) -> wp.uint64:
    """A 64-bit number for each 64-bit number, without pattern (variant 13 of Stafford's mixers, as in SplitMix64)."""
    x = (x ^ (x >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return x ^ (x >> wp.uint64(31))


@wp.func
def place(key: wp.array[wp.int64], env: int, kind: int) -> wp.uint64:
    """Where the draws of a kind begin in this policy step; the key, shape (2,), holds :data:`SEED` and :data:`STEP`."""
    counter = (wp.uint64(key[STEP]) << _ENV_BITS) | wp.uint64(env)
    counter = (counter << _INDEX_BITS) | wp.uint64(kind * WIDTH)
    return mixed(wp.uint64(key[SEED]) + _GOLDEN) + counter * _GOLDEN


@wp.func
def further(k: int) -> int:
    """The k-th number of POSE or of DEVICE, of which there are more than :data:`WIDTH`."""
    if k < WIDTH:
        return k
    return k + _FURTHER


@wp.func
def draw(begin: wp.uint64, k: int) -> float:
    """The k-th number from a place on, see :data:`WIDTH`; uniform over [0, 1) in steps of 2^-24."""
    bits = mixed(begin + wp.uint64(k) * _GOLDEN) >> wp.uint64(40)
    return float(int(bits)) * 5.9604644775390625e-08


@wp.func
def between(low: float, high: float, begin: wp.uint64, k: int) -> float:
    """The k-th number from a place on, uniform over [low, high)."""
    return low + (high - low) * draw(begin, k)
