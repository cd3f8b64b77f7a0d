"""``mrwarp train`` and ``python train/ppo.py``: train a walking policy."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import warp as wp

from mrwarp.enums import RANDOMIZATIONS, BackendKind, Coupling, HoldCurrent, ZStep
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.env.events import make_randomize_cfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.options.command_line import CommandLine, given
from mrwarp.options.train_options import Train
from mrwarp.resources import shipped_model
from mrwarp.rl import checkpoint
from mrwarp.rl.ppo_cfg import LearningCfg
from mrwarp.rl.ranks import Ranks
from mrwarp.rl.trainer import TrainCfg, Trainer
from mrwarp.run_dir import one_line
from mrwarp.runtime import exit_code
from mrwarp.usd.asset import device_lines
from mrwarp.viewing.live_view import LiveTraining


def run(options: Train, line: CommandLine) -> int:
    """Run a training.

    Returns:
        0 when the gate was met or not asked for, 1 when missed or broken off, 130 after Ctrl-C, 2 on bad input.
    """
    ranks = Ranks()
    try:
        ranks = Ranks.join()
        return _train(options, line, ranks)
    except Exception as error:
        code = exit_code(error)
        if ranks.world == 1 or code is None:
            raise
        ranks.complain(f"{line.prog}: {one_line(error)}")
        return ranks.exit(code)


def _train(options: Train, line: CommandLine, ranks: Ranks) -> int:
    if options.resume:
        options = resumed(options, given(line), ranks)
    kept = options.out / "checkpoint.pt"
    if ranks.main and kept.is_file() and not options.overwrite and not _is(kept, options.resume):
        raise ValueError(
            f"{kept} is there already; go on with --resume {kept}, choose another --out or add --overwrite"
        )
    trainer = Trainer(make_cfg(options, line, ranks), resume=options.resume, start_from=options.start_from, ranks=ranks)
    view = None
    if ranks.main:
        for text in device_lines(trainer.env.sim.scene.actuators):
            print(text, flush=True)
        for text in limited(trainer.env):
            print(text, flush=True)
        if options.live or options.rrd or options.connect:
            view = LiveTraining(trainer.env, rrd=options.rrd, url=options.connect)
            trainer.watchers.append(view.update)
    try:
        result = trainer.run()
    finally:
        if view is not None:
            view.close()
    ranks.leave()
    if not ranks.main:
        return 0
    if result["stopped"] == "interrupted":
        print(f"stopped; go on with --resume {options.out / 'checkpoint.pt'}")
        return 130
    passed, minutes = "met" if result["gate_passed"] else "NOT met", result["seconds"] / 60
    print(f"walking gate {passed} after {minutes:.1f} min ({result['iterations']} updates); see {options.out}")
    return 0 if result["gate_passed"] or options.no_gate else 1


def resumed(options: Train, typed: set[str], ranks: Ranks) -> Train:
    """The options of a training that goes on: those of the checkpoint, in its folder, but for what was typed.

    What was typed and changes the task is refused by the trainer, which compares it with the checkpoint.

    Raises:
        CheckpointError: the checkpoint cannot be used.
    """
    path = options.resume
    assert path is not None  # asked by the caller
    content = checkpoint.load(path)
    try:
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
            "z_step": ZStep(task["z_step"]),
            "sal": "on" if task["sal"] else "off",
            "randomize": kinds[json.dumps(task["randomize"])],
            "power_price": 0.0 - task["rewards"]["power"],
            "device": "cuda" if ranks.world > 1 and task["device"].startswith("cuda") else task["device"],
            "backend": BackendKind(task["engine"]),
            "seed": content["seed"],
            "desired_kl": learning["desired_kl"],
            "entropy": learning["entropy"],
            "out": path.parent,
            **content.get("run", {}),  # files of earlier versions do not hold it
        }
        found = replace(options, **{name: value for name, value in kept.items() if name not in typed})
        update = int(content["iteration"])
    except (KeyError, TypeError, ValueError, AttributeError, StopIteration) as error:
        raise checkpoint.CheckpointError(
            f"{path}: does not fit this version of mrwarp ({one_line(error)}); start anew"
        ) from error
    if ranks.main:
        print(f"going on from {path}, update {update}, with its options, in {found.out}", flush=True)
    return found


def _is(path: Path, other: Path | None) -> bool:
    """Whether both are the same file."""
    return other is not None and other.is_file() and path.samefile(other)


def limited(env: WalkEnv) -> list[str]:
    """Which coils take less than the training's currents, a line each; broken wires too."""
    top, coils = max(env.cfg.currents), [(a.joint, a.mr.coil.current_max) for a in env.sim.scene.actuators if a.mr]
    most = sorted({current for _, current in coils if current < top})
    joints = {current: ", ".join(joint for joint, own in coils if own == current) for current in most}
    return [
        f"warning: {joints[i]} take at most {i:.4g} A; training currents up to {top:g} A are cut to it" for i in most
    ]


def make_cfg(options: Train, line: CommandLine, ranks: Ranks) -> TrainCfg:
    """The training that the options ask for; says what it is."""
    device = ranks.device(options.device)
    check_device(device)
    env = make_walk_cfg(
        num_envs=options.num_envs,
        device=device,
        seed=options.seed,
        robot=options.robot,
        payload=options.payload,
        asset=options.asset,
        actuator_model=options.actuator,
        actuator_file=options.actuator_model or shipped_model(options.actuator),
        model=options.model,
        extrapolate=options.extrapolate,
        coupling=options.coupling,
        hold_current=options.hold_current,
        z_step=options.z_step,
        sal=options.sal == "on",
        backend=options.backend,
        threads=ranks.threads(options.threads),
        deterministic=options.deterministic,
        terrain=options.terrain,
        randomize=options.randomize,
    )
    cfg = TrainCfg(
        env=replace(env, rewards=replace(env.rewards, power=0.0 - options.power_price)),
        out=options.out,
        seed=options.seed,
        iterations=options.iterations,
        until_gate=not options.no_gate,
        save_every=options.save_every,
        learning=LearningCfg(desired_kl=options.desired_kl, entropy=options.entropy),
        command=str(line),
    )
    if ranks.main:
        together = f"{ranks.world} processes with {options.num_envs} each" if ranks.world > 1 else f"{options.num_envs}"
        print(
            f"training {options.robot} ({options.actuator}, {options.coupling.value} coupling) in {together} "
            f"environments on {options.device}; first start compiles kernels; output in {options.out}",
            flush=True,
        )
    return cfg


def check_device(device: str) -> None:
    """Raise ValueError unless the device is there."""
    known = ["cpu"] + [f"cuda:{i}" for i in range(wp.get_cuda_device_count())]
    if device not in known:
        raise ValueError(f"--device {device}: no such device here; choose from {', '.join(known)}")
