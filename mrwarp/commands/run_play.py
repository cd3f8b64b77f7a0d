"""``mrwarp play`` and ``python train/play.py``: run a policy and show it."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import create_mutex_group

from mrwarp.enums import ZStep
from mrwarp.env.cfg import PlantCfg, TaskCfg
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options, given, parse
from mrwarp.run_dir import check_output, write_result
from mrwarp.runtime import drawing, four_digits, render_offscreen
from mrwarp.usd.robot import CURRENT_GROUPS

if TYPE_CHECKING:
    from mrwarp.viewing.live_view import Player
    from mrwarp.viewing.viewer import WebViewer

WARMUP = 2.0
"""Longest time to get going that is shown but not measured [s]; at most a quarter of the run."""

MAX_SHOWN = 8
"""Most robots that are drawn; with more environments these are spread over all of them."""

TRAINED = (
    "robot", "payload", "actuator", "lstm_state", "gains", "coupling", "hold_current", "z_step", "sal", "current_by",
    "coil_lag", "hold_speed", "terrain", "extrapolate",
)  # fmt: skip
"""Fields of the task that are a policy's own, unless an option says else. Files and the machine are the user's."""

WHO = create_mutex_group(required=True, title="who walks")

port = opt.checked(int, lambda n: 1 <= n <= 65535, "; allowed: 1 to 65535")
duration = opt.checked(float, lambda s: 1.0 <= s < math.inf, " must be a finite number of at least 1 s")


@dataclass(frozen=True, kw_only=True)
class Play(Options):
    """Run a policy with one robot per MR current side by side, and show it in rerun, in a recording or in a picture.

    Without --rrd, --connect, --serve-web, --png, --film and --out, rerun's window opens. The default of each option on
    robot, devices and ground is what the policy was trained with; there are as many robots as currents.
    """

    renamed = {"actuator-model": "actuator-file"}
    policy: Annotated[opt.OptionalText, WHO] = None
    """exported policy (.onnx), as 'mrwarp train' writes it"""
    agent: Annotated[Literal["zero", "random", "sine"] | None, WHO] = None
    """no policy: stand still, move at random; sine, for an arm: every joint follows one"""
    live: Annotated[opt.Flag, opt.VIEW] = False
    """open rerun's window, also with --png and --out"""
    rrd: Annotated[opt.OptionalFile, opt.VIEW] = None
    """save a recording for 'rerun FILE'"""
    connect: Annotated[str | None, opt.maybe_one("URL"), opt.VIEW] = None
    """send to a viewer that runs already"""
    serve_web: Annotated[opt.Flag, opt.VIEW] = False
    """show in a browser on this machine"""
    web_port: Annotated[int | None, opt.one(port, "PORT")] = None
    """port of --serve-web (default: 9090 if free)"""
    png: opt.OptionalFile = None
    """save a picture: five instants and time series"""
    film: opt.OptionalFile = None
    """save the last four seconds as a rendered animation (.webp or .gif)"""
    out: opt.OptionalFolder = None
    """folder for result.json, the measured figures"""
    speed: opt.Speed = 0.5
    """commanded forward speed [m/s]"""
    seconds: Annotated[float, opt.one(duration, "S")] = 10.0
    """time shown [s]"""
    plant: PlantCfg = field(default_factory=lambda: PlantCfg(num_envs=len(CURRENT_GROUPS)))

    def check(self) -> None:
        """Refuse also a robot that the policy was not made for."""
        super().check()
        if self.policy:
            from mrwarp.rl.policy_file import check_robot

            check_robot(Path(self.policy), self._robot(), self.plant.asset)

    def _robot(self) -> str | None:
        """The robot that is asked for; None: the one that the policy was trained on."""
        return None if self.plant.robot == PlantCfg().robot else self.plant.robot

    def run(self, line: CommandLine) -> int:
        """0 when done, 1 when a recording failed, 2 on bad input, 130 after Ctrl-C."""
        if self.film:
            render_offscreen()
        if self.agent == "sine":
            return self._sine(line)
        player = self._prepare(line)
        web = player.sink.web if player.sink else None
        try:
            return self._play(line, player, web)
        finally:
            if web:
                web.close()

    def _sine(self, line: CommandLine) -> int:
        """An arm whose joints follow a sine with every current: a table, --png and --out."""
        from mrwarp.trials import fixed_base
        from mrwarp.usd.asset import load_robot, taken_currents

        for path, suffix in ((self.png, ".png"), (self.out, "")):
            check_output(path, suffix)
        asset = load_robot(robot=self.plant.robot)
        if not fixed_base.is_arm(asset):
            raise ValueError("--agent sine: is for an arm; a robot with legs takes --policy, or --agent zero or random")
        currents = taken_currents(asset.actuators, self.plant.currents, CURRENT_GROUPS)
        device = {"coupling": self.plant.coupling, "z_step": self.plant.z_step}
        scene, trace = fixed_base.move(asset, currents, target=fixed_base.sine, seconds=self.seconds, **device)
        rows = fixed_base.figures(scene, trace, currents)
        print("\n".join(fixed_base.lines(rows, "carriage" if fixed_base.has_rail(asset) else "last link")))
        if self.out:
            print(f"figures: {write_result(self.out, {'by_current': rows}, seed=self.plant.seed, command=str(line))}")
        if self.png:
            with drawing(self.png.name):
                fixed_base.picture(scene, trace, currents, self.png, f"{asset.path.name}: a sine at every joint")
                print(f"picture: {self.png}")
        return 0

    def _prepare(self, line: CommandLine) -> Player:
        """The player, with its viewers open; nothing is written when something is wrong."""
        typed = given(line, Play)
        for path, suffix in ((self.rrd, ".rrd"), (self.png, ".png"), (self.out, "")):
            check_output(path, suffix)
        if self.film is not None:
            check_output(self.film, ".gif" if self.film.suffix == ".gif" else ".webp")
        if self.policy:
            from mrwarp.rl.policy_file import check_robot

            if note := check_robot(Path(self.policy), self.plant.robot if "robot" in typed else None, self.plant.asset):
                print(note, flush=True)

        from mrwarp.rl.policy import OnnxPolicy
        from mrwarp.trials.walking import devices_of, make_env
        from mrwarp.usd.asset import device_lines, taken_currents
        from mrwarp.viewing.live_view import Player, open_sink
        from mrwarp.viewing.viewer import DEFAULT_URL

        policy = OnnxPolicy(self.policy) if self.policy else None
        cfg = self._cfg(line, policy.description.get("task", {}) if policy else {})
        currents = taken_currents(devices_of(cfg), cfg.currents, CURRENT_GROUPS)
        robots = cfg.num_envs if "num_envs" in typed else len(currents)
        env = make_env(replace(cfg, currents=currents), robots, cfg.seed)
        for text in device_lines(env.sim.scene.actuators):
            print(four_digits(text), flush=True)
        if policy:  # it runs on the CPU
            actor = lambda obs: policy(obs["actor"].cpu()).to(env.device)  # noqa: E731
        else:
            actor = make_agent(str(self.agent), env)
        sink, viewed = None, self.live or self.rrd or self.connect is not None or self.serve_web
        if viewed or not (self.png or self.film or self.out):
            sink = open_sink(
                rrd=_partial(self.rrd) if self.rrd else None,
                url=DEFAULT_URL if self.connect == "" else self.connect,
                web=self.serve_web,
                web_port=self.web_port,
            )
        keep = self.png is not None or self.film is not None
        return Player(env, actor, speed=self.speed, shown=shown(env.num_envs), sink=sink, keep=keep)

    def _play(self, line: CommandLine, player: Player, web: WebViewer | None) -> int:
        from mrwarp.viewing.frames import Frames
        from mrwarp.viewing.robot_pictures import contact_sheet, device_title

        cfg, agent = player.env.cfg, self.policy or f"agent {self.agent}"
        print(
            f"{agent}: {len(player.currents)} of {player.env.num_envs} robots shown ({cfg.robot}, "
            f"payload {cfg.payload:g} kg, SAL {'on' if cfg.sal else 'off'}, "
            f"{'rough' if cfg.terrain else 'flat'} ground), {self.speed:g} m/s for {self.seconds:g} s",
            flush=True,
        )
        if web:
            print(f"open {web.page}", flush=True)
        started, figures, code = time.perf_counter(), {}, 0
        try:
            figures = player.play(self.seconds, warmup=min(WARMUP, 0.25 * self.seconds))
        except KeyboardInterrupt:
            print("\nstopped", file=sys.stderr)
            code = 130
        except RuntimeError as error:
            print(f"{line.prog}: {error}", file=sys.stderr)
            code = 1
        wall = time.perf_counter() - started
        if not player.close():
            where = "recording is not complete" if self.rrd else "viewer did not take everything"
            print(f"{line.prog}: the {where} ({player.dropped} frames dropped)", file=sys.stderr)
            code = code or int(self.rrd is not None)
        if self.rrd:
            _partial(self.rrd).replace(self.rrd)
            print(f"recording: {self.rrd}; open it with: rerun {self.rrd}")
        if figures:
            _report(figures, wall)
            if self.out:
                figures |= {"wall_seconds": wall, "dropped_frames": player.dropped, "currents": player.currents}
                print(f"figures: {write_result(self.out, figures, seed=self.plant.seed, command=str(line))}")
        if self.png and len(player.frames) > 1:
            robot = f"{cfg.robot}{device_title(player.env.sim.scene.actuators)}"
            where = f"{robot}, payload {cfg.payload:g} kg, command {self.speed:g} m/s, seed {cfg.seed}"
            title = f"{Path(agent).name} on {where}{', rough ground' * bool(cfg.terrain)}"
            with drawing(self.png.name):
                contact_sheet(player.env.sim.scene, Frames.join(player.frames), player.currents, self.png, title=title)
                print(f"picture: {self.png}")
        if self.film and len(player.frames) > 1:
            from mrwarp.viewing.film import film

            with drawing(self.film.name):
                film(player.env.sim.scene, Frames.join(player.frames), player.currents, self.film)
                print(f"film: {self.film}")
        if figures and web:
            print("the page stays until Ctrl-C", flush=True)
            web.wait()
            print()
        return code

    def _cfg(self, line: CommandLine, trained: dict[str, Any]) -> TaskCfg:
        """The options' values, else those of the policy's training.

        Args:
            line: What was typed.
            trained: The policy's task, see :mod:`mrwarp.rl.task_record`; empty without a policy.

        Raises:
            ValueError: the policy was made for another action scale or rate than this version has, or its task cannot
                be read.
        """
        from mrwarp.rl.task_record import task_of, trained_device

        cfg = TaskCfg(num_envs=len(CURRENT_GROUPS))
        for name in ("action_scale", "step_dt", "gait_frequency"):
            theirs, ours = trained.get(name, getattr(cfg, name)), getattr(cfg, name)
            if not (isinstance(theirs, int | float) and math.isclose(theirs, ours)):
                raise ValueError(f"{self.policy}: made for {name} = {theirs}, this version has {ours}")
        if trained:
            try:
                theirs = task_of({name: value for name, value in trained.items() if name in (*TRAINED, "current")})
            except ValueError as error:
                raise ValueError(f"{self.policy}: {error}; train it again") from None
            cfg = replace(cfg, **{name: getattr(theirs, name) for name in TRAINED})
        plant = PlantCfg(**{each.name: getattr(cfg, each.name) for each in fields(PlantCfg)})
        plant = parse(Play, line.argv, line.prog, Play(plant=plant)).plant
        typed = given(line, Play)
        others = any(
            name in typed and getattr(plant, name) != trained.get(name) for name in ("robot", "asset", "model")
        )
        if others and "z_step" not in typed:  # devices that the policy was not trained with
            plant = replace(plant, z_step=ZStep.EXACT)
        if not {"robot", "asset", "model"} & typed:
            plant = replace(plant, model=trained_device(trained, str(self.policy)))
        return replace(cfg, **{each.name: getattr(plant, each.name) for each in fields(PlantCfg)})


def make_agent(name: str, env: Any) -> Callable[[Any], Any]:
    """Actions (E, 12) without a policy: ``zero`` keeps the neutral stance, ``random`` draws from [-1, 1)."""
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
    simulated = figures["shown_seconds"]
    print(f"simulated {simulated:g} s in {wall:.1f} s ({simulated / wall:.1f} times real time)")
    print("current [A]   v_x RMSE [m/s]")
    for current, rmse in figures["v_x_rmse_by_current"].items():
        print(f"{float(current):11.4g}   {rmse:14.3f}")
    print(
        f"trunk height {figures['height']:.3f} m, stride {figures['stride_frequency']:.2f} Hz, contacts on the clock "
        f"{figures['clock_match']:.0%}, brakes hold {figures['hold_share']:.0%} and damp "
        f"{figures['dynamic_share']:.0%} of the time, falls {len(figures['falls'])}"
    )


def _partial(path: Path) -> Path:
    """Where a recording stands until it is whole."""
    return path.with_name(path.name + ".part")
