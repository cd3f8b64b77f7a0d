"""``mrwarp impact``: hit walking robots, with each current, and show what the MR joints change."""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrwarp import paper
from mrwarp.enums import Coupling, HoldCurrent
from mrwarp.options.arguments import Parser, coil_current, count, force, positive, seed, speed
from mrwarp.params import ParameterError
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.run_dir import check_writable, one_line, write_result
from mrwarp.runtime import quiet_libraries
from mrwarp.usd.robot import CURRENT_GROUPS

if TYPE_CHECKING:
    from mrwarp.env.cfg import EnvCfg
    from mrwarp.rl.policy import OnnxPolicy


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp impact``."""
    parser = Parser(
        prog="mrwarp impact",
        description="Hit walking robots at random gait phases; the same trials are repeated with each current.",
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs/impact"), help="output folder (default: runs/impact)")
    add("--policy", type=Path, default=DEFAULT_POLICY, help=f"walking policy (default: {DEFAULT_POLICY.name})")
    currents = "currents I_e [A] (default: 0 0.5 1 1.5)"
    add("--current", type=coil_current, nargs="+", default=list(CURRENT_GROUPS), metavar="A", help=currents)
    kind = "push on the trunk, or the guided 10 kg mass (default: push)"
    add("--kind", choices=("push", "drop"), default="push", help=kind)
    push = "push, world frame [N] (default: 0 0 -100)"
    add("--force", type=force, nargs=3, default=[0.0, 0.0, -100.0], metavar="N", help=push)
    add("--duration", type=positive, default=0.2, help="duration of the push [s] (default: 0.2)")
    add("--trials", type=count, default=20, help="trials per current (default: 20)")
    add("--speed", type=speed, default=0.5, help="commanded speed [m/s] (default: 0.5)")
    coupling = "how the device acts: a brake that sticks, the paper's explicit torque, or each in turn (default: both)"
    add("--coupling", choices=("constraint", "explicit", "both"), default="both", help=coupling)
    branches = "the dynamic branch alone, as the paper's section 6.3 evaluates it (default), or with holding"
    add("--branches", choices=("damping", "both"), default="damping", help=branches)
    add("--robot", choices=("mr_go", "go1"), default="mr_go", help="robot variant (default: mr_go)")
    add("--payload", type=int, choices=(0, 3), default=0, help="payload variant [kg] (default: 0)")
    add("--model", metavar="MODEL.json", help="identified joint with its effects, on all MR joints")
    add("--asset", help="another USD file than assets/usd/mr_go.usda")
    add("--sensitivity", action="store_true", help="also vary the gates' thresholds (paper section 3.2)")
    add("--seed", type=seed, default=0, help="seed of poses and gait phases (default: 0)")
    view = parser.add_mutually_exclusive_group()
    view.add_argument("--live", action="store_true", help="open rerun and watch the first trial of every current")
    view.add_argument("--rrd", type=Path, metavar="FILE", help="save that view as a rerun recording")
    view.add_argument("--connect", metavar="URL", help="send it to a rerun viewer that runs already")
    view.add_argument("--serve-web", action="store_true", help="serve it to a browser on this machine")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run the trials; 0 done, 2 on bad input."""
    argv = sys.argv[1:] if argv is None else argv
    args = make_parser().parse_args(argv)
    quiet_libraries()
    from mrwarp.rl.policy import OnnxPolicy, PolicyError
    from mrwarp.trials.impact import ImpactSweep, figures
    from mrwarp.usd.asset import check_currents, effect_lines
    from mrwarp.usd.open_stage import AssetError
    from mrwarp.viewing import impact_pictures
    from mrwarp.viewing.impact_view import ImpactView
    from mrwarp.viewing.viewer import ViewerError

    try:
        check_writable(args.out)
        policy = OnnxPolicy(args.policy)
        couplings = list(Coupling) if args.coupling == "both" else [Coupling(args.coupling)]
        sweeps = {c: ImpactSweep(_cfg(args, c), policy) for c in couplings}
        actuators = sweeps[couplings[0]].env.sim.scene.actuators
        check_currents(actuators, args.current)
        for line in effect_lines(actuators):
            print(line, flush=True)
        shown = sweeps.get(Coupling.CONSTRAINT) or sweeps[couplings[0]]
        view = ImpactView.open(shown, live=args.live, rrd=args.rrd, connect=args.connect, serve_web=args.serve_web)
    except (PolicyError, AssetError, ParameterError, ViewerError, ValueError, OSError) as error:
        print(f"mrwarp impact: {one_line(error)}", file=sys.stderr)
        return 2
    args.out.mkdir(parents=True, exist_ok=True)
    result: dict[str, Any] = {
        "kind": args.kind, "branches": args.branches, "paper_change": paper.IMPACT_CHANGE, "couplings": {},
    }  # fmt: skip
    for coupling, sweep in sweeps.items():
        print(
            f"{args.kind}, {coupling.value} coupling: {args.trials} trials at {len(args.current)} currents", flush=True
        )
        trace = sweep.run()
        found = figures(trace, sweep.cfg.currents)
        result["couplings"][coupling.value] = found
        _print(found, args.kind)
        impact_pictures.contact_sheet(sweep, trace, args.out / f"impact_{coupling.value}.png")
        impact_pictures.loops(trace, sweep.cfg.currents, args.out / f"loops_{coupling.value}.png")
        impact_pictures.timeline(trace, sweep.cfg.currents, args.out / f"timeline_{coupling.value}.png")
    if view is not None:
        view.close()
        result["shown"] = view.minima
    if args.sensitivity:
        result["sensitivity"] = _sensitivity(args, policy)
    write_result(args.out, result, seed=args.seed, command="mrwarp impact " + shlex.join(argv))
    print(f"\nfigures and pictures in {args.out}")
    if view is not None:
        view.wait()
    return 0


def _cfg(args: argparse.Namespace, coupling: Coupling, **changes: Any):
    from mrwarp.trials.impact import ImpactCfg, ImpactKind, Variant

    return ImpactCfg(
        kind=ImpactKind(args.kind),
        variants=changes.get("variants", tuple(Variant(current=current) for current in args.current)),
        trials=args.trials,
        speed=args.speed,
        force=tuple(args.force),
        duration=args.duration,
        env=_env(args, coupling),
        seed=args.seed,
    )


def _env(args: argparse.Namespace, coupling: Coupling) -> EnvCfg:
    from mrwarp.env.cfg import make_walk_cfg

    env = make_walk_cfg(
        robot=args.robot, payload=args.payload, asset=args.asset, model=args.model, coupling=coupling,
        hold_current=HoldCurrent.FIXED,
    )  # fmt: skip
    return replace(env, actuator=replace(env.actuator, holding=args.branches == "both"))


def _sensitivity(args: argparse.Namespace, policy: OnnxPolicy) -> dict[str, Any]:
    from mrwarp.trials import thresholds
    from mrwarp.trials.impact import ImpactSweep

    print("threshold sensitivity: every value of f_th, eps_e and eps_v in one batch", flush=True)
    current = max(args.current)
    sweep = ImpactSweep(_cfg(args, Coupling.CONSTRAINT, variants=thresholds.variants(current)), policy)
    rows = thresholds.reductions(sweep.run())
    thresholds.plot(rows, args.out / "sensitivity.png")
    for name, entries in rows.items():
        text = ", ".join(f"{e['value']:g}: {e['drop']['mean']:.2f} / {e['motor']['mean']:.2f} %" for e in entries)
        print(f"  {name:6s} reduction of CoM drop / motor torque: {text}")
    return {"current": current, "ours": rows, "paper": paper.THRESHOLDS}


def _print(found: dict[str, Any], kind: str) -> None:
    """The table of one sweep."""
    print(f"  {'current':>8s}  {'min height [m]':>18s}  {'peak v_z [m/s]':>18s}  {'drop [m]':>16s}  {'damping':>7s}")
    for row in found["by_current"]:
        cells = [f"{row[k]['mean']:.4f} ± {row[k]['sd']:.4f}" for k in ("min_height", "peak_down_velocity", "drop")]
        print(
            f"  {row['current']:6.2f} A  {cells[0]:>18s}  {cells[1]:>18s}  {cells[2]:>16s}  {row['dynamic_share']:6.1%}"
            + (f"  fell {row['fell']:.0%}" if row["fell"] else "")
        )
    for name, text in (("min_height", "minimum height"), ("peak_down_velocity", "peak downward speed")):
        change = found["change"][name]
        low, high = change["ci95"]
        monotone = "monotone" if found["monotone"][name] else "not monotone"
        print(
            f"  {text}: {change['percent']:+.2f} % [{low:+.2f}, {high:+.2f}] from first to last current, {monotone} "
            f"(paper {paper.IMPACT_CHANGE[name][kind]:+.1f} %)"
        )
