"""Where the fit of a robot begins: the session's numbers, and the single change with which the replay is best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrwarp.robot_logs.causes.cause import NUISANCE
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, ORDINARY
from mrwarp.robot_logs.likelihood import Likelihood, gather, left_by_each, replayed
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.report.stages import DERIVATIVES, SESSION, SINGLE, within
from mrwarp.robot_logs.robot_fit import FirstLook, nuisances_of, searched
from mrwarp.robot_logs.selection import (
    Hypothesis,
    bounds_of,
    healthy,
    hypotheses_of,
    payload_of,
    prior_of,
    vector,
)
from mrwarp.robot_logs.single_changes import screened, sizes_of_their_own
from mrwarp.robot_logs.windows import Windows


def first_look(
    model: ReplayModel, groups: list[Windows], parameters: list[Parameter], progress: Callable[[str], None]
) -> FirstLook:
    """The described robot in this session, and of single changes that with which the replay is best."""
    nuisance = np.zeros(len(parameters))
    if model.free:  # what every session has is first: on another floor, derivatives of a fault are others
        nuisance = nuisances_of(model, groups, parameters, within(progress, SESSION))
    described = gather(model, groups, parameters, nuisance, within(progress, DERIVATIVES))
    guess, guessed = initial_guess(model, groups, parameters, described, nuisance, within(progress, SINGLE))
    return FirstLook(nuisance=nuisance, described=described, guess=guess, guessed=guessed)


def initial_guess(
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
    described: Likelihood,
    theta: np.ndarray,
    log: Callable[[str], None] = lambda _: None,
) -> tuple[np.ndarray, list[Hypothesis]]:
    """A robot where a fit can begin, (P,), and the fault in it, if any: of single changes that which replays like best.

    Derivatives about the described robot in this session, ``theta``, end where a foot lifts: in sum, many small changes
    then promise more than the true large one, and the replay keeps none of it. So single changes are tried by the
    replay at several sizes, the best is kept, and its neighbours are tried, until one is more than a healthy robot
    can have.
    """
    trials = _Trials.of(model, groups, parameters, described)
    payload = payload_of(parameters)
    (here,) = trials.left(theta)
    odds = described.settings.robot.odds
    for pick in range(described.settings.robot_fit.picks):
        log(f"change {pick + 1} of at most {described.settings.robot_fit.picks}")
        pull = trials.pull(theta)
        gain, taken = trials.best(theta, here, pull)
        # rather than a heavy link: of one at a hip a weight on the trunk is the likelier reason
        margin = 2.0 * odds * (-1.0 if taken is not None and CATALOGUE[taken[1].cause].or_payload else 1.0)
        if not pick and payload and (weight := trials.heavier(theta, here, pull, payload, gain + margin)) is not None:
            return weight, payload
        if taken is None or gain < 2.0 * odds:
            return theta, []
        new, d = taken
        # of its best size: what a pick leaves by its size, others would be blamed for
        new = trials.searched(new, list(d.members), prior_of(parameters, [d]))
        alone = np.where(trials.follows(d), 0.0, new - theta)
        theta, (here,) = new, trials.left(new)
        if d.cause not in ORDINARY and alone @ trials.usual @ alone > 2.0 * odds:
            return theta, [d]
    return theta, []


@dataclass(frozen=True, kw_only=True)
class _Trials:
    """Changes of a robot along each of D hypotheses, tried by the replay."""

    model: ReplayModel
    groups: list[Windows]
    parameters: list[Parameter]
    described: Likelihood
    hypotheses: list[Hypothesis]
    plain: np.ndarray
    """Change that each makes, in steps, shape (D, P)."""
    changes: np.ndarray
    """With the session's numbers that follow, shape (D, P)."""
    information: np.ndarray
    """On a change along each, shape (D,)."""
    own: dict[int, list[float]]
    """Sizes of hypotheses that derivatives do not see, by their place."""
    nuisance: np.ndarray
    """Whether a number is the session's, shape (P,)."""
    usual: np.ndarray
    """Precision of healthy robots, shape (P, P)."""

    @classmethod
    def of(
        cls, model: ReplayModel, groups: list[Windows], parameters: list[Parameter], described: Likelihood
    ) -> _Trials:
        """All hypotheses; a session's numbers, fitted without a change, have taken up what they can of it."""
        usual = healthy(parameters)
        a, _ = described.sums()
        hypotheses = [d for d in hypotheses_of(parameters) if d.cause != NUISANCE]
        nuisance = np.array([p.is_nuisance and model.free for p in parameters])
        plain = np.stack([vector(d, parameters) for d in hypotheses])
        follow = np.linalg.solve((a / described.scale + usual)[np.ix_(nuisance, nuisance)], a[nuisance] @ plain.T)
        changes = plain.copy()
        changes[:, nuisance] -= np.where(plain[:, nuisance].any(axis=1), 0.0, follow / described.scale).T
        return cls(
            model=model,
            groups=groups,
            parameters=parameters,
            described=described,
            hypotheses=hypotheses,
            plain=plain,
            changes=changes,
            information=np.maximum(np.einsum("dp,pq,dq->d", changes, a, changes), 1e-12),
            own=sizes_of_their_own(hypotheses, model, groups, parameters),
            nuisance=nuisance,
            usual=usual,
        )

    def left(self, *robots: np.ndarray) -> list[float]:
        """Mismatch that the replay leaves with robots, each (P,)."""
        return left_by_each(self.described, self.model, self.groups, self.parameters, np.array(robots)).tolist()

    def pull(self, theta: np.ndarray) -> np.ndarray:
        """Score of the parameters at a robot, by the replay, shape (P,)."""
        a, _ = self.described.sums()
        return replayed(self.described, self.model, self.groups, self.parameters, theta)[1].sums()[1] - a @ theta

    def searched(self, theta: np.ndarray, members: list[int], prior: np.ndarray) -> np.ndarray:
        """The robot with some numbers of the size that the replay is best with."""
        bounds = bounds_of(self.parameters)
        return searched(theta, members, self.model, self.groups, self.parameters, self.described, prior, *bounds)

    def follows(self, d: Hypothesis) -> np.ndarray:
        """Whether a number is the session's and no part of a hypothesis, shape (P,)."""
        return self.nuisance & ~self.plain[self.hypotheses.index(d)].astype(bool)

    def best(
        self, theta: np.ndarray, here: float, pull: np.ndarray
    ) -> tuple[float, tuple[np.ndarray, Hypothesis] | None]:
        """Gain of the best single change of a robot that leaves ``here``, that robot and what changed; or None."""
        (low, high), score = bounds_of(self.parameters), self.changes @ pull
        tried: list[tuple[np.ndarray, Hypothesis, float]] = []
        settings = self.described.settings.robot_fit
        loud = np.argsort(-(score**2) / self.information)[: settings.guesses].tolist()
        asked = {k: [times * score[k] / self.information[k] for times in settings.multiples] for k in loud}
        for all_sizes, along in ((asked, self.changes), (self.own, self.plain)):
            for k, k_sizes in all_sizes.items():
                d, prior = self.hypotheses[k], prior_of(self.parameters, [self.hypotheses[k]])
                changed = [np.clip(theta + size * along[k], low, high) for size in k_sizes]
                tried += [(new, d, float(new @ prior @ new)) for new in changed]
        tried = screened(tried, self.described, self.model, self.groups, self.parameters)
        gains = [
            here - left - unlikely + float(theta @ self.usual @ theta)
            for (_, _, unlikely), left in zip(tried, self.left(*(new for new, _, _ in tried)), strict=True)
        ]
        best = max([0.0, *gains])
        return best, tried[gains.index(best)][:2] if best > 0.0 else None

    def heavier(
        self, theta: np.ndarray, here: float, pull: np.ndarray, payload: list[Hypothesis], least: float
    ) -> np.ndarray | None:
        """The robot with a weight on its trunk, which no single number is, where it gains more than ``least``."""
        (low, high), (a, _) = bounds_of(self.parameters), self.described.sums()
        parts = np.stack([vector(d, self.parameters) for d in payload])
        prior, members = prior_of(self.parameters, payload), [k for d in payload for k in d.members]
        both = parts @ (a / self.described.scale + prior) @ parts.T
        change = np.linalg.solve(both, parts @ pull / self.described.scale) @ parts

        def gains(*robots: np.ndarray) -> list[float]:
            own, left = float(theta @ self.usual @ theta), self.left(*robots)
            return [here - rest - float(x @ prior @ x) + own for x, rest in zip(robots, left, strict=True)]

        multiples = self.described.settings.robot_fit.multiples
        tried = [np.clip(theta + times * change, low, high) for times in multiples]
        best = self.searched(tried[int(np.argmax(gains(*tried)))], members, prior)
        return best if gains(best)[0] > least else None
