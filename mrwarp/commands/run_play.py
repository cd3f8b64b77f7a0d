"""``mrwarp play`` and ``python train/play.py``: run a policy and show it."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from mrwarp.commands.run_train import check_device
from mrwarp.enums import Coupling, HoldCurrent, ZStep
from mrwarp.env.cfg import EnvCfg, make_walk_cfg
from mrwarp.options.command_line import CommandLine
from mrwarp.options.train_options import Play
from mrwarp.resources import shipped_model
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_output, write_result
from mrwarp.trials.walking import make_env
from mrwarp.usd.asset import check_currents, device_lines
from mrwarp.viewing.frames import Frames
from mrwarp.viewing.live_view import Player, open_sink
from mrwarp.viewing.robot_pictures import contact_sheet
from mrwarp.viewing.viewer import DEFAULT_URL, WebViewer

WARMUP = 2.0
"""Longest time to get going that is shown but not measured [s]; at most a quarter of the run."""

MAX_SHOWN = 8
"""Most robots that are drawn; with more environments these are spread over all of them."""

Actor = Callable[[Any], torch.Tensor]
"""Observations to actions (E, 12)."""


def run(options: Play, line: CommandLine) -> int:
    """Run and show; 0 when done, 1 when a recording failed, 2 on bad input, 130 after Ctrl-C."""
    player = prepare(options)
    web = player.sink.web if player.sink else None
    try:
        return _play(options, line, player, web)
    finally:
        if web:
            web.close()


def prepare(options: Play) -> Player:
    """The player, with its viewers open; nothing is written when something is wrong."""
    check_device(options.device)
    for path, suffix in ((options.rrd, ".rrd"), (options.png, ".png"), (options.out, "")):
        check_output(path, suffix)
    policy = OnnxPolicy(options.policy) if options.policy else None
    cfg = make_cfg(options, policy.description.get("task", {}) if policy else {})
    env = make_env(cfg, options.num_envs, options.seed)
    check_currents(env.sim.scene.actuators, options.current)
    for text in device_lines(env.sim.scene.actuators):
        print(text, flush=True)
    actor = on_device(policy, env.device) if policy else make_agent(str(options.agent), env)
    sink = None
    if (
        options.rrd
        or options.connect is not None
        or options.serve_web
        or options.live
        or not (options.png or options.out)
    ):
        sink = open_sink(
            rrd=_partial(options.rrd) if options.rrd else None,
            url=DEFAULT_URL if options.connect == "" else options.connect,
            web=options.serve_web,
            web_port=options.web_port,
        )
    keep = options.png is not None
    return Player(env, actor, speed=options.speed, shown=shown(options.num_envs), sink=sink, keep=keep)


def _partial(path: Path) -> Path:
    """Where a recording stands until it is whole."""
    return path.with_name(path.name + ".part")


def _play(options: Play, line: CommandLine, player: Player, web: WebViewer | None) -> int:
    """Play, then write what was asked for."""
    cfg, agent = player.env.cfg, options.policy or f"agent {options.agent}"
    print(
        f"{agent}: {len(player.currents)} of {options.num_envs} robots shown ({cfg.robot}, payload {cfg.payload} kg, "
        f"SAL {'on' if cfg.actuator.sal else 'off'}, {'rough' if cfg.terrain else 'flat'} ground), "
        f"{options.speed:g} m/s for {options.seconds:g} s",
        flush=True,
    )
    if web:
        print(f"open {web.page}", flush=True)
    started = time.perf_counter()
    figures: dict[str, Any] = {}
    code = 0
    try:
        figures = player.play(options.seconds, warmup=min(WARMUP, 0.25 * options.seconds))
    except KeyboardInterrupt:
        print("\nstopped", file=sys.stderr)
        code = 130
    except RuntimeError as error:
        print(f"{line.prog}: {error}", file=sys.stderr)
        code = 1
    wall = time.perf_counter() - started
    if not player.close():
        where = "recording is not complete" if options.rrd else "viewer did not take everything"
        print(f"{line.prog}: the {where} ({player.dropped} frames dropped)", file=sys.stderr)
        code = code or int(options.rrd is not None)
    if options.rrd:
        _partial(options.rrd).replace(options.rrd)
        print(f"recording: {options.rrd}; open it with: rerun {options.rrd}")
    if options.png and len(player.frames) > 1:
        where = f"{cfg.robot}, payload {cfg.payload} kg, command {options.speed:g} m/s, seed {options.seed}"
        where += ", rough ground" if cfg.terrain else ""
        frames, title = Frames.join(player.frames), f"{Path(agent).name} on {where}"
        contact_sheet(player.env.sim.scene, frames, player.currents, options.png, title=title)
        print(f"picture: {options.png}")
    if figures:
        _report(figures, wall)
        if options.out:
            figures |= {"wall_seconds": wall, "dropped_frames": player.dropped, "currents": player.currents}
            written = write_result(options.out, figures, seed=options.seed, command=str(line))
            print(f"figures: {written}")
        if web:
            print("the page stays until Ctrl-C", flush=True)
            web.wait()
            print()
    return code


def make_cfg(options: Play, task: dict[str, Any]) -> EnvCfg:
    """The task to play: what the options say, else what the policy was trained with.

    Args:
        options: Parsed options.
        task: The policy's task, as :func:`mrwarp.rl.checkpoint.task` describes it; empty without a policy.

    Raises:
        ValueError: the policy was made for another action scale or rate than this version has.
    """

    def chosen(name: str, default: Any) -> Any:
        option = getattr(options, name)
        return task.get(name, default) if option is None else option

    actuator = chosen("actuator", "bouc_wen")
    cfg = make_walk_cfg(
        num_envs=options.num_envs,
        device=options.device,
        seed=options.seed,
        robot=chosen("robot", "mr_go"),
        payload=chosen("payload", 0),
        asset=options.asset,
        actuator_model=actuator,
        actuator_file=options.actuator_model or shipped_model(actuator),
        model=options.model,
        coupling=Coupling(chosen("coupling", "constraint")),
        hold_current=HoldCurrent(chosen("hold_current", "support")),
        z_step=ZStep(task.get("z_step", "euler")),
        sal=task.get("sal", True) if options.sal is None else options.sal == "on",
        terrain=chosen("terrain", "flat"),
    )
    for name in ("action_scale", "step_dt", "gait_frequency"):
        same = isinstance(task.get(name, 0.0), int | float) and math.isclose(task.get(name, 0.0), getattr(cfg, name))
        if name in task and not same:
            raise ValueError(f"{options.policy}: made for {name} = {task[name]}, this version has {getattr(cfg, name)}")
    return replace(cfg, currents=tuple(options.current))


def on_device(policy: OnnxPolicy, device: torch.device | str) -> Actor:
    """The policy for observations on another device; it runs on the CPU."""
    return lambda obs: policy(obs["actor"].cpu()).to(device)


def make_agent(name: str, env: Any) -> Actor:
    """Actions without a policy: ``zero`` keeps the neutral stance, ``random`` draws from [-1, 1)."""
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
