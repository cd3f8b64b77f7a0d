"""The walks behind tables 6 and 7 and figures 8 and 9: simulated once, read by all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrwarp import paper
from mrwarp.actuator import Coupling
from mrwarp.electrical.calibrate import Calibration, Row, calibrate
from mrwarp.electrical.power import ElectricalCfg, Use
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.evaluate.load import VARIANT
from mrwarp.evaluate.standing import standing_use
from mrwarp.evaluate.traces import GaitTrace
from mrwarp.evaluate.walk_figures import calibration_rows
from mrwarp.evaluate.walk_trials import WalkCfg, WalkResult, walk
from mrwarp.reproduce import store
from mrwarp.reproduce.experiment import Experiment, Findings, Job
from mrwarp.reproduce.settings import ensembles

DATA = "walks.npz"
"""File with the data."""

VARIANTS: dict[str, tuple[tuple[str, ...], bool, Coupling]] = {
    "both": (paper.ROBOTS, True, Coupling.CONSTRAINT),
    "holding": (("mr_go_sal",), False, Coupling.CONSTRAINT),
    "explicit": (("mr_go", "mr_go_sal"), False, Coupling.EXPLICIT),
}
"""Robots, whether SAL damps too, and how the devices act, see :class:`Walks`."""


@dataclass(frozen=True, kw_only=True)
class Walks:
    """What was simulated."""

    both: list[WalkResult]
    """Go1, MR_Go and MR_Go-SAL with both branches, over payloads and speeds."""
    holding: list[WalkResult]
    """The same with MR_Go-SAL's holding branch alone."""
    explicit: list[WalkResult]
    """MR_Go, and MR_Go-SAL holding with the torque of eq. 19 in place of a device that sticks."""
    standing: dict[str, Use]
    """Standing robots by name: ``go1``, ``mr_go`` on its motors, ``mr_go_hold`` on its devices; shapes (J,), (M,)."""
    policies: int
    """Policies per robot; trial i was walked by policy ``i % policies``."""

    def calibrated(self, cfg: ElectricalCfg | None = None) -> Calibration:
        """Electrical numbers from Go1's rows of table 6 and its standby power; no other row takes part."""
        return calibrate(self.calibration_rows(), cfg)

    def calibration_rows(self) -> list[Row]:
        """Go1's rows and standby."""
        return calibration_rows(self.both, self.standing["go1"])

    def seed_of(self, result: WalkResult) -> np.ndarray:
        """Policy of each trial, shape (n,)."""
        return result.trial % self.policies


def simulate(job: Job) -> Findings:
    """Walk all conditions with every variant of SAL, and stand."""
    settings, load = job.settings, paper.arm_load()
    env = make_walk_cfg(threads=settings.threads)
    loaded = ensembles(settings)
    found: dict[str, list[WalkResult]] = {}
    for k, (name, (robots, damping, coupling)) in enumerate(VARIANTS.items()):
        cfg = WalkCfg(
            trials=settings.policy_seeds * settings.rollouts, distance=settings.distance, seed=settings.seed,
            robots=robots, env=replace(env, actuator=replace(env.actuator, damping=damping, coupling=coupling)),
        )  # fmt: skip
        found[name] = walk(cfg, loaded, lambda text, share, k=k: job.report(text, (k + share) / 3.1))
    job.report("standing", 0.96)
    standing = {
        name: standing_use(replace(env, robot=robot, payload=VARIANT, currents=(1.5,)), load=load, hold=hold)[0]
        for name, (robot, hold) in {
            "go1": ("go1", False), "mr_go": ("mr_go", False), "mr_go_hold": ("mr_go", True)
        }.items()
    }  # fmt: skip
    store.save(job.out / DATA, {**found, "standing": standing, "policies": settings.policy_seeds})
    return Findings()


def read(folder: Path) -> Walks:
    """The data of :func:`simulate`."""
    tree = store.load(folder / DATA)
    return Walks(
        **{name: [_result(item) for item in tree[name]] for name in VARIANTS},
        standing={name: Use(**use) for name, use in tree["standing"].items()}, policies=tree["policies"],
    )  # fmt: skip


def _result(item: dict) -> WalkResult:
    return WalkResult(**{**item, "use": Use(**item["use"]), "trace": GaitTrace(**item["trace"])})


EXPERIMENT = Experiment(
    name="walks", title="Walks of Go1, MR_Go and MR_Go-SAL", compute=simulate, shown=False,
    settings=("policies", "rollouts", "distance", "seed"),
)  # fmt: skip
