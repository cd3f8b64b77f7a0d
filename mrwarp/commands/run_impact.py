"""``mrwarp impact``: hit walking robots, with each current, and show what the MR joints change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mrwarp import paper
from mrwarp.enums import Coupling, HoldCurrent
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.options.command_line import CommandLine
from mrwarp.options.trial_options import Impact
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, write_result
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, Variant
from mrwarp.trials.impact_figures import figures, plot_thresholds, threshold_reductions, threshold_variants
from mrwarp.usd.asset import check_currents, device_lines
from mrwarp.viewing import robot_pictures
from mrwarp.viewing.live_view import ImpactView, open_sink


def run(options: Impact, line: CommandLine) -> int:
    """Run the trials; 0 done, 2 on bad input."""
    check_writable(options.out)
    policy = OnnxPolicy(options.policy)
    couplings = list(Coupling) if options.coupling == "both" else [Coupling(options.coupling)]
    variants = tuple(Variant(current=current) for current in options.current)
    sweeps = {coupling: ImpactSweep(make_cfg(options, coupling, variants), policy) for coupling in couplings}
    actuators = sweeps[couplings[0]].env.sim.scene.actuators
    check_currents(actuators, options.current)
    shown = sweeps.get(Coupling.CONSTRAINT) or sweeps[couplings[0]]
    for text in (*device_lines(actuators), *([shown.foreign] if shown.foreign else [])):
        print(text, flush=True)
    sink = None
    if options.live or options.rrd or options.connect or options.serve_web:
        sink = open_sink(rrd=options.rrd, url=options.connect, web=options.serve_web)
    view = ImpactView(shown, sink) if sink else None
    options.out.mkdir(parents=True, exist_ok=True)
    result: dict[str, Any] = {
        "kind": options.kind,
        "branches": options.branches,
        "paper_change": None if shown.foreign else paper.IMPACT_CHANGE,
        "couplings": {},
    }
    for coupling, sweep in sweeps.items():
        currents = len(options.current)
        print(f"{options.kind}, {coupling.value} coupling: {options.trials} trials at {currents} currents", flush=True)
        trace = sweep.run()
        found = figures(trace, sweep.cfg.currents)
        result["couplings"][coupling.value] = found
        _print(found, None if sweep.foreign else options.kind)
        robot_pictures.impact_sheet(sweep, trace, options.out / f"impact_{coupling.value}.png")
        robot_pictures.impact_loops(trace, sweep.cfg.currents, options.out / f"loops_{coupling.value}.png")
        robot_pictures.impact_timeline(trace, sweep.cfg.currents, options.out / f"timeline_{coupling.value}.png")
    if view is not None:
        view.close()
        result["shown"] = view.minima
    if options.sensitivity:
        result["sensitivity"] = _sensitivity(options, policy)
    write_result(options.out, result, seed=options.seed, command=str(line))
    print(f"\nfigures and pictures in {options.out}")
    if sink and sink.web:
        print(f"open {sink.web.page} in a browser on this machine; Ctrl-C ends", flush=True)
        sink.web.wait()
        sink.web.close()
    return 0


def make_cfg(options: Impact, coupling: Coupling, variants: tuple[Variant, ...]) -> ImpactCfg:
    """The trials of a coupling that the options ask for."""
    env = make_walk_cfg(
        robot=options.robot,
        payload=options.payload,
        asset=options.asset,
        model=options.model,
        coupling=coupling,
        hold_current=HoldCurrent.FIXED,
    )
    return ImpactCfg(
        kind=ImpactKind(options.kind),
        variants=variants,
        trials=options.trials,
        speed=options.speed,
        force=(options.force[0], options.force[1], options.force[2]),
        duration=options.duration,
        env=replace(env, actuator=replace(env.actuator, holding=options.branches == "both")),
        seed=options.seed,
    )


def _sensitivity(options: Impact, policy: OnnxPolicy) -> dict[str, Any]:
    print("threshold sensitivity: every value of f_th, eps_e and eps_v in one batch", flush=True)
    current = max(options.current)
    sweep = ImpactSweep(make_cfg(options, Coupling.CONSTRAINT, threshold_variants(current)), policy)
    rows = threshold_reductions(sweep.run())
    plot_thresholds(rows, options.out / "sensitivity.png", paper_device=not sweep.foreign)
    for name, entries in rows.items():
        text = ", ".join(f"{e['value']:g}: {e['drop']['mean']:.2f} / {e['motor']['mean']:.2f} %" for e in entries)
        print(f"  {name:6s} reduction of CoM drop / motor torque: {text}")
    return {"current": current, "ours": rows, "paper": None if sweep.foreign else paper.THRESHOLDS}


def _print(found: dict[str, Any], kind: str | None) -> None:
    """The table of one sweep; ``kind`` of impact, of which the paper's change stands beside."""
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
            f"  {text}: {change['percent']:+.2f} % [{low:+.2f}, {high:+.2f}] from first to last current, {monotone}"
            + (f" (paper {paper.IMPACT_CHANGE[name][kind]:+.1f} %)" if kind else "")
        )
