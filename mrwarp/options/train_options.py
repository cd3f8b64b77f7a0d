"""Options of ``mrwarp train`` and ``mrwarp play``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from mrwarp.enums import ACTUATORS, RANDOMIZATIONS, TERRAINS, BackendKind, Coupling, HoldCurrent, ZStep
from mrwarp.options import option_types as opt

TRAIN_VIEW = opt.exclusive("view")
TRAIN_BEGIN = opt.exclusive("begin with")
PLAY_WHO = opt.exclusive("who walks", required=True)
PLAY_VIEW = opt.exclusive("view")


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How fast networks learn."""

    desired_kl: opt.Positive = 0.04
    """divergence between the policies of two updates; 0.01 settles a gait"""
    entropy: opt.NotNegative = 0.003
    """weight of the entropy, which keeps up exploration, in the loss"""


@dataclass(frozen=True, kw_only=True)
class Train(Learning):
    """Train a quadruped with MR calf joints to walk, until the walking gate is met."""

    device: str = "cpu"
    """cpu, cuda:N, or cuda: under torchrun a GPU for each process"""
    num_envs: opt.Count = 64
    """parallel environments, in each process of torchrun"""
    seed: opt.Seed = 0
    """seed of everything random"""
    iterations: opt.Count = 6000
    """most PPO updates"""
    no_gate: opt.Flag = False
    """run all iterations instead of stopping at the gate"""
    actuator: Annotated[str, opt.one_of(ACTUATORS)] = "bouc_wen"
    """torque model of the MR joint"""
    actuator_model: opt.OptionalText = None
    """trained network of --actuator mlp, lstm or pg_rlstm (default: the shipped one)"""
    model: opt.OptionalText = None
    """model.json: identified joint with its effects, on all MR joints (default: the asset's own numbers)"""
    extrapolate: opt.Flag = False
    """let coils take more current than the recordings of --model held"""
    robot: Literal["mr_go", "go1"] = "mr_go"
    """robot variant of the USD asset"""
    payload: Literal[0, 3] = 0
    """payload variant [kg]"""
    asset: opt.OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""
    coupling: Coupling = Coupling.CONSTRAINT
    """how the device acts: the paper's explicit torque, or a brake that sticks"""
    hold_current: HoldCurrent = HoldCurrent.SUPPORT
    """current while holding: as much as the load needs, or the environment's own"""
    z_step: ZStep = ZStep.EULER
    """step of the hysteresis state: the paper's, or the closed form for constant speed"""
    sal: Literal["on", "off"] = "on"
    """whether the gates may open"""
    terrain: Annotated[str, opt.one_of(TERRAINS)] = "flat"
    """ground; rough has a curriculum"""
    randomize: Annotated[str, opt.one_of(RANDOMIZATIONS)] = "all"
    """what differs between environments: friction, kicks, mass, gains and devices; friction and kicks; nothing"""
    power_price: opt.NotNegative = 0.0
    """reward taken per watt of motors and coils; the policies in policies/energy pay 0.002"""
    backend: BackendKind | None = None
    """physics engine (default: by device)"""
    threads: opt.Whole = 0
    """CPU threads of the physics; 0 = all"""
    deterministic: opt.Flag = False
    """make a GPU repeat its bits, at some cost in speed (the CPU repeats them anyway)"""
    save_every: opt.NotNegative = 30.0
    """time between checkpoints [s]"""
    out: opt.Folder = Path("runs/walk")
    """output folder"""
    overwrite: opt.Flag = False
    """start over in a folder that holds a checkpoint"""
    live: Annotated[opt.Flag, TRAIN_VIEW] = False
    """watch four robots in rerun while they train"""
    rrd: Annotated[opt.OptionalFile, TRAIN_VIEW] = None
    """save that view as a recording"""
    connect: Annotated[opt.OptionalText, TRAIN_VIEW] = None
    """URL: send it to a rerun viewer that runs already"""
    resume: Annotated[opt.OptionalFile, TRAIN_BEGIN] = None
    """go on from a checkpoint.pt, in its folder and with its options; options of the task cannot change"""
    start_from: Annotated[opt.OptionalFile, TRAIN_BEGIN] = None
    """a new training that begins with the networks of another task's checkpoint.pt, or a policy's actor (.onnx)"""


def port(text: str) -> int:
    """Port of a web page."""
    if (value := opt.count(text)) > 65535:
        raise ValueError(f"{text}; allowed: 1 to 65535")
    return value


def duration(text: str) -> float:
    """Time that is shown [s]."""
    if (value := opt.finite(text)) < 1.0:
        raise ValueError(f"{text} must be at least 1 s")
    return value


@dataclass(frozen=True, kw_only=True)
class Play:
    """Run a policy with one robot per MR current side by side, and show it in rerun, in a recording or in a picture.

    Without --rrd, --connect, --serve-web, --png and --out, rerun's window opens. The default of each option on the
    robot is what the policy was trained with.
    """

    policy: Annotated[opt.OptionalText, PLAY_WHO] = None
    """exported policy (.onnx), as train/ppo.py writes it"""
    agent: Annotated[Literal["zero", "random"] | None, PLAY_WHO] = None
    """no policy: stand still, or move at random"""
    live: Annotated[opt.Flag, PLAY_VIEW] = False
    """open rerun's window, also beside --png and --out"""
    rrd: Annotated[opt.OptionalFile, PLAY_VIEW] = None
    """save a recording for 'rerun FILE'"""
    connect: Annotated[str | None, opt.maybe_one("URL"), PLAY_VIEW] = None
    """send to a viewer that runs already"""
    serve_web: Annotated[opt.Flag, PLAY_VIEW] = False
    """show in a browser on this machine"""
    web_port: Annotated[int | None, opt.one(port, "PORT")] = None
    """port of --serve-web (default: 9090 if free)"""
    png: opt.OptionalFile = None
    """save a picture: five instants and time series"""
    out: Annotated[Path | None, opt.FOLDER] = None
    """folder for result.json, the measured figures"""
    num_envs: opt.Count = len(opt.CURRENTS)
    """robots"""
    current: Annotated[tuple[float, ...], opt.some(opt.coil_current, "A")] = opt.CURRENTS
    """currents I_e [A], over equal groups of robots"""
    speed: Annotated[float, opt.one(opt.forward_speed, "V")] = 0.5
    """commanded forward speed [m/s]"""
    seconds: Annotated[float, opt.one(duration, "S")] = 10.0
    """time shown [s]"""
    seed: opt.Seed = 0
    """seed of initial poses and of --agent random"""
    device: str = "cpu"
    """cpu or cuda:N"""
    robot: Literal["mr_go", "go1"] | None = None
    """robot variant of the USD asset"""
    payload: Literal[0, 3] | None = None
    """payload variant [kg]"""
    sal: Literal["on", "off"] | None = None
    """whether the gates may open"""
    asset: opt.OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""
    actuator: Annotated[str | None, opt.one_of(ACTUATORS)] = None
    """torque model of the MR joint"""
    actuator_model: opt.OptionalText = None
    """trained network of --actuator mlp, lstm or pg_rlstm"""
    model: opt.OptionalText = None
    """model.json: identified joint with its effects, on all MR joints"""
    terrain: Annotated[str | None, opt.one_of(TERRAINS)] = None
    """ground; on rough ground the robots stand on different tiles"""
    coupling: Coupling | None = None
    """how the device acts"""
    hold_current: HoldCurrent | None = None
    """current while holding"""
