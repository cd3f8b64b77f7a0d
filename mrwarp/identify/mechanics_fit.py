"""Identification of a motor or an arm's joint without any device: inertia, gravity, spring, viscous and dry friction.

Linear in its numbers: all are fitted at once, then those that the data do not need are taken out again, by the error on
trajectories left out in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.checks.limits import Limits
from mrwarp.identify.checks.lone_samples import ROUNDS, beside_spikes, far_off, find_spikes
from mrwarp.identify.contradictions import refuse_contradictions
from mrwarp.identify.dataset import Motion
from mrwarp.identify.fit import PARAMETERS, FitResult, fit, made_motion, misfit, origin
from mrwarp.identify.law_fit import LawSearch, Solution, outer_numbers, printed_numbers
from mrwarp.identify.parameters import LINEAR, SHAPE_PART, Parameters
from mrwarp.identify.projection import Progress
from mrwarp.identify.replay import EffectReplay
from mrwarp.params import BoucWenParams
from mrwarp.recording.load import Holding, Recording, RecordingError
from mrwarp.sysid.certainty import gain_and_t
from mrwarp.sysid.settings import Data, Gain, Settings

SPRING = "C"
"""The term of eq. 14 that may go as an effect does: over a short way a weight and a spring resemble each other."""


RUBS = next(name for name, law in CATALOGUE.items() if law.mechanics and law.dry)
SOFTLY = "biviscous"
"""Dry friction as an effect; and the law of one that turns its direction over a range of speeds."""

MECHANICAL = ("D", "B", SPRING, *printed_numbers([name for name, law in CATALOGUE.items() if law.mechanics]))
"""Numbers of a joint without a device, as a fit prints them."""


class _Bodies(LawSearch):
    """Eq. 14 without hysteresis, with effects that only add; ``spring`` says whether it has C."""

    spring = True

    def bounds(self, layout: Parameters) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds: no hysteresis but a law's, nothing over a current."""
        low, high = super().bounds(layout)
        own = {LINEAR.index(name) for name in self.limits if name in LINEAR}
        gone = [LINEAR.index(name) for name in ("I1", "K1", *(() if self.spring else (SPRING,)))]
        if not layout.law:
            gone.append(LINEAR.index("K0"))
        gone = [i for i in gone if i not in own]
        low[gone] = high[gone] = 0.0
        low[SHAPE_PART] = high[SHAPE_PART] = 0.0
        return low, high

    def fitted(self, terms: Sequence[str]) -> Solution:
        """The fit with these effects, and C if it is among them."""
        self.spring = SPRING in terms
        layout = self.layout([e for e in terms if e != SPRING])
        starts = self.starts(layout) if layout.law else [np.zeros(layout.size)]
        return min((self.descend(layout, x) for x in starts), key=lambda s: float(s.held_out.sum()))

    def limited(self, term: str) -> bool:
        """Whether a number of an effect, or C, is given or bounded."""
        return any(name == term or name.startswith(f"{term}.") for name in self.limits)

    def without_spikes(self, terms: Sequence[str]) -> np.ndarray:
        """Samples that stand out of what these terms leave, and come again nowhere, bool, shape (N,)."""
        weight, motion, settings = self.weight, self.motion, Settings()
        far = np.zeros(len(weight), dtype=bool)
        left = motion.torque
        for _ in range(ROUNDS):
            self.weight = weight * ~far
            left = motion.torque - self.fitted(terms).torque
            before, far = far, far_off(left, motion, weight > 0.0, settings.spikes.far)
            if (far == before).all():
                break
        found = find_spikes(left, motion.torque - left, motion, weight > 0.0, settings)
        self.weight = motion.settled(4.0) * ~beside_spikes(found, motion)
        return found


def fit_joint(
    recording: Recording,
    *,
    holding: Holding | None = None,
    robust: bool = False,
    seed: int = 0,
    progress: Progress | None = None,
    limits: Limits | None = None,
) -> FitResult:
    """Identify a joint: eqs. 14 and 15, or without any current the mechanics alone where they predict better.

    The arguments are those of :func:`mrwarp.identify.fit.fit`.

    Raises:
        ValueError: ``limits`` name what neither has.
        RecordingError: as :func:`mrwarp.identify.fit.fit` does.
    """
    refuse_contradictions(recording)
    bodies, named = None, {*(limits.ends if limits else ())}
    if not any(run.current.any() for run in recording.trajectories) and not named - {*MECHANICAL}:
        bodies = fit_mechanics(recording, seed=seed, progress=progress, limits=limits)
        if named - {*PARAMETERS}:
            return bodies
    try:
        device = fit(recording, holding=holding, robust=robust, seed=seed, progress=progress, limits=limits)
    except RecordingError:
        if bodies is None or max(bodies.nrmse, bodies.held_out or 0.0) >= Data().nothing:
            raise
        return bodies
    if bodies is None or not bodies.effects:
        return device
    unseen = (bodies.held_out or bodies.nrmse, device.held_out or device.nrmse)  # of one run there is none
    return bodies if unseen[0] < unseen[1] else device


def fit_mechanics(
    recording: Recording, *, seed: int = 0, progress: Progress | None = None, limits: Limits | None = None
) -> FitResult:
    """Inertia, gravity, spring and friction of a joint without a device; single spikes of the torque do not count.

    Args:
        recording: Measured runs.
        seed: Written to the result; nothing is drawn.
        progress: Called with what is being done.
        limits: Numbers of :data:`MECHANICAL` that are given or bounded; they stay in the model.
    """
    limits = limits or Limits()
    (progress or (lambda text: None))("inertia, gravity, spring and friction")
    motion = Motion.of(recording)
    radian = motion.ranges.radian > 0.0
    found = [name for name, law in CATALOGUE.items() if law.mechanics and (radian or law.needs != "angle")]
    search = _Bodies(EffectReplay(motion), 0.0, offsets=False, limits=limits.ends)
    search.without_spikes([SPRING, *found])
    search, rough = _smooth(search, recording, [SPRING, *found])
    motion = search.motion
    spikes = search.without_spikes([SPRING, *found])
    best, kept = _needed(search, [SPRING, *found])
    if RUBS in kept and not search.limited(RUBS):
        softly = search.fitted([SOFTLY if e == RUBS else e for e in kept])
        best = min(best, softly, key=lambda s: float(s.held_out.sum()))
    moved = rough.fitted([*best.layout.effects, *([SPRING] if SPRING in kept else [])]).x - best.x
    estimates, effects = outer_numbers(best, motion.scales, recording.units, error=np.abs(moved))
    warnings = made_motion(recording)
    if spikes.any():
        warnings.append(f"{int(spikes.sum())} samples of the torque are spikes: they are kept out of the fit")
        lost = [spikes[part] | ~run.known for part, run in zip(motion.parts, recording.trajectories, strict=True)]
        runs = [replace(run, lost=x) for run, x in zip(recording.trajectories, lost, strict=True)]
        recording = replace(recording, trajectories=tuple(runs))
    runs, weight = recording.trajectories, search.weight
    held = float(np.sqrt(best.held_out.sum() / weight.sum())) / (float(motion.torque.std()) or 1.0)
    left = ["D", "B", *([SPRING] if SPRING in kept else []), *(["K0"] if best.layout.law else [])]
    for name in set(estimates) - {*left}:  # what there is none of has no interval
        estimates[name] = replace(estimates[name], half=np.inf, half_joint=np.inf)
    return FitResult(
        estimates={name: e for name, e in estimates.items() if name not in limits.given},
        combinations={},
        fixed={"q_offset": 0.0, "q_center": 0.0, "coil_time_constant": 0.0, "alpha": 0.0, "gamma": 0.0, "beta": 1.0}
        | {"z_max": BoucWenParams().z_max}
        | {name: value for name, value in limits.given.items() if name in LINEAR},
        given=limits.given,
        condition=1.0,
        seed=seed,
        effects=effects,
        held_out=held if len(runs) > 1 else None,
        **origin(recording),
        **misfit(recording, best.torque, motion, warnings),
    )


def _smooth(search: _Bodies, recording: Recording, terms: list[str]) -> tuple[_Bodies, _Bodies]:
    """The search on the motion smoothed as much as predicts the torque best, and with half of that.

    Of a coarse angle's acceleration, what is quick is noise, which makes an inertia too small; what numbers still
    change by the last doubling is a part of their error.
    """
    rough, least, smoothing = search, float(search.fitted(terms).held_out.sum()), 2.0
    while smoothing <= Settings().reading.smoothing:
        replay = EffectReplay(Motion.of(recording, smoothing=smoothing))
        smooth = _Bodies(replay, 0.0, offsets=False, limits=search.limits)
        smooth.weight = search.weight
        if (left := float(smooth.fitted(terms).held_out.sum())) > (1.0 - Gain.share) * least:
            break
        rough, search, least, smoothing = search, smooth, left, 2.0 * smoothing
    return search, rough


def _needed(search: _Bodies, terms: list[str]) -> tuple[Solution, list[str]]:
    """The model and its terms, those without which unseen trajectories are predicted worse, of a possible sign."""
    gain = Gain()
    best = search.fitted(terms)
    while loose := [e for e in terms if not search.limited(e)]:
        wrong = [e for e in loose if e != SPRING and CATALOGUE[e].positive and best.x[best.layout.own(e)[0]] <= 0.0]
        without = {e: search.fitted([x for x in terms if x != e]) for e in wrong or loose}
        least = min(without, key=lambda e: float(without[e].held_out.sum()))
        more, t = gain_and_t(without[least].held_out, best.held_out)
        needed = t > gain.one_error and more > gain.share * float(best.held_out.sum())
        if not wrong and needed:
            break
        best = without[least]
        terms = [e for e in terms if e != least]
    return best, terms
