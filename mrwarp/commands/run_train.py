"""``mrwarp train`` and ``python train/ppo.py``: train a walking policy."""

from __future__ import annotations

from dataclasses import replace

import warp as wp

from mrwarp.env.cfg import make_walk_cfg
from mrwarp.options.command_line import CommandLine
from mrwarp.options.train_options import Train
from mrwarp.resources import shipped_model
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
    trainer = Trainer(make_cfg(options, line, ranks), resume=options.resume, start_from=options.start_from, ranks=ranks)
    view = None
    if ranks.main:
        for text in device_lines(trainer.env.sim.scene.actuators):
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
