"""Settings of what a recording must hold, of its faults, of how it is read, and of the time that is spent on it."""

from __future__ import annotations

from dataclasses import dataclass

from mrwarp.sysid.settings.checked import RATES, Checked, setting


@dataclass(frozen=True, kw_only=True)
class Data(Checked):
    """Which data carry a verdict."""

    runs: int = setting(3, 2, 1000, fewer="verdicts by chance", more="recordings without a verdict")
    """Fewest trajectories of which one can be predicted by the others."""
    seconds: float = setting(10.0, 0.0, 1e6, fewer="verdicts by chance", more="recordings without a verdict")
    """Shortest recording, all trajectories together [s]."""
    samples: int = setting(1500, 50, 10**8, fewer="verdicts by chance", more="recordings without a verdict")
    """Fewest samples, all trajectories together."""
    nothing: float = setting(0.9, 0.0, 10.0, fewer="refusals", more="models that explain little")
    """NRMSE from which a model explains next to nothing: four fifths of the torque's variance are left."""
    unlikely: float = setting(0.6, 0.0, 1.0, fewer="warnings before a fit", more="fits that end in a refusal")
    """Part of the torque's variance that the plainest laws leave from which a model is likely to explain next to
    nothing: hysteresis and weakening, which they lack, bear up to a quarter of it, and a joint's hysteresis leaves
    half."""


@dataclass(frozen=True, kw_only=True)
class Faults(Checked):
    """Faults of a recording: zeros, signs and gains that moved between runs, and runs of another device."""

    gap: float = setting(2.0, 0.0, 100.0, fewer="moved zeros by chance", more="missed ones")
    """Least width of the gap between two groups of zeros, in ranges of the wider group."""
    gain_gap: float = setting(0.7, 0.0, 100.0, fewer="moved gains by chance", more="missed ones")
    """That width for the logarithms of gains."""
    gain: float = setting(0.25, 0.0, 10.0, fewer="differences of runs taken for gains", more="missed gains")
    """Smallest other gain that is reported [1]."""
    drives: float = setting(0.3, 0.0, 1.0, fewer="wrong refusals", more="torques of turned sign that are fitted")
    """Part of the power, in size, that a torque of turned sign gives to the motion."""
    agree: float = setting(0.7, 0.0, 1.0, fewer="faults that stand for a wrong law", more="missed faults")
    """Least correlation of a run with what the others say, and share of the runs that must reach it."""
    similar: float = setting(1.6, 1.0, 100.0, fewer="missed faults", more="faults that stand for a wrong law")
    """Largest factor of a run against what all agree on."""
    as_well: float = setting(1.5, 1.0, 100.0, fewer="missed gains", more="other devices taken for gains")
    """After rescaling, a run's error may be at most this multiple of the median run's."""
    explained: float = setting(0.8, 0.0, 1.0, fewer="missed zeros", more="loads taken for zeros")
    """Share of the offsets' variance that place and control input of the runs may explain."""
    other: float = setting(2.0, 1.0, 100.0, fewer="false other devices", more="missed ones", by=RATES)
    """Least factor by which the other group's coefficients leave more of each run than its own group's, and of the
    middle run than its own group's without it."""
    boosting: float = setting(1.25, 1.0, 100.0, fewer="false other devices", more="missed ones")
    """That factor against boosting that learns from runs of both groups."""


@dataclass(frozen=True, kw_only=True)
class Spikes(Checked):
    """Single samples that stand out of all that is smooth."""

    far: float = setting(
        6.0, 1.0, 100.0, fewer="samples of noise taken for spikes", more="missed spikes", by="normal law"
    )
    """Size of a spike in robust standard deviations of what is left: one in 500 million samples of normal noise. As
    many standard errors a zero must be off to have moved."""
    most: float = setting(0.05, 0.0, 1.0, fewer="recordings with spikes left in", more="laws taken for spikes")
    """Largest share of samples that may be spikes: what is more frequent is no exception."""
    size: float = setting(0.1, 0.0, 10.0, fewer="idle searches", more="bent fits")
    """Their least RMS over the torque's standard deviation: below, the fits hardly bend."""
    event: float = setting(0.1, 0.0, 100.0, fewer="missing laws taken for spikes", more="missed spikes")
    """Time after a reversal or a step of the control input in which a law may show [s]."""
    locked: float = setting(3.0, 1.0, 100.0, fewer="missed spikes", more="missing laws taken for spikes")
    """Ratio of the rates of far samples in these times and outside, from which they belong to the events."""


@dataclass(frozen=True, kw_only=True)
class Reading(Checked):
    """How a log is read, and when what a model leaves is no noise."""

    samples: int = setting(60_000, 10, 10**8, fewer="samples left out", more="time")
    """Samples up to which a recording is diagnosed as it is: beyond, more of them say nothing new."""
    least_rate: float = setting(300.0, 1.0, 1e5, fewer="missed lags", more="time")
    """Rate below which nothing is decimated [Hz]: lags of a few milliseconds must still show."""
    per_period: float = setting(10.0, 2.0, 1e3, fewer="accelerations that are too small", more="time")
    """Samples per period of the torque's quick part that are kept at least: an acceleration of fewer is too small by a
    tenth."""
    misfit: float = setting(
        1.3, 1.0, 100.0, fewer="fits by plain least squares", more="misfits that are whitened as noise"
    )
    """Ratio of the mismatch with the learned noise to that of least squares above which the noise is no noise."""
    many: int = setting(20, 2, 1000, fewer="drifts in the noise", more="effects in the noise")
    """Trajectories above which smooth functions take up little of their offsets and factors; below, most of them."""
    begun: float = setting(0.8, 0.0, 1.0, fewer="runs without stress at their start", more="runs under way by chance")
    """Ratio of squared mismatches of a trajectory's head below which it begins under way instead of without stress."""
    rest: float = setting(0.25, 0.1, 60.0, fewer="slow turning points taken for rests", more="short rests not seen")
    """Shortest time in which a joint that does not move rests [s]."""
    smoothing: float = setting(8.0, 1.0, 1e3, fewer="noisy accelerations", more="time")
    """Largest divisor of the smoother's bandwidth that is tried; it doubles from 2 on."""


@dataclass(frozen=True, kw_only=True)
class Effort(Checked):
    """Processor time against certainty."""

    starts_on: int = setting(8000, 500, 10**8, fewer="starts in a corner", more="time")
    """Samples on which the starts of the baseline are searched."""
    samples: int = setting(12_000, 500, 10**8, fewer="errors by chance", more="time")
    """Samples on which laws are compared, and by which boosting learns what repeats."""
    runs: int = setting(40, 3, 10**6, fewer="laws by chance", more="time")
    """Trajectories to which these may fall, where there are many short ones: enough to distinguish chance from gain."""
