"""Settings of a robot's log: which causes are named, and how far the robot is fitted.

Odds are logarithms of likelihood ratios. Sizes and spreads of causes stand in their declarations,
``mrwarp/robot_logs/causes``.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrwarp.sysid.settings.checked import Checked, setting


@dataclass(frozen=True, kw_only=True)
class Robot(Checked):
    """Causes of a robot that are named, and forces that are reported as unexplained."""

    odds: float = setting(12.0, 0.0, 1e3, fewer="false causes", more="missed ones", by="200 causes and places")
    """Least logarithm of the odds of a cause: some 200 are looked at, and one log of a hundred may speak of one
    wrongly."""
    ordinary_z: float = setting(4.5, 0.0, 100.0, fewer="false causes", more="missed ones")
    """Least standard score of a number that descriptions rarely know."""
    recurrence: float = setting(4.0, 0.0, 100.0, fewer="false causes", more="suspects", by="200 causes and places")
    """Least size of a cause in standard deviations over windows: one chance in a hundred over 200 causes and places."""
    rivals: int = setting(4, 0, 100, fewer="lost alternatives", more="long lists")
    """Most alternatives of a cause."""
    share: float = setting(0.03, 0.0, 10.0, fewer="false small causes", more="missed ones")
    """Least squared mismatch that a cause explains, in units of what every reading of its joints is left with; and the
    share by which no channel's squared error may grow with it."""
    most: int = setting(8, 1, 100, fewer="missed causes", more="time")
    """Most causes, next to ordinary ones, that one log distinguishes."""
    parts: int = setting(8, 3, 100, fewer="intervals that are too wide", more="parts with similar errors")
    """Parts of a log, one after the other: each counts as one reading in an interval, as neighbouring windows have
    similar errors, and is predicted from the others."""
    walking: float = setting(2.0, 1.0, 100.0, fewer="false causes", more="suspects", by="a healthy virtual walk")
    """Factor on intervals of a robot on its feet: on a healthy walk of the virtual robot numbers lie this many of their
    standard deviations from what is true in root mean square, for the replay repeats its error in every step."""
    acts: float = setting(0.05, 0.0, 1.0, fewer="windows that say nothing", more="windows left out")
    """A window counts for a cause where it holds this share of the mean window's information on it: a coil that was
    not asked for current says nothing of it, but for what the other numbers do without it."""
    windows: int = setting(8, 3, 1000, fewer="verdicts by chance", more="logs without a verdict")
    """Fewest windows that carry a verdict, and most of one recording that may repeat each other."""
    quiet: float = setting(0.3, 0.0, 0.9, fewer="windows that begin while a foot lands", more="readings left out")
    """Part of a window of a robot on its feet that may be left out before it, until joints and trunk keep their speed:
    the speed at its start is an average over some samples, and wrong while a foot lands."""
    worst: float = setting(4.0, 1.0, 100.0, fewer="windows left out", more="falls and pushes that are fitted")
    """A window whose mismatch is this many times the median one is left out: a fall, a hand that touched the robot.
    Others count less, the more is left in them than in the median one: small errors of some grow to large ones. A
    whole replay that errs by this many healthy errors is not right: the verdict says so."""
    push: float = setting(0.1, 1e-4, 10.0, fewer="forces held back", more="forces at joints that stick")
    """Standard deviation of forces that no cause gives, as shares of the robot's weight and of the most a joint was
    asked for: joints that stick hardly show one, however large."""
    push_share: float = setting(0.3, 0.0, 1.0, fewer="false forces", more="missed ones")
    """Least part of a window's mismatch that a force explains where it is reported."""
    push_windows: int = setting(3, 1, 100, fewer="false forces", more="missed short ones")
    """Fewest windows one after the other that ask for a force."""


@dataclass(frozen=True, kw_only=True)
class RobotFit(Checked):
    """Fits of a robot to its log: certainty against time."""

    seconds: float = setting(60.0, 1.0, 1e4, fewer="missed causes", more="time")
    """Part of a log from which causes are reported [s]."""
    fit_seconds: float = setting(10.0, 1.0, 1e4, fewer="fits astray", more="time")
    """Part of a log by which the robot is fitted step by step [s]."""
    whole: float = setting(15.0, 0.0, 1e4, fewer="fits by a part", more="time")
    """Logs of up to this length are fitted as a whole [s]."""
    rounds: int = setting(4, 1, 100, fewer="fits that stop early", more="time")
    """Times that outstanding numbers are freed and the robot is fitted again, and that channels are weighed again."""
    trusted: float = setting(0.5, 0.0, 1.0, fewer="steps along old derivatives", more="derivatives")
    """A step that gains less than this share of what the derivatives promise calls for new ones."""
    renewals: int = setting(1, 0, 100, fewer="fits that stop early", more="time")
    """Times that a fit takes new derivatives on its way: they cost as much as a hundred steps."""
    trials: int = setting(5, 1, 100, fewer="fits that stop early", more="time")
    """Points that are looked at for each better one."""
    converged: float = setting(2.0, 0.0, 100.0, fewer="idle steps", more="fits that stop early")
    """Gain of a step, in units of twice the logarithm of a likelihood, below which a fit ends."""
    proof_steps: int = setting(2, 1, 100, fewer="causes that a better fit would do without", more="time")
    """Steps of the fits by which a cause is proven: from where derivatives say."""
    guesses: int = setting(6, 1, 1000, fewer="wrong beginnings", more="time")
    """Hypotheses that are tried by the replay alone."""
    multiples: tuple[float, ...] = setting((0.5, 1.0, 2.0, 4.0), 0.01, 100.0, fewer="small guesses", more="large ones")
    """Their sizes, in those that derivatives ask for."""
    picks: int = setting(3, 1, 100, fewer="wrong beginnings", more="time")
    """Guesses that are taken one after the other."""
    screened: int = setting(3, 1, 100, fewer="replays", more="wrong beginnings")
    """Every change that is tried is replayed along one window of so many, by long steps."""
    kept: int = setting(8, 1, 1000, fewer="wrong beginnings", more="time")
    """So many of the best are replayed along all windows."""
    limited: int = setting(2, 0, 100, fewer="missed torque limits", more="time")
    """Drives whose limit is tried next to them, at the most that they gave: those that gave least of what was asked of
    them. Derivatives see a limit only where it begins to act."""
    factor: float = setting(1.25, 1.01, 10.0, fewer="replays", more="coarse sizes")
    """Ratio of sizes of a cause that are tried by the replay."""
    widened: int = setting(4, 1, 100, fewer="sizes at the end of their range", more="time")
    """Times that this range is widened."""
    narrowed: int = setting(2, 0, 100, fewer="coarse sizes", more="time")
    """Times that it is then narrowed."""
