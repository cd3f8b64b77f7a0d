"""A plant of twenty lines whose truth is known: a spring with friction, runs with a zero of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrwarp.sysid.certainty import agreement
from mrwarp.sysid.least_squares import ridge_solve
from mrwarp.sysid.left_out import predicted
from mrwarp.sysid.pieces import Pieces, without_nuisances
from mrwarp.sysid.plant import Listed

NOISE, ZEROS = 0.05, 0.2
"""Standard deviations of the reading and of a run's zero [N]."""

LAWS = {"softer": lambda q, v: q, "coulomb": lambda q, v: np.sign(v), "viscous": lambda q, v: v}
"""Force per unit of each cause: they are linear, so that least squares has a closed form."""


@dataclass
class Spring:
    """Force read over motions at several paces; ``truth`` are sizes of the causes."""

    truth: dict[str, float]
    seed: int = 0
    runs: int = 12
    rows: list[np.ndarray] = field(init=False)
    """Of each run [laws, mismatch of the described spring], shape (4, N), in units of the noise."""

    def __post_init__(self) -> None:
        rng, self.rows, t = np.random.default_rng(self.seed), [], np.linspace(0.0, 2.0 * np.pi, 200)
        for pace in rng.uniform(0.5, 2.0, self.runs):
            q, v = np.sin(t), pace * np.cos(t)
            laws = np.stack([law(q, v) for law in LAWS.values()])
            force = sum(self.truth.get(name, 0.0) * row for name, row in zip(LAWS, laws, strict=True))
            force = force + rng.normal(0.0, ZEROS) + rng.normal(0.0, NOISE, len(t))
            self.rows.append(np.vstack([laws, force]) / NOISE)

    def pieces(self, causes: list[str]) -> Pieces:
        """The runs' quadratic forms in the sizes of some causes, their zeros removed."""
        use = [*(list(LAWS).index(name) for name in causes), len(LAWS)]
        tables = [np.vstack([x[use], np.full((1, x.shape[1]), 1.0 / NOISE)]) for x in self.rows]
        grams = np.stack([x @ x.T for x in tables])
        return Pieces.of_grams(without_nuisances(grams, len(use), 1.0 / ZEROS**2)[0])


class SpringPlant(Listed[str]):
    """A spring's runs as a plant; causes in ``positive`` have no negative size."""

    def __init__(self, spring: Spring, positive: tuple[str, ...] = ()) -> None:
        self.spring, self.positive, self.base = spring, positive, list[str]()
        self.tests = (self.agreed,)

    def loss(self, causes: list[str]) -> np.ndarray:
        """Of each run by the others, shape (N,)."""
        return predicted(self.spring.pieces(causes))[1]

    def candidates(self, causes: list[str]) -> list[str]:
        """Causes of possible sizes that predict runs left out clearly better, the best first."""
        now, left = self.loss(causes).sum(), {}
        for name in (x for x in LAWS if x not in causes):
            size = ridge_solve(*self.spring.pieces([*causes, name]).sums())[-1]
            if name not in self.positive or size > 0.0:
                left[name] = self.loss([*causes, name]).sum()
        return sorted((x for x in left if now - left[x] > 12.0), key=lambda x: left[x])

    def grown(self, causes: list[str], candidates: Sequence[str]) -> list[str]:
        """With the best."""
        return [*causes, candidates[0]]

    def settled(self, causes: list[str]) -> list[str]:
        """As they are."""
        return causes

    def agreed(self, causes: list[str]) -> list[float]:
        """Whether the runs agree on each."""
        return [agreement(self.loss(self.without(causes, x)) - self.loss(causes)) for x in causes]
