"""Proof of a found effect before it is called a cause; one that fails is a suspect, with the reason in words.

The search decides by whitened differences, which on a device of another shape are about that shape. Here an effect has
to pass what does not rest on the noise's model: its interval excludes zero, its size is possible and the same however
the joint moves, and without it the plain simulation error of trajectories that took no part rises by more than chance,
with trajectories as units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.diagnose.held_out import Account, HeldOut, held_out_squares, hold_out, reduction
from mrwarp.diagnose.problem import Fit, Problem, covariance, drifts, fit_model, interval, plain_fit
from mrwarp.diagnose.residual_structure import leftovers
from mrwarp.diagnose.screening import Candidate, Models
from mrwarp.diagnose.search import Selection, expected_in, select
from mrwarp.effects.catalogue import KNOWN
from mrwarp.effects.law import Ranges
from mrwarp.identify.parameters import LINEAR, YIELDING, row_column
from mrwarp.identify.projection import Progress
from mrwarp.sysid.certainty import by_ratio, two_sizes
from mrwarp.sysid.jackknife import sum_and_error
from mrwarp.sysid.last_gate import Change, passed
from mrwarp.sysid.settings import Proof

_SPEEDS = ("slow and quick motion", "low and high speed")
_SHORT = "it is shorter than a sample: with this law it may only round the corners of the loop"
"""Why one that is shorter is no cause there."""
HIDDEN_MOTION = "it is a small part of a sample: with a shaft that yields it may stand for its hidden motion"
"""Why one that is shorter still is no cause there, and what it would take up no structure."""
_HIDDEN = "it is too small to resolve at your sampling rate"
"""Why a spring is no cause next to play, or next to another law; play that is none itself hides nothing."""


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """Why an effect that was found is not proven."""

    effect: str
    reason: str
    gain: float
    """Its reduction of the loss where it was found, as a share of the baseline's."""
    fit: Fit
    """The model, as it would be reported, in which it was found."""


def select_proven(
    models: Models, screened: list[Candidate], log: Progress = lambda text: None
) -> tuple[Selection, tuple[Rejection, ...]]:
    """Search the causes and try each; what fails is left out, and the rest searched again without it."""
    rejections: dict[str, Rejection] = {}
    problem, base, left = models.problem, models.base, screened
    rounds = problem.settings.proof.rounds
    for k in range(rounds):
        selection = _restarted(select(problem, base, left, log, models=models), models)
        found = _rejections(selection, models)
        if not found:
            break
        log(f"not proven: {', '.join(found)}")
        rejections |= found
        # the last search is only among what it has shown so far
        allowed = [c.effect for c in screened] if k < rounds - 2 else selection.named
        left = [c for c in screened if c.effect in allowed and c.effect not in rejections]
        models.fits = {effects: fit for effects, fit in models.fits.items() if not rejections.keys() & set(effects)}
    else:
        selection = select(problem, base, [], log)
    alternatives = _possible_alternatives(selection, models)
    for effect, rejection in rejections.items():
        if rejection.reason == _SHORT:  # it may be there all the same, and what is named instead stand for it
            for name in set(selection.named) - set(rejection.fit.effects):
                alternatives[name] = (*alternatives.get(name, ()), effect)
    return replace(selection, screened=screened, alternatives=alternatives), tuple(rejections.values())


def _restarted(selection: Selection, models: Models) -> Selection:
    """The search's end with play that predicts best: fits of play with another law stop where contacts come and go.

    It is also fitted from the model without play, from the gap found and from larger ones.
    """
    problem, final = models.problem, selection.final
    again = [(e, p.tried_again) for e in selection.named for p in KNOWN[e].parameters if p.tried_again]
    if not final.parameters.law or not again:
        return selection
    play, factors = again[0]
    without = models.reported(models.without(final, play))
    least = min(held_out_squares(problem, fit).sum() for fit in (without, models.reported(final)))
    own = final.parameters.own(play)
    for larger in factors:
        x = without.parameters.moved(without.x, final.parameters)
        x[own] = final.x[own] + np.log(larger)
        plain = plain_fit(problem, replace(final, x=x))
        left = held_out_squares(problem, plain).sum()
        if left < least:
            x = plain.parameters.moved(plain.x, final.parameters)
            least, selection = left, replace(selection, final=fit_model(problem, final.parameters, x, iterations=0))
    return selection


def _possible_alternatives(selection: Selection, models: Models) -> dict[str, tuple[str, ...]]:
    """Effects that would do as well in a named one's place, without those whose size no device has there."""
    problem, found = models.problem, {}
    for effect, names in selection.alternatives.items():
        rest = [name for name in selection.final.effects if name != effect]
        fits = {name: models.fits.get(problem.parameters([*rest, name]).effects) for name in names}
        found[effect] = tuple(
            name for name, fit in fits.items() if fit is None or not _size_rejection(name, fit, problem)
        )
    return found


def without_parts(models: Models, selection: Selection, account: Account) -> tuple[Selection, tuple[Rejection, ...]]:
    """The selection without effects that may be a part of what repeats without a name, because that is much larger.

    A law of another shape leaves pieces that some effect fits: on devices by other laws these took a tenth to a sixth
    of what repeated, effects that were there a third and more. What takes the place of a term of eq. 14 is no piece.
    """
    rejections: list[Rejection] = []
    if account.competing <= account.unreported or not selection.named:
        return selection, ()
    problem, fit = models.problem, models.reported(selection.final)
    after = float(held_out_squares(problem, fit).sum())
    baseline = float(held_out_squares(problem, models.reported(selection.base)).sum())
    for effect in selection.named:
        if effect == expected_in(problem):
            continue
        without = float(held_out_squares(problem, models.reported(models.without(selection.final, effect))).sum())
        gain = (without - after) / baseline
        if gain < problem.settings.gain.part * account.competing:
            times = account.competing / max(gain, 1e-9)
            much = f"{times:.0f} times as large" if times < 100.0 else "far larger"
            reason = f"the mismatch that repeats without a name is {much}: it may be a part of that"
            rejections.append(Rejection(effect=effect, reason=reason, gain=max(gain, 0.0), fit=fit))
    return _without(models, selection, [x.effect for x in rejections]), tuple(rejections)


def without_unknown(models: Models, selection: Selection, final: Fit) -> tuple[Selection, tuple[Rejection, ...]]:
    """The selection without effects whose interval, as reported of ``final``, says nothing of their size.

    The error of smoothing is in it. That changes an inertia's size, not whether it is there; another effect that may
    vanish with it makes up for what the smoother took.
    """
    final, expected = models.reported(final), expected_in(models.problem)
    proof = models.problem.settings.proof
    asked = [e for e in selection.named if e != expected and not KNOWN[e].inertial]
    unknown = {e: why for e in asked if (why := interval_rejection(e, final, proof, selection.refined))}
    return _without(models, selection, list(unknown)), _refused(selection, unknown, final)


def through_gate(models: Models, selection: Selection, seed: int) -> tuple[Selection, tuple[Rejection, ...], HeldOut]:
    """The selection through the last gate, with what is refused there and the predictions of held-out trajectories."""
    problem, base = models.problem, models.reported(selection.base)

    def with_only(named: Sequence[str]) -> Selection:
        return _without(models, selection, [effect for effect in selection.named if effect not in named])

    def errors(named: Sequence[str]) -> tuple[tuple[float, float], dict[str, Change], HeldOut]:
        own = with_only(named)
        held = hold_out(problem, own, base, models.reported(own.final))
        return reduction(held, seed)[1], {"torque": Change.of(held.baseline, held.extended)}, held

    def impossible(named: Sequence[str]) -> dict[str, str]:
        fit = models.reported(with_only(named).final)
        return {effect: impossible_size(effect, fit, problem.motion.ranges) for effect in named}

    named, refused, held = passed(
        selection.named,
        faults=impossible,
        errors=errors,
        gains=lambda effect, _: selection.own_gain.get(effect, selection.gain),
        most=problem.settings.gain.share,
    )
    return with_only(named), _refused(selection, refused, models.reported(selection.final)), held


def _refused(selection: Selection, reasons: Mapping[str, str], fit: Fit) -> tuple[Rejection, ...]:
    """Effects that are taken out after the search, by their reasons, with their numbers in ``fit``."""
    gains = {e: max(selection.own_gain.get(e, selection.gain), 0.0) / selection.base.total for e in reasons}
    return tuple(Rejection(effect=e, reason=why, gain=gains[e], fit=fit) for e, why in reasons.items())


def _without(models: Models, selection: Selection, effects: Sequence[str]) -> Selection:
    """The selection without some of its effects, with what is left over then."""
    if not effects:
        return selection
    final = selection.final
    for effect in effects:
        final = models.without(final, effect)
    own, odds = ({e: x for e, x in of.items() if e not in effects} for of in (selection.own_gain, selection.odds))
    return replace(selection, final=final, own_gain=own, odds=odds, leftovers=leftovers(models.problem, final))


def _rejections(selection: Selection, models: Models) -> dict[str, Rejection]:
    """Effects of a search that are not proven."""
    if not selection.named:
        return {}
    problem, fit = models.problem, models.reported(selection.final)
    reasons = _unknown_sizes(selection, models)
    if not any(reasons.values()):  # next to an impossible effect, nothing else has its true size
        after = held_out_squares(problem, fit)
        for effect in selection.named:
            before = held_out_squares(problem, models.reported(models.without(selection.final, effect)))
            reasons[effect] = _gain_rejection(before, after, problem.settings.gain.one_error)
            # what takes away more than all that is left is no piece of it, for any exact form of its law, but for a
            # lag, which rounds the corners of every loop
            corners = problem.misfit and KNOWN[effect].rounds_corners
            if not reasons[effect] and (corners or before.sum() < 2.0 * after.sum()):
                reasons[effect] = _halves_rejection(effect, fit, problem)
    gains = {e: selection.own_gain.get(e, selection.gain) / selection.base.total for e in selection.named}
    return {e: Rejection(effect=e, reason=x, gain=gains[e], fit=fit) for e, x in reasons.items() if x}


def _unknown_sizes(selection: Selection, models: Models) -> dict[str, str]:
    """Why the size of each named effect is not possible or not known, or nothing."""
    fit = models.reported(selection.final)
    reasons = {e: _unknown(e, fit, models.problem, selection.refined) for e in selection.named}
    hides_nothing = {e for e in reasons if reasons.get(KNOWN[e].hidden_by)}
    return {e: "" if e in hides_nothing and x == _HIDDEN else x for e, x in reasons.items()}


def _gain_rejection(before: np.ndarray, after: np.ndarray, least_t: float) -> str:
    """Why the fall of the trajectories' squared errors, both of shape (T,), may be chance, or nothing.

    It has to be ``least_t`` standard errors in their sum and by each one's own error: in the sum only the few with the
    largest torque count.
    """
    gain, error = sum_and_error(before - after)
    if gain <= least_t * error or by_ratio(before, after) <= least_t:
        better = int((before > after).sum())
        return (
            f"without it the simulation of unseen trajectories is as good, but for chance (better with it in {better} "
            f"of {len(before)})"
        )
    return ""


def _halves_rejection(effect: str, fit: Fit, problem: Problem) -> str:
    """Why an effect stands for something else, or nothing: a true one has the same size however the joint moves.

    What makes up for the shape of a loop is a matter of some speeds, angles or currents: a lag that rounds corners acts
    at reversals, cogging that bends a step acts at its angle. The samples are halved by each of these, so that both
    halves bear half of what the effect changes if each has enough runs, else in the middle, and its size is fitted in
    each, with all else free and common.
    """
    motion, own, settings = problem.motion, fit.parameters.own(effect), problem.settings
    if drifts(effect) or not set(own) & set(fit.free):
        return ""
    change = problem.weight * (fit.torque - without_effect(problem, fit, effect))
    free = [i for i in fit.free if i not in own]
    rows = np.vstack([fit.slopes[free], (motion.torque - fit.torque)[None]]) * problem.weight
    rows[-1] += change
    rates = [float(motion.qdd[r].std() / max(motion.qd[r].std(), 1e-9)) for r in motion.parts]
    drives = {
        _SPEEDS[0]: np.repeat(rates, np.diff(motion.start)),
        _SPEEDS[1]: np.abs(motion.qd),
        "small and large acceleration": np.abs(motion.qdd),
        "the middle and the ends of the stroke": np.abs(motion.q - 0.5 * (motion.q.min() + motion.q.max())),
        "low and high current": motion.current,
    }
    for drive, x in drives.items():
        order = np.argsort(x, kind="stable")
        energy = np.cumsum(change[order] ** 2)
        for cut in (x[order][int(np.searchsorted(energy, 0.5 * energy[-1]))], float(np.median(x))):
            low = change * (x <= cut)
            halves = np.stack([low, change - low])
            bears = np.add.reduceat(halves**2, motion.start[:-1], axis=1)
            whole = bears.sum(axis=1, keepdims=True)
            many = ((bears > settings.gain.share * whole).sum(axis=1) >= settings.gain.few).all()
            in_many = many and whole.min() > settings.rest.unreported * whole.sum()
            if in_many:
                break
        if not in_many:
            continue
        parts = [np.vstack([rows[:-1, p], halves[:, p], rows[-1:, p]]) for p in motion.parts]
        sizes, error = two_sizes(np.stack([part @ part.T for part in parts]))
        small, large = sorted(sizes, key=abs)
        ratio = settings.proof.twice ** (2 if KNOWN[effect].dry and drive in _SPEEDS else 1)
        if abs(large - small) > settings.gain.likely_t * error and small / large < 1.0 / ratio:
            return (
                f"it has no single size: it differs between {drive} by more than chance, and by over {ratio:.0f} times"
            )
    return ""


def _unknown(
    effect: str, fit: Fit, problem: Problem, refined: Mapping[tuple[str, str], tuple[float, float, float]]
) -> str:
    """Why the size of an effect is not possible or not known, or nothing."""
    possible = _size_rejection(effect, fit, problem)
    return possible or interval_rejection(effect, fit, problem.settings.proof, refined)


def interval_rejection(
    effect: str, fit: Fit, proof: Proof, refined: Mapping[tuple[str, str], tuple[float, float, float]] | None = None
) -> str:
    """Why the size of an effect is not known, or nothing.

    An effect of several numbers that may be zero is known if one of them is, with the 95 % shared among them. Of a
    number that is known better than by the fit, in ``refined``, the interval that is reported decides.
    """
    spread, known = covariance(fit), False
    own = [(i, slot) for i, slot in fit.parameters.items() if slot.effect == effect and not slot.parameter.form]
    linear = [i for i, slot in own if not slot.logarithmic or slot.parameter.null > 0.0]
    for i, slot in own:
        if i in linear:
            low, high = interval(fit, i, spread, 1.0 - 0.05 / len(linear))
            null = float(np.log(slot.parameter.null)) if slot.logarithmic else slot.parameter.null
            known |= not low <= null <= high
        elif i == fit.parameters.own(effect)[0]:
            low, high = interval(fit, i, spread)
            if better := (refined or {}).get(slot.key):
                low, high = np.log(np.maximum(better[1:], 1e-300))
            if high - low > np.log(proof.known_within):
                return "its size is not known within a factor of five"
    return "its 95 % interval contains zero" if linear and not known else ""


def _size_rejection(effect: str, fit: Fit, problem: Problem) -> str:
    """Why an effect of such a size is not possible, or stands for something else, or nothing."""
    first, ranges, torque = fit.parameters.own(effect)[0], problem.motion.ranges, problem.motion.torque
    value = dict(fit.parameters.items())[first].value(fit.x[first])
    inexact = problem.misfit or bool(fit.parameters.law)
    if inexact and KNOWN[effect].rounds_corners and value < ranges.dt:
        return _SHORT
    unseen = problem.settings.proof.unseen * ranges.dt
    if KNOWN[effect].rounds_corners and value < unseen and set(YIELDING) & set(fit.effects):
        return HIDDEN_MOTION
    finest = 0.5 if KNOWN[effect].hidden_by in fit.effects else inexact * problem.settings.proof.unseen
    if KNOWN[effect].hidden_by and value * ranges.torque < finest * ranges.qd * ranges.dt:
        return _HIDDEN
    if impossible := impossible_size(effect, fit, ranges):
        return impossible
    counts, bears = problem.weight > 0.0, fit.torque - without_effect(problem, fit, effect)
    if KNOWN[effect].rare and np.mean([bears[part].any() for part in problem.motion.parts]) < 0.5:
        return KNOWN[effect].rare
    if KNOWN[effect].needs == "angle" and interval(fit, LINEAR.index("C"), covariance(fit))[1] < 0.0:
        return "next to this weight the spring C would push away from its rest, which none does"
    if KNOWN[effect].mechanics:  # inertia opposes a weight, a spring and friction: each may bear more than all do
        return ""
    borne = float(bears[counts].std() / max(torque[counts].std(), 1e-12))
    return f"it would bear {borne:.2g} times the torque, which another term takes back" if borne > 1.0 else ""


def impossible_size(effect: str, fit: Fit, ranges: Ranges) -> str:
    """Why no device has an effect of such a sign or size, or nothing."""
    own = {i: slot for i, slot in fit.parameters.items() if slot.effect == effect}
    first = fit.parameters.own(effect)[0]
    value = own[first].value(fit.x[first])
    if KNOWN[effect].one_positive:
        value = max(fit.x[i] for i, slot in own.items() if slot.linear)
    if would_be_negative(effect, value):
        return f"it would be negative: {KNOWN[effect].positive}"
    for i, slot in own.items():
        size, most, beyond = slot.value(fit.x[i]), slot.parameter.most(ranges), slot.parameter.beyond
        if size > most:
            times = f"{1e3 * size:.3g} ms are not possible: {beyond} (at most {1e3 * most:.0f} ms)"
            return times if slot.parameter.unit == "s" else beyond
    return ""


def would_be_negative(effect: str, value: float) -> bool:
    """Whether the first number of an effect has a sign that no device has."""
    return bool(KNOWN[effect].positive) and value <= 0.0


def without_effect(problem: Problem, fit: Fit, effect: str) -> np.ndarray:
    """Torque of a model whose effect is taken out and all else kept, shape (N,)."""
    row = fit.row
    for parameter in KNOWN[effect].parameters:
        row[row_column(effect, parameter.name)] = parameter.null
    return problem.replay.torque(row[None])[0].astype(float)
