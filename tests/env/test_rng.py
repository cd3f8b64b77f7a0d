"""Random numbers of the control step: uniform, without pattern along any of their counters, never the same twice."""

import numpy as np
import pytest
import warp as wp

from mrwarp.env.rng import DEVICE, MOST_JOINTS, NOISE, POSE, PUSH, WIDTH, draw, first_key, further, place

MASK = (1 << 64) - 1


@wp.kernel
def draws_kernel(
    # parameters: what is drawn
    kind: int,
    # in, shape (N, 2)
    keys_in: wp.array2d[wp.int64],
    # out, shape (N, E, K)
    draws_out: wp.array3d[float],
):
    """The numbers of each key, environment and place."""
    n, env, k = wp.tid()
    draws_out[n, env, k] = draw(place(keys_in[n], env, kind), k)


def draws(keys: list[list[int]], num_envs: int, width: int, kind: int = PUSH) -> np.ndarray:
    """Draws of several seeds and steps, shape (keys, num_envs, width)."""
    found = wp.full((len(keys), num_envs, width), float("nan"), dtype=float, device="cpu")
    wp.launch(draws_kernel, found.shape, [kind, wp.array(keys, dtype=wp.int64, device="cpu")], [found], device="cpu")
    return found.numpy()


def mixed(x: int) -> int:
    """SplitMix64's mixer in Python's integers."""
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & MASK
    return x ^ (x >> 31)


@pytest.mark.parametrize("seed", [0, 7, -3, 2**63 + 5])
def test_draws_are_splitmix64_at_a_counter_of_step_environment_and_place(seed: int) -> None:
    """Against Python's integers: step above 2^32, environment above 2^10, kind above 2^6, then the number."""
    golden = 0x9E3779B97F4A7C15
    found = draws([[first_key(seed)[0], step] for step in (0, 3, 70_000)], 3, 5, NOISE)
    for n, step in enumerate((0, 3, 70_000)):
        for env in range(3):
            for k in range(5):
                counter = (step << 32) + (env << 10) + NOISE * WIDTH + k
                number = mixed((mixed((seed + golden) & MASK) + counter * golden) & MASK)
                assert found[n, env, k] == (number >> 40) / 2**24


def test_draws_are_uniform() -> None:
    """Half a million draws: inside [0, 1), mean, spread and the counts of a hundred bins within five deviations."""
    found = draws([[0, step] for step in range(256)], 64, 32).astype(float).ravel()
    assert found.min() >= 0.0 and found.max() < 1.0
    assert abs(found.mean() - 0.5) < 5.0 / np.sqrt(12 * found.size)
    counts = np.bincount((100 * found).astype(int), minlength=100)
    # chi squared of 99 degrees of freedom: 99 within five times sqrt(198)
    expected = found.size / 100
    assert abs(((counts - expected) ** 2 / expected).sum() - 99) < 5 * np.sqrt(198)


def test_neighbours_are_independent_along_every_counter() -> None:
    """Successive places, environments, steps, kinds and seeds: correlations within five deviations of none."""
    steps = draws([[0, step] for step in range(256)], 64, 16)
    seeds = draws([[seed, 0] for seed in range(256)], 64, 16)
    kinds = np.stack([draws([[0, step] for step in range(64)], 64, 16, kind) for kind in range(6)])
    along = {"step": (steps, 0), "environment": (steps, 1), "place": (steps, 2), "seed": (seeds, 0), "kind": (kinds, 0)}
    for name, (values, axis) in along.items():
        rolled = np.moveaxis(values, axis, 0).astype(float)
        first, second = rolled[:-1].ravel(), rolled[1:].ravel()
        assert abs(np.corrcoef(first, second)[0, 1]) < 5.0 / np.sqrt(first.size), name


def test_no_draw_is_another_one() -> None:
    """A million draws in steps of 2^-24: as many equal pairs as chance makes of independent ones, not more."""
    found = draws([[0, step] for step in range(1024)], 64, 16)
    equal = found.size - len(np.unique(found))
    pairs = found.size**2 / 2 / 2**24
    assert abs(equal - pairs) < 0.05 * pairs  # triples make 2 %; five deviations are 3 %


def test_the_largest_robot_draws_no_number_twice() -> None:
    """Noise of gyro, gravity, angles and rates; pose, velocity and phase; four numbers of a device at each joint."""
    own = {kind: range(WIDTH) for kind in range(NOISE)} | {NOISE: range(6 + 2 * MOST_JOINTS)}
    own |= {POSE: range(MOST_JOINTS + 7), DEVICE: range(4 * MOST_JOINTS)}
    wide = (POSE, DEVICE)
    counters = [kind * WIDTH + (further(k) if kind in wide else k) for kind, ks in own.items() for k in ks]
    assert len(set(counters)) == len(counters) and max(counters) < 1024
