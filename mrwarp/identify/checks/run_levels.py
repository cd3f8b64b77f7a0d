"""Runs whose torque is another one in the same motion, where nobody knows which came first."""

from __future__ import annotations

import numpy as np

from mrwarp.identify.checks.shared_fit import RunTable
from mrwarp.recording.data import quantity, session_clock
from mrwarp.recording.load import Recording
from mrwarp.sysid.settings import Settings


def levels_without_clock(recording: Recording, settings: Settings | None = None) -> str:
    """A note on runs that share no clock and whose torque's level differs; empty where they do not, or not clearly.

    One description fits all runs but for a factor of each. The factors have to differ in both halves of the runs, and
    not along how far, how fast, where and with which input these move: that may be a law. The one run with the least
    or the largest input has none to be compared with.
    """
    settings, runs = settings or Settings(), recording.trajectories
    if len(runs) < settings.gain.few or session_clock(recording) is not None:
        return ""
    table = RunTable(recording)
    if not table.usable:
        return ""
    factors, fits = table.fit.factors()
    halves = table.fit.factors_of_halves(table.torque)
    inputs = table.places[:, 1]
    others = [np.delete(inputs, k) for k in range(len(runs))]
    among = np.array([other.min() <= own <= other.max() for own, other in zip(inputs, others, strict=True)])
    if among.sum() < settings.gain.few:
        return ""
    runs = [run for run, counts in zip(runs, among, strict=True) if counts]
    factors, fits, halves, conditions = factors[among], fits[among], halves[:, among], table.conditions[among]
    differ = min(factors.min(), halves.min()) > 0.0 and factors.max() > (1.0 + settings.faults.gain) * factors.min()
    if not differ or fits.min() < settings.faults.agree:
        return ""
    both = np.corrcoef(halves)[0, 1]
    along = [np.corrcoef(x, factors)[0, 1] for x in conditions.T if np.ptp(x) > 0.0]
    if both < settings.faults.agree or any(abs(r) > settings.faults.explained for r in along):
        return ""
    most, least = (runs[int(k)].id for k in (factors.argmax(), factors.argmin()))
    return (
        f"the level of the {quantity('torque', recording.units)} differs between runs ({factors.max():.2f} times the "
        f"usual one in {most!r}, {factors.min():.2f} times in {least!r}), and they share no clock: wear, warming and "
        "another set-up cannot be distinguished; record t by a clock that runs on from run to run, and the temperature"
    )
