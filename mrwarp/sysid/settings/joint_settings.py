"""Settings of the search for a joint's effects.

Losses are sums of squares in units of the noise's variance, so a gain compares with chi-squared. A *t* is a gain over
its standard error, with trajectories as units.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrwarp.sysid.settings.checked import RATES, Checked, setting


@dataclass(frozen=True, kw_only=True)
class Gain(Checked):
    """Gains that count, in every step."""

    chi2: float = setting(30.0, 0.0, 1e6, fewer="false causes", more="missed small ones", by="chi-squared law")
    """Least gain in units of the noise's variance: one chance in a million over a hundred starts. A model that loses
    this much on the data is no rival. An effect that gains less than twice as much within trajectories has to show
    between them."""
    floor: float = setting(0.003, 0.0, 1.0, fewer="false causes in long data", more="missed ones", by="replay's step")
    """Least gain as a share of the noise's energy: the replay's own step errs by about as much. Of what motion and
    current leave it is the least by which a current has to leave less than the motion alone."""
    distinct: float = setting(12.0, 0.0, 1e4, fewer="single answers", more="alternatives")
    """Difference of chi-squared from which two explanations are distinguished: a likelihood ratio of 400."""
    one_error: float = setting(1.0, 0.0, 10.0, fewer="false causes", more="suspects", by="one-standard-error rule")
    """Least t of an effect on trajectories left out, and of a number that is known to be there, as an inertia."""
    likely_t: float = setting(2.0, 0.0, 10.0, fewer="chance findings", more="missed ones", by="95 % of a normal law")
    """Least t where one question is asked."""
    clear_t: float = setting(4.0, 0.0, 20.0, fewer="wrong readings of the log", more="right ones not taken")
    """Least t where many were asked, or where a wrong answer bends all that follows: bent laws, another reading of the
    motion, a single step over the noise."""
    share: float = setting(0.02, 0.0, 1.0, fewer="idle refinements", more="missed ones")
    """Share of the squares, of samples or of a range up to which something is next to nothing: what a refinement gains,
    a trajectory says, a model explains, or a control input changes that stays the same."""
    few: int = setting(4, 2, 100, fewer="chance findings", more="questions that stay open in short data")
    """Fewest runs, rests or spectra among which a gain can be distinguished from chance."""
    half: float = setting(0.5, 0.0, 1.0, fewer="missed differences", more="false ones")
    """Ratio of two squares, spreads, powers or gains below which one is clearly less than the other, and share of a
    variance, of a sum, of a range or of full correlation from which it is most of it."""
    detail: float = setting(0.05, 0.0, 1.0, fewer="findings of no use", more="missed small ones")
    """Share of the torque's standard deviation up to which a mismatch, a moved zero or a growth at rest is a detail."""
    chance: float = setting(1e-3, 0.0, 1.0, fewer="missed laws", more="accidents taken for laws")
    """Largest chance of an agreement that is no accident: of runs with a drift, of stretches with the motion."""
    part: float = setting(
        0.2,
        0.0,
        10.0,
        fewer="pieces of other laws",
        more="suspects",
        by="devices by other laws: a tenth to a sixth; true effects: a third and more",
    )
    """Least size of a finding as a share of a larger one next to it: of an effect over what comes again without a name,
    of what is left over what is named, of spikes over all that is left; and the torque that falls with the
    acceleration, from which it is no inertia's."""


@dataclass(frozen=True, kw_only=True)
class Search(Checked):
    """Which effects are found together."""

    added: float = setting(0.13, 0.0, 1.0, fewer="false second causes", more="missed ones", by=RATES)
    """Part of the gain so far that one more effect must add: a law in a wrong form leaves a part for others."""
    added_slowly: float = setting(0.06, 0.0, 1.0, fewer="false drifts", more="missed ones", by=RATES)
    """That part for what drifts over the session, which is nobody else's wrong form."""
    kept: float = setting(0.35, 0.0, 1.0, fewer="proxies of other structure", more="missed causes", by=RATES)
    """Part of an effect's gain that must remain next to free functions of its rest."""
    kept_next_to_more: float = setting(0.5, 0.01, 1.0, fewer="proxies", more="missed causes next to others", by=RATES)
    """That part where the free functions gain much more than the effect."""
    taken_up: float = setting(0.3, 0.0, 1.0, fewer="missed causes", more="proxies of other structure")
    """Part of a structure's gain before the effects that they have to leave of it: what they have mostly taken up is
    their own law in another form."""
    same: float = setting(0.01, 0.0, 1.0, fewer="single answers", more="alternatives")
    """Part of an effect's gain by which another may be behind and still do as well in its place."""
    same_t: float = setting(1.5, 0.0, 10.0, fewer="single answers", more="alternatives")
    """t of that difference from which it does not."""
    same_slowly: float = setting(0.05, 0.0, 1.0, fewer="single answers", more="alternatives")
    """That part for what drifts over the session: it shows in trajectories, not by samples."""
    bent: float = setting(0.05, 0.0, 1.0, fewer="bent laws by chance", more="biased numbers")
    """Part of what a model leaves that a bent law must take away."""


@dataclass(frozen=True, kw_only=True)
class Proof(Checked):
    """Which found effects are causes; the others are suspects."""

    known_within: float = setting(25.0, 1.0, 1e6, fewer="suspects", more="causes of unknown size")
    """Ratio of an interval's ends from which a positive number counts as not known at all."""
    twice: float = setting(2.0, 1.0, 100.0, fewer="suspects", more="pieces of other laws", by=RATES)
    """Ratio of an effect's sizes in two halves from which it is no single effect; of dry friction between speeds, which
    changes with speed, its square."""
    unseen: float = setting(0.1, 0.0, 1.0, fewer="false lags behind a yielding shaft", more="missed ones")
    """Part of a sample below which a lag is not distinguished from the hidden motion of a yielding shaft, nor a spring
    from the corners of another law."""
    rounds: int = setting(6, 2, 100, fewer="searches that end without a cause", more="work")
    """Most searches; each after the first leaves out the suspects of those before."""


@dataclass(frozen=True, kw_only=True)
class Odds(Checked):
    """The prior of the evidence: what is likely before the data are seen.

    A nameless group is less likely than a cause by as much as distinguishes two explanations, half of
    :attr:`Gain.distinct`.
    """

    enters: float = setting(6.0, 0.0, 100.0, fewer="false causes", more="missed ones", by=RATES)
    """Logarithm of the odds against any one cause: it enters a model that is so many times likelier with it."""
    rival: float = setting(4.5, 0.0, 100.0, fewer="wrong single answers", more="alternatives")
    """Causes that are less than so far behind, in the logarithm of the odds, may do as well in one's place."""
    form: float = setting(0.1, 0.0, 1.0, fewer="second causes that make up for a first", more="missed ones")
    """Standard deviation of a law's own error, over what it bears: by speed, place and current."""


@dataclass(frozen=True, kw_only=True)
class Rest(Checked):
    """Structure that no effect explains."""

    certainly: float = setting(5.0, 0.0, 1e3, fewer="reports from few runs", more="missed structures")
    """Gain, in least gains, from which another reading of the clocks counts."""
    unreported: float = setting(0.1, 0.0, 0.5, fewer="open questions", more="errors that nobody reports")
    """Share of the mismatch that may repeat without being reported. A half of the data that has less of an effect's
    energy says nothing of its size: what else is wrong there is as large. An effect that leaves less of the loss
    stands in for nothing."""
    with_law: float = setting(2 / 3, 0.0, 1.0, fewer="missed repeats", more="noises counted as repeats")
    """Ratio of squares, next to a law of another shape, below which what differs where a motion comes again is clearly
    less than what boosting leaves: much of that is the law's own rest."""
    formula: float = setting(0.6, 0.0, 1.0, fewer="formulas that say little", more="structures without a formula")
    """Part of the variance of cell means, beyond noise, that a formula must explain to be reported."""
    line_chance: float = setting(1e-5, 0.0, 1.0, fewer="missed lines", more="false lines", by="exponential law")
    """Chance of a false line of the spectrum in a data set without any."""
    line_periods: int = setting(6, 1, 1000, fewer="drifts taken for lines", more="missed slow lines")
    """Fewest periods of a line in a trajectory."""


@dataclass(frozen=True, kw_only=True)
class Law(Checked):
    """Whether the hysteresis has another shape than eq. 15's."""

    margin: float = setting(0.15, 0.0, 1.0, fewer="false laws", more="missed ones", by=RATES)
    """Share by which the held-out RMSE of another law must be lower than that of eq. 14 with its best effect."""
    t: float = setting(3.0, 0.0, 20.0, fewer="false laws", more="missed ones", by=RATES)
    """Least t of that gain, each trajectory by the logarithm of its error."""
    simpler: float = setting(0.03, 0.0, 1.0, fewer="numbers without need", more="laws that are too simple")
    """Share of the held-out RMSE within which a law with fewer numbers is taken instead."""
    structured: float = setting(2.5, 1.0, 100.0, fewer="comparisons of laws", more="missed laws")
    """Ratio of the mismatch to the noise from sample to sample below which no law is looked for."""
    rivals: int = setting(3, 1, 20, fewer="false laws", more="work")
    """Effects that are tried with eq. 14, and most that a first answer lists."""
    moved: float = setting(
        0.85, 0.0, 1.0, fewer="moved zeros taken for friction", more="frictions taken for moved zeros"
    )
    """Ratio of squared errors, with a zero for each trajectory to one for all, below which the zeros differ."""
    gap: float = setting(0.3, 0.0, 1.0, fewer="groups of zeros", more="runs that all count as moved")
    """Share of the zeros' range from which a gap between them separates the moved ones from the others."""


@dataclass(frozen=True, kw_only=True)
class Steps(Checked):
    """Whether a current creeps or arrives late, by single steps of the command."""

    enough: int = setting(3, 1, 1000, fewer="wrong answers", more="alternatives")
    """Fewest steps for an answer."""
    model_error: float = setting(0.03, 0.0, 1.0, fewer="wrong answers", more="alternatives")
    """Error of the model in a step's change of torque [1]."""
    near: float = setting(0.7, 0.0, 1.0, fewer="answers by the fits' luck", more="answers by single steps")
    """Part of an effect's gain by which its like may be behind, and single steps still decide between them: each step
    falls where it likes between two samples."""


@dataclass(frozen=True, kw_only=True)
class Calibration(Checked):
    """Whether the parameters lie off their nominal values along one clear direction."""

    odds: float = setting(11.0, 0.0, 100.0, fewer="false shifts", more="missed ones", by="real shifts: 17 to 20")
    """Logarithm of the odds that a single shift must have against another device."""
    left: float = setting(22.0, 0.0, 1e3, fewer="missed shifts", more="false ones", by="chi-squared law")
    """Most chi-squared that a shift may leave."""
    distinct: float = setting(6.0, 0.0, 1e3, fewer="single answers", more="alternatives")
    """Difference of chi-squared from which two shifts are distinguished."""


@dataclass(frozen=True, kw_only=True)
class Experiment(Checked):
    """The experiment that is proposed next, and the sizes that would have shown."""

    chi2: float = setting(100.0, 0.0, 1e6, fewer="experiments that decide nothing", more="time on the bench")
    """Least miss of the wrong effect, in units of the noise's variance: four times what decides, for the experiment's
    own noise and for models that err."""
    steps: int = setting(80, 1, 10_000, fewer="experiments that decide nothing", more="time on the bench")
    """Steps of the current that distinguish a lag from a delay."""
    runs: int = setting(24, 1, 1000, fewer="long runs", more="runs")
    """Runs above which they are made longer instead."""
