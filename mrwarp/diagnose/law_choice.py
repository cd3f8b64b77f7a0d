"""Which hysteresis law the device follows, asked before any effect: eq. 15, or a published one in its place.

All laws are judged in one way: plain simulation error of trajectories left out in turn, each with its own zero of the
torque. Eq. 14 is preferred. It is tried with the best effects of the catalogue, and another law is taken only if it
leaves less error by more than chance over the trajectories *and* by the margin of :class:`~mrwarp.sysid.settings.Law`:
a hidden effect bends a loop too, and a law of another shape would take that up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, fit_model, threshold
from mrwarp.diagnose.screening import Candidate, lacking_together
from mrwarp.effects.catalogue import HYSTERESIS, KNOWN, OF_PUBLISHED_LAWS
from mrwarp.identify.law_fit import LawSearch, Solution, law_search, one_zero, turn_back, zero_line, zeros_moved
from mrwarp.identify.parameters import LINEAR, SHAPE, SHAPE_PART, YIELDING, slots_of
from mrwarp.identify.projection import Progress
from mrwarp.identify.replay import EffectReplay
from mrwarp.sysid.certainty import by_ratio
from mrwarp.sysid.settings import Law

_SINGLE = "dahl"
"""The law that eq. 15 becomes with alpha = gamma = 0."""


@dataclass(frozen=True, kw_only=True)
class LawChoice:
    """The hysteresis law of a device, and what it was compared with."""

    name: str
    """Law of the baseline; ``bouc_wen`` is the paper's."""
    held_out: Mapping[str, float]
    """NRMSE on trajectories left out in turn, each with its own zero, of every law that was tried, with inertia and
    gravity if the recording shows them."""
    rival: float
    """Error of eq. 14 with the effects that help it most."""
    beside: tuple[str, ...] = ()
    """These effects."""
    simpler: bool = False
    """Whether the law was taken as one of fewer numbers than eq. 15 that predicts as well."""
    offsets: Mapping[str, float] = field(default_factory=dict)
    """Zero of each trajectory where another law was taken and they have moved, about most of them [unit of the torque].

    With eq. 14 they stay: the mean rest of a wrong law in a trajectory may be its own form.
    """

    @property
    def other(self) -> bool:
        """Whether another law than the paper's was taken."""
        return self.name != "bouc_wen"

    @property
    def title(self) -> str:
        """The law in words."""
        return HYSTERESIS[self.name].title if self.other else "eq. 14"

    def moved(self, gap: float) -> list[str]:
        """Trajectories on the far side of the widest gap between zeros, if it is that share of their range."""
        names = sorted(self.offsets, key=lambda name: self.offsets[name])
        zeros = np.array([self.offsets[name] for name in names])
        gaps = np.diff(zeros)
        if not len(gaps) or gaps.max() < gap * np.ptp(zeros):
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
    if not may_follow_another_law(problem, base):
        return None, problem, base
    log(f"other hysteresis laws: {', '.join(law.title for law in HYSTERESIS.values())}")
    limit = problem.settings.effort.samples
    small = motion.stretches(limit, problem.settings.effort.runs)
    threads, q_zero = problem.replay.threads, problem.q_zero
    search = LawSearch(EffectReplay(small, threads=threads), q_zero, offsets=True)
    with_effects = [e for e in OF_PUBLISHED_LAWS["term"] if search.levels > 1 and e not in problem.impossible]
    shown = [c.effect for c in screened if base.total - c.total > threshold(problem, base)]
    shown += [c.effect for c in lacking_together(problem, base, [c.effect for c in screened])]
    # what follows the velocity alone is a matter of the loop
    along = {e: {*KNOWN[e].depends_on} for e in dict.fromkeys(shown) if KNOWN[e].mechanics}
    mechanics = [e for e in along if along[e] & {"q", "qdd"}]
    count, spread = float(search.weight.sum()), float(small.torque.std()) or 1.0

    def nrmse(found: Solution) -> float:
        return float(np.sqrt(found.held_out.sum() / count)) / spread

    laws = {
        name: law_search(
            small, q_zero, name, offsets=True, effects=[*with_effects, *mechanics], threads=threads, limit=limit
        )
        for name in HYSTERESIS
    }
    settings = problem.settings.law
    alone, paper, effects = _eq_14(search, base, screened, with_effects, mechanics, laws[_SINGLE], settings.rivals)
    held_out = {"bouc_wen": nrmse(alone)} | {name: nrmse(found) for name, found in laws.items()}
    rounded = _next_to_lags(search, laws, screened) if problem.unchanging else laws
    best = min(rounded, key=lambda name: _error(rounded[name]))
    near = [name for name in laws if _error(rounded[name]) < (1.0 + settings.simpler) ** 2 * _error(rounded[best])]
    best = min(near, key=lambda name: (laws[name].layout.size, held_out[name]))
    found = rounded[best]
    found = min(found, _next_to(search, found, paper, [e for e in effects if e not in base.effects]), key=_error)
    taken = _clear(settings, paper, found)
    if _error(found) < _error(paper):  # what stands before the shaft may bend the loop more than another law does
        behind = _behind(search, paper)
        if not taken or _error(behind) < _error(found):
            taken = _clear(settings, behind, _behind(search, found))
    fewer = len(slots_of(best)) < len(SHAPE) and _error(found) < (1.0 + settings.simpler) ** 2 * _error(paper)
    simpler = not taken and problem.unchanging and fewer
    found = laws[best]
    choice = LawChoice(
        name=best if taken or simpler else "bouc_wen",
        held_out=held_out,
        rival=nrmse(paper),
        beside=effects,
        simpler=simpler,
    )
    if not choice.other:
        return choice, problem, base
    # friction that differs by direction is searched as a cause
    if turn_back(motion) and zeros_moved(found, one_zero(found, search.replay, settings.moved), settings.moved):
        problem, offsets = _without_zeros(problem, found, names)
        choice = replace(choice, offsets=offsets)
    log(f"the hysteresis has another shape: {choice.title}")
    layout = problem.parameters([name for name in found.layout.effects if name not in mechanics])
    return choice, problem, fit_model(problem, layout, found.layout.moved(found.x, layout), tolerance=1e-4)


def _error(found: Solution) -> float:
    """Squared error of a solution on trajectories left out."""
    return float(found.held_out.sum())


def _next_to_lags(
    search: LawSearch, laws: Mapping[str, Solution], screened: Sequence[Candidate]
) -> dict[str, Solution]:
    """The laws, each with the lag that helps it most, where one does: a lag rounds corners as a softer law would."""
    found, lags = dict(laws), [c for c in screened if KNOWN[c.effect].rounds_corners]
    for name, law in laws.items():
        for lag in lags:
            layout = replace(search.layout([*law.layout.effects, lag.effect]), choices=lag.choices)
            x = law.layout.moved(law.x, layout)
            x[layout.own(lag.effect)] = lag.values
            found[name] = min(found[name], search.descend(layout, x), key=_error)
    return found


def _next_to(search: LawSearch, found: Solution, paper: Solution, effects: Sequence[str]) -> Solution:
    """Another law with the effects that eq. 14 has: a true one bears as much of either's error."""
    extra = [name for name in effects if name not in found.layout.effects]
    if not extra:
        return found
    layout = replace(search.layout([*found.layout.effects, *extra]), choices=paper.layout.choices)
    x = found.layout.moved(found.x, layout)
    for name in extra:
        x[layout.own(name)] = paper.x[paper.layout.own(name)]
    return search.descend(layout, x)


def _clear(law: Law, paper: Solution, found: Solution) -> bool:
    """Whether another law predicts clearly better than the paper's."""
    after, before = found.held_out.sum(), paper.held_out.sum()
    return by_ratio(paper.held_out, found.held_out) > law.t and bool(after < (1.0 - law.margin) ** 2 * before)


def may_follow_another_law(problem: Problem, base: Fit) -> bool:
    """Whether the laws are compared: of some trajectories, where eq. 14 leaves much, and no other law is known."""
    enough = len(problem.motion.parts) >= problem.settings.gain.few
    return enough and not base.parameters.law and structured(problem, base)


def structured(problem: Problem, base: Fit) -> bool:
    """Whether the mismatch is large against the noise from sample to sample: then plain error decides."""
    return _structured(problem, _left(problem, base))


def _structured(problem: Problem, left: np.ndarray) -> bool:
    """As :func:`structured`, of what a model leaves, shape (N,)."""
    counts = problem.weight > 0.0
    bends = np.concatenate([np.diff(left[part], 2)[counts[part][2:]] for part in problem.motion.parts])
    left = left[counts]
    noise = 1.4826 * float(np.median(np.abs(bends))) / np.sqrt(6.0)
    return float(np.sqrt(np.mean(left**2))) > problem.settings.law.structured * noise


def _left(problem: Problem, fit: Fit) -> np.ndarray:
    """Torque that a model leaves, without the zeros and gains by which trajectories differ, shape (N,)."""
    left = problem.motion.torque - fit.torque
    return left - problem.of_runs(left, fit.torque)


def misfits(problem: Problem, fit: Fit) -> bool:
    """Whether a model is wrong by much that is structured, so that its whitened differences say what is quick only.

    Below :attr:`~mrwarp.sysid.settings.Gain.detail` what it leaves is a correction to a model that is right, and may be
    whitened.
    """
    left = _left(problem, fit)
    detail = problem.settings.gain.detail * float(problem.motion.torque.std())
    return float(left[problem.weight > 0.0].std()) > detail and _structured(problem, left)


def _eq_14(
    search: LawSearch,
    base: Fit,
    screened: Sequence[Candidate],
    with_effects: list[str],
    mechanics: list[str],
    single: Solution,
    rivals: int,
) -> tuple[Solution, Solution, tuple[str, ...]]:
    """Eq. 14 with inertia and gravity if there are any, and with what helps it most of the best effects.

    The error on trajectories left out counts. Each is fitted from the baseline and from ``single``, the law that eq. 15
    contains: a baseline without them may have a loop that stands for it. ``rivals`` effects are tried.
    """
    known = dict(base.parameters.choices)

    def descend(effects: Sequence[str], candidate: Candidate | None = None) -> Solution:
        layout = replace(search.layout([*base.effects, *effects]), choices=known)
        starts = [base.parameters.moved(base.x, layout)]
        if mechanics:  # the baseline's loop stands for them
            x = single.layout.moved(single.x, layout)
            rate = float(np.log(single.layout.values(single.x)[_SINGLE]["rate"]))
            x[SHAPE_PART] = np.clip([0.0, rate, rate], layout.low[SHAPE_PART], layout.high[SHAPE_PART])
            x[[LINEAR.index("K0"), LINEAR.index("K1")]] *= np.exp(x[SHAPE_PART.start + 1])
            starts.append(x)
        for x in starts:
            if candidate and len(own := layout.own(candidate.effect)) == len(candidate.values):
                x[own] = candidate.values
        return min((search.descend(layout, x) for x in starts), key=_error)

    found = []
    for candidate in (None, *[c for c in screened if c.effect not in mechanics][:rivals]):
        solution = descend([*with_effects, *mechanics, *([candidate.effect] if candidate else [])], candidate)
        found.append((solution, tuple(e for e in solution.layout.effects if e not in base.effects)))
    return descend(mechanics), *min(found, key=lambda item: _error(item[0]))


def _behind(search: LawSearch, found: Solution) -> Solution:
    """A model with play and a spring before its shaft, as far as each predicts better."""
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
        best = min(best, search.descend(layout, start), key=_error)
    return best if best is found else _behind(search, best)


def _without_zeros(problem: Problem, found: Solution, names: Sequence[str]) -> tuple[Problem, dict[str, float]]:
    """The problem with one zero for all trajectories where theirs have moved, and the zeros in the recording's unit."""
    motion = problem.motion
    torque = EffectReplay(motion, threads=problem.replay.threads).torque(found.layout.row(found.x)[None])[0]
    left = motion.torque - torque.astype(float)
    zeros = np.array([float(np.median(left[part])) for part in motion.parts])
    middle, slope = zero_line(LawSearch(problem.replay, problem.q_zero, offsets=True), zeros)
    zeros -= middle + slope * np.array([motion.current[part].mean() for part in motion.parts])
    moved = np.repeat(zeros, np.diff(motion.start))
    together, separate = float(np.var(left)), float(np.var(left - moved))
    gain = problem.settings.gain
    if zeros.std() < gain.detail * motion.torque.std() or separate > gain.half * together:
        return problem, {}
    corrected = problem.with_motion(replace(motion, torque=motion.torque - moved))
    offsets = {name: float(zero) * motion.scales.torque for name, zero in zip(names, zeros, strict=True)}
    return replace(corrected, measured=problem.measured - moved), offsets
