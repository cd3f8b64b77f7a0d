"""Which hysteresis law the device follows, asked before any effect: eq. 15, or a published one in its place.

All laws are judged alike: plain simulation error of trajectories left out in turn, each with its own zero of the
torque. Eq. 14 is preferred. It stands with the best effects of the catalogue beside it, and another law is taken only
if it leaves less error by more than chance over the trajectories *and* by the stated :data:`MARGIN`: a hidden effect
bends a loop too, and a law of another shape would take that up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, by_ratio, fit_model
from mrwarp.diagnose.screening import Candidate
from mrwarp.effects.catalogue import HYSTERESIS, KNOWN
from mrwarp.identify.law_fit import LawSearch, Solution, law_search, one_zero, zero_line, zeros_moved
from mrwarp.identify.parameters import YIELDING
from mrwarp.identify.projection import Progress
from mrwarp.identify.replay import EffectReplay

MARGIN = 0.15
"""Share by which the held-out RMSE of another law must be lower than that of eq. 14 with its best effect."""
LEAST_T = 3.0
"""Least ratio of that gain to its standard error over trajectories, each by the logarithm of its error: in the sum only
the few with the largest torque would count."""
SIMPLER = 0.03
"""Share of the held-out RMSE within which a law with fewer numbers is taken instead."""
_SAMPLES = 12_000
"""Samples on which laws are compared."""
_RUNS = 40
"""Trajectories to which these may fall, where there are many short ones: enough to tell chance from gain."""
_STRUCTURED = 2.5
"""Ratio of the mismatch to the noise from sample to sample below which no law is looked for."""
_SMALL = 0.05
"""Mismatch, as a share of the torque's standard deviation, up to which a model counts as right but for details."""
_FEW = 4
"""Trajectories below which nobody can tell chance from gain."""
_RIVALS = 3
"""Effects that are tried beside eq. 14."""
_ZEROS_SHARE, _ZEROS_GAIN = 0.05, 0.5
"""Spread of the trajectories' zeros, as a share of the torque's, and share of the squared error that letting them go
takes away, from which the zeros have moved."""
_GAP = 0.3
"""Share of the zeros' range from which a gap between them parts the moved ones from the others."""
_BESIDE = "current_viscosity"
"""What published laws have besides: viscosity in a straight line over the current."""


@dataclass(frozen=True, kw_only=True)
class LawChoice:
    """The hysteresis law of a device, and what it was compared with."""

    name: str
    """Law of the baseline; ``bouc_wen`` is the paper's."""
    held_out: Mapping[str, float]
    """NRMSE on trajectories left out in turn, each with its own zero, of every law that was tried."""
    rival: float
    """The same of eq. 14 with the effects that help it most."""
    beside: tuple[str, ...] = ()
    """These effects."""
    offsets: Mapping[str, float] = field(default_factory=dict)
    """Zero of each trajectory where another law was taken and they have moved, about most of them [unit of the torque].

    Beside eq. 14 they stay: what a law of the wrong form leaves on average in a trajectory may be its own form.
    """

    @property
    def other(self) -> bool:
        """Whether another law than the paper's was taken."""
        return self.name != "bouc_wen"

    @property
    def title(self) -> str:
        """The law in words."""
        return HYSTERESIS[self.name].title if self.other else "eq. 14"

    @property
    def moved(self) -> list[str]:
        """Trajectories on the far side of the widest gap between zeros, where there is one; else all."""
        names = sorted(self.offsets, key=lambda name: self.offsets[name])
        zeros = np.array([self.offsets[name] for name in names])
        gaps = np.diff(zeros)
        if not len(gaps) or gaps.max() < _GAP * np.ptp(zeros):
            return names
        cut = int(np.argmax(gaps)) + 1
        return min(names[:cut], names[cut:], key=len)

    @property
    def error(self) -> tuple[float, float]:
        """Held-out NRMSE of eq. 14 and of the law that was taken."""
        return self.held_out["bouc_wen"], self.held_out[self.name]


def choose_law(
    problem: Problem, base: Fit, screened: Sequence[Candidate], names: Sequence[str], log: Progress
) -> tuple[LawChoice | None, Problem, Fit]:
    """Compare the laws, and take another one's baseline where it is clearly better.

    Args:
        problem: The data set.
        base: Eqs. 14 and 15 fitted to it.
        screened: What the effects would gain on it, best first.
        names: Those of the trajectories.
        log: Takes a line on what is being done.

    Returns:
        What was compared, or None where there was no need; the problem without the zeros that moved; the baseline.
    """
    motion = problem.motion
    if len(motion.parts) < _FEW or base.parameters.law or not structured(problem, base):
        return None, problem, base
    log(f"other hysteresis laws: {', '.join(law.title for law in HYSTERESIS.values())}")
    small = motion.stretches(_SAMPLES, _RUNS)
    threads, q_zero = problem.replay.threads, problem.q_zero
    search = LawSearch(EffectReplay(small, threads=threads), q_zero, offsets=True)
    beside = [_BESIDE] if search.levels > 1 and _BESIDE not in problem.impossible else []
    alone, paper, effects = _eq_14(search, base, screened, beside)
    count, spread = float(search.weight.sum()), float(small.torque.std()) or 1.0

    def nrmse(found: Solution) -> float:
        return float(np.sqrt(found.held_out.sum() / count)) / spread

    def error(found: Solution) -> float:
        return float(found.held_out.sum())

    laws = {name: law_search(small, q_zero, name, offsets=True, effects=beside, threads=threads) for name in HYSTERESIS}
    held_out = {"bouc_wen": nrmse(alone)} | {name: nrmse(found) for name, found in laws.items()}
    best = min(laws, key=lambda name: held_out[name])
    near = [name for name in laws if held_out[name] < (1.0 + SIMPLER) * held_out[best]]
    best = min(near, key=lambda name: (laws[name].layout.size, held_out[name]))
    found = laws[best]
    extra = [name for name in effects if name not in beside and name not in base.effects]
    if extra:  # a true effect bears as much of another law's error
        layout = replace(search.layout([*found.layout.effects, *extra]), choices=paper.layout.choices)
        x = found.layout.moved(found.x, layout)
        for name in extra:
            x[layout.own(name)] = paper.x[paper.layout.own(name)]
        found = min(found, search.descend(layout, x), key=error)

    def clear(paper: Solution, found: Solution) -> bool:
        return by_ratio(paper.held_out, found.held_out) > LEAST_T and error(found) < (1.0 - MARGIN) ** 2 * error(paper)

    taken = clear(paper, found)
    if not taken and error(found) < error(paper):  # what stands before the shaft bends the loop of either most
        taken = clear(_behind(search, paper), _behind(search, found))
    found = laws[best]
    choice = LawChoice(name=best if taken else "bouc_wen", held_out=held_out, rival=nrmse(paper), beside=effects)
    if not taken:
        return choice, problem, base
    if zeros_moved(found, one_zero(found, search.replay)):  # friction that differs by direction is searched as a cause
        problem, offsets = _without_zeros(problem, found, names)
        choice = replace(choice, offsets=offsets)
    log(f"the hysteresis has another shape: {choice.title}")
    layout = problem.parameters(found.layout.effects)
    return choice, problem, fit_model(problem, layout, found.x, tolerance=1e-4)


def structured(problem: Problem, base: Fit) -> bool:
    """Whether the mismatch is large against the noise from sample to sample: then plain error decides."""
    left = problem.motion.torque - base.torque
    bends = np.concatenate([np.diff(left[part], 2) for part in problem.motion.parts])
    noise = 1.4826 * float(np.median(np.abs(bends))) / np.sqrt(6.0)
    return float(np.sqrt(np.mean(left**2))) > _STRUCTURED * noise


def misfits(problem: Problem, fit: Fit) -> bool:
    """Whether a model is wrong by much that is structured, so that its whitened differences say what is quick only.

    Below :data:`_SMALL` of the torque what it leaves is a correction to a model that is right, and may be whitened.
    """
    left = problem.motion.torque - fit.torque
    return structured(problem, fit) and float(left.std()) > _SMALL * float(problem.motion.torque.std())


def _eq_14(
    search: LawSearch, base: Fit, screened: Sequence[Candidate], beside: list[str]
) -> tuple[Solution, Solution, tuple[str, ...]]:
    """Eq. 14 alone, and with what helps it most of the best effects, by the error on trajectories left out."""
    known = dict(base.parameters.choices)
    found = []
    alone = search.descend(search.layout(base.effects), base.x)
    for candidate in (None, *screened[:_RIVALS]):
        extra = [*base.effects, *beside, *([candidate.effect] if candidate else [])]
        layout = replace(search.layout(extra), choices=known)
        x = base.parameters.moved(base.x, layout)
        if candidate:
            own = layout.own(candidate.effect)
            if len(own) == len(candidate.values):
                x[own] = candidate.values
        found.append((search.descend(layout, x), tuple(e for e in layout.effects if e not in base.effects)))
    return alone, *min(found, key=lambda item: float(item[0].held_out.sum()))


def _behind(search: LawSearch, found: Solution) -> Solution:
    """A model with play or a spring before its shaft, where that predicts better."""
    best = found
    for name in YIELDING:
        if name in found.layout.effects:
            continue
        layout = replace(search.layout([*found.layout.effects, name]), choices=found.layout.choices)
        x, own = found.layout.moved(found.x, layout), layout.own(name)[0]
        starts = KNOWN[name].parameters[0].starts
        assert starts is not None
        trials = [np.where(np.arange(len(x)) == own, np.log(v), x) for v in starts(layout.ranges)]
        start = min(trials, key=lambda trial: search.evaluate(layout, trial).loss)
        best = min(best, search.descend(layout, start), key=lambda s: float(s.held_out.sum()))
    return best


def _without_zeros(problem: Problem, found: Solution, names: Sequence[str]) -> tuple[Problem, dict[str, float]]:
    """The problem with one zero for all trajectories where theirs have moved, and the zeros in the recording's unit."""
    motion = problem.motion
    torque = EffectReplay(motion, threads=problem.replay.threads).torque(found.layout.row(found.x)[None])[0]
    left = motion.torque - torque.astype(float)
    zeros = np.array([float(np.median(left[part])) for part in motion.parts])
    middle, slope = zero_line(LawSearch(problem.replay, problem.q_zero, offsets=True), zeros)
    zeros -= middle + slope * np.array([motion.current[part].mean() for part in motion.parts])
    moved = np.repeat(zeros, np.diff(motion.start))
    together, apart = float(np.var(left)), float(np.var(left - moved))
    if zeros.std() < _ZEROS_SHARE * motion.torque.std() or apart > (1.0 - _ZEROS_GAIN) * together:
        return problem, {}
    corrected = problem.with_motion(replace(motion, torque=motion.torque - moved))
    offsets = {name: float(zero) * motion.scales.torque for name, zero in zip(names, zeros, strict=True)}
    return replace(corrected, measured=problem.measured - moved), offsets
