"""``mrwarp train`` (``python train/ppo.py``): train a walking policy; ``replay-dump``: where a number went wrong."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, create_mutex_group

from mrwarp.enums import (
    ACTUATORS,
    RANDOMIZATIONS,
    TERRAINS,
    BackendKind,
    Coupling,
    CurrentCommand,
    HoldCurrent,
    ResidualEngine,
    ZStep,
)
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options, given
from mrwarp.resources import shipped_model
from mrwarp.run_dir import check_output, claim, one_line
from mrwarp.runtime import check_device, exit_code

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv
    from mrwarp.rl.ppo_cfg import LearningCfg
    from mrwarp.rl.ranks import Ranks
    from mrwarp.rl.trainer import TrainCfg

BEGIN = create_mutex_group(required=False, title="begin with")

AS_TYPED = (
    "seed", "num_envs", "robot", "payload", "actuator", "terrain", "coupling", "hold_current", "z_step", "extrapolate",
    "desired_kl", "entropy",
)  # fmt: skip
"""Options that a checkpoint holds as they are typed."""


@dataclass(frozen=True, kw_only=True)
class Learning(Options):
    """How fast networks learn."""

    desired_kl: opt.Positive = 0.04
    """divergence between the policies of two updates; 0.01 settles a gait"""
    entropy: opt.NotNegative = 0.003
    """weight of the entropy, which keeps up exploration, in the loss"""
    symmetry: Literal["on", "off"] = "on"
    """whether networks treat left and right in the same way, where the robot is its own mirror image"""

    def learning(self) -> LearningCfg:
        """As the trainer takes it."""
        from mrwarp.rl.ppo_cfg import LearningCfg

        return LearningCfg(desired_kl=self.desired_kl, entropy=self.entropy, symmetry=self.symmetry == "on")


@dataclass(frozen=True, kw_only=True)
class Train(opt.ViewOptions, opt.SteppedRobot, Learning):
    """Train a robot on legs, with MR devices at its joints, to walk, until the walking gate is met."""

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
    residual_engine: ResidualEngine = ResidualEngine.KERNELS
    """what evaluates that network: our kernels, or torch on the same arrays, slower"""
    extrapolate: opt.Flag = False
    """let coils take more current than the recordings of --model held"""
    robot: opt.Robot = "mr_go"
    """robot variant of the USD asset, or a USD file of 'mrwarp robot import'"""
    payload: opt.Load = 0
    """mass on the back [kg]"""
    coupling: Coupling = Coupling.CONSTRAINT
    """how the device acts: the paper's explicit torque, or a brake that sticks"""
    hold_current: HoldCurrent = HoldCurrent.SUPPORT
    """current while holding: as much as the load needs, or the environment's own"""
    current: CurrentCommand = CurrentCommand.FIXED
    """what commands the coils: the gates alone, a law at 50 Hz, or the policy, with an action for each"""
    coil_lag: opt.OptionalLag = None
    """time constant of the coils [s] (default: the devices' own)"""
    hold_speed: Annotated[float | None, opt.one(opt.positive, "W")] = None
    """speed below which a device may hold [rad/s] (default: the devices' own eps_hold)"""
    sal: Literal["on", "off"] = "on"
    """whether the gates may open"""
    terrain: Annotated[str, opt.one_of(TERRAINS)] = "flat"
    """ground; rough has a curriculum"""
    randomize: Annotated[str, opt.one_of(RANDOMIZATIONS)] = "all"
    """what differs between environments: friction, kicks, mass, gains and devices; friction and kicks; nothing"""
    reward: Annotated[tuple[str, ...], opt.some(str, "TERM=WEIGHT")] = ()
    """weights of reward terms in place of their own, such as tilt=-100; terms stand in mrwarp/env/rewards.py"""
    power_price: opt.NotNegative = 0.0
    """reward taken per watt of motors and coils; the policies in policies/energy pay 0.002"""
    backend: BackendKind | None = None
    """physics engine (default: by device)"""
    threads: opt.Whole = 0
    """CPU threads of the physics; 0 = all"""
    deterministic: opt.Flag = False
    """order contacts and sums on a GPU; nine times slower, and its bits still differ (the CPU repeats them anyway)"""
    save_every: opt.NotNegative = 30.0
    """time between checkpoints [s]"""
    out: opt.Folder = Path("runs/walk")
    """output folder"""
    overwrite: opt.Flag = False
    """start over in a folder that holds a checkpoint"""
    resume: Annotated[opt.OptionalFile, BEGIN] = None
    """go on from a checkpoint.pt, in its folder and with its options; options of the task cannot change"""
    start_from: Annotated[opt.OptionalFile, BEGIN] = None
    """a new training that begins with the networks of another task's checkpoint.pt, or a policy's actor (.onnx)"""

    def check(self) -> None:
        """Refuse also to start over, unasked, in a folder that holds a checkpoint, and a robot without legs."""
        super().check()
        if self.resume is None:
            self._refuse_used_folder()
        from mrwarp.usd.asset import load_robot

        if Path(self.robot).suffix and not load_robot(robot=self.robot).layout.legs:
            move = "'mrwarp play --agent sine' and 'mrwarp impact' move arms and legs on a rail"
            raise ValueError(f"--robot {self.robot}: has no legs to walk with; {move}")

    def claimed(self) -> contextlib.AbstractContextManager[None]:
        """Nothing yet: the folder follows from the checkpoint, and one of several processes keeps it."""
        return contextlib.nullcontext()

    def run(self, line: CommandLine) -> int:
        """0 when the gate was met or not asked for, 1 when missed or broken off, 130 after Ctrl-C, 2 on bad input."""
        from mrwarp.rl.ranks import Ranks

        ranks = Ranks()
        try:
            ranks = Ranks.join()
            out = self.resume.parent if self.resume and "out" not in given(line) else self.out
            with claim(out) if ranks.main else contextlib.nullcontext():  # before its checkpoint is read
                options = resumed(self, given(line), ranks) if self.resume else self
                return options._train(line, ranks)
        except Exception as error:
            code = exit_code(error)
            if ranks.world == 1 or code is None:
                raise
            ranks.complain(f"{line.prog}: {one_line(error)}")
            return ranks.exit(code)

    def _train(self, line: CommandLine, ranks: Ranks) -> int:
        from mrwarp.rl.trainer import Trainer
        from mrwarp.usd.asset import device_lines
        from mrwarp.viewing.live_view import LiveTraining

        if ranks.main:
            self._refuse_used_folder()
        cfg = self._cfg(line, ranks)
        trainer = Trainer(cfg, resume=self.resume, start_from=self.start_from, ranks=ranks)
        view = None
        if ranks.main:
            for text in (*device_lines(trainer.env.sim.scene.actuators), *limited(trainer.env)):
                print(text, flush=True)
            if self.live or self.rrd or self.connect:
                view = LiveTraining(trainer.env, rrd=self.rrd, url=self.connect)
                trainer.watchers.append(view.update)
        try:
            result = trainer.run(claimed=True)
        finally:
            if view is not None:
                view.close()
        ranks.leave()
        if not ranks.main:
            return 0
        if result["stopped"] == "interrupted":
            print(f"stopped; go on with --resume {self.out / 'checkpoint.pt'}")
            return 130
        passed, minutes = "met" if result["gate_passed"] else "NOT met", result["seconds"] / 60
        print(f"walking gate {passed} after {minutes:.1f} min ({result['iterations']} updates); see {self.out}")
        # torchrun ends in a traceback where a process ends with another code than 0
        return 0 if result["gate_passed"] or self.no_gate or ranks.world > 1 else 1

    def _refuse_used_folder(self) -> None:
        kept = self.out / "checkpoint.pt"
        if kept.is_file() and not self.overwrite and not (self.resume and kept.samefile(self.resume)):
            remedy = f"go on with --resume {kept}, choose another --out or add --overwrite"
            raise ValueError(f"{kept} is there already; {remedy}")

    def _weights(self) -> dict[str, float]:
        """Weights of reward terms that were asked for."""
        weights = dict(weight_of(word) for word in self.reward)
        if self.power_price:
            weights["power"] = 0.0 - self.power_price
        return weights

    def _cfg(self, line: CommandLine, ranks: Ranks) -> TrainCfg:
        """The training that the options ask for; says what it is."""
        from mrwarp.env.cfg import make_walk_cfg
        from mrwarp.rl.trainer import TrainCfg

        device = ranks.device(self.device)
        check_device(device)
        env = make_walk_cfg(
            **self.chosen("num_envs", "seed", "robot", "payload", "asset", "model", "extrapolate", "coupling"),
            **self.chosen(
                "hold_current",
                "current",
                "coil_lag",
                "hold_speed",
                "z_step",
                "residual_engine",
                "backend",
                "deterministic",
                "terrain",
                "randomize",
            ),
            device=device,
            actuator_model=self.actuator,
            actuator_file=self.actuator_model or shipped_model(self.actuator),
            sal=self.sal == "on",
            threads=ranks.threads(self.threads),
        )
        cfg = TrainCfg(
            **self.chosen("out", "seed", "iterations", "save_every"),
            env=replace(env, rewards=replace(env.rewards, weights=self._weights())),
            until_gate=not self.no_gate,
            learning=self.learning(),
            command=str(line),
        )
        if ranks.main:
            together = f"{ranks.world} processes with {self.num_envs} each" if ranks.world > 1 else f"{self.num_envs}"
            print(
                f"training {self.robot} ({self.actuator}, {self.coupling.value} coupling) in {together} "
                f"environments on {self.device}; first start compiles kernels; output in {self.out}",
                flush=True,
            )
        return cfg


@dataclass(frozen=True, kw_only=True)
class ReplayDump(Options):
    """Open the last states of an environment in which a number went wrong: what was first, when, and how it got there.

    A training writes such files to the folder 'diverged' of its output.
    """

    engines = False
    file: Positional[opt.File]
    """dump, a .safetensors file"""
    rows: opt.Count = 10
    """last states to print"""
    png: opt.OptionalFile = None
    """save a picture of the states over time"""

    def run(self, line: CommandLine) -> int:
        """0 when done, 2 on bad input."""
        check_output(self.png, ".png")

        from mrwarp.env import nan_dump

        found = nan_dump.load(self.file)
        print("\n".join([*nan_dump.report(found), "", *nan_dump.table(found, self.rows)]))
        if self.png is not None:
            nan_dump.plot(found, self.png)
            print(f"picture: {self.png}")
        return 0


def weight_of(word: str) -> tuple[str, float]:
    """Term and weight of ``NAME=WEIGHT``.

    Raises:
        ValueError: the weight is no number.
    """
    name, _, text = word.partition("=")
    try:
        return name, float(text)
    except ValueError:
        raise ValueError(f"--reward {word}: give a term and its weight, such as tilt=-100") from None


def changed_weights(rewards: dict[str, float]) -> tuple[str, ...]:
    """Those of a checkpoint's task that are not the terms' own, as ``--reward`` takes them."""
    from mrwarp.env.rewards import TERMS

    return tuple(f"{name}={rewards[name]!r}" for name, term in TERMS.items() if rewards[name] != term.weight)


def resumed(options: Train, typed: set[str], ranks: Ranks) -> Train:
    """The options of a training that goes on: those of the checkpoint, in its folder, but for what was typed.

    What was typed and changes the task is refused: what stands in the checkpoint as it is typed at once, the rest by
    the trainer.

    Raises:
        CheckpointError: the checkpoint cannot be used.
    """
    from mrwarp.rl import checkpoint

    path = options.resume
    assert path is not None  # asked by the caller
    content = checkpoint.load(path)
    try:
        asked = {name: getattr(options, name) for name in AS_TYPED if name in typed}
        asked = {name: value.value if isinstance(value, Enum) else value for name, value in asked.items()}
        checkpoint.check_same(path, content, asked)

        from mrwarp.env.events import make_randomize_cfg

        task, learning = content["task"], checkpoint.learned(content)
        randomized = {kind: make_randomize_cfg(kind) for kind in RANDOMIZATIONS}
        kinds = {json.dumps(asdict(cfg) if cfg else None): kind for kind, cfg in randomized.items()}
        file, shipped = task["actuator_file"], shipped_model(task["actuator"])
        kept = {
            **{name: task[name] for name in ("robot", "payload", "asset", "actuator", "model", "terrain", "num_envs")},
            "actuator_model": None if shipped and file == checkpoint.portable(shipped) else file,
            "extrapolate": task.get("extrapolate", False),
            "coupling": Coupling(task["coupling"]),
            "hold_current": HoldCurrent(task["hold_current"]),
            "current": CurrentCommand(task.get("current", "fixed")),  # files of earlier versions have none
            **{name: task.get(name) for name in ("coil_lag", "hold_speed")},
            "z_step": ZStep(task.get("z_step", "euler")),  # as above
            "residual_engine": ResidualEngine(task.get("residual_engine") or "kernels"),
            "sal": "on" if task["sal"] else "off",
            "randomize": kinds[json.dumps(task["randomize"])],
            "reward": changed_weights(task["rewards"]),
            "device": "cuda" if ranks.world > 1 and task["device"].startswith("cuda") else task["device"],
            "backend": BackendKind(task["engine"]),
            "seed": content["seed"],
            "desired_kl": learning["desired_kl"],
            "entropy": learning["entropy"],
            "symmetry": "on" if learning["symmetry"] else "off",
            "out": path.parent,
            **content.get("run", {}),  # files of earlier versions do not hold it
        }
        found = replace(options, **{name: value for name, value in kept.items() if name not in typed})
        update = int(content["iteration"])
    except checkpoint.CheckpointError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, StopIteration) as error:
        raise checkpoint.CheckpointError(
            f"{path}: does not fit this version of mrwarp ({one_line(error)}); start again"
        ) from error
    if ranks.main:
        print(f"going on from {path}, update {update}, with its options, in {found.out}", flush=True)
    return found


def limited(env: WalkEnv) -> list[str]:
    """Which coils take less than the training's currents, a line each; broken wires too."""
    top, coils = max(env.cfg.currents), [(a.joint, a.mr.coil.current_max) for a in env.sim.scene.actuators if a.mr]
    most = sorted({current for _, current in coils if current < top})
    joints = {current: ", ".join(joint for joint, own in coils if own == current) for current in most}
    return [
        f"warning: {joints[i]} take at most {i:.4g} A; training currents up to {top:g} A are cut to it" for i in most
    ]
