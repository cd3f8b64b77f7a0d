"""The walks behind tables 6 and 7 and figures 8 and 9: simulated once, read by all of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrwarp import paper
from mrwarp.actuator.mr_actuator import Coupling
from mrwarp.energy.calibrate import Calibration, MeasuredPower, calibrate
from mrwarp.energy.power import ElectricalCfg, JointLoad
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.reproduce import store
from mrwarp.reproduce.ensemble import Ensemble, ensembles
from mrwarp.reproduce.experiment import Experiment, Findings, Job, seeds_of
from mrwarp.trials.standing import standing_load
from mrwarp.trials.traces import GaitTrace
from mrwarp.trials.walk_figures import calibration_rows
from mrwarp.trials.walk_trials import WalkCfg, WalkResult, walk
from mrwarp.trials.walking import PAYLOAD_VARIANT

DATA = "walks.npz"
"""File with the data."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """Walks over all payloads and speeds."""

    robots: tuple[str, ...]
    """Of ``paper.ROBOTS``."""
    damping: bool = True
    """Whether MR_Go-SAL damps too, or only holds."""
    coupling: Coupling = Coupling.EXPLICIT
    """How the devices act: by the paper's torque (eqs. 6, 19), or as a brake that sticks."""
    policy: str = "own"
    """``own``: each robot's, MR_Go-SAL's trained with the explicit torque; ``mr_go``: MR_Go's; ``crossed``: MR_Go and
    MR_Go-SAL walk with each other's; ``sticking``: MR_Go-SAL with those that were trained with a device that
    sticks; ``unpaid``: all with those of table 2, whose training has no price on power and a device that sticks;
    ``high``: each robot's own that paid the high price."""
    title: str = ""
    """What it is called in notes; empty for the walks that the tables are about."""


VARIANTS = {
    "both": Variant(robots=paper.ROBOTS),
    "holding": Variant(robots=("mr_go_sal",), damping=False, title="Holding alone"),
    "same_gait": Variant(robots=("mr_go_sal",), damping=False, policy="mr_go", title="Holding alone on MR_Go's gait"),
    "sticking": Variant(
        robots=("mr_go", "mr_go_sal"), coupling=Coupling.CONSTRAINT, policy="sticking", title="A device that sticks"
    ),
    "crossed": Variant(robots=("mr_go", "mr_go_sal"), policy="crossed", title="Each other's policies"),
    "unpaid": Variant(robots=paper.ROBOTS, coupling=Coupling.CONSTRAINT, policy="unpaid", title="Table 2's policies"),
    "high": Variant(robots=paper.ROBOTS, policy="high", title="The high price's policies"),
}
"""What is walked, by the names in :class:`Walks`."""


@dataclass(frozen=True, kw_only=True)
class Walks:
    """What was simulated."""

    both: list[WalkResult]
    """Go1, MR_Go and MR_Go-SAL with both branches of the paper's torque, over payloads and speeds."""
    holding: list[WalkResult]
    """The same with MR_Go-SAL's holding branch alone."""
    same_gait: list[WalkResult]
    """MR_Go-SAL holding with the torque of eq. 19 on MR_Go's policies: this torque leaves the gait as it is."""
    sticking: list[WalkResult]
    """MR_Go, and MR_Go-SAL with both branches, whose devices are brakes that stick, each with its own policies: those
    of MR_Go-SAL were trained with such devices, MR_Go's are the first, as many as those."""
    crossed: list[WalkResult]
    """MR_Go with MR_Go-SAL's policies and the other way round."""
    unpaid: list[WalkResult]
    """All three robots with the actuator-aware policies of table 2, which pay no price for power."""
    high: list[WalkResult]
    """As ``both``, with policies that paid :data:`mrwarp.study.plan.HIGH_POWER_PRICE`."""
    standing: dict[str, JointLoad]
    """Standing robots by name: ``go1``, ``mr_go`` on its motors, ``mr_go_hold`` on its devices; shapes (J,), (M,)."""
    policies: dict[str, int]
    """Policies per robot by the names in :data:`VARIANTS`; trial i was walked by policy ``i % n`` of n."""

    def calibrated(self, cfg: ElectricalCfg | None = None) -> Calibration:
        """Electrical numbers from Go1's rows of table 6 and its standby power; no other row takes part."""
        return calibrate(self.calibration_rows(), cfg)

    def calibration_rows(self) -> list[MeasuredPower]:
        """Go1's rows and standby."""
        return calibration_rows(self.both, self.standing["go1"])

    def calibrated_on(self, results: list[WalkResult]) -> Calibration:
        """The same from Go1's walks among others: ``unpaid`` or ``high``."""
        return calibrate(calibration_rows(results, self.standing["go1"]))

    def seed_of(self, result: WalkResult, variant: str = "both") -> np.ndarray | None:
        """Policy of each trial of a variant's walk that arrived, shape (n,); None with a single policy."""
        return seeds_of(result.trial, self.policies[variant])


def complete(results: Sequence[WalkResult]) -> bool:
    """Whether a trial of every condition arrived; without, no claim over all of them can hold."""
    return bool(results) and all(len(result.speed) for result in results)


def arrivals(results: Sequence[WalkResult]) -> list[str]:
    """The note of :func:`lost` on some walks; rows and claims see only the trials that arrived."""
    return lost({
        f"{paper.NAMES[r.robot]}, {paper.condition_name(r.payload, r.command)}": (
            len(r.speed) + r.fell + r.late, r.fell, r.late
        )
        for r in results
    })  # fmt: skip


def all_arrivals(walks: Walks, *variants: str, robots: Collection[str] = paper.ROBOTS) -> list[str]:
    """The notes of :func:`arrivals` on some robots' walks of some variants, each with its title."""
    return [
        f"{title}: {note}" if (title := VARIANTS[variant].title) else note
        for variant in variants
        for note in arrivals([result for result in getattr(walks, variant) if result.robot in robots])
    ]


def lost(counts: Mapping[str, tuple[int, int, int]]) -> list[str]:
    """One note on what fell or came too late; none if nothing did.

    Args:
        counts: By condition, how many trials began, how many of them fell and how many came too late.
    """
    parts = [
        f"{name}: {fell} fell and {late} came too late of {began}"
        + (", which leaves no figure" if fell + late == began else "")
        for name, (began, fell, late) in counts.items() if fell or late
    ]  # fmt: skip
    return [f"Only trials that arrived count. {'; '.join(parts)}."] if parts else []


def simulate(job: Job) -> Findings:
    """Walk all conditions with every variant of SAL, and stand."""
    settings, load = job.settings, paper.arm_load()
    env = make_walk_cfg(threads=settings.threads)
    own, unpaid = ensembles(settings), Ensemble(settings.aware)
    policies = {
        "own": own,
        "mr_go": {"mr_go_sal": own["mr_go"]},
        "sticking": {
            "mr_go": Ensemble(settings.policies["mr_go"][: len(settings.sticking)]),
            "mr_go_sal": Ensemble(settings.sticking),
        },
        "crossed": {"mr_go": own["mr_go_sal"], "mr_go_sal": own["mr_go"]},
        "unpaid": dict.fromkeys(paper.ROBOTS, unpaid),
        "high": {robot: Ensemble(paths) for robot, paths in settings.high.items()},
    }
    found: dict[str, list[WalkResult]] = {}
    counts = {name: len(policies[variant.policy][variant.robots[0]]) for name, variant in VARIANTS.items()}
    for k, (name, variant) in enumerate(VARIANTS.items()):
        actuator = replace(env.actuator, damping=variant.damping, coupling=variant.coupling)
        cfg = WalkCfg(
            trials=counts[name] * settings.rollouts, distance=settings.distance, seed=settings.seed,
            robots=variant.robots, env=replace(env, actuator=actuator),
        )  # fmt: skip
        found[name] = walk(
            cfg, policies[variant.policy],
            lambda text, share, k=k: job.report(text, (k + share) / (len(VARIANTS) + 0.1)),
        )  # fmt: skip
    job.report("standing", 0.98)
    stood = replace(
        env, payload=PAYLOAD_VARIANT, currents=(1.5,), actuator=replace(env.actuator, coupling=Coupling.EXPLICIT)
    )
    standing = {
        name: standing_load(replace(stood, robot=robot), load=load, hold=hold)[0]
        for name, (robot, hold) in {
            "go1": ("go1", False), "mr_go": ("mr_go", False), "mr_go_hold": ("mr_go", True)
        }.items()
    }  # fmt: skip
    store.save(job.out / DATA, {**found, "standing": standing, "policies": counts})
    return Findings()


def read(folder: Path) -> Walks:
    """The data of :func:`simulate`."""
    tree = store.load(folder / DATA)
    return Walks(
        **{name: [_result(item) for item in tree[name]] for name in VARIANTS},
        standing={name: JointLoad(**joints) for name, joints in tree["standing"].items()}, policies=tree["policies"],
    )  # fmt: skip


def _result(item: dict) -> WalkResult:
    return WalkResult(**{**item, "joints": JointLoad(**item["joints"]), "trace": GaitTrace(**item["trace"])})


EXPERIMENT = Experiment(
    name="walks", compute=simulate, shown=False,
    settings=("policies", "aware", "sticking", "high", "rollouts", "distance", "seed"),
)  # fmt: skip
