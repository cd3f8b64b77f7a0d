"""The virtual torque bench: excitations, truth and logging put together into recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.bench.bench_effects import LOG_DT, Drive, Effects, breakaway_torque, simulate
from mrwarp.bench.excitation import FIT_CURRENTS, CalfPool, Excitation, evaluation_excitations, fit_excitations
from mrwarp.params import MrParams
from mrwarp.recording.load import MIN_SAMPLES, Holding, Recording, Trajectory
from mrwarp.run_dir import no_file

PAPER_SAMPLES = 665_442
"""Samples of the paper's fitting data, table 1."""

FIT_SHARE = 0.85
"""Share of the session that the fitting set takes; the evaluation follows."""

HOLDING_CURRENTS = tuple(round(0.1 * k, 1) for k in range(16))
"""Currents of the break-away tests [A]: 0 to 1.5."""

HOLDING_REPEATS = 5
"""Break-away tests at each current."""

_BATCH = 48
"""Trajectories that are integrated together: enough to hide NumPy's overhead, few enough for 1 GB of memory."""


@dataclass(frozen=True, kw_only=True)
class BenchCfg:
    """One session on the bench."""

    effects: Effects = field(default_factory=Effects.defaults)
    """Effects of the joint beyond eq. 14."""
    params: MrParams = field(default_factory=MrParams)
    """The device; defaults are the paper's coefficients."""
    trajectories: int = 120
    """Trajectories of the fitting set."""
    samples: int = PAPER_SAMPLES
    """Samples of the fitting set in total."""
    evaluation_samples: int = 4000
    """Samples of each of the 30 evaluation trajectories; 0 for none."""
    policy: Path | None = None
    """Exported walking policy whose calf motion is used; None takes a synthetic gait."""
    seed: int = 0
    """Seed of motions, currents and noise."""

    def __post_init__(self) -> None:
        if self.trajectories < 1:
            raise ValueError(f"trajectories = {self.trajectories} must be at least 1")
        if self.samples < MIN_SAMPLES * self.trajectories:
            raise ValueError(
                f"samples = {self.samples} are fewer than {MIN_SAMPLES} for each of {self.trajectories} trajectories"
            )
        if 0 < self.evaluation_samples < 4 * MIN_SAMPLES or self.evaluation_samples < 0:
            raise ValueError(f"evaluation_samples = {self.evaluation_samples} must be 0 or at least {4 * MIN_SAMPLES}")
        if self.policy is not None and not self.policy.is_file():
            raise ValueError(
                f"{self.policy}: {no_file(self.policy, 'policy')}; name an .onnx file that 'mrwarp train' wrote"
            )
        if self.seed < 0:
            raise ValueError(f"seed = {self.seed} must not be negative")

    @property
    def share(self) -> float:
        """Factor on the currents of the session: a device that takes less than the paper's gets the same shares."""
        return min(1.0, self.params.coil.current_max / FIT_CURRENTS[-1])

    @property
    def longest(self) -> float:
        """Length of the longest trajectory [s]."""
        return max(self.samples // self.trajectories + 1, self.evaluation_samples) * LOG_DT


def bench_device() -> MrParams:
    """The paper's device on a bench: angles from zero, and no motor; ``assets/usd/mr_bench.usda`` has the same."""
    return MrParams().alone()


@dataclass(frozen=True, kw_only=True)
class BenchData:
    """Recordings of a session."""

    fit: Recording
    """Trajectories at 0, 0.5, 1.0 and 1.5 A, of which a device that takes less gets :attr:`BenchCfg.share`."""
    evaluation: Recording | None
    """Ten other motions, each at 1.0, 1.2 and 1.5 A, with the same effects."""
    holding: Holding
    """Break-away torques."""


def run_bench(
    cfg: BenchCfg, progress: Callable[[float, str], None] | None = None, pool: CalfPool | None = None
) -> BenchData:
    """Run a session; the same configuration gives the same bits.

    Args:
        cfg: The session.
        progress: Called with the finished share and what is being done.
        pool: Calf motion of ``cfg.policy``, each at least ``cfg.longest`` seconds; None takes a synthetic gait.
    """
    log = progress or (lambda share, text: None)
    # separate streams: changing the noise of a session leaves its motions as they are, and the other way round
    streams = [np.random.default_rng([cfg.seed, k]) for k in range(5)]
    fit = fit_excitations(cfg.trajectories, cfg.samples, streams[0], pool, share=cfg.share)
    work = cfg.samples + 30 * cfg.evaluation_samples
    share = cfg.samples / work
    header = _header(cfg)
    recorded = record(
        fit, cfg, streams[1], {**header, "part": "fit"}, (0.0, FIT_SHARE), progress=lambda s: log(share * s, "fit")
    )
    evaluation = None
    if cfg.evaluation_samples:
        excitations = evaluation_excitations(cfg.evaluation_samples, streams[2], pool, share=cfg.share)
        evaluation = record(
            excitations,
            cfg,
            streams[3],
            {**header, "part": "evaluation"},
            (FIT_SHARE, 1.0),
            begin=LOG_DT * recorded.samples,
            progress=lambda s: log(share + (1.0 - share) * s, "evaluation"),
        )
    return BenchData(fit=recorded, evaluation=evaluation, holding=_holding(cfg, streams[4], header))


def record(
    excitations: Sequence[Excitation],
    cfg: BenchCfg,
    rng: np.random.Generator,
    header: dict[str, Any],
    session: tuple[float, float] = (0.0, 1.0),
    *,
    begin: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Run excitations on the bench and log them, one after the other by one clock.

    Args:
        excitations: Motions and currents.
        cfg: The device and its effects.
        rng: Source of noise and of what differs from run to run.
        header: What the recording says about its making.
        session: Start and end as shares of the session.
        begin: What the clock shows at the first sample [s].
        progress: Called with the finished share.
    """
    log, total = progress or (lambda share: None), len(excitations)
    start = session[0] + (session[1] - session[0]) * np.arange(total) / total
    trajectories, count = [], 0
    for first in range(0, total, _BATCH):
        batch = excitations[first : first + _BATCH]
        drive = Drive(
            q=_columns([x.q for x in batch]),
            command=_columns([x.command for x in batch]),
            session=start[first : first + _BATCH],
        )

        def finished(share: float, first: int = first, size: int = len(batch)) -> None:
            log((first + share * size) / total)

        logged = simulate(drive, cfg.effects, cfg.params, rng, finished)
        for k, excitation in enumerate(batch):
            n = len(excitation.command)
            t, count = np.round(begin + (count + np.arange(n)) * LOG_DT, 6), count + n
            # a log file has a finite number of digits; all are far below the sensors' resolution
            trajectories.append(
                Trajectory(
                    id=excitation.id,
                    t=t,
                    q=np.round(logged.q[:n, k], 7),
                    qd=np.round(logged.qd[:n, k], 6),
                    current=excitation.command,
                    torque=np.round(logged.torque[:n, k], 6),
                    header={**header, "kind": excitation.kind},
                )
            )
    return Recording(trajectories=tuple(trajectories), header=header)


def _header(cfg: BenchCfg) -> dict[str, Any]:
    return {
        "made_by": "mrwarp bench",
        "seed": cfg.seed,
        "effects": dict(cfg.effects),
        "coil_resistance": cfg.params.coil.coil_resistance,
        "gait": "synthetic" if cfg.policy is None else cfg.policy.name,
    }


def _holding(cfg: BenchCfg, rng: np.random.Generator, header: dict[str, Any]) -> Holding:
    """Break-away tests: the motor's torque rises slowly until the joint slips, at rising currents."""
    current = np.round(cfg.share * np.repeat(HOLDING_CURRENTS, HOLDING_REPEATS), 6)
    torque = breakaway_torque(current, cfg.effects, cfg.params, rng)
    return Holding(current=current, torque=np.round(torque, 6), header={**header, "part": "holding"})


def _columns(arrays: list[np.ndarray]) -> np.ndarray:
    """Arrays side by side, the shorter ones held at their last value."""
    longest = max(len(a) for a in arrays)
    return np.stack([np.pad(a, (0, longest - len(a)), mode="edge") for a in arrays], axis=1)
