"""The walks behind tables 6 and 7 and figures 8 and 9: simulated once, read by all of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp import paper
from mrwarp.energy.model_numbers import Calibration, MeasuredPower, calibrate
from mrwarp.energy.power import JointLoad
from mrwarp.enums import Coupling, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.trials.walk_figures import calibration_rows
from mrwarp.trials.walk_trials import WalkCfg, WalkResult, standing_load, walk
from mrwarp.trials.walking import PAYLOAD_VARIANT
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings
from paper.reproduce.settings import (
    Ensemble,
    ensembles,
    seeds_of,
    walks_time,
)

SAL = ("mr_go", "mr_go_sal")
"""Robots that a reduction by SAL compares."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """Walks over all payloads and speeds."""

    robots: tuple[str, ...]
    """Of ``paper.ROBOTS``."""
    coupling: Coupling = Coupling.EXPLICIT
    """How the devices act: by the paper's torque (eqs. 6, 19), or as a brake that sticks."""
    as_commanded: bool = False
    """Whether 0.3 and 0.5 m/s are commanded, or the speeds that the paper measured where it commanded these."""
    repeated: bool = False
    """Whether every policy walks ``rollouts`` times, or once."""
    title: str = ""
    """Name in notes; empty for the walks that the tables are about."""


VARIANTS = {
    # each robot with its own policies, MR_Go-SAL's trained with the explicit torque
    "both": Variant(robots=paper.ROBOTS, repeated=True),
    "as_commanded": Variant(robots=("mr_go_sal",), as_commanded=True, title="At 0.3 and 0.5 m/s"),
    # MR_Go-SAL's policies were trained with such devices; MR_Go's are its first, as many as those
    "constraint_coupling": Variant(robots=SAL, coupling=Coupling.CONSTRAINT, title="A device that sticks"),
    "swapped_policies": Variant(robots=SAL, title="Each other's policies"),
    # the actuator-aware policies of table 2, trained without a price
    "no_power_price": Variant(robots=paper.ROBOTS, title="Table 2's policies"),
}
"""The walked conditions, by the names in :attr:`Walks.results`."""


@dataclass(frozen=True, kw_only=True)
class Walks:
    """The simulated walks."""

    results: dict[str, list[WalkResult]]
    """Walks of every variant."""
    standing: dict[str, JointLoad]
    """Standing robots by name: ``go1``, ``mr_go`` on its motors, ``mr_go_hold`` on its devices; shapes (J,), (M,)."""
    policies: dict[str, int]
    """Policies per robot of every variant; trial i was walked by policy ``i % n`` of n."""

    @property
    def both(self) -> list[WalkResult]:
        """Walks that the tables are about: three robots, both branches of the paper's torque."""
        return self.results["both"]

    def calibrated(self, variant: str = "both") -> Calibration:
        """Electrical numbers from Go1's rows of table 6 and its standby power; no other row takes part."""
        return calibrate(self.calibration_rows(variant))

    def calibration_rows(self, variant: str = "both") -> list[MeasuredPower]:
        """Go1's walks of a variant, and its standby."""
        return calibration_rows(self.results[variant], self.standing["go1"])

    def seed_of(self, result: WalkResult, variant: str = "both") -> np.ndarray | None:
        """Policy of each trial of a variant's walk that arrived, shape (n,); None with a single policy."""
        return seeds_of(result.trial, self.policies[variant])

    def arrivals(self, *variants: str, robots: Collection[str] = paper.ROBOTS) -> list[str]:
        """Notes on what was lost of some robots' walks of some variants; rows and claims see what arrived alone."""
        found = []
        for variant in variants:
            title = VARIANTS[variant].title
            counts = {
                f"{paper.NAMES[r.robot]}, {r.condition}": (len(r.speed) + r.fell + r.late, r.fell, r.late)
                for r in self.results[variant]
                if r.robot in robots
            }
            found += [f"{title}: {note}" if title else note for note in lost(counts)]
        return found


def complete(results: Sequence[WalkResult]) -> bool:
    """Whether a trial of every condition arrived; without, no claim over all of them can hold."""
    return bool(results) and all(len(result.speed) for result in results)


def lost(counts: Mapping[str, tuple[int, int, int]]) -> list[str]:
    """One note on what fell or came too late; none if nothing did.

    ``counts``: by condition, how many trials began, how many of them fell and how many came too late.
    """
    parts = [
        f"{name}: {fell} fell and {late} came too late of {began}"
        + (", which leaves no figure" if fell + late == began else "")
        for name, (began, fell, late) in counts.items()
        if fell or late
    ]
    return [f"Only trials that arrived count. {'; '.join(parts)}."] if parts else []


def simulate(job: Job) -> Findings:
    """Walk all conditions with every variant of SAL, and stand.

    Each robot is commanded the speed that the paper measured for it (table 6): a cost of transport divides by it.
    """
    settings = job.settings
    env = TaskCfg(z_step=ZStep.EULER, threads=settings.threads)
    own = ensembles(settings.policies)
    policies = {
        "both": own,
        "as_commanded": own,
        "constraint_coupling": {
            "mr_go": Ensemble(settings.policies["mr_go"][: len(settings.sticking)]),
            "mr_go_sal": Ensemble(settings.sticking),
        },
        "swapped_policies": {"mr_go": own["mr_go_sal"], "mr_go_sal": own["mr_go"]},
        "no_power_price": dict.fromkeys(paper.ROBOTS, Ensemble(settings.aware)),
    }
    counts = {name: len(policies[name][variant.robots[0]]) for name, variant in VARIANTS.items()}
    results, share = {}, 1.0 / (len(VARIANTS) + 0.1)
    for k, (name, variant) in enumerate(VARIANTS.items()):
        cfg = WalkCfg(
            trials=counts[name] * (settings.rollouts if variant.repeated else 1),
            commanded={} if variant.as_commanded else paper.MEASURED_SPEED,
            distance=settings.distance,
            seed=settings.seed,
            robots=variant.robots,
            env=replace(env, coupling=variant.coupling),
        )
        results[name] = walk(cfg, policies[name], lambda text, part, k=k: job.report(text, (k + part) * share))
    job.report("standing", 0.98)
    stood = replace(env, payload=PAYLOAD_VARIANT, currents=(1.5,), coupling=Coupling.EXPLICIT)
    standing = {
        name: standing_load(replace(stood, robot=robot), load=paper.arm_load(), hold=hold)[0]
        for name, robot, hold in (("go1", "go1", False), ("mr_go", "mr_go", False), ("mr_go_hold", "mr_go", True))
    }
    return job.save(Walks(results=results, standing=standing, policies=counts))


def read(job: Job) -> Walks:
    """Data of :func:`simulate`."""
    return job.load("walks", Walks)


EXPERIMENTS = (
    Experiment(
        name="walks",
        compute=simulate,
        settings=("policies", "aware", "sticking", "rollouts", "distance", "seed"),
        seconds=walks_time(150.0, "distance", 30.0),
    ),
)
