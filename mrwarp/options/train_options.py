"""Options of ``mrwarp train`` and ``mrwarp play``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from mrwarp.enums import ACTUATORS, RANDOMIZATIONS, TERRAINS, BackendKind, Coupling, HoldCurrent, ZStep
from mrwarp.options.option_types import (
    CURRENTS,
    FOLDER,
    Count,
    Flag,
    Folder,
    NotNegative,
    OptionalFile,
    OptionalText,
    Positive,
    Seed,
    Whole,
    coil_current,
    count,
    exclusive,
    finite,
    forward_speed,
    maybe_one,
    one,
    one_of,
    some,
)

TRAIN_VIEW = exclusive("view")
TRAIN_BEGIN = exclusive("begin with")
PLAY_WHO = exclusive("who walks", required=True)
PLAY_VIEW = exclusive("view")


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How fast networks learn."""

    desired_kl: Positive = 0.04
    """divergence between the policies of two updates; 0.01 settles a gait"""
    entropy: NotNegative = 0.003
    """weight of the entropy, which keeps up exploration, in the loss"""


@dataclass(frozen=True, kw_only=True)
class Train(Learning):
    """Train a quadruped with MR calf joints to walk, until the walking gate is met."""

    device: str = "cpu"
    """cpu, cuda:N, or cuda: under torchrun a GPU for each process"""
    num_envs: Count = 64
    """parallel environments, in each process of torchrun"""
    seed: Seed = 0
    """seed of everything random"""
    iterations: Count = 6000
    """most PPO updates"""
    no_gate: Flag = False
    """run all iterations instead of stopping at the gate"""
    actuator: Annotated[str, one_of(ACTUATORS)] = "bouc_wen"
    """torque model of the MR joint"""
    actuator_model: OptionalText = None
    """trained network of --actuator mlp, lstm or pg_rlstm (default: the shipped one)"""
    model: OptionalText = None
    """model.json: identified joint with its effects, on all MR joints (default: the asset's own numbers)"""
    robot: Literal["mr_go", "go1"] = "mr_go"
    """robot variant of the USD asset"""
    payload: Literal[0, 3] = 0
    """payload variant [kg]"""
    asset: OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""
    coupling: Coupling = Coupling.CONSTRAINT
    """how the device acts: the paper's explicit torque, or a brake that sticks"""
    hold_current: HoldCurrent = HoldCurrent.SUPPORT
    """current while holding: as much as the load needs, or the environment's own"""
    z_step: ZStep = ZStep.EULER
    """step of the hysteresis state: the paper's, or the closed form for constant speed"""
    sal: Literal["on", "off"] = "on"
    """whether the gates may open"""
    terrain: Annotated[str, one_of(TERRAINS)] = "flat"
    """ground; rough has a curriculum"""
    randomize: Annotated[str, one_of(RANDOMIZATIONS)] = "all"
    """what differs between environments: friction, kicks, mass, gains and devices; friction and kicks; nothing"""
    power_price: NotNegative = 0.0
    """reward taken per watt of motors and coils; the policies in policies/energy pay 0.002"""
    backend: BackendKind | None = None
    """physics engine (default: by device)"""
    threads: Whole = 0
    """CPU threads of the physics; 0 = all"""
    deterministic: Flag = False
    """make a GPU repeat its bits, at some cost in speed (the CPU repeats them anyway)"""
    save_every: NotNegative = 30.0
    """time between checkpoints [s]"""
    out: Folder = Path("runs/walk")
    """output folder"""
    live: Annotated[Flag, TRAIN_VIEW] = False
    """watch four robots in rerun while they train"""
    rrd: Annotated[OptionalFile, TRAIN_VIEW] = None
    """save that view as a recording"""
    connect: Annotated[OptionalText, TRAIN_VIEW] = None
    """URL: send it to a rerun viewer that runs already"""
    resume: Annotated[OptionalFile, TRAIN_BEGIN] = None
    """go on from a checkpoint.pt"""
    start_from: Annotated[OptionalFile, TRAIN_BEGIN] = None
    """a new training that begins with the networks of another task's checkpoint.pt, or a policy's actor (.onnx)"""


def port(text: str) -> int:
    """Port of a web page."""
    if (value := count(text)) > 65535:
        raise ValueError(f"{text}; allowed: 1 to 65535")
    return value


def duration(text: str) -> float:
    """Time that is shown [s]."""
    if (value := finite(text)) < 1.0:
        raise ValueError(f"{text} must be at least 1 s")
    return value


@dataclass(frozen=True, kw_only=True)
class Play:
    """Run a policy with one robot per MR current side by side, and show it in rerun, in a recording or in a picture.

    Without --rrd, --connect, --serve-web, --png and --out, rerun's window opens. The default of each option on the
    robot is what the policy was trained with.
    """

    policy: Annotated[OptionalText, PLAY_WHO] = None
    """exported policy (.onnx), as train/ppo.py writes it"""
    agent: Annotated[Literal["zero", "random"] | None, PLAY_WHO] = None
    """no policy: stand still, or move at random"""
    live: Annotated[Flag, PLAY_VIEW] = False
    """open rerun's window, also beside --png and --out"""
    rrd: Annotated[OptionalFile, PLAY_VIEW] = None
    """save a recording for 'rerun FILE'"""
    connect: Annotated[str | None, maybe_one("URL"), PLAY_VIEW] = None
    """send to a viewer that runs already"""
    serve_web: Annotated[Flag, PLAY_VIEW] = False
    """show in a browser on this machine"""
    web_port: Annotated[int | None, one(port, "PORT")] = None
    """port of --serve-web (default: 9090 if free)"""
    png: OptionalFile = None
    """save a picture: five instants and time series"""
    out: Annotated[Path | None, FOLDER] = None
    """folder for result.json, the measured figures"""
    num_envs: Count = len(CURRENTS)
    """robots"""
    current: Annotated[tuple[float, ...], some(coil_current, "A")] = CURRENTS
    """currents I_e [A], over equal groups of robots"""
    speed: Annotated[float, one(forward_speed, "V")] = 0.5
    """commanded forward speed [m/s]"""
    seconds: Annotated[float, one(duration, "S")] = 10.0
    """time shown [s]"""
    seed: Seed = 0
    """seed of initial poses and of --agent random"""
    device: str = "cpu"
    """cpu or cuda:N"""
    robot: Literal["mr_go", "go1"] | None = None
    """robot variant of the USD asset"""
    payload: Literal[0, 3] | None = None
    """payload variant [kg]"""
    sal: Literal["on", "off"] | None = None
    """whether the gates may open"""
    asset: OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""
    actuator: Annotated[str | None, one_of(ACTUATORS)] = None
    """torque model of the MR joint"""
    actuator_model: OptionalText = None
    """trained network of --actuator mlp, lstm or pg_rlstm"""
    model: OptionalText = None
    """model.json: identified joint with its effects, on all MR joints"""
    terrain: Annotated[str | None, one_of(TERRAINS)] = None
    """ground; on rough ground the robots stand on different tiles"""
    coupling: Coupling | None = None
    """how the device acts"""
    hold_current: HoldCurrent | None = None
    """current while holding"""
