"""``mrwarp robot``: bring a robot of one's own (MJCF, URDF, USD), look at it, put devices onto its joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.runtime import four_digits, quiet_libraries, uncollected

ANGLES = Annotated[tuple[tuple[str, float], ...], opt.some(opt.assignment, "JOINT=X")]
POSITIVE = Annotated[tuple[tuple[str, float], ...], opt.some(partial(opt.assignment, read=opt.positive), "JOINT=X")]
NOT_NEGATIVE = Annotated[
    tuple[tuple[str, float], ...], opt.some(partial(opt.assignment, read=opt.not_negative), "JOINT=X")
]


@dataclass(frozen=True, kw_only=True)
class Import(Options):
    """Read a robot from MJCF (.xml), URDF or USD and write it as a USD file that every command takes as --robot.

    Trunk, legs, feet, neutral stance, gait, torque limits and gains are found and shown; every guess can be overridden
    here, and edited in the file afterwards. Names of joints may hold * and ?, as in --kp '*_calf_joint=40'.
    """

    engines = False  # until it is tried out

    file: Positional[opt.File]
    """the robot's file"""
    out: opt.File
    """USD file to write (.usda, .usdc)"""
    base: Literal["fixed", "free"] | None = None
    """whether the trunk is held, as an arm's base, or floats (default: as the file says, or asked)"""
    pose: ANGLES = ()
    """neutral angles [rad] (default: a keyframe in which the robot stands, else a solved stance)"""
    kp: POSITIVE = ()
    """gains [N·m/rad] (default: the file's position actuators, else 1.5/rad of the torque limit)"""
    kd: NOT_NEGATIVE = ()
    """damping [N·m·s/rad] (default: the file's, else 0.02 s of Kp)"""
    torque_limit: POSITIVE = ()
    """torque limits [N·m] (default: the file's)"""
    armature: NOT_NEGATIVE = ()
    """rotor inertias at the joints [kg·m²] (default: the file's, else 5 ms of Kd)"""
    unlimited: Annotated[tuple[str, ...], opt.some(str, "JOINT")] = ()
    """joints that may turn without limits, which is not noted then"""
    feet: Annotated[tuple[str, ...], opt.some(str, "BODY")] = ()
    """last bodies of the legs (default: the ends of chains that stand in --pose or a keyframe, else hang lowest)"""
    fix: Annotated[tuple[str, ...], opt.some(str, "JOINT")] = ()
    """joints that are held at their neutral angle, as those of arms"""
    gait: Literal["trot", "alternate", "tripod"] | None = None
    """gait (default: trot of four legs, alternate of two, tripod of six)"""
    forward: Literal["x", "-x", "y", "-y"] = "x"
    """axis of the trunk that points forwards"""
    packages: Annotated[tuple[Path, ...], opt.some(Path, "DIR")] = ()
    """folders that hold the packages of a URDF's package:// meshes (default: those next to and around the file)"""
    skip_meshes: opt.Flag = False
    """leave all meshes out"""
    overwrite: opt.Flag = False
    """replace a file that is there"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        with uncollected():
            return self._import()

    def _import(self) -> int:
        """Read, understand, try out, write, show."""
        from mrwarp.robots.drives import Choices
        from mrwarp.robots.foreign import prim_pattern
        from mrwarp.robots.legs import understand
        from mrwarp.robots.read_robot import read_robot
        from mrwarp.robots.urdf import Meshes
        from mrwarp.usd.asset import ROBOT_SUFFIXES

        if self.out.suffix not in ROBOT_SUFFIXES:
            raise ValueError(f"--out {self.out}: a robot is a USD file; end it in .usda")
        if self.out.exists() and not self.overwrite:
            raise ValueError(f"{self.out} is there already; choose another --out or add --overwrite")
        if not self.out.parent.is_dir():
            raise ValueError(f"--out {self.out}: no such folder; make it first")

        def by_name(pairs: tuple[tuple[str, float], ...]) -> dict[str, float]:
            return {prim_pattern(name): value for name, value in pairs}

        choices = Choices(
            pose=by_name(self.pose),
            kp=by_name(self.kp),
            kd=by_name(self.kd),
            torque_limit=by_name(self.torque_limit),
            armature=by_name(self.armature),
            gait=self.gait or "",
            unlimited=tuple(map(prim_pattern, self.unlimited)),
            feet=tuple(map(prim_pattern, self.feet)),
            fix=tuple(map(prim_pattern, self.fix)),
            forward=self.forward,
        )
        robot = read_robot(self.file, Meshes(packages=self.packages, skip=self.skip_meshes), self.base)
        understood = understand(robot, choices)
        print(f"{self.file} is understood; loading Newton and MuJoCo-Warp takes longest, to try it out ...", flush=True)
        from mrwarp.robots.robot_table import guess_lines, layout_lines
        from mrwarp.robots.write_robot import write_checked  # Newton takes seconds to load

        quiet_libraries(gpu=False, networks=False)
        asset = write_checked(understood, self.out, source=str(self.file))
        print("\n".join(layout_lines(asset, guesses=False)))
        print(f"robot written: {self.out}; look at it with 'mrwarp robot show {self.out} --png robot.png'")
        print("\n".join(guess_lines(asset)))
        return 0


@dataclass(frozen=True, kw_only=True)
class ShowRobot(Options):
    """Show what legged tasks know of a robot: trunk, legs, joints with limits and gains, feet, gait, devices."""

    engines = False  # until it is tried out

    robot: Positional[opt.Robot]
    """mr_go, go1, or a USD file"""
    png: opt.OptionalFile = None
    """draw it standing"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        from mrwarp.robots.robot_table import layout_lines
        from mrwarp.run_dir import check_output
        from mrwarp.usd.asset import load_robot

        check_output(self.png, ".png")
        asset = load_robot(robot=self.robot)
        print("\n".join(layout_lines(asset)))
        if self.png is not None:
            from mrwarp.robots.standing_picture import draw

            quiet_libraries(gpu=False, networks=False)
            draw(asset, self.png)
            print(f"picture: {self.png}")
        return 0


def _scale(text: str) -> float | None:
    """A factor; None stands for the joint's torque limit."""
    if text == "limit":
        return None
    try:
        return opt.positive(text)
    except ValueError as error:
        raise ValueError(f"{error}; or say limit") from None


@dataclass(frozen=True, kw_only=True)
class FitDevice(Options):
    """Put an MR device onto joints of a robot's USD file, in place of their plain motors; the motors' numbers stay.

    Joints that are not named keep what they have. Repeat the command for devices of another kind.
    """

    engines = False  # until it is tried out

    robot: Positional[opt.File]
    """USD file of 'mrwarp robot import'; it is changed unless --out is given"""
    joint: Annotated[tuple[str, ...], opt.some(str, "JOINT")]
    """joints; names may hold * and ?"""
    model: opt.OptionalFile = None
    """model.json of the device, or a name of 'mrwarp device list' (default: the paper's)"""
    scale: Annotated[float | None, opt.one(_scale, "X")] = 1.0
    """times stronger than --model, at the same currents; 'limit': as the joint's torque limit to the paper's calf's"""
    remove: opt.Flag = False
    """take the device off, and leave the motor"""
    out: opt.OptionalFile = None
    """write another file"""
    extrapolate: opt.Flag = False
    """let coils take more current than the recordings of --model held"""

    def check(self) -> None:
        """Refuse also options that exclude each other."""
        super().check()
        if self.model is not None and self.remove:
            raise ValueError("--model and --remove exclude each other")
        if self.model is not None and self.scale is None:
            raise ValueError("--scale limit is for the paper's device, made for a joint of 35.55 N·m; give a number")

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        from mrwarp.model_file import load_model
        from mrwarp.robots.fit_device import fit_device
        from mrwarp.robots.robot_table import layout_lines
        from mrwarp.usd.asset import device_lines

        model = load_model(self.model) if self.model else None
        layer = fit_device(self.robot, self.joint, model, **self.chosen("scale", "remove", "extrapolate"))

        from mrwarp.env.sim import robot_scene
        from mrwarp.robots.write_robot import save_checked
        from mrwarp.trials.joint_need import need_lines

        quiet_libraries(gpu=False, networks=False)
        asset = save_checked(layer, self.out or self.robot)
        notes = map(four_digits, (*device_lines(asset.actuators), *need_lines(robot_scene(asset))))
        print("\n".join([*layout_lines(asset), *notes]))
        print(f"robot written: {self.out or self.robot}")
        return 0
