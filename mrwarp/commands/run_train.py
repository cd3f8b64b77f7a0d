"""Command line of the training: ``python train/ppo.py`` and ``mrwarp train`` are this."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

from mrwarp.enums import ACTUATORS, RANDOMIZATIONS, TERRAINS, BackendKind, Coupling, HoldCurrent, ZStep
from mrwarp.options.arguments import Parser, count, not_negative, positive, seed, typed, whole
from mrwarp.params import ParameterError
from mrwarp.resources import shipped_model
from mrwarp.rl.ppo_cfg import LearningCfg
from mrwarp.runtime import one_voice, quiet_libraries

if TYPE_CHECKING:
    from mrwarp.rl.trainer import Trainer
    from mrwarp.viewing.live_view import LiveTraining


def make_parser(prog: str = "mrwarp train") -> argparse.ArgumentParser:
    """The options of ``mrwarp train`` and ``train/ppo.py``."""
    parser = Parser(
        prog=prog, description="Train a quadruped with MR calf joints to walk, until the walking gate is met."
    )
    where = "cpu, cuda:N, or cuda: under torchrun a GPU for each process (default: cpu)"
    parser.add_argument("--device", default="cpu", help=where)
    envs = "parallel environments, in each process of torchrun (default: 64)"
    parser.add_argument("--num-envs", type=count, default=64, help=envs)
    parser.add_argument("--seed", type=seed, default=0, help="seed of everything random (default: 0)")
    parser.add_argument("--iterations", type=count, default=6000, help="most PPO updates (default: 6000)")
    parser.add_argument("--no-gate", action="store_true", help="run all iterations instead of stopping at the gate")
    parser.add_argument(
        "--actuator", choices=ACTUATORS, default="bouc_wen", help="torque model of the MR joint (default: bouc_wen)"
    )
    network = "trained network of --actuator mlp, lstm or pg_rlstm (default: the shipped one)"
    parser.add_argument("--actuator-model", metavar="FILE", help=network)
    identified = "identified joint with its effects, on all MR joints (default: the asset's own numbers)"
    parser.add_argument("--model", metavar="MODEL.json", help=identified)
    variant = "robot variant of the USD asset (default: mr_go)"
    parser.add_argument("--robot", choices=("mr_go", "go1"), default="mr_go", help=variant)
    parser.add_argument("--payload", type=int, choices=(0, 3), default=0, help="payload variant [kg] (default: 0)")
    parser.add_argument("--asset", help="another USD file than assets/usd/mr_go.usda")
    coupling = "how the device acts: the paper's explicit torque, or a brake that sticks (default: constraint)"
    parser.add_argument("--coupling", choices=_values(Coupling), default="constraint", help=coupling)
    holding = "current while holding: as much as the load needs, or the environment's own (default: support)"
    parser.add_argument("--hold-current", choices=_values(HoldCurrent), default="support", help=holding)
    step = "step of the hysteresis state: the paper's, or the closed form for constant speed (default: euler)"
    parser.add_argument("--z-step", choices=_values(ZStep), default="euler", help=step)
    parser.add_argument("--sal", choices=("on", "off"), default="on", help="whether the gates may open (default: on)")
    ground = "ground; rough has a curriculum (default: flat)"
    parser.add_argument("--terrain", choices=TERRAINS, default="flat", help=ground)
    differs = "what differs between environments: friction, kicks, mass, gains and devices; friction and kicks; nothing"
    parser.add_argument("--randomize", choices=RANDOMIZATIONS, default="all", help=f"{differs} (default: all)")
    price = "reward taken per watt of motors and coils (default: 0; the policies in policies/energy pay 0.002)"
    parser.add_argument("--power-price", type=not_negative, default=0.0, metavar="R", help=price)
    add_learning(parser)
    parser.add_argument("--backend", choices=_values(BackendKind), help="physics engine (default: by device)")
    parser.add_argument("--threads", type=whole, default=0, help="CPU threads of the physics; 0 = all (default)")
    repeat = "make a GPU repeat its bits, at some cost in speed (the CPU repeats them anyway)"
    parser.add_argument("--deterministic", action="store_true", help=repeat)
    parser.add_argument(
        "--save-every", type=not_negative, default=30.0, metavar="S", help="time between checkpoints [s] (default: 30)"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/walk"), help="output folder (default: runs/walk)")
    view = parser.add_mutually_exclusive_group()
    view.add_argument("--live", action="store_true", help="watch four robots in rerun while they train")
    view.add_argument("--rrd", type=Path, metavar="FILE", help="save that view as a recording")
    view.add_argument("--connect", metavar="URL", help="send it to a rerun viewer that runs already")
    begin = parser.add_mutually_exclusive_group()
    begin.add_argument("--resume", type=Path, metavar="CHECKPOINT", help="go on from a checkpoint.pt")
    networks = (
        "a new training that begins with the networks of another task's checkpoint.pt, or a policy's actor (.onnx)"
    )
    begin.add_argument("--start-from", type=Path, metavar="FILE", help=networks)
    return parser


def add_learning(parser: argparse.ArgumentParser) -> None:
    """Options of :class:`LearningCfg`."""
    default = LearningCfg()
    step = f"divergence between the policies of two updates; 0.01 settles a gait (default: {default.desired_kl:g})"
    parser.add_argument("--desired-kl", type=positive, default=default.desired_kl, metavar="D", help=step)
    bonus = f"weight of the entropy, which keeps up exploration, in the loss (default: {default.entropy:g})"
    parser.add_argument("--entropy", type=not_negative, default=default.entropy, metavar="W", help=bonus)


def main(argv: list[str] | None = None, prog: str = "mrwarp train") -> int:
    """Run a training.

    Args:
        argv: Arguments; None takes those of the process.
        prog: What the command is called, as a user types it.

    Returns:
        0 when the gate was met or not asked for, 1 when missed or broken off, 130 after Ctrl-C, 2 on bad input.
    """
    with one_voice():
        args = make_parser(prog).parse_args(argv)
    quiet_libraries()
    from mrwarp.env.cfg import make_walk_cfg
    from mrwarp.rl.checkpoint import CheckpointError
    from mrwarp.rl.ranks import RankLostError, Ranks
    from mrwarp.rl.trainer import TrainCfg, Trainer, TrainingError
    from mrwarp.run_dir import FolderError, one_line
    from mrwarp.usd.asset import effect_lines
    from mrwarp.usd.open_stage import AssetError
    from mrwarp.viewing.viewer import ViewerError

    ranks = Ranks()
    try:
        ranks = Ranks.join()
        device = ranks.device(args.device)
        check_device(device)
        env = make_walk_cfg(
            num_envs=args.num_envs,
            device=device,
            seed=args.seed,
            robot=args.robot,
            payload=args.payload,
            asset=args.asset,
            actuator_model=args.actuator,
            actuator_file=args.actuator_model or shipped_model(args.actuator),
            model=args.model,
            coupling=Coupling(args.coupling),
            hold_current=HoldCurrent(args.hold_current),
            z_step=ZStep(args.z_step),
            sal=args.sal == "on",
            backend=BackendKind(args.backend) if args.backend else None,
            threads=ranks.threads(args.threads),
            deterministic=args.deterministic,
            terrain=args.terrain,
            randomize=args.randomize,
        )
        cfg = TrainCfg(
            env=replace(env, rewards=replace(env.rewards, power=0.0 - args.power_price)),
            out=args.out,
            seed=args.seed,
            iterations=args.iterations,
            until_gate=not args.no_gate,
            save_every=args.save_every,
            learning=LearningCfg(desired_kl=args.desired_kl, entropy=args.entropy),
            command=typed(prog, sys.argv[1:] if argv is None else argv),
        )
        if ranks.main:
            together = f"{ranks.world} processes with {args.num_envs} each" if ranks.world > 1 else f"{args.num_envs}"
            print(
                f"training {args.robot} ({args.actuator}, {args.coupling} coupling) in {together} environments on "
                f"{args.device}; first start compiles kernels; output in {args.out}",
                flush=True,
            )
        trainer = Trainer(cfg, resume=args.resume, start_from=args.start_from, ranks=ranks)
        for line in effect_lines(trainer.env.sim.scene.actuators) if ranks.main else ():
            print(line, flush=True)
        view = _open_view(args, trainer) if ranks.main else None
    except (ViewerError, AssetError, ParameterError, CheckpointError, RankLostError, ValueError, OSError) as error:
        ranks.complain(f"{prog}: {one_line(error)}")
        return ranks.exit(1 if isinstance(error, RankLostError) else 2)
    result, code = {}, 0
    try:
        result = trainer.run()
    except (TrainingError, FolderError) as error:
        ranks.complain(f"{prog}: {error}")
        code = 1 if isinstance(error, TrainingError) else 2
    finally:
        if view is not None:
            view.close()
    if code:
        return ranks.exit(code)
    ranks.leave()
    if not ranks.main:
        return 0
    if result["stopped"] == "interrupted":
        print(f"stopped; go on with --resume {args.out / 'checkpoint.pt'}")
        return 130
    passed = "met" if result["gate_passed"] else "NOT met"
    print(
        f"walking gate {passed} after {result['seconds'] / 60:.1f} min ({result['iterations']} updates); see {args.out}"
    )
    return 0 if result["gate_passed"] or args.no_gate else 1


def _open_view(args: argparse.Namespace, trainer: Trainer) -> LiveTraining | None:
    """Show a few robots while they train, if asked to."""
    if not (args.live or args.rrd or args.connect):
        return None
    from mrwarp.viewing.live_view import LiveTraining

    view = LiveTraining(trainer.env, rrd=args.rrd, url=args.connect)
    trainer.watchers.append(view.update)
    return view


def check_device(device: str) -> None:
    """Raise ValueError unless the device is there."""
    import warp as wp

    known = ["cpu"] + [f"cuda:{i}" for i in range(wp.get_cuda_device_count())]
    if device not in known:
        raise ValueError(f"--device {device}: no such device here; choose from {', '.join(known)}")


def _values(choices: type[Enum]) -> list[str]:
    return [member.value for member in choices]
