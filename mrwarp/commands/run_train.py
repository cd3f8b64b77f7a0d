"""``mrwarp train`` (``python train/ppo.py``): train a walking policy; ``replay-dump``: where a number went wrong."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, create_mutex_group

from mrwarp.enums import CurrentCommand
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options, given, parse
from mrwarp.rl.train_cfg import TrainCfg
from mrwarp.run_dir import check_output, claim, one_line
from mrwarp.runtime import check_device, exit_code, four_digits

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv
    from mrwarp.rl.ranks import Ranks

BEGIN = create_mutex_group(required=False, title="begin with")


@dataclass(frozen=True, kw_only=True)
class Train(opt.ViewOptions):
    """Train a robot on legs, with MR devices at its joints, until it passes its trials of walking (the gate)."""

    renamed = {
        "actuator-model": "actuator-file",
        **{f"current {command.value}": "current-by" for command in CurrentCommand},
    }
    cfg: TrainCfg = field(default_factory=TrainCfg)
    power_price: Annotated[float | None, opt.one(opt.not_negative, "X")] = None
    """reward taken per watt of motors and coils, as --reward power=-X; the policies in policies/energy pay 0.002"""
    overwrite: opt.Flag = False
    """start over in a folder that holds a checkpoint"""
    resume: Annotated[opt.OptionalFile, BEGIN] = None
    """go on from a checkpoint.pt, in its folder and with its options; options of the task cannot change"""
    start_from: Annotated[opt.OptionalFile, BEGIN] = None
    """a new training that begins with the networks of another task's checkpoint.pt, or a policy's actor (.onnx)"""

    @property
    def out(self) -> Path:
        """Folder of the training."""
        return self.cfg.run.out

    def check(self) -> None:
        """Refuse also to start over, unasked, in a folder that holds a checkpoint, and a robot without legs."""
        super().check()
        if self.resume is None:
            self._refuse_used_folder()
        from mrwarp.usd.asset import load_robot

        robot = self.cfg.task.robot
        if Path(robot).suffix and not load_robot(robot=robot).layout.legs:
            move = "'mrwarp play --agent sine' and 'mrwarp impact' move arms and legs on a rail"
            raise ValueError(f"--robot {robot}: has no legs to walk with; {move}")

    def claimed(self) -> contextlib.AbstractContextManager[None]:
        """Nothing yet: the folder follows from the checkpoint, and one of several processes keeps it."""
        return contextlib.nullcontext()

    def run(self, line: CommandLine) -> int:
        """0 when the gate was met or not asked for, 1 when missed or broken off, 130 after Ctrl-C, 2 on bad input."""
        from mrwarp.rl.ranks import Ranks

        ranks = Ranks()
        try:
            ranks = Ranks.join()
            out = self.resume.parent if self.resume and "out" not in given(line, Train) else self.out
            with claim(out) if ranks.main else contextlib.nullcontext():  # before its checkpoint is read
                options = resumed(self.resume, line, ranks) if self.resume else self
                return options._train(line, ranks)
        except Exception as error:
            code = exit_code(error)
            if ranks.world == 1 or code is None:
                raise
            ranks.complain(f"{line.prog}: {one_line(error)}")
            return ranks.exit(code)

    def _train(self, line: CommandLine, ranks: Ranks) -> int:
        from mrwarp.rl.trainer import Trainer
        from mrwarp.trials.joint_need import need_lines
        from mrwarp.usd.asset import device_lines
        from mrwarp.viewing.live_view import LiveTraining

        if ranks.main:
            self._refuse_used_folder()
        cfg = self._on(line, ranks)
        trainer = Trainer(cfg, resume=self.resume, start_from=self.start_from, ranks=ranks)
        view = None
        if ranks.main:
            scene = trainer.env.sim.scene
            for text in (*device_lines(scene.actuators), *limited(trainer.env), *need_lines(scene)):
                print(four_digits(text), flush=True)
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
        return 0 if result["gate_passed"] or cfg.run.no_gate or ranks.world > 1 else 1

    def _refuse_used_folder(self) -> None:
        kept = self.out / "checkpoint.pt"
        if kept.is_file() and not self.overwrite and not (self.resume and kept.samefile(self.resume)):
            remedy = f"go on with --resume {kept}, choose another --out or add --overwrite"
            raise ValueError(f"{kept} is there already; {remedy}")

    def priced(self) -> TrainCfg:
        """The training with the price of power among its rewards."""
        task = self.cfg.task
        if self.power_price is None:
            return self.cfg
        return replace(self.cfg, task=replace(task, rewards=task.rewards.weighing(power=0.0 - self.power_price)))

    def _on(self, line: CommandLine, ranks: Ranks) -> TrainCfg:
        """The training on this process's device and threads; says what it is."""
        cfg = self.priced()
        task, asked = cfg.task, cfg.task.device
        check_device(device := ranks.device(asked))
        if ranks.main:
            together = f"{ranks.world} processes with {task.num_envs} each" if ranks.world > 1 else f"{task.num_envs}"
            print(
                f"training {task.robot} ({task.actuator}, {task.coupling.value} coupling) in {together} "
                f"environments on {asked}; first start compiles kernels; output in {self.out}",
                flush=True,
            )
        own = replace(task, device=device, threads=ranks.threads(task.threads))
        return replace(cfg, task=own, run=replace(cfg.run, command=str(line)))


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


def resumed(path: Path, line: CommandLine, ranks: Ranks) -> Train:
    """The options of a training that goes on: those of the checkpoint, in its folder, but for what was typed.

    What was typed and changes the task is refused.

    Raises:
        CheckpointError: the checkpoint cannot be used.
    """
    from mrwarp.rl import checkpoint

    content = checkpoint.load(path)
    try:
        saved = checkpoint.saved_cfg(content)
        device = saved.task.device
        if ranks.world > 1 and device.startswith("cuda"):
            saved = replace(saved, task=replace(saved.task, device="cuda"))  # each process has its own
        default = Train(cfg=replace(saved, run=replace(saved.run, out=path.parent)))
        found = parse(Train, line.argv, line.prog, default)
        asked = found.priced()
        if "device" not in given(line, Train):
            asked = replace(asked, task=replace(asked.task, device=device))
        checkpoint.check_same(path, content, asked)
        update = int(content["iteration"])
    except checkpoint.CheckpointError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
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
        f"warning: training currents up to {top:g} A are limited to {i:.4g} A at {joints[i]}, which take no more"
        for i in most
    ]
