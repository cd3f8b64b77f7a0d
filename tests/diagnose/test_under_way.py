"""Trajectories cut out of a longer motion: the joint slides already at the first sample."""

import dataclasses

import numpy as np
import pytest

from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.prepare import begin_under_way
from mrwarp.identify.dataset import Motion
from mrwarp.identify.replay import EffectReplay
from tests.diagnose import known

STIFF = {"beta": 60.0, "gamma": -20.0}
"""A hysteresis that has mostly yielded by the time the runs are cut."""


def _cut(long: Motion, first: int) -> Motion:
    """Each run without its first samples."""
    s = long
    taken = np.concatenate([np.arange(p.start + first, p.stop) for p in s.parts])
    lengths = np.diff(s.start) - first
    samples = dataclasses.replace(
        s, q=s.q[taken], qd=s.qd[taken], current=s.current[taken], torque=s.torque[taken],
        start=np.concatenate([[0], np.cumsum(lengths)]),
    )  # fmt: skip
    return dataclasses.replace(
        long, samples=samples, qdd=long.qdd[taken], time=long.time[taken], slid_time=long.slid_time[taken],
        heat=long.heat[:, taken],
    )  # fmt: skip


def _engine(cut_off: int) -> Engine:
    """An engine on data of a device that started without stress before the cut."""
    whole = known.engine(sigma=1e-3, **STIFF)
    at = _cut(dataclasses.replace(whole.motion, torque=whole.samples.torque), cut_off)
    weight = at.settled(30.0)
    made = Engine(EffectReplay(at), 0.0, weight, whole.units)
    made.noise = known.white(1e-3)
    return made


def _fitted(on: Engine) -> Fitted:
    c = on.coordinates(())
    return on.fit(c, known.vector(c, **STIFF))


def test_begin_is_the_direction_of_sliding() -> None:
    """Only where the first sample moves."""
    at = known.motion()
    first = at.start[:-1]
    qd = at.qd.copy()
    qd[first] = (0.0, 0.02, -0.02, 2.0, -2.0, 3.0, -3.0, 1.0)
    begin = dataclasses.replace(at, qd=qd).under_way().begin
    assert begin is not None
    assert begin.tolist() == [0.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0, 1.0]


def test_steady_stress_holds_from_the_first_sample() -> None:
    """At a constant velocity the torque does not change with time when z begins under way, either way."""
    at = known.motion(current=1.0)
    s = at
    for direction in (1.0, -1.0):
        zero, qd = np.zeros(len(s.q)), np.full(len(s.q), direction)
        moved = dataclasses.replace(at, samples=dataclasses.replace(s, q=zero, qd=qd), qdd=zero)
        c = known.engine().coordinates(())
        row = c.row(known.vector(c))
        steady = EffectReplay(moved.under_way()).torque(row)[0]
        settling = EffectReplay(moved).torque(row)[0]
        assert np.ptp(steady) < 1e-5 * abs(steady[-1])
        assert steady[-1] == pytest.approx(settling[s.start[1] - 1], rel=1e-4)
        assert abs(settling[0]) < 0.5 * abs(steady[0])


def test_heads_tell_a_cut_record() -> None:
    """Runs cut in mid-motion begin under way, and the heads then fit better; runs from rest do not."""
    cut = _engine(150)
    fitted = _fitted(cut)
    heads = cut.weight == 0.0
    for k in (3, 6):  # these runs are cut at a reversal
        heads[cut.samples.parts[k]] = False
    before = float(np.abs(cut.samples.torque - fitted.torque)[heads].mean())
    assert begin_under_way(cut, fitted)
    assert cut.motion.begin is not None
    assert np.flatnonzero(cut.motion.begin == 0.0).tolist() == [3, 6]
    again = cut.fit(fitted.coordinates, fitted.x)
    assert float(np.abs(cut.samples.torque - again.torque)[heads].mean()) < 0.5 * before
    whole = _engine(0)
    assert not begin_under_way(whole, _fitted(whole))
    assert whole.motion.begin is None
