"""Options of the commands that try robots out: impact, walk, mission, verify, replay-dump."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from mrwarp.enums import Coupling
from mrwarp.options import option_types as opt
from mrwarp.paper import DISTANCE, ROBOTS, STANDBY, arm_load
from mrwarp.resources import DEFAULT_POLICY

IMPACT_VIEW = opt.exclusive("view")

push_force = opt.within(-1e4, 1e4, "N")
"""Push on a robot of 15 kg; the paper's is 100 N."""

trot_speed = opt.within(0.05, 1.0, "m/s")
"""Command; the 1.5 Hz trot reaches about 0.6 m/s (section 7)."""

load = opt.within(0.0, 20.0, "kg")
"""Mass on the back; the robot has 12 kg."""

distance = opt.within(0.01, 1e4, "m")
"""Path length walked."""

used_current = opt.within(0.01, 100.0, "A")
"""Coil current; each device clips it to its own ``current_max``."""

Distance = Annotated[float, opt.one(distance, "M")]
Load = Annotated[float, opt.one(load, "KG")]


@dataclass(frozen=True, kw_only=True)
class Impact:
    """Hit walking robots at random gait phases; the same trials are repeated with each current."""

    out: opt.Folder = Path("runs/impact")
    """output folder"""
    policy: opt.File = DEFAULT_POLICY
    """walking policy"""
    current: Annotated[tuple[float, ...], opt.some(opt.coil_current, "A")] = opt.CURRENTS
    """currents I_e [A]"""
    kind: Literal["push", "drop"] = "push"
    """push on the trunk, or the guided 10 kg mass"""
    force: Annotated[tuple[float, ...], opt.some(push_force, "N", exactly=3)] = (0.0, 0.0, -100.0)
    """push, world frame [N]"""
    duration: opt.Positive = 0.2
    """duration of the push [s]"""
    trials: opt.Count = 20
    """trials per current"""
    speed: Annotated[float, opt.one(opt.forward_speed, "V")] = 0.5
    """commanded speed [m/s]"""
    coupling: Literal["constraint", "explicit", "both"] = "both"
    """how the device acts: a brake that sticks, the paper's explicit torque, or each in turn"""
    branches: Literal["damping", "both"] = "damping"
    """the dynamic branch alone, as the paper's section 6.3 evaluates it, or with holding"""
    robot: Literal["mr_go", "go1"] = "mr_go"
    """robot variant"""
    payload: Literal[0, 3] = 0
    """payload variant [kg]"""
    model: opt.OptionalText = None
    """model.json: identified joint with its effects, on all MR joints"""
    asset: opt.OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""
    sensitivity: opt.Flag = False
    """also vary the gates' thresholds (paper section 3.2)"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""
    live: Annotated[opt.Flag, IMPACT_VIEW] = False
    """open rerun and watch the first trial of every current"""
    rrd: Annotated[opt.OptionalFile, IMPACT_VIEW] = None
    """save that view as a rerun recording"""
    connect: Annotated[opt.OptionalText, IMPACT_VIEW] = None
    """URL: send it to a rerun viewer that runs already"""
    serve_web: Annotated[opt.Flag, IMPACT_VIEW] = False
    """serve it to a browser on this machine"""


@dataclass(frozen=True, kw_only=True)
class EnergyRun:
    """What the measurements of energy share: policies, devices and the numbers of the models."""

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
    coupling: Coupling = Coupling.CONSTRAINT
    """how the device acts"""
    branches: Literal["both", "holding"] = "both"
    """SAL with damping and holding, or holding alone"""
    current: Annotated[float, opt.one(used_current, "A")] = 1.5
    """current the devices may use"""
    model: opt.OptionalText = None
    """model.json: identified joint with its effects, on all MR joints"""
    asset: opt.OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same for any number"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""


@dataclass(frozen=True, kw_only=True)
class Walk(EnergyRun):
    """Walk a measured distance with Go1, MR_Go (SAL off) and MR_Go-SAL.

    Battery power and cost of transport (table 6), support activation (table 7), torques (figure 8) and tracking.
    """

    out: opt.Folder = Path("runs/walk-energy")
    """output folder"""
    robot: Annotated[tuple[str, ...] | None, opt.some_of(ROBOTS)] = None
    """robots (default: all three)"""
    sal: Literal["on", "off"] | None = None
    """only MR_Go-SAL (on) or MR_Go (off)"""
    speed: Annotated[tuple[float, ...], opt.some(trot_speed, "V")] = (0.3, 0.5)
    """commands [m/s]"""
    payload: Annotated[tuple[float, ...], opt.some(load, "KG")] = (0.0, 3.0)
    """loads [kg]"""
    distance: Distance = 30.0
    """measured distance [m]"""
    trials: opt.Count = 3
    """repetitions per condition"""
    calibrate: opt.Flag = False
    """fit the electrical numbers to this run's Go1 rows, write numbers.json"""


@dataclass(frozen=True, kw_only=True)
class Mission(EnergyRun):
    """The pickup-and-return task with Go1, MR_Go and MR_Go-SAL.

    A window of every phase is simulated and carried over the whole phase by the electrical, battery and thermal models.
    """

    out: opt.Folder = Path("runs/mission")
    """output folder"""
    robot: Annotated[tuple[str, ...], opt.some_of(ROBOTS)] = ROBOTS
    """robots"""
    speed: Annotated[float, opt.one(trot_speed, "V")] = 0.3
    """command [m/s], not in the paper"""
    distance: Distance = DISTANCE
    """one way [m]"""
    standby: opt.Positive = STANDBY
    """standing [s]"""
    outbound_load: Load = arm_load()
    """load out and while standing [kg]: by default the arm, from Go1's own rows"""
    return_load: Load = 3.0
    """load back [kg]"""
    window: Distance = 10.0
    """simulated distance of each walk [m]"""
    seeds: opt.Count = 3
    """repetitions"""
    feedback: opt.Flag = False
    """warm windings and fluids act back; a second pass"""
    calibrate: opt.Flag = False
    """fit thermal numbers and capacity to Go1's, write numbers.json"""


@dataclass(frozen=True, kw_only=True)
class Verify:
    """Run all physics checks; 0 when every limit holds, 1 when one is missed, 2 on bad input."""

    out: opt.Folder = Path("runs/verify")
    """output folder"""
    policy: opt.OptionalFile = None
    """exported policy for the walking checks (.onnx)"""
    seed: opt.Seed = 0
    """seed of random states"""


@dataclass(frozen=True, kw_only=True)
class ReplayDump:
    """Open the last states of an environment in which a number went wrong: what was first, when, and how it got there.

    A training writes such files to the folder 'broken' of its output.
    """

    file: Positional[opt.File]
    """dump, a .safetensors file"""
    rows: opt.Count = 10
    """last states to print"""
    png: opt.OptionalFile = None
    """save a picture of the states over time"""
