"""Which causes a plant has, by evidence: named causes and nameless structure enter and leave one model.

A model is the plant with some causes and some groups of nameless functions. Whichever adds most to the evidence enters,
as long as that is more than the prior odds against it; what the others have made idle leaves. A cause that nameless
structure explains as well is a suspect.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol

import numpy as np

from mrwarp.sysid.evidence import Discrepancy, Posterior, Signals, correlation, learned, left_over, posterior
from mrwarp.sysid.plant import Cause, Model, Named
from mrwarp.sysid.settings import Gain, Odds

Active = frozenset[int]
"""Nameless groups of a model."""
_Step = tuple[float, str, Model, Active]
"""Log odds of something more, its name, and the model and the nameless groups with it."""


class EvidencePlant(Named[Model, Cause], Protocol):
    """Questions that the evidence asks of a plant."""

    @property
    def base(self) -> Model:
        """The model without any cause."""
        ...

    @property
    def least(self) -> float:
        """Least variance of the noise in the signals' units; next to 0 where nothing is known of it."""
        ...

    def grown(self, model: Model, /) -> Iterable[tuple[str, Model]]:
        """The most promising of the possible models with one cause more, or with several that act together, by name."""
        ...

    def swapped(self, model: Model, cause: Cause, /) -> Iterable[tuple[Cause, Model]]:
        """Models that were fitted with another cause in one's place, and that cause."""
        ...

    def contains(self, cause: Cause, other: Cause, /) -> bool:
        """Whether a cause is another one with more numbers."""
        ...

    def ordinary(self, cause: Cause, /) -> bool:
        """Whether such plants have a cause as a rule, so that the prior odds are not against it."""
        ...

    def distinct(self, cause: Cause, other: Cause, /) -> bool:
        """Whether two causes are distinct, and by fits: none is a part of the other, and no other data decide."""
        ...

    def signals(self, model: Model, /) -> Signals:
        """Derivatives, nameless functions and mismatch of a model, by unit of chance."""
        ...

    def rest(self, model: Model, change: np.ndarray, sizes: np.ndarray, /) -> Sequence[np.ndarray]:
        """White rest of each unit after changes of the live numbers, (nb,), and nameless functions' sizes, (T, K)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Found(Generic[Model, Cause]):
    """Causes, suspects and nameless structure of a plant, by their evidence."""

    model: Model
    """The plant with its causes."""
    nameless: dict[int, float]
    """Groups of functions that are needed next to them, and the log odds of each."""
    odds: dict[Cause, float]
    """Log odds of each cause against the model without it."""
    rivals: dict[Cause, tuple[Cause, ...]]
    """Causes that would do as well in one's place, next to what has no name and within the odds of chance."""
    suspects: dict[Cause, Model]
    """Causes that fit, but less well than as much as has no name would by chance, and the model that has them."""
    entered: frozenset[Cause]
    """Of the suspects those that were not in the model from which the search began."""
    numbers: Sequence[int]
    """Places of the model's numbers that count."""
    variance: np.ndarray
    """Of these, with the nameless groups in, shape (nb,)."""
    correlation: float
    """Samples of what is left that count as one."""
    discrepancy: Discrepancy
    """Variances of the nameless functions about the model."""
    steps: list[list[tuple[str, float]]] = field(default_factory=list)
    """Best findings of each step, with their log odds."""


class Comparison(Generic[Model, Cause]):
    """Evidence of a plant's models, with the variances of what is nameless as learned about one of them."""

    def __init__(self, plant: EvidencePlant[Model, Cause]) -> None:
        self.plant, self.correlation = plant, 1.0
        self._signals: dict[Model, Signals] = {}
        self._learned: dict[Model, tuple[Discrepancy, float]] = {}
        self.discrepancy: Discrepancy = learned(self.signals(plant.base), plant.least)
        self.about(plant.base)

    def about(self, model: Model) -> None:
        """Learn the variances about a model, once, and how far what it leaves is correlated."""
        if model not in self._learned:
            start = learned(self.signals(model), self.plant.least, self.discrepancy)
            self.correlation = correlation(self.plant.rest(model, *left_over(self.signals(model), start)))
            self._learned[model] = learned(self.signals(model), self.plant.least, start), self.correlation
        self.discrepancy, self.correlation = self._learned[model]
        self._known: dict[tuple[Model, Active], Posterior] = {}
        self._totals: dict[Model, np.ndarray] = {}

    def signals(self, model: Model) -> Signals:
        """Signals of a model, in samples that count."""
        counted = self._counted(model)
        return replace(counted, grams=counted.grams / self.correlation)

    def _counted(self, model: Model) -> Signals:
        """Signals whose counts are samples that count, and whose Gram matrices are of all."""
        if model not in self._signals:
            self._signals[model] = self.plant.signals(model)
        return replace(self._signals[model], counts=self._signals[model].counts / self.correlation)

    def posterior(self, model: Model, active: Active) -> Posterior:
        """Evidence and numbers of a model with nameless groups."""
        key = model, active
        if key not in self._known:
            if model not in self._totals:
                self._totals[model] = self.discrepancy.reduced(self.signals(model)).sum(axis=0)
            total, start = self._totals[model], self.discrepancy.common
            self._known[key] = posterior(self._counted(model), total, sorted(active), start)
        return self._known[key]

    def log(self, model: Model, active: Active) -> float:
        """Log evidence of a model with nameless groups."""
        return self.posterior(model, active).log


class _Search(Generic[Model, Cause]):
    """A model that grows and shrinks by its evidence."""

    def __init__(self, plant: EvidencePlant[Model, Cause], odds: Odds, gain: Gain) -> None:
        self.plant, self.odds, self.gain, self.compared = plant, odds, gain, Comparison(plant)
        self.model, self.active = plant.base, frozenset[int]()
        self.groups = range(int(self.compared.signals(plant.base).group.max(initial=-1)) + 1)
        self.steps: list[list[tuple[str, float]]] = []
        self.out: set[Cause] = set()
        self.proven: set[Cause] | None = None
        self.closed = False  # whether causes may enter no more
        self._judged: dict[tuple[Model, Cause, bool], tuple[float, bool]] = {}

    def score(self, model: Model, active: Active) -> float:
        """Log evidence with the prior odds against what has no name."""
        return self.compared.log(model, active) - 0.5 * self.gain.distinct * len(active)

    def grows(self) -> bool:
        """Let the best cause or nameless group enter; False where none adds enough.

        A cause comes before a group that adds up to twice as much: what is left of that then competes with it. What it
        contains comes before it where both are as likely. Next to what was proven before, one that is not ordinary has
        to add more than any group, and none enters after some that left nameless ones.
        """
        now, causes = self.score(self.model, self.active), list[_Step[Model]]()
        present = set(self.plant.causes(self.model))
        for name, model in () if self.closed else self.plant.grown(self.model):
            new = set(self.plant.causes(model)) - present
            if not new & self.out:
                against = self.odds.enters * (sum(not self.plant.ordinary(cause) for cause in new) - 1)
                causes.append((self.score(model, self.active) - now - against, name, model, self.active))
        more = {group: self.active | {group} for group in self.groups if group not in self.active}
        nameless = [(self.score(self.model, x) - now, f"nameless {g}", self.model, x) for g, x in more.items()]
        best = max(nameless, key=lambda row: row[0], default=(0.0,))[0]
        found = sorted(causes + nameless, key=lambda row: -row[0])
        self.steps.append([(name, gain) for gain, name, *_ in found[:5]])
        first = max(causes, key=lambda row: row[0], default=None)
        if first is not None:
            first = self._simpler(first, causes)
            known = all(map(self.is_proven, set(self.plant.causes(first[2])) - present))
            if first[0] > (self.gain.half if known else 1.0) * best:
                found = [first]
        if not found or found[0][0] < self.odds.enters:
            return False
        _, _, model, active = found[0]
        if model is not self.model:
            self.compared.about(model)
        self.model, self.active = model, active
        return True

    def _simpler(self, best: _Step[Model], others: Sequence[_Step[Model]]) -> _Step[Model]:
        """The cause that the best one contains, where the odds between both are those of chance."""

        def contained(row: _Step[Model]) -> bool:
            return any(self.plant.contains(a, b) for a in new(best) for b in new(row))

        def new(row: _Step[Model]) -> set[Cause]:
            return set(self.plant.causes(row[2])) - set(self.plant.causes(self.model))

        near = [row for row in others if row[0] > max(best[0] - self.odds.rival, self.odds.enters) and contained(row)]
        return max(near, key=lambda row: row[0], default=best)

    def idle(self, cause: Cause) -> float:
        """Log odds of a cause, next to the nameless structure that is in the model."""
        return self.score(self.model, self.active) - self.score(self.plant.without(self.model, cause), self.active)

    def judge(self, cause: Cause) -> tuple[float, bool]:
        """Log odds of a cause without any nameless structure, and whether it may be a part of such structure.

        It may where it adds nothing to the structure that suits the model without it, takes less than half of what that
        takes, and leaves more than half of the mismatch: what takes more than all that is left is no part of it. An
        ordinary one may where it is less likely than the structure in its place. One that was not proven before has to
        be as likely as such structure, and by the odds that a nameless group needs; what it adds to that is no proof.
        Where some structure is left next to it, it has to add these odds to the structure in its place, too.
        The variances are learned without the cause: it may not have shaped what it is judged by.
        """
        if (key := (self.model, cause, bool(self.active))) not in self._judged:
            self._judged[key] = self._judge(cause)
        return self._judged[key]

    def _judge(self, cause: Cause) -> tuple[float, bool]:
        without = self.plant.without(self.model, cause)
        self.compared.about(without)
        nothing, alone = (self.score(model, frozenset()) for model in (without, self.model))
        nameless, both = self.with_nameless(without), self.with_nameless(self.model)
        self.compared.about(self.model)
        odds, more, adds = alone - nothing, nameless - nothing, min(alone - nothing, both - nameless)
        left = [float(self.compared.signals(x).grams[:, -1, -1].sum()) for x in (without, self.model)]
        half, enters = self.gain.half, self.odds.enters
        needed = enters + 0.5 * self.gain.distinct
        if self.is_proven(cause):
            least = 0.0 if self.plant.ordinary(cause) else enters
            part = adds < least and odds < max(enters, half * more)
        elif self.active:
            return odds, adds < needed or odds < more
        else:
            part = odds < max(needed, more)
        return odds, part and left[1] > half * left[0]

    def weak(self) -> list[Cause]:
        """Causes that may be a part of what has no name: such that entered, all if some is left, or the weakest."""
        causes = self.plant.causes(self.model)
        entered = [cause for cause in causes if not self.is_proven(cause)]
        for kind in (entered, [cause for cause in causes if cause not in entered]):
            parts = [cause for cause in kind if self.judge(cause)[1]]
            if parts:
                together = self.active and kind is entered
                return parts if together else [min(parts, key=lambda cause: self.judge(cause)[0])]
        return []

    def is_proven(self, cause: Cause) -> bool:
        """Whether a cause needs no more than the evidence here: an ordinary one, and any if none was proven before."""
        return self.proven is None or cause in self.proven or self.plant.ordinary(cause)

    def with_nameless(self, model: Model) -> float:
        """Score of a model with the nameless groups that it needs."""
        active, best = frozenset[int](), self.score(model, frozenset())
        while True:
            more = [(self.score(model, active | {g}), active | {g}) for g in self.groups if g not in active]
            score, groups = max(more, key=lambda row: row[0], default=(best, active))
            if score < best + self.odds.enters:
                return best
            best, active = score, groups

    def rivals(self, cause: Cause) -> tuple[Cause, ...]:
        """Causes that would do as well in one's place, best first; the variances are learned without any of them.

        In the place of one that was proven before, which predicts better, or that is ordinary, another has to be
        likelier.
        """
        without, present = self.plant.without(self.model, cause), set(self.plant.causes(self.model))
        others, behind = list(self.plant.swapped(self.model, cause)), 0.0
        if self.proven is None or not self.is_proven(cause):
            added = [(set(self.plant.causes(model)) - present, model) for _, model in self.plant.grown(without)]
            others += [(new.pop(), model) for new, model in added if len(new) == 1]
            behind = self.odds.rival
        if not (others := [(other, model) for other, model in others if self.plant.distinct(cause, other)]):
            return ()
        self.compared.about(without)
        least = self.with_nameless(self.model) - behind
        scores = {other: self.with_nameless(model) for other, model in others}
        return tuple(sorted((other for other, score in scores.items() if score > least), key=lambda x: -scores[x]))

    def needed(self, group: int) -> float:
        """Log odds of a nameless group."""
        return self.score(self.model, self.active) - self.score(self.model, self.active - {group})

    def shrinks(self) -> None:
        """Take out what the others have made idle."""
        while True:
            idle = {cause: self.idle(cause) for cause in self.plant.causes(self.model)}
            causes = {c: x for c, x in idle.items() if x < self.odds.enters and self.judge(c)[1]}
            groups = {group: self.needed(group) for group in self.active}
            weakest = min([*causes.values(), *groups.values()], default=np.inf)
            if len(idle) + len(groups) < 2 or weakest >= self.odds.enters:
                return
            if weakest in groups.values():
                self.active -= {min(groups, key=lambda group: groups[group])}
            else:
                self.model = self.plant.without(self.model, min(causes, key=lambda cause: causes[cause]))

    def ends(self) -> None:
        """Grow and shrink until nothing changes."""
        seen = set[tuple[Model, Active]]()
        while (self.model, self.active) not in seen:
            seen.add((self.model, self.active))
            if not self.grows():
                return
            self.shrinks()


def searched_by_evidence(
    plant: EvidencePlant[Model, Cause], odds: Odds, gain: Gain, begin: Model | None = None
) -> Found[Model, Cause]:
    """The causes and the nameless structure of a plant, and what would do as well, from a model with some causes.

    Others may enter next to these where nothing nameless is left then: what stands in for something else leaves that.
    """
    search, suspects = _Search(plant, odds, gain), dict[Cause, Model]()
    if begin is not None:
        search.model, search.proven = begin, set(plant.causes(begin))
        if begin is not plant.base:
            search.compared.about(begin)
    while True:
        before = search.model
        search.ends()
        idle = set(plant.causes(before)) - set(plant.causes(search.model)) if begin is not None else set()
        suspects |= dict.fromkeys(idle, before)
        if not (weak := search.weak()):
            break
        search.closed |= bool(search.active) and not any(map(search.is_proven, weak))
        suspects |= dict.fromkeys(weak, search.model)
        search.out |= set(weak)
        for cause in weak:
            search.model = plant.without(search.model, cause)
        search.compared.about(search.model)
    known = {cause: search.judge(cause)[0] for cause in plant.causes(search.model)}
    rivals = {cause: search.rivals(cause) for cause in known}
    search.compared.about(search.model)
    numbers = search.compared.signals(search.model).live
    covariance = search.compared.posterior(search.model, search.active).covariance
    return Found(
        model=search.model,
        nameless={group: search.needed(group) for group in sorted(search.active)},
        odds=known,
        rivals=rivals,
        suspects=suspects,
        entered=frozenset(cause for cause in suspects if not search.is_proven(cause)),
        numbers=numbers,
        variance=np.diag(covariance)[: len(numbers)],
        correlation=search.compared.correlation,
        discrepancy=search.compared.discrepancy,
        steps=search.steps,
    )
