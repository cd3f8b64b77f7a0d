"""Sections 3.3, 5.2 and 7: what the support branch's free numbers move in table 6, and how fast the gait can walk.

The policies are those of table 6, not trained again; one walk of each at each condition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp import paper
from mrwarp.energy.power import ElectricalCfg
from mrwarp.enums import Coupling, HoldCurrent, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials import walk_figures
from mrwarp.trials.walk_trials import WalkCfg, WalkResult, walk
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, TextTable, compare, identified
from paper.reproduce.settings import Ensemble, over_seeds, walks_time
from paper.reproduce.verdicts import Claim, rows

FASTER = (0.5, 0.6, 0.7, 0.8, 1.0)
"""Commanded speeds [m/s] of the search for the fastest."""

REACHED = 0.95
"""Share of a command that counts as reached."""

NOMINAL = "as it is"
"""The support branch of tables 6 and 7."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """One change of the support branch."""

    name: str
    params: tuple[tuple[str, float], ...] = ()
    """MR parameters that differ."""
    fixed: float | None = None
    """Support current that does not change from step to step [A], section 5.2; None computes it again every step."""

    def set(self, env: WalkEnv, robots: Sequence[str]) -> None:
        """Give the devices their parameters."""
        for name, value in self.params:
            env.view(env.actuator.param(name))[:] = value


CHOICES = (
    Choice(name=NOMINAL),
    *(Choice(name=f"eps_hold {v:g} rad/s", params=(("eps_hold", v),)) for v in (0.1, 0.15, 0.25, 0.4)),
    *(Choice(name=f"Kp_low {v:g} N·m/rad", params=(("kp_low", v),)) for v in (0.0, 2.5, 10.0, 20.0)),
    *(Choice(name=f"fixed support current, {amps:g} A", fixed=amps) for amps in (0.5, 1.0, 1.5)),
    Choice(name="coil lag of 0.02 s", params=(("coil_time_constant", 0.02),)),
)
"""The walked variants. A fixed current bounds the damping's too."""


def compute(job: Job) -> Findings:
    """Reductions of COT and shares held under every choice, and speeds beyond 0.5 m/s."""
    settings = job.settings
    cfg = walks.read(job).calibrated().cfg
    env = TaskCfg(coupling=Coupling.EXPLICIT, z_step=ZStep.EULER, threads=settings.threads)
    paths = settings.policies
    base = WalkCfg(
        trials=len(paths["mr_go"]),
        distance=settings.window,
        seed=settings.seed,
        robots=("mr_go",),
        env=env,
        commanded=paper.MEASURED_SPEED,
    )
    off = _costs(walk(base, {"mr_go": Ensemble(paths["mr_go"])}), cfg)
    policy = {"mr_go_sal": Ensemble(paths["mr_go_sal"])}
    held: dict[str, list[float]] = {}
    saved: dict[str, list[float]] = {}
    lines = []
    for k, choice in enumerate(CHOICES):
        job.report(choice.name, (1.0 + k) / (len(CHOICES) + 2.0))
        hold = HoldCurrent.SUPPORT if choice.fixed is None else HoldCurrent.FIXED
        walked = replace(
            base,
            robots=("mr_go_sal",),
            derate=choice.set,
            current=choice.fixed or base.current,
            env=replace(env, hold_current=hold),
        )
        results = walk(walked, policy)
        on = _costs(results, cfg)
        saved[choice.name] = [100.0 * (1.0 - on[cell] / off[cell]) for cell in off]
        held[choice.name] = [100.0 * float(np.mean(r.hold)) if len(r.hold) else float("nan") for r in results]
        lost = sum(r.fell + r.late for r in results)
        both = zip(saved[choice.name], held[choice.name], strict=True)
        lines.append([choice.name, *(f"{less:.1f}, {share:.1f}" for less, share in both), str(lost)])
    job.report("speeds", 0.95)
    fast = replace(base, payloads=(0.0,), speeds=FASTER, robots=walks.SAL, commanded={})
    both = walk(fast, {"mr_go": Ensemble(paths["mr_go"]), **policy})
    speeds = [r for r in both if r.robot == "mr_go_sal"]
    fastest, without = (_fastest(both, robot, base.trials) for robot in reversed(walks.SAL))
    order = [np.mean(held[name]) for name in ("eps_hold 0.1 rad/s", NOMINAL, "eps_hold 0.4 rad/s")]
    less = np.mean(saved["eps_hold 0.1 rad/s"]) < np.mean(saved[NOMINAL])
    return Findings(
        rows=[
            compare(
                "MR_Go-SAL, 0 kg",
                ("fastest reliable speed", "m/s", 2),
                paper.FASTEST,
                over_seeds(fastest),
                f"The fastest of the commands {', '.join(f'{v:g}' for v in FASTER)} m/s that every policy reached to "
                f"{100.0 * REACHED:.0f} %; trainings command up to 0.6 m/s, so it bounds policy and gait together.",
            )
        ],
        **identified(
            ("eps_hold_extends", "a larger eps_hold extends the holding", order[0] < order[1] < order[2]),
            ("eps_hold_saves", "a smaller eps_hold costs a part of the reduction of COT", less),
            (
                "lower_kp_low_saves",
                "a lower Kp_low saves more",
                np.mean(saved["Kp_low 0 N·m/rad"]) > np.mean(saved["Kp_low 20 N·m/rad"]),
            ),
        ),
        notes=[
            f"{base.trials} walks of {base.distance:g} m each, policies of table 6, not trained again. Commands: "
            + "; ".join(
                f"{r.command:g} m/s: {walk_figures.mean(r.speed):.2f} m/s, {r.fell} fell, {r.late} late" for r in speeds
            )
            + "."
        ],
        reasons={
            "support.fastest": (
                f"Ours follow commands beyond the {env.commands.v_x[1]:g} m/s of their training, with SAL to "
                f"{np.mean(fastest):.2f} and with SAL off to {np.mean(without):.2f} m/s. The leg's workspace, to which "
                "the paper puts its limit down, is wide enough (paper_checks.md); training with faster commands at "
                "this clock does not raise it (beyond.md, where holding ends)."
            )
        },
        tables=[
            TextTable(
                title="Reduction of COT by SAL, time held [%] by the support branch's free numbers",
                head=["choice", *(paper.condition_name(*cell) for cell in off), "lost walks"],
                rows=lines,
                id="choices",
            )
        ],
        figures={"saved": saved, "held": held},
    )


def _fastest(results: Sequence[WalkResult], robot: str, trials: int) -> np.ndarray:
    """Speeds of a robot's walks [m/s] at the fastest command that all trials reached; NaN if none did."""
    reached = [
        r for r in results if r.robot == robot and len(r.speed) == trials and r.speed.mean() >= REACHED * r.command
    ]
    return max((r.speed for r in reached), key=np.mean, default=np.array([np.nan]))


def _costs(results: Sequence[WalkResult], cfg: ElectricalCfg) -> dict[tuple[float, float], float]:
    """Mean cost of transport by payload and speed."""
    return {r.cell: walk_figures.mean(walk_figures.cot(r, cfg)) for r in results}


EXPERIMENTS = (
    Experiment(
        name="support",
        compute=compute,
        needs=("walks",),
        settings=("policies", "window", "seed"),
        seconds=walks_time(60.0, "window", 10.0),
    ),
)

CLAIMS = (
    Claim(
        id="support.eps_hold",
        place="Section 3.3",
        says="a larger eps_hold extends the holding, a smaller one raises COT",
        holds=(("support", "eps_hold_extends"), ("support", "eps_hold_saves")),
        why="Policies not trained again.",
    ),
    Claim(
        id="support.kp_low",
        place="Section 7",
        says="a lower Kp_low saves more",
        holds=(("support", "lower_kp_low_saves"),),
        why="Ours walks with Kp_low 0 too; what made the hardware sensitive is not simulated.",
    ),
    Claim(
        id="support.fastest",
        place="Section 7",
        says="fastest reliable speed of the 1.5 Hz gait [m/s]",
        measure=rows("support", "fastest reliable speed", "MR_Go-SAL, 0 kg"),
        why="Ours reaches a command of 0.7 m/s, above those of its training, and falls from 0.8 m/s on.",
    ),
)
