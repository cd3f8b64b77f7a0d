"""Pushes from all directions: where current keeps a robot on its feet, where it does not, which gate and legs do it.

A robot stands, walks, or walks on rough ground and is pushed at the trunk for 0.2 s, horizontally. All currents are
bit-equal copies of the same robots until the push begins (:mod:`mrwarp.trials.impact`), and each has a copy that nobody
pushes, from which the displacement is counted. Two further arms at the largest current close one gate each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from mrwarp.enums import ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.gait import legs_of
from mrwarp.resources import policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import panels, text_table
from mrwarp.trials.impact import ImpactCfg, ImpactSweep, ImpactTrace, Variant, fixed_current_env
from mrwarp.trials.statistics import half_width, share
from mrwarp.trials.walking import Policy
from mrwarp.usd.robot import CURRENT_GROUPS
from paper.study.plan import AWARE, check_seeds, kept

GROUNDS = ("standing", "walking", "rough")
"""Standing: the targets stay those of the neutral stance, nothing steps. Walking: 0.5 m/s on flat ground. Rough: the
same on tiles of all levels and kinds."""

DIRECTIONS = 12
"""Sectors of 30° into which a push goes: 0 forwards, then to the left. The trials spread over a sector."""

EARLY = 0.4
"""Time from the push's onset over which gates and the devices' work count [s]."""

ONE_GATE = {"damping only": {"eps_hold": 0.0}, "holding only": {"eps_e": 10.0}}
"""Arms with one gate: parameters with which the other never opens."""


@dataclass(frozen=True, kw_only=True)
class PushesCfg:
    """Pushed robots, and how hard."""

    policies: Path
    """Folder of policies that walk on rough ground; they walk on the flat one too."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds, and seeds of poses and gait phases."""
    strengths: tuple[float, ...] = (40.0, 60.0, 80.0)
    """Pushes for 0.2 s [N]."""
    currents: tuple[float, ...] = CURRENT_GROUPS
    """Currents I_e [A]; the first is what the others are compared with."""
    trials: int = 6
    """Pushes into each sector, per seed."""
    seconds: float = 2.0
    """Time after the push's onset in which a fall counts; the displacement is taken at its end [s]."""
    threads: int = 0
    """CPU threads of the physics; 0 = all, the figures are the same."""

    def __post_init__(self) -> None:
        check_seeds(self.seeds)
        if not self.strengths or not all(0.0 < force < math.inf for force in self.strengths):
            raise ValueError(f"strengths = {self.strengths} N: name at least one, all above 0 and finite")
        for name in ("strengths", "currents"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} = {getattr(self, name)}: name each once")
        if len(self.currents) < 2:
            raise ValueError(f"currents = {self.currents} A: name at least two to compare")


def arms(cfg: PushesCfg) -> dict[str, Variant]:
    """Settings of the devices by name."""
    found = {f"{amps:g} A": Variant(current=amps) for amps in cfg.currents}
    top = max(cfg.currents)
    return found | {f"{top:g} A, {name}": Variant(current=top, params=params) for name, params in ONE_GATE.items()}


def stance(obs: TensorDict) -> torch.Tensor:
    """The policy of a standing robot: targets of the neutral stance, shape (E, 12)."""
    return torch.zeros(len(obs), 12, device=obs.device)


def directions(trials: int) -> np.ndarray:
    """Where the pushes go [rad], shape (DIRECTIONS, trials): each sector's evenly over its 30°."""
    within = (np.arange(trials) + 0.5) / trials - 0.5
    return 2.0 * np.pi / DIRECTIONS * (np.arange(DIRECTIONS)[:, None] + within)


def run(cfg: PushesCfg, out: Path, report: Callable[[str, float], None] = lambda text, share: None) -> dict[str, Any]:
    """Push what is not done yet in ``out``, and sum up.

    Args:
        cfg: What is pushed.
        out: Folder of the cells, which are taken from there when they are done.
        report: Called with what is under way and the share that is done.

    Raises:
        ValueError: a file in ``out`` is damaged or of other choices, or a policy is missing.
    """
    asked = {name: getattr(cfg, name) for name in ("currents", "trials", "seconds", "policies")}
    walks = {seed: OnnxPolicy(policy_file(cfg.policies, AWARE, seed)) for seed in cfg.seeds}
    jobs = [(ground, seed) for ground in GROUNDS for seed in cfg.seeds]
    cells: dict[str, list[dict[str, Any]]] = {ground: [] for ground in GROUNDS}
    for k, (ground, seed) in enumerate(jobs):
        pusher = Pusher(cfg, ground, seed, stance if ground == "standing" else walks[seed])
        for i, force in enumerate(cfg.strengths):
            report(f"{ground}, seed {seed}, {force:g} N", (k + i / len(cfg.strengths)) / len(jobs))
            path = out / "cells" / f"{ground}_{force:g}N_seed{seed}.json"
            cells[ground].append({"force": force, "seed": seed} | kept(path, asked, partial(pusher.push, force)))
    names = list(arms(cfg))
    rows = {
        ground: {
            f"{force:g}": summary(names, [cell for cell in own if cell["force"] == force]) for force in cfg.strengths
        }
        for ground, own in cells.items()
    }
    return {"arms": names, "strengths": list(cfg.strengths), "directions": DIRECTIONS, "rows": rows}


class Pusher:
    """The robots of one ground and seed; they are built when the first push is missing."""

    def __init__(self, cfg: PushesCfg, ground: str, seed: int, policy: Policy) -> None:
        self.cfg, self.ground, self.seed, self.policy = cfg, ground, seed, policy
        self._sweep: ImpactSweep | None = None

    def push(self, force: float) -> dict[str, Any]:
        """Push with a force [N] into all directions.

        Returns:
            Of each arm: ``fell``, shape (directions, trials); ``moved`` [m] of that shape, null where the robot fell;
            and of each leg group, lee (where the push goes) and luff, the share of the first 0.4 s in which their
            knees' gates are open and the work that the devices took in it [J], means over the trials.
        """
        sweep, cfg = self._built(), self.cfg
        env, trials, count = sweep.env, cfg.trials, len(arms(cfg))
        angle = directions(trials)
        force_xy = force * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        one_arm = np.concatenate([np.zeros((1, trials, 2)), force_xy]).reshape(-1, 2)  # the first is not pushed
        sweep.forces[:, :2] = np.tile(one_arm, (count, 1))
        fell = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        fallen = TaskCfg()

        def watch(time: float) -> None:
            if time > 0.0:
                fell.logical_or_((env.height < fallen.fall_height) | (env.gravity[:, 2] > -math.cos(fallen.fall_tilt)))

        sweep.watchers[:] = [watch]
        trace = sweep.run(again=True)
        shape = (count, 1 + DIRECTIONS, trials)
        end = env.root_pos[:, :2].cpu().numpy().reshape(*shape, 2)
        lost = fell.cpu().numpy().reshape(shape)
        moved = np.linalg.norm(end[:, 1:] - end[:, :1], axis=-1)
        moved[lost[:, 1:] | lost[:, :1]] = np.nan
        feet = legs_of(env.sim.scene).feet.numpy()[:, :2]
        lee = np.einsum("dnk,lk->dnl", force_xy, feet) > 0.0
        found = _gates(trace, shape, lee)
        found |= {"fell": lost[:, 1:].astype(int), "moved": moved}
        return {name: {key: values[i] for key, values in found.items()} for i, name in enumerate(arms(cfg))}

    def _built(self) -> ImpactSweep:
        if self._sweep is None:
            cfg = self.cfg
            terrain = "rough" if self.ground == "rough" else "flat"
            env = replace(
                fixed_current_env(holding=True, z_step=ZStep.EULER, threads=cfg.threads, terrain=terrain),
                randomize=None,
            )
            impact = ImpactCfg(
                variants=tuple(arm for arm in arms(cfg).values() for _ in range(1 + DIRECTIONS)),
                trials=cfg.trials,
                speed=0.0 if self.ground == "standing" else 0.5,
                warmup=2.0,
                window=cfg.seconds,
                env=env,
                seed=self.seed,
            )
            self._sweep = ImpactSweep(impact, self.policy)
        return self._sweep


def _gates(trace: ImpactTrace, shape: tuple[int, ...], lee: np.ndarray) -> dict[str, np.ndarray]:
    """Shares of open gates and work of the devices in :data:`EARLY`, by arm and leg group (lee, luff), shape (C, 2).

    ``lee``: whether the push goes to a leg's side, shape (directions, trials, L).
    """
    early = trace.t <= EARLY
    dt = trace.t[1] - trace.t[0]
    power = trace.tau_mr[:, :, early] * trace.qd[:, :, early]
    dyn, hold = trace.m_dyn[:, :, early], trace.m_hold[:, :, early]
    series = {
        "damps": dyn.mean(axis=2), "holds": hold.mean(axis=2),
        "damping_work": -dt * (power * dyn).sum(axis=2), "holding_work": -dt * (power * hold).sum(axis=2),
    }  # fmt: skip
    sides = np.stack([lee, ~lee])
    found = {}
    for name, values in series.items():
        by_push = values.reshape(*shape, -1)[:, 1:]
        found[name] = np.einsum("cdnl,sdnl->cs", by_push, sides) / sides.sum(axis=(1, 2, 3))
    return found


def summary(names: Sequence[str], cells: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Figures of one ground and strength over its seeds.

    Returns:
        By arm: ``fell``, over all directions, ``by_direction``, and ``ahead`` and ``aside`` (within 45° of the robot's
        axis, or of its sides), each a share with its interval; ``fell_change`` against the first arm with the half
        width of its 95 % interval over robots (a robot: one seed, pose and gait phase, pushed into all directions);
        ``moved``, by direction [m], and ``moved_change`` [m] of the pushes that neither arm fell under, in that form;
        ``damps``, ``holds``, ``damping_work``, ``holding_work`` of the knees at lee and luff.
    """
    fell = {name: np.concatenate([np.array(cell[name]["fell"]) for cell in cells], axis=1) for name in names}
    moved = {
        name: np.concatenate([np.array(cell[name]["moved"], dtype=float) for cell in cells], axis=1) for name in names
    }
    axis = np.abs(np.cos(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS))
    ahead = axis > math.sqrt(0.5)
    found: dict[str, Any] = {}
    for name in names:
        mine, first = fell[name], fell[names[0]]
        change = (mine - first).mean(axis=0)
        further = moved[name] - moved[names[0]]
        robots = np.array([np.nanmean(x) for x in further.T if np.isfinite(x).any()])
        found[name] = {
            "fell": share(int(mine.sum()), mine.size),
            "by_direction": [share(int(row.sum()), row.size) for row in mine],
            "ahead": share(int(mine[ahead].sum()), mine[ahead].size),
            "aside": share(int(mine[~ahead].sum()), mine[~ahead].size),
            "fell_change": {"mean": float(change.mean()), "half_width": half_width(change)},
            "moved": [float(np.nanmean(row)) if np.isfinite(row).any() else float("nan") for row in moved[name]],
            "moved_change": {"mean": float(robots.mean()) if len(robots) else float("nan"),
                             "half_width": half_width(robots), "pushes": int(np.isfinite(further).sum())},
            **{key: np.mean([cell[name][key] for cell in cells], axis=0).tolist()
               for key in ("damps", "holds", "damping_work", "holding_work")},
        }  # fmt: skip
    return found


def lines(found: Mapping[str, Any]) -> list[str]:
    """The table."""
    head = (
        "pushed",
        "arm",
        "fell [%]",
        "ahead",
        "aside",
        "change [points]",
        "moved on [m]",
        "damps lee, luff [%]",
        "holds lee, luff [%]",
        "damping work [J]",
        "holding work [J]",
    )
    rows = []
    for ground, by_force in found["rows"].items():
        for force, own in by_force.items():
            for name, row in own.items():
                fell, change, moved = row["fell"], row["fell_change"], row["moved_change"]
                rows.append((
                    f"{ground}, {force} N", name,
                    f"{100 * fell['share']:.1f} ({100 * fell['low']:.0f} to {100 * fell['high']:.0f})",
                    *(f"{100 * row[side]['share']:.0f}" for side in ("ahead", "aside")),
                    f"{100 * change['mean']:+.1f} ± {100 * change['half_width']:.1f}",
                    f"{moved['mean']:+.3f} ± {moved['half_width']:.3f}",
                    *(", ".join(f"{100 * x:.0f}" for x in row[key]) for key in ("damps", "holds")),
                    *(", ".join(f"{x:.1f}" for x in row[key]) for key in ("damping_work", "holding_work")),
                ))  # fmt: skip
    return text_table(head, rows, left=2)


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Polar maps: falls by direction at every strength, and displacement at the least one; a row per ground."""
    strengths = [f"{force:g}" for force in found["strengths"]]
    size = (3.3 * (1 + len(strengths)), 10.5)
    figure, axes = panels(size, len(GROUNDS), 1 + len(strengths), subplot_kw={"projection": "polar"})
    angle = 2.0 * np.pi * np.arange(DIRECTIONS + 1) / DIRECTIONS
    shown = [name for name in found["arms"] if "," not in name]
    colours = dict(zip(shown, ("#888888", "#e0a030", "#4a90c8", "#b02a2a", "#207040", "#704090"), strict=False))

    def closed(values: Sequence[float | None]) -> np.ndarray:
        filled = np.array([np.nan if v is None else v for v in values], dtype=float)
        return np.append(filled, filled[0])

    for row, (ground, by_force) in zip(axes, found["rows"].items(), strict=True):
        for axis, force in zip(row, [*strengths, strengths[0]], strict=True):
            falls = axis is not row[-1]
            for name in shown:
                own, colour = by_force[force][name], colours.get(name)
                if falls:
                    by = own["by_direction"]
                    axis.plot(angle, closed([x["share"] for x in by]), color=colour, label=name)
                    if name in (shown[0], shown[-1]):
                        ends = (closed([x[end] for x in by]) for end in ("low", "high"))
                        axis.fill_between(angle, *ends, color=colour, alpha=0.15, linewidth=0)
                else:
                    axis.plot(angle, closed(own["moved"]), color=colour)
            axis.set_theta_zero_location("N")
            axis.set_xticks(angle[:-1:3], ["forwards", "left", "back", "right"], fontsize=7)
            axis.tick_params(axis="y", labelsize=6)
            if falls:
                axis.set_ylim(0.0, 1.0)
            axis.set_title(f"{ground}, {force} N: {'falls' if falls else 'displacement [m]'}", fontsize=9)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(shown), fontsize=9)
    figure.savefig(path, dpi=110)
