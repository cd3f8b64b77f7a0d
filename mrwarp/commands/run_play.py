"""Command line of the player: ``python train/play.py`` and ``mrwarp play`` are this."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrwarp.commands.run_train import check_device
from mrwarp.enums import ACTUATORS, TERRAINS, Coupling, HoldCurrent, ZStep
from mrwarp.options.arguments import Parser, coil_current, count, finite, seed, speed, typed
from mrwarp.params import ParameterError
from mrwarp.resources import shipped_model
from mrwarp.run_dir import check_output, one_line, write_result
from mrwarp.runtime import quiet_libraries
from mrwarp.usd.robot import CURRENT_GROUPS

if TYPE_CHECKING:
    import torch

    from mrwarp.env.cfg import EnvCfg
    from mrwarp.rl.policy import OnnxPolicy
    from mrwarp.viewing.player import Player

WARMUP = 2.0
"""Longest time to get going that is shown but not measured [s]; at most a quarter of the run."""

MAX_SHOWN = 8
"""Most robots that are drawn; with more environments these are spread over all of them."""

Actor = Callable[[Any], "torch.Tensor"]
"""Observations to actions (E, 12)."""


def make_parser(prog: str = "mrwarp play") -> argparse.ArgumentParser:
    """The options of ``mrwarp play`` and ``train/play.py``."""
    parser = Parser(
        prog=prog,
        description="Run a policy with one robot per MR current side by side, and show it in rerun, in a recording or "
        "in a picture. Without --rrd, --connect, --serve-web, --png and --out, rerun's window opens.",
    )
    parser.set_defaults(prog=prog)
    who = parser.add_mutually_exclusive_group(required=True)
    who.add_argument("--policy", metavar="FILE", help="exported policy (.onnx), as train/ppo.py writes it")
    who.add_argument("--agent", choices=("zero", "random"), help="no policy: stand still, or move at random")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--live", action="store_true", help="open rerun's window, also beside --png and --out")
    where.add_argument("--rrd", type=Path, metavar="FILE", help="save a recording for 'rerun FILE'")
    where.add_argument("--connect", nargs="?", const="", metavar="URL", help="send to a viewer that runs already")
    where.add_argument("--serve-web", action="store_true", help="show in a browser on this machine")
    parser.add_argument("--web-port", type=_port, metavar="PORT", help="port of --serve-web (default: 9090 if free)")
    parser.add_argument("--png", type=Path, metavar="FILE", help="save a picture: five instants and time series")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for result.json, the measured figures")
    parser.add_argument("--num-envs", type=count, default=len(CURRENT_GROUPS), help="robots (default: 4)")
    parser.add_argument("--current", type=coil_current, nargs="+", metavar="A", default=list(CURRENT_GROUPS),
                        help="currents I_e [A], over equal groups of robots (default: 0 0.5 1 1.5)")  # fmt: skip
    parser.add_argument("--speed", type=speed, default=0.5, help="commanded forward speed [m/s] (default: 0.5)")
    parser.add_argument("--seconds", type=_duration, default=10.0, help="time shown [s] (default: 10)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of initial poses and of --agent random (default: 0)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda:N (default: cpu)")
    task = parser.add_argument_group("robot", "the default of each is what the policy was trained with")
    task.add_argument("--robot", choices=("mr_go", "go1"), help="robot variant of the USD asset")
    task.add_argument("--payload", type=int, choices=(0, 3), help="payload variant [kg]")
    task.add_argument("--sal", choices=("on", "off"), help="whether the gates may open")
    task.add_argument("--asset", help="another USD file than assets/usd/mr_go.usda")
    task.add_argument("--actuator", choices=ACTUATORS, help="torque model of the MR joint")
    task.add_argument("--actuator-model", metavar="FILE", help="trained network of --actuator mlp, lstm or pg_rlstm")
    task.add_argument("--model", metavar="MODEL.json", help="identified joint with its effects, on all MR joints")
    task.add_argument("--terrain", choices=TERRAINS, help="ground; on rough ground the robots stand on different tiles")
    task.add_argument("--coupling", choices=_values(Coupling), help="how the device acts")
    task.add_argument("--hold-current", choices=_values(HoldCurrent), help="current while holding")
    return parser


def main(argv: list[str] | None = None, prog: str = "mrwarp play") -> int:
    """Run and show; 0 when done, 1 when a recording failed, 2 on bad input, 130 after Ctrl-C.

    Args:
        argv: Arguments; None takes those of the process.
        prog: What the command is called, as a user types it.
    """
    argv = sys.argv[1:] if argv is None else argv
    try:
        args = make_parser(prog).parse_args(argv)
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else 2
    quiet_libraries()
    try:
        return _play(args, argv)
    except KeyboardInterrupt:
        print("\nstopped", file=sys.stderr)
        return 130


def _play(args: argparse.Namespace, argv: list[str]) -> int:
    """Prepare everything, so that nothing is written when something is wrong, then play."""
    from mrwarp.rl.policy import OnnxPolicy, PolicyError
    from mrwarp.trials.walking import make_env
    from mrwarp.usd.asset import check_currents, effect_lines
    from mrwarp.usd.open_stage import AssetError
    from mrwarp.viewing.player import Player
    from mrwarp.viewing.viewer import ViewerError

    try:
        check_device(args.device)
        for path, suffix in ((args.rrd, ".rrd"), (args.png, ".png"), (args.out, "")):
            check_output(path, suffix)
        policy = OnnxPolicy(args.policy) if args.policy else None
        cfg = make_cfg(args, policy.description.get("task", {}) if policy else {})
        env = make_env(cfg, args.num_envs, args.seed)
        check_currents(env.sim.scene.actuators, args.current)
        for line in effect_lines(env.sim.scene.actuators):
            print(line, flush=True)
        actor = on_device(policy, env.device) if policy else make_agent(args.agent, env)
        player = Player(env, actor, speed=args.speed, shown=shown(args.num_envs))
        player.open(
            rrd=args.rrd,
            url=None if args.connect is None else args.connect or "default",
            web=args.serve_web,
            web_port=args.web_port,
            window=args.live or not any((args.rrd, args.connect is not None, args.serve_web, args.png, args.out)),
            keep=args.png is not None,
        )
    except (AssetError, ParameterError, PolicyError, ViewerError, ValueError, OSError) as error:
        print(f"{args.prog}: {one_line(error)}", file=sys.stderr)
        return 2
    try:
        return _run(args, argv, player)
    finally:
        player.end()


def _run(args: argparse.Namespace, argv: list[str], player: Player) -> int:
    """Play, then write what was asked for."""
    cfg, agent = player.env.cfg, args.policy or f"agent {args.agent}"
    print(
        f"{agent}: {len(player.currents)} of {args.num_envs} robots shown ({cfg.robot}, payload {cfg.payload} kg, "
        f"SAL {'on' if cfg.actuator.sal else 'off'}, {'rough' if cfg.terrain else 'flat'} ground), "
        f"{args.speed:g} m/s for {args.seconds:g} s",
        flush=True,
    )
    if player.page:
        print(f"open {player.page}", flush=True)
    started = time.perf_counter()
    figures: dict[str, Any] = {}
    code = 0
    try:
        figures = player.play(args.seconds, warmup=min(WARMUP, 0.25 * args.seconds))
    except KeyboardInterrupt:
        print("\nstopped", file=sys.stderr)
        code = 130
    except RuntimeError as error:
        print(f"{args.prog}: {error}", file=sys.stderr)
        code = 1
    wall = time.perf_counter() - started
    if not player.close():
        where = "recording is not complete" if args.rrd else "viewer did not take everything"
        print(f"{args.prog}: the {where} ({player.dropped} frames dropped)", file=sys.stderr)
        code = code or int(args.rrd is not None)
    if args.rrd:
        print(f"recording: {args.rrd}; open it with: rerun {args.rrd}")
    if args.png and len(player.frames) > 1:
        where = f"{cfg.robot}, payload {cfg.payload} kg, command {args.speed:g} m/s, seed {args.seed}"
        where += ", rough ground" if cfg.terrain else ""
        player.picture(args.png, f"{Path(agent).name} on {where}")
        print(f"picture: {args.png}")
    if figures:
        _report(figures, wall)
        if args.out:
            figures |= {"wall_seconds": wall, "dropped_frames": player.dropped, "currents": player.currents}
            written = write_result(args.out, figures, seed=args.seed, command=typed(args.prog, argv))
            print(f"figures: {written}")
        if player.page:
            _wait_for_interrupt()
    return code


def make_cfg(args: argparse.Namespace, task: dict[str, Any]) -> EnvCfg:
    """The task to play: what the command line says, else what the policy was trained with.

    Args:
        args: Parsed options.
        task: The policy's task, as :func:`mrwarp.rl.task.task` describes it; empty without a policy.

    Raises:
        ValueError: the policy was made for another action scale or rate than this version has.
    """
    from mrwarp.env.cfg import make_walk_cfg

    def chosen(option: Any, name: str, default: Any) -> Any:
        return task.get(name, default) if option is None else option

    sal = task.get("sal", True) if args.sal is None else args.sal == "on"
    cfg = make_walk_cfg(
        num_envs=args.num_envs,
        device=args.device,
        seed=args.seed,
        robot=chosen(args.robot, "robot", "mr_go"),
        payload=chosen(args.payload, "payload", 0),
        asset=args.asset,
        actuator_model=chosen(args.actuator, "actuator", "bouc_wen"),
        actuator_file=args.actuator_model or shipped_model(chosen(args.actuator, "actuator", "bouc_wen")),
        model=args.model,
        coupling=Coupling(chosen(args.coupling, "coupling", "constraint")),
        hold_current=HoldCurrent(chosen(args.hold_current, "hold_current", "support")),
        z_step=ZStep(task.get("z_step", "euler")),
        sal=sal,
        terrain=chosen(args.terrain, "terrain", "flat"),
    )
    for name in ("action_scale", "step_dt", "gait_frequency"):
        same = isinstance(task.get(name, 0.0), int | float) and math.isclose(task.get(name, 0.0), getattr(cfg, name))
        if name in task and not same:
            raise ValueError(f"{args.policy}: made for {name} = {task[name]}, this version has {getattr(cfg, name)}")
    return replace(cfg, currents=tuple(args.current))


def on_device(policy: OnnxPolicy, device: torch.device | str) -> Actor:
    """The policy for observations on another device; it runs on the CPU."""
    return lambda obs: policy(obs["actor"].cpu()).to(device)


def make_agent(name: str, env: Any) -> Actor:
    """Actions without a policy: ``zero`` keeps the neutral stance, ``random`` draws from [-1, 1)."""
    import torch

    shape = (env.num_envs, env.num_actions)
    if name == "zero":
        return lambda _: torch.zeros(shape, device=env.device)
    generator = torch.Generator(device=env.device).manual_seed(env.cfg.seed)
    return lambda _: 2.0 * torch.rand(shape, generator=generator, device=env.device) - 1.0


def shown(num_envs: int) -> list[int]:
    """Which environments are drawn: all, or :data:`MAX_SHOWN` spread over them."""
    count = min(num_envs, MAX_SHOWN)
    return [(2 * k + 1) * num_envs // (2 * count) for k in range(count)]


def _report(figures: dict[str, Any], wall: float) -> None:
    """Print what was measured."""
    simulated = figures["shown_seconds"]
    print(f"simulated {simulated:g} s in {wall:.1f} s ({simulated / wall:.1f} times real time)")
    print("current [A]   v_x RMSE [m/s]")
    for current, rmse in figures["v_x_rmse_by_current"].items():
        print(f"{current:>11s}   {rmse:14.3f}")
    print(
        f"trunk height {figures['height']:.3f} m, stride {figures['stride_frequency']:.2f} Hz, contacts on the clock "
        f"{figures['clock_match']:.0%}, gates open: hold {figures['hold_share']:.0%}, dynamic "
        f"{figures['dynamic_share']:.0%}, falls {len(figures['falls'])}"
    )


def _wait_for_interrupt() -> None:
    print("the page stays until Ctrl-C", flush=True)
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        print()


def _port(text: str) -> int:
    value = count(text)
    if value > 65535:
        raise argparse.ArgumentTypeError(f"{text}; allowed: 1 to 65535")
    return value


def _duration(text: str) -> float:
    value = finite(text)
    if value < 1.0:
        raise argparse.ArgumentTypeError(f"{text} must be at least 1 s")
    return value


def _values(choices: type[Enum]) -> list[str]:
    return [member.value for member in choices]
