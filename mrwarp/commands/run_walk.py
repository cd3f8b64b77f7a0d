"""``mrwarp walk``: the electrical energy of three walking robots, ours compared with the paper's."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from mrwarp import paper
from mrwarp.enums import CurrentCommand
from mrwarp.env.cfg import TaskCfg
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.paper import ROBOTS
from mrwarp.run_dir import write_result
from mrwarp.runtime import drawing, four_digits

if TYPE_CHECKING:
    from mrwarp.trials.walking import Policy
    from mrwarp.usd.asset import JointActuator

trot_speed = opt.within(0.05, 1.0, "m/s")
"""Command; the 1.5 Hz trot reaches about 0.6 m/s (section 7)."""

used_current = opt.within(0.01, 100.0, "A")
"""Coil current; each device clips it to its own ``current_max``."""


def _walker(text: str) -> str:
    """One of the paper's robots, or a robot's USD file."""
    return text if text in ROBOTS else opt.robot_name(text)


def trained_on(policy: Path) -> str | None:
    """USD file of the robot of one's own that a policy was trained on."""
    from mrwarp.rl.policy_file import read_policy, robot_of

    return robot_of(read_policy(policy)[1])


Distance = Annotated[float, opt.one(opt.within(0.01, 1e4, "m"), "M")]


@dataclass(frozen=True, kw_only=True)
class EnergyOptions(opt.RobotChoice, opt.DeviceChoice, Options):
    """Shared options of the measurements of energy: policies, devices and the numbers of the models."""

    policy: opt.OptionalFile = None
    """policy of all robots (default: each robot's own of policies/energy, training seed 0)"""
    policy_go1: opt.OptionalFile = None
    """another policy for go1"""
    policy_mr_go: opt.OptionalFile = None
    """another policy for mr_go"""
    policy_mr_go_sal: opt.OptionalFile = None
    """another policy for mr_go_sal"""
    numbers: opt.OptionalFile = None
    """JSON with numbers of the models, as --calibrate writes it"""
    set: Annotated[tuple[str, ...], opt.some(str, "NAME=VALUE", least=0)] = ()
    """single numbers, e.g. regeneration=0"""
    branches: Literal["both", "holding"] = "both"
    """SAL with damping and holding, or holding alone"""
    current: Annotated[float | None, opt.one(used_current, "A")] = None
    """current the devices may use (default: the largest that they take)"""
    current_by: CurrentCommand | None = None
    """what commands the coils within that (default: as the policy of mr_go_sal was trained)"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same for any number"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""

    def env_cfg(self) -> TaskCfg:
        """The task that the options ask for."""
        trained = self._trained()
        return TaskCfg(
            **self.chosen("coupling", "asset", "z_step", "threads"),
            model=self.model or trained.model,
            damping=self.branches == "both",
            current_by=trained.current_by,
            coil_lag=trained.coil_lag,
            hold_speed=trained.hold_speed,
        )

    def used(self, devices: Sequence[JointActuator]) -> float:
        """Current that devices may use [A]."""
        from mrwarp.usd.asset import most_current

        most = most_current(devices)
        return min(most if self.current is None else self.current, most)

    def _trained(self) -> TaskCfg:
        """The policy's task: the device and the command of its coils are those of its training unless options say else.

        Raises:
            ValueError: the policy commands the coils and the option says that it does not, or the other way round.
        """
        path = self.policy_mr_go_sal or self.policy
        learns, task = False, TaskCfg()
        if path is not None:
            from mrwarp.rl.policy import OnnxPolicy
            from mrwarp.rl.task_record import task_of, trained_device

            policy = OnnxPolicy(path)
            learns, said = policy.currents > 0, policy.description.get("task", {})
            coils = ("current", "current_by", "coil_lag", "hold_speed")
            try:
                task = task_of({name: said[name] for name in coils if name in said})
            except ValueError as error:
                raise ValueError(f"{path}: {error}; train it again") from None
            if not (self.model or self.asset):
                task = replace(task, model=trained_device(said, path))
            if learns:
                task = replace(task, current_by=CurrentCommand.LEARNED)
        command = self.current_by or task.current_by
        if learns != (command is CurrentCommand.LEARNED):
            has = "commands the coils" if learns else "commands no coils"
            raise ValueError(f"--current-by {command.value}: {path or 'the shipped policy'} {has}; name another policy")
        return replace(task, current_by=command)

    def read_policies(self) -> dict[str, Policy]:
        """Policy of each robot, by default trained with its coupling; files that are the same are loaded once.

        Raises:
            PolicyError: a file cannot be used.
        """
        from mrwarp.resources import ENERGY, FIRST_SEEDS, plant_of, policy_file
        from mrwarp.rl.policy import OnnxPolicy

        paths = {
            robot: getattr(self, f"policy_{robot}")
            or self.policy
            or policy_file(ENERGY, plant_of(robot, self.coupling), FIRST_SEEDS[0])
            for robot in ROBOTS
        }
        loaded = {path: OnnxPolicy(path) for path in set(paths.values())}
        return {robot: loaded[path] for robot, path in paths.items()}


@dataclass(frozen=True, kw_only=True)
class Walk(EnergyOptions):
    """Walk a measured distance with Go1, MR_Go (SAL off) and MR_Go-SAL.

    Battery power and cost of transport (table 6), support activation (table 7), torques (figure 8) and tracking.
    """

    out: opt.Folder = Path("runs/walk-energy")
    """output folder"""
    robot: Annotated[tuple[str, ...] | None, opt.some(_walker, f"{{{','.join(ROBOTS)}}}")] = None
    """robots (default: all three), or a USD file of 'mrwarp robot import', the default of a policy trained on one: its
    cost of transport by current"""
    sal: Literal["on", "off"] | None = None
    """only MR_Go-SAL (on) or MR_Go (off)"""
    speed: Annotated[tuple[float, ...] | None, opt.some(trot_speed, "V")] = None
    """commands [m/s] (default: 0.3 and 0.5, as of a robot 0.334 m high)"""
    payload: Annotated[tuple[float, ...] | None, opt.some(opt.load, "KG")] = None
    """loads [kg] (default: 0 and 3; a robot of your own walks without)"""
    distance: Distance = 30.0
    """measured distance [m]"""
    trials: opt.Count = 3
    """repetitions per condition"""
    calibrate: opt.Flag = False
    """fit the electrical numbers to Go1's rows, write numbers.json; each robot walks at the speed that the paper
    measured where it commanded 0.3 or 0.5 m/s"""

    def check(self) -> None:
        """Refuse also a robot of one's own without its policy, or without a device."""
        super().check()
        if (file := self._file()) is None:
            return
        from mrwarp.rl.policy_file import check_robot
        from mrwarp.usd.asset import load_robot

        if len(self.robot or ()) > 1 or self.sal or self.calibrate:
            raise ValueError(f"--robot {file}: leave out other robots, --sal and --calibrate, which are the paper's")
        if self.policy is None:
            raise ValueError(f"--robot {file}: give its --policy, as 'mrwarp train --robot {file}' writes it")
        check_robot(self.policy, file if self.robot else None)
        if all(actuator.mr is None for actuator in load_robot(robot=file).actuators):
            raise ValueError(
                f"{file}: no joint has a device to compare with; put some on with 'mrwarp robot fit-device'"
            )

    def _file(self) -> str | None:
        """The robot of one's own that is named, or that the policy was trained on."""
        if self.robot is None:
            return trained_on(self.policy) if self.policy else None
        return next((name for name in self.robot if name not in ROBOTS), None)

    def run(self, line: CommandLine) -> int:
        """0 done, 1 when a robot fell or was too slow in every trial, 2 on bad input."""
        if file := self._file():
            return self._own(line, file)

        from mrwarp.energy.model_numbers import read_numbers, write_numbers
        from mrwarp.env.sim import robot_scene
        from mrwarp.trials import energy_report, walk_pictures
        from mrwarp.trials.joint_need import chatter, need_lines
        from mrwarp.trials.walk_trials import WalkCfg, walk
        from mrwarp.trials.walking import asset_of, device_notes, task_devices
        from mrwarp.usd.asset import not_known

        groups, policies = read_numbers(self.numbers, self.set), self.read_policies()
        cfg = WalkCfg(
            **self.chosen("trials", "distance", "seed"),
            robots=self._robots(),
            payloads=(0.0, 3.0) if self.payload is None else self.payload,
            speeds=self.speed or (0.3, 0.5),
            commanded=paper.MEASURED_SPEED if self.calibrate else {},
            env=self.env_cfg(),
        )
        if self.calibrate and not energy_report.can_calibrate(cfg):
            conditions = "Go1 at 0.3 and 0.5 m/s with 0 and 3 kg"
            raise ValueError(f"--calibrate needs {conditions}; leave out --robot, --sal, --speed and --payload")
        scene = robot_scene(asset_of(replace(cfg.env, robot="mr_go")))
        for text in (*device_notes(cfg.env, self.current or 0.0), *need_lines(scene)):
            print(four_digits(text), flush=True)
        cfg = replace(cfg, current=self.used(task_devices(cfg.env)))
        started, progress = time.perf_counter(), ProgressBar()
        try:
            results = walk(cfg, policies, progress)
            figures = energy_report.walk_figures_of(cfg, results, groups, calibrated=self.calibrate)
        finally:
            progress.done()
        if self.calibrate:
            write_numbers(self.out / "numbers.json", groups)
        figures |= {"distance": self.distance, "current": cfg.current, "wall_seconds": time.perf_counter() - started}
        figures["not_known"] = not_known(task_devices(cfg.env))
        write_result(self.out, figures, seed=self.seed, command=str(line))
        with drawing("cot.png"):
            walk_pictures.cost(figures["conditions"], self.out / "cot.png")
        with drawing("holding.png"):
            walk_pictures.holding(results, self.out / "holding.png")
        with drawing("torques.png"):
            walk_pictures.distributions(results, self.out / "torques.png")
        seen = [float(x.switches.mean()) for x in results if x.switches.size and x.robot == ROBOTS[-1]]
        often = max(seen, default=0.0)
        warned = chatter(task_devices(cfg.env), often, cfg.env.gait_frequency)
        print("\n".join([*energy_report.walk_lines(figures), *([warned] if warned else [])]))
        print(f"\nfigures and pictures in {self.out}")
        return 0 if all(len(result.speed) for result in results) else 1

    def _own(self, line: CommandLine, file: str) -> int:
        """Rows for a robot of one's own: with no current, and a third, two thirds and all of --current."""
        from mrwarp.energy.model_numbers import described, read_numbers
        from mrwarp.env.natural_units import scales_of
        from mrwarp.env.sim import robot_scene
        from mrwarp.rl.policy import OnnxPolicy
        from mrwarp.rl.policy_file import check_robot
        from mrwarp.trials import own_robot
        from mrwarp.trials.joint_need import need_lines
        from mrwarp.trials.walking import asset_of, devices_of, limit_note
        from mrwarp.usd.asset import device_lines, not_known

        assert self.policy is not None  # checked
        if note := check_robot(self.policy, file):
            print(note, flush=True)
        task = replace(self.env_cfg(), robot=file)
        devices = devices_of(task)
        policy, by = OnnxPolicy(self.policy), scales_of(file)
        electrical = read_numbers(self.numbers, self.set)["electrical"]
        said = (*device_lines(devices), *limit_note(devices, self.current or 0.0), own_robot.assumption(by))
        for text in (*said, *need_lines(robot_scene(asset_of(task)))):
            print(four_digits(text), flush=True)
        rows, progress, loads = [], ProgressBar(), self.payload or (0.0,)
        try:
            for k, load in enumerate(loads):
                rows += own_robot.walk_currents(
                    task,
                    policy,
                    **self.chosen("trials", "distance", "seed"),
                    currents=own_robot.currents_of(devices, self.used(devices)),
                    speeds=self.speed or [round(speed * by.speed, 3) for speed in (0.3, 0.5)],
                    payload=load,
                    cfg=electrical,
                    report=lambda share, k=k, load=load: progress(
                        f"walking with {load:g} kg", (k + share) / len(loads)
                    ),
                )
        finally:
            progress.done()
        figures = {
            "robot": Path(file).name, "conditions": rows, "savings": own_robot.savings(rows), **own_robot.figures(rows),
            "assumption": own_robot.assumption(by), "calibrated": False, "distance": self.distance,
            "scales": {name: getattr(by, name) for name in ("length", "mass", "time", "torque", "power")},
            "numbers": described({"electrical": electrical}), "not_known": not_known(devices),
        }  # fmt: skip
        write_result(self.out, figures, seed=self.seed, command=str(line))
        with drawing("cot.png"):
            own_robot.picture(rows, self.out / "cot.png", Path(file).name)
        print("\n".join([*own_robot.lines(rows), *own_robot.chattering(rows, task, devices)]))
        print(f"\nfigures and picture in {self.out}")
        return 0 if all(row["trials"] for row in rows) else 1

    def _robots(self) -> tuple[str, ...]:
        """Robots that are asked for.

        Raises:
            ValueError: --robot and --sal exclude each other.
        """
        if self.sal is None:
            return tuple(robot for robot in ROBOTS if self.robot is None or robot in self.robot)
        if self.robot is not None:
            raise ValueError("--robot and --sal exclude each other: --sal on is --robot mr_go_sal, --sal off is mr_go")
        return ("mr_go_sal",) if self.sal == "on" else ("mr_go",)
