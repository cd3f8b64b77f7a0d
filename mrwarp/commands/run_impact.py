"""``mrwarp impact``: hit walking robots, with each current, and show what the MR joints change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from mrwarp import paper
from mrwarp.enums import Coupling
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.run_dir import write_result
from mrwarp.runtime import drawing, four_digits, text_table

if TYPE_CHECKING:
    from mrwarp.rl.policy import OnnxPolicy
    from mrwarp.trials.impact import ImpactSweep, Variant
    from mrwarp.usd.asset import RobotAsset

push_force = opt.within(-1e4, 1e4, "N")
"""Push on a robot of 15 kg; the paper's is 100 N."""


@dataclass(frozen=True, kw_only=True)
class Impact(opt.ViewOptions, opt.SteppedRobot):
    """Hit walking robots at random gait phases; the same trials are repeated with each current."""

    out: opt.Folder = Path("runs/impact")
    """output folder"""
    policy: opt.OptionalFile = None
    """walking policy (default: the shipped one; a robot of your own needs its own)"""
    current: opt.Currents = opt.CURRENTS
    """currents I_e [A]"""
    kind: Literal["push", "drop"] = "push"
    """push on the trunk, or the guided 10 kg mass"""
    force: Annotated[tuple[float, ...] | None, opt.three(push_force, "N")] = None
    """push, world frame [N] (default: 100 N down, as of a robot of 12.6 kg)"""
    duration: Annotated[float | None, opt.one(opt.positive, "S")] = None
    """duration of the push [s] (default: 0.2, as of a robot 0.334 m high)"""
    trials: opt.Count = 20
    """trials per current"""
    speed: Annotated[float | None, opt.one(opt.forward_speed, "V")] = None
    """commanded speed [m/s] (default: 0.5, as of a robot 0.334 m high)"""
    coupling: Literal["constraint", "explicit", "both"] = "both"
    """how the device acts: a brake that sticks, the paper's explicit torque, or each in turn"""
    branches: Literal["damping", "both"] = "damping"
    """the dynamic branch alone, as the paper's section 6.3 evaluates it, or with holding"""
    robot: Annotated[str | None, opt.ROBOT] = None
    """mr_go, go1, or a USD file of 'mrwarp robot import' (default: the file of the policy's robot, else mr_go)"""
    payload: opt.Load = 0
    """mass on the back [kg]"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""
    serve_web: Annotated[opt.Flag, opt.VIEW] = False
    """serve that view to a browser on this machine"""

    def check(self) -> None:
        """Refuse also a robot that the policy was not made for."""
        super().check()
        from mrwarp.rl.policy_file import check_robot
        from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot

        if self.robot and not load_robot(robot=self.robot).layout.legs:
            return
        if self.robot and self.robot.endswith(ROBOT_SUFFIXES) and self.policy is None:
            raise ValueError(
                f"--robot {self.robot}: give its --policy, as 'mrwarp train --robot {self.robot}' writes it"
            )
        check_robot(self.policy or DEFAULT_POLICY, self.robot, self.asset)

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        from mrwarp.rl.policy_file import check_robot
        from mrwarp.usd.asset import device_lines, load_robot, taken_currents

        if self.robot and not (arm := load_robot(robot=self.robot)).layout.legs:
            return self._arm(line, arm)
        if note := check_robot(self.policy or DEFAULT_POLICY, self.robot, self.asset):
            print(note, flush=True)

        from mrwarp.rl.policy import OnnxPolicy
        from mrwarp.trials.impact import Variant
        from mrwarp.trials.impact_figures import figures
        from mrwarp.viewing import robot_pictures
        from mrwarp.viewing.live_view import ImpactView, open_sink

        policy = OnnxPolicy(self.policy or DEFAULT_POLICY)
        couplings = list(Coupling) if self.coupling == "both" else [Coupling(self.coupling)]
        variants = tuple(Variant(current=current) for current in self.current)
        sweeps = {coupling: self._sweep(coupling, variants, policy) for coupling in couplings}
        actuators = sweeps[couplings[0]].env.sim.scene.actuators
        if (currents := taken_currents(actuators, self.current, opt.CURRENTS)) != self.current:
            return replace(self, current=currents).run(line)
        shown = sweeps.get(Coupling.CONSTRAINT) or sweeps[couplings[0]]
        for text in (*device_lines(actuators), *([shown.foreign] if shown.foreign else [])):
            print(four_digits(text), flush=True)
        sink = None
        if self.live or self.rrd or self.connect or self.serve_web:
            sink = open_sink(rrd=self.rrd, url=self.connect, web=self.serve_web)
        view = ImpactView(shown, sink) if sink else None
        self.out.mkdir(parents=True, exist_ok=True)
        couples: dict[str, Any] = {}
        pictures: dict[str, Callable[..., Any]] = {}
        theirs = None if shown.foreign else paper.IMPACT_CHANGE
        result = {**self.chosen("kind", "branches"), "paper_change": theirs, "couplings": couples}
        for name, sweep in ((coupling.value, sweep) for coupling, sweep in sweeps.items()):
            currents = len(self.current)
            print(f"{self.kind}, {name} coupling: {self.trials} trials at {currents} currents", flush=True)
            trace = sweep.run()
            couples[name] = figures(trace, sweep.cfg.currents)
            print("\n".join(f"  {text}" for text in _lines(couples[name], None if sweep.foreign else self.kind)))
            pictures[f"impact_{name}.png"] = partial(robot_pictures.impact_sheet, sweep, trace, title=_title(sweep))
            pictures[f"loops_{name}.png"] = partial(robot_pictures.impact_loops, trace, sweep.cfg.currents)
            pictures[f"timeline_{name}.png"] = partial(robot_pictures.impact_timeline, trace, sweep.cfg.currents)
        if view is not None:
            view.close()
            result["shown"] = view.minima
        write_result(self.out, result, seed=self.seed, command=str(line))
        _draw(pictures, self.out)
        print(f"\nfigures and pictures in {self.out}")
        if sink and sink.web:
            print(f"open {sink.web.page} in a browser on this machine; Ctrl-C ends", flush=True)
            sink.web.wait()
            sink.web.close()
        return 0

    def _arm(self, line: CommandLine, arm: RobotAsset) -> int:
        """Push an arm's last link, or a rail's carriage, by default with the weight of all that moves."""
        from mrwarp.trials import fixed_base
        from mrwarp.usd.asset import taken_currents

        if self.kind == "drop":
            raise ValueError("--kind drop: the mass falls on a trunk that floats, this robot has none; use a push")
        currents = taken_currents(arm.actuators, self.current, opt.CURRENTS)
        force = self.force or fixed_base.default_push(arm)
        couplings = [c for c in Coupling if self.coupling in ("both", c.value)]
        result: dict[str, Any] = {"force": force, "couplings": {}}
        pictures: dict[str, Callable[..., Any]] = {}
        self.out.mkdir(parents=True, exist_ok=True)
        for coupling in couplings:
            push = {"force": force, "duration": self.duration or 0.2, "seconds": 2.0, "coupling": coupling}
            push["z_step"] = self.z_step
            scene, trace = fixed_base.move(arm, currents, **push)
            rows = fixed_base.figures(scene, trace, currents)
            result["couplings"][coupling.value] = {"by_current": rows}
            what = "carriage" if fixed_base.has_rail(arm) else "last link"
            newtons = ", ".join(f"{round(f, 3) + 0.0:g}" for f in force)
            print(f"push of ({newtons}) N on the {what}, {coupling.value} coupling")
            print("\n".join(fixed_base.lines(rows, what)))
            title = f"{arm.path.name} pushed, {coupling.value} coupling"
            pictures[f"impact_{coupling.value}.png"] = partial(fixed_base.picture, scene, trace, currents, title=title)
        write_result(self.out, result, seed=self.seed, command=str(line))
        _draw(pictures, self.out)
        print(f"\nfigures and pictures in {self.out}")
        return 0

    def _sweep(self, coupling: Coupling, variants: tuple[Variant, ...], policy: OnnxPolicy) -> ImpactSweep:
        from mrwarp.env.natural_units import scales_of
        from mrwarp.rl.task_record import trained_device
        from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, fixed_current_env

        robot = {**self.chosen("payload", "asset", "model", "z_step"), "robot": self.robot or policy.file or "mr_go"}
        if not (self.model or self.asset or self.robot):
            robot["model"] = trained_device(policy.description.get("task", {}), policy.path)
        given = {name: value for name, value in self.chosen("speed", "force", "duration").items() if value is not None}
        cfg = ImpactCfg(
            **self.chosen("trials", "seed"),
            kind=ImpactKind(self.kind),
            variants=variants,
            env=fixed_current_env(holding=self.branches == "both", coupling=coupling, **robot),
        )
        return ImpactSweep(replace(cfg.scaled(scales_of(robot["robot"], self.asset)), **given), policy)


def _title(sweep: ImpactSweep) -> str:
    """The impact, the devices and how they act, in a line."""
    from mrwarp.trials.impact import ImpactKind
    from mrwarp.viewing.robot_pictures import device_title

    cfg, robot = sweep.cfg, Path(str(sweep.cfg.env.robot)).name
    newtons = ", ".join(f"{round(f, 1) + 0.0:g}" for f in cfg.force)
    pushed = f"push of ({newtons}) N for {cfg.duration:.3g} s on {robot}"
    impact = pushed if cfg.kind is ImpactKind.PUSH else f"{cfg.mass.mass:.3g} kg fall on {robot}"
    return f"{impact}{device_title(sweep.env.sim.scene.actuators)}; {cfg.env.coupling.value} coupling"


def _draw(pictures: Mapping[str, Callable[..., Any]], out: Path) -> None:
    """Draw pictures by their file names, after what they show was written."""
    for name, draw in pictures.items():
        with drawing(name):
            draw(path=out / name)


def _lines(found: dict[str, Any], kind: str | None) -> list[str]:
    """The table of one sweep, and what changes from the first to the last current.

    It is compared with the paper's change by an impact of this ``kind``.
    """
    columns = {"min_height": "min height [m]", "peak_down_velocity": "peak v_z [m/s]", "drop": "drop [m]"}
    rows = [
        (
            f"{row['current']:.2f} A",
            *(f"{row[name]['mean']:.4f} ± {row[name]['sd']:.4f}" for name in columns),
            f"{row['dynamic_share']:.1%}",
            f"fell {row['fell']:.0%}" if row["fell"] else "",
        )
        for row in found["by_current"]
    ]
    lines = text_table(("current", *columns.values(), "damping", ""), rows)
    for name, text in (("min_height", "minimum height"), ("peak_down_velocity", "peak downward speed")):
        change, monotone = found["change"][name], "monotone" if found["monotone"][name] else "not monotone"
        low, high = change["ci95"]
        lines.append(
            f"{text}: {change['percent']:+.2f} % [{low:+.2f}, {high:+.2f}] from first to last current, {monotone}"
            + (f" (paper {paper.IMPACT_CHANGE[name][kind]:+.1f} %)" if kind else "")
        )
    return lines
