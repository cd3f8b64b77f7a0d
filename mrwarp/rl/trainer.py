"""Training: rsl-rl's PPO on the walking task, until the walking gate is met; can be stopped and resumed at any time."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import torch
import warp as wp
from torch.utils.tensorboard import SummaryWriter

from mrwarp.env.vec_env import WalkEnv
from mrwarp.options.plain_values import plain
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.rl import checkpoint, policy, progress
from mrwarp.rl.mirror import NoMirrorError, mirror_of
from mrwarp.rl.ppo import PPO
from mrwarp.rl.ppo_cfg import make_ppo_cfg
from mrwarp.rl.progress import DivergenceError, Divergences, not_finite
from mrwarp.rl.ranks import Ranks
from mrwarp.rl.task_record import record
from mrwarp.rl.train_cfg import TrainCfg
from mrwarp.rl.warm_start import critic_learns_alone, read_networks, take_networks
from mrwarp.run_dir import check_writable, claim, one_line, write_result
from mrwarp.runtime import drawing, one_torch_thread, repeating_torch, silent
from mrwarp.trials.walking import GateCheck, WalkingGate


class TrainingError(RuntimeError):
    """A training cannot go on; the message says why, and which checkpoint is left."""

    exit_code = 1


class Trainer:
    """Collects rollouts, updates the policy, checks the gate, reports and saves.

    Args:
        cfg: The run.
        resume: Checkpoint to go on from, or None to start from the beginning.
        start_from: Checkpoint or policy of another task whose networks a new training begins with; not with ``resume``.
        ranks: The processes that train together, each with ``cfg``'s environments; None trains alone.

    Attributes:
        watchers: Called after every policy step, e.g. to show it.
        progress: Figures of the updates and gate checks.
        divergences: Episodes that ended because a number went wrong, of all processes.
        started_from: Where the first networks came from (see :func:`take_networks`), None if they were drawn.

    Raises:
        CheckpointError: a checkpoint cannot be used.
        PolicyError: a policy to start from cannot.
        FolderError: the output folder cannot be written.
    """

    def __init__(
        self, cfg: TrainCfg, *, resume: Path | None = None, start_from: Path | None = None, ranks: Ranks | None = None
    ) -> None:
        if resume and start_from:
            raise ValueError("a training goes on from a checkpoint or starts from one, not both")
        self.cfg = cfg
        self.ranks = ranks = ranks or Ranks()
        if ranks.main:
            check_writable(cfg.run.out)
        content = _of_as_many(checkpoint.load(resume), resume, ranks.world) if resume else {}
        networks = read_networks(start_from) if start_from else None
        self._seed = ranks.seed(cfg.task.seed)
        torch.manual_seed(self._seed)
        self.env = WalkEnv(replace(cfg.task, seed=self._seed))
        self.ppo_cfg = make_ppo_cfg(self.env.num_envs * ranks.world, ppo=cfg.ppo)
        self.ppo_cfg["multi_gpu"] = ranks.ppo_setting
        self.obs = self.env.get_observations()
        with silent():
            self.ppo_cfg["algorithm"]["class_name"] = ranks.ppo
            algorithm = ranks.ppo.construct_algorithm(self.obs, self.env, self.ppo_cfg, str(self.env.device))
        self.algorithm = cast(PPO, algorithm)  # rsl-rl promises only its own
        self.started_from = take_networks(self.algorithm, networks) if networks else None
        if cfg.ppo.symmetry:
            try:
                self.algorithm.be_symmetric(mirror_of(self.env), drawn=networks is None)
            except NoMirrorError as reason:
                if ranks.main:
                    print(f"note: trained without left-right symmetry ({reason})", flush=True)
        if ranks.world > 1:
            self.algorithm.broadcast_parameters()
        self.iteration = 0
        self.seconds = 0.0
        self.progress = progress.Progress()
        self.gate_check: GateCheck | None = None
        self.watchers: list[Callable[[], None]] = []
        self.bar: ProgressBar | None = None
        to_gate = not cfg.run.no_gate and self.env.terrain is None
        self.typical = progress.typical_updates(self.env.num_envs * ranks.world) if to_gate else None
        self.timed = False
        """Whether an update waits for the device before it learns, so that collecting and learning have their own
        times; else a GPU still collects while the host's clock says that it learns."""
        self._interrupted = self._stop = self._met_gate = False
        # spread the episodes, so that resets do not come all at once
        self.env.episode_length_buf = torch.randint_like(self.env.episode_length_buf, self.env.max_episode_length)
        run = {"seed": self._seed, "num_envs": self.env.num_envs, "task": record(cfg.task)}
        self.divergences = Divergences(self.env, ranks, cfg.run.out / "diverged", run, self._say)
        if resume:
            self._load(content, resume)

    def run(self, *, claimed: bool = False) -> dict[str, Any]:
        """Train until the gate is met, the iterations are used up, or Ctrl-C; returns what ``result.json`` holds.

        ``claimed``: whether the caller keeps other runs out of the folder, since before it read a checkpoint there.

        Raises:
            FolderError: another run writes into the folder.
            TrainingError: too many environments or the networks hold no numbers, the disk takes no more, or another
                process of this training ended.
        """
        alone = claim(self.cfg.run.out) if self.ranks.main and not claimed else contextlib.nullcontext()
        with alone, one_torch_thread(), repeating_torch(self.cfg.task.deterministic):
            previous = signal.signal(signal.SIGINT, self._interrupt)
            writer = None
            try:
                if self.ranks.main:
                    writer = SummaryWriter(str(self.cfg.run.out / "tensorboard"), purge_step=self.iteration + 1)
                    self.bar = ProgressBar()
                return self._run(writer)
            except DivergenceError as error:
                raise TrainingError(f"{error}; {self._left()}") from error
            except RuntimeError as error:
                if isinstance(error, TrainingError) or not self.ranks.lost(error):
                    raise
                raise TrainingError(f"another process of this training ended; {self._left()}") from error
            except OSError as error:
                raise TrainingError(f"{one_line(error)} (update {self.iteration}); {self._left()}") from error
            finally:
                signal.signal(signal.SIGINT, previous)
                if self.bar is not None:
                    self.bar.done()
                if writer is not None:
                    with contextlib.suppress(OSError):  # the same full disk again
                        writer.close()

    def _run(self, writer: SummaryWriter | None) -> dict[str, Any]:
        started = time.perf_counter() - self.seconds
        saved, checked = self.seconds, self.seconds
        while self.iteration < self.cfg.run.iterations and not self._asked_to_stop():
            row = self.update()
            self.seconds = time.perf_counter() - started
            row["seconds"] = self.seconds
            self.progress.rows.append(row)
            if writer is not None:
                for name, value in row.items():
                    writer.add_scalar(f"train/{name}", value, self.iteration)
            if self.bar is not None:
                self._show(self.bar, row)
            check, save = self.ranks.decided(
                row["v_x_rmse"] < self.cfg.run.check_below * self.env.scales.speed
                and self.seconds - checked >= self.cfg.run.check_every,
                self.seconds - saved >= self.cfg.run.save_every,
            )
            if check:
                self._check_gate(writer)
                checked = self.seconds = time.perf_counter() - started
                (passed,) = self.ranks.decided(self.progress.gate_passed)
                if passed and not self.cfg.run.no_gate:
                    self._met_gate = True
                    break
            if save:
                self.save()
                saved = self.seconds
                if self.bar is not None:
                    self.bar.log(f"update {self.iteration}: {progress.figures_line(row)}")
        if not self._stop and [row["iteration"] for row in self.progress.gate_rows[-1:]] != [self.iteration]:
            self._check_gate(writer)
        self.seconds = time.perf_counter() - started
        return self._finish()

    def save(self) -> Path:
        """Write ``checkpoint.pt``: networks, optimiser, random generators, environment and progress."""
        path = self.cfg.run.out / "checkpoint.pt"
        algorithm = self.algorithm.save()
        if wrong := not_finite(algorithm):
            raise TrainingError(f"{wrong} holds no numbers after update {self.iteration}; {self._left()}")
        ranks = self.ranks.gather(self._own_state())
        if not self.ranks.main:
            return path
        checkpoint.save(
            path,
            {
                "algorithm": algorithm,
                "learning_rate": self.algorithm.learning_rate,
                **ranks[0],
                "other_ranks": ranks[1:],
                "iteration": self.iteration,
                "seconds": self.seconds,
                **self.progress.state(),
                **self.divergences.state(),
                **checkpoint.settings(self.cfg),
                "started_from": self.started_from,
            },
        )
        return path

    def _own_state(self) -> dict[str, Any]:
        """State that every process of a training has for itself: random generator and environment."""
        env = {name: value.cpu() for name, value in self.env.state().items()}
        return {**checkpoint.random_state(torch.device(self.env.device)), "env": env}

    def _load(self, content: dict[str, Any], path: Path) -> None:
        """Go on from a checkpoint of the same task and seed (which drew the frictions, masses and gains)."""
        own = self.cfg
        try:
            if not self.ranks.main:  # the device is that of the first process, which compares it
                own = replace(own, task=replace(own.task, device=content["task"]["device"]))
            checkpoint.check_same(path, content, own)
            mine = content if self.ranks.main else content["other_ranks"][self.ranks.rank - 1]
            self.algorithm.load(content["algorithm"], None, strict=True)
            self.algorithm.learning_rate = content["learning_rate"]
            self.env.load_state(mine["env"])
            self.iteration, self.seconds = content["iteration"], content["seconds"]
            self.started_from = content.get("started_from")  # earlier versions had none
            self.progress.load_state(content)
            self.divergences.load_state(content)
            self.obs = self.env.last_observations
            if note := checkpoint.set_random_state(mine, torch.device(self.env.device)):
                self._say(f"  {path}: {note}")
        except checkpoint.CheckpointError:
            raise
        except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise checkpoint.CheckpointError(
                f"{path}: does not fit this version of mrwarp ({' '.join(str(error).split())}); start again"
            ) from error

    def update(self) -> dict[str, float]:
        """One PPO update: collect, learn; returns the progress figures, averaged over the last updates.

        Raises:
            DivergenceError: too many environments diverged.
            TrainingError: the update left networks without numbers.
        """
        env, algorithm = self.env, self.algorithm
        begin = time.perf_counter()
        error, reward, match = 0.0, 0.0, 0.0
        falls = torch.zeros((), device=env.device)
        steps = self.ppo_cfg["num_steps_per_env"]
        with torch.inference_mode():
            for _ in range(steps):
                self.obs, rewards, dones, extras = env.step(algorithm.act(self.obs))
                algorithm.process_env_step(self.obs, rewards, dones, extras)
                for watch in self.watchers:
                    watch()
                error = error + (env.body_velocity[:, 0] - env.command[:, 0]).square().mean()
                reward = reward + rewards.mean()
                match = match + env.clock_match.float().mean()
                falls += env.fallen.sum()
            algorithm.compute_returns(self.obs)
        if self.timed:
            wp.synchronize_device(str(env.device))
        collected = time.perf_counter()
        algorithm.critic_only = critic_learns_alone(self.started_from, self.iteration)
        if self.divergences.take(self.iteration + 1):
            value_loss = algorithm.update()["value"]
            weights = [*algorithm.actor.parameters(), *algorithm.critic.parameters()]
            if not bool(torch.isfinite(torch.stack([weight.detach().sum() for weight in weights]).sum())):
                raise TrainingError(f"update {self.iteration + 1} left networks without numbers; {self._left()}")
        else:
            algorithm.storage.clear()
            value_loss = self.progress.window[-1]["value_loss"] if self.progress.window else 0.0
        learned = time.perf_counter()
        self.iteration += 1
        figures = {
            "v_x_square": float(error) / steps,
            "reward": float(reward) / steps / env.cfg.step_dt,
            "clock_match": float(match) / steps,
            "falls_per_hour": float(falls) / (steps * env.cfg.step_dt * env.num_envs / 3600.0),
            "collect_ms": 1e3 * (collected - begin),
            "learn_ms": 1e3 * (learned - collected),
            "value_loss": value_loss,
        }
        row = self.progress.average(self.ranks.means(figures))
        taken = steps * env.num_envs * self.ranks.world
        row["steps_per_second"] = taken / (1e-3 * (row["collect_ms"] + row["learn_ms"]))
        row["learning_rate"] = float(self.algorithm.learning_rate)
        row["action_std"] = float(self.algorithm.get_policy().output_std.detach().mean())
        if self.env.terrain is not None:
            row |= self.ranks.means({"level": float(self.env.arrays.level.float().mean())})
        row["iteration"] = float(self.iteration)
        return row

    def _left(self) -> str:
        """The remedy in a message: the checkpoint to go on from."""
        path = self.cfg.run.out / "checkpoint.pt"
        return f"go on from {path}" if path.is_file() else "no checkpoint was written yet"

    def _check_gate(self, writer: SummaryWriter | None) -> None:
        """Evaluate the policy without exploration against the walking gate; one process does it for all."""
        if writer is None:
            return
        if self.gate_check is None:
            self.gate_check = GateCheck(self.cfg.task)
        actor = self.algorithm.get_policy()
        measured = self.gate_check(lambda obs: actor(obs))
        self.progress.gate_rows.append({"iteration": self.iteration, "seconds": self.seconds, **measured})
        gate = self.gate_check.gate
        writer.add_scalar("gate/v_x_rmse", progress.rmse_at(measured, gate), self.iteration)
        self._say(progress.gate_line(measured, gate))

    def _show(self, bar: ProgressBar, row: dict[str, float]) -> None:
        """Stage, figures and estimated end on the progress bar."""
        if len(self.progress.window) < progress.SETTLED:
            bar("first updates", detail=progress.figures_line(row))
            return
        each = self.progress.update_seconds()
        bar(
            "learning to walk",
            self.iteration / min(self.typical or self.cfg.run.iterations, self.cfg.run.iterations),
            detail=progress.figures_line(row),
            ending=progress.ending(self.iteration, each, self.cfg.run.iterations, self.typical),
        )

    def _say(self, text: str) -> None:
        """Print a line, above the bar where there is one."""
        if self.bar is None:
            print(text, flush=True)
        else:
            self.bar.line(text)

    def _interrupt(self, *_: Any) -> None:
        if self.ranks.main:
            self._say("\nstopping after this update; a second Ctrl-C stops at once")
        self._interrupted = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def _asked_to_stop(self) -> bool:
        """Whether Ctrl-C came to any process, so that all stop after the same update."""
        self._stop = self.ranks.any(self._interrupted)
        return self._stop

    def _finish(self) -> dict[str, Any]:
        out = self.cfg.run.out
        self.save()
        rows, gate_rows = self.progress.rows, self.progress.gate_rows
        unsolved = round(self.ranks.total(float(self.env.sim.unsolved.numpy().sum()))[0])
        steps = self.iteration * self.ppo_cfg["num_steps_per_env"] * self.env.num_envs * self.ranks.world
        result = {
            "gate": gate_rows[-1] if gate_rows else None,
            "gate_passed": self.progress.gate_passed,
            "stopped": "interrupted" if self._stop else "gate" if self._met_gate else "iterations",
            "iterations": self.iteration,
            "seconds": self.seconds,
            "environment_steps": steps,
            "training": rows[-1] if rows else None,
            "unsolved_steps": unsolved,
            "diverged_episodes": self.divergences.count,
            "warnings": asdict(self.env.nan_guard.warnings()),
            "task": record(self.cfg.task),
            "learning": plain(self.cfg.ppo),
            "started_from": self.started_from,
            "processes": self.ranks.world,
        }
        if not self.ranks.main:
            return result
        description = {name: result[name] for name in ("task", "started_from")}
        description |= {"seed": self.cfg.task.seed, "iteration": self.iteration, "command": self.cfg.run.command}
        policy.export_onnx(self.algorithm.get_policy(), out / "policy.onnx", description)
        write_result(out, result, seed=self.cfg.task.seed, command=self.cfg.run.command)
        if gate_rows and (line := progress.rules_line(gate_rows[-1], out)):
            self._say(line)
        with drawing("learning_curve.png"):
            progress.plot(self.progress, out / "learning_curve.png", WalkingGate().scaled(self.env.scales))
        return result


def _of_as_many(content: dict[str, Any], path: Path, processes: int) -> dict[str, Any]:
    """A checkpoint's content: environments and draws of each process that wrote it, who must be as many as now."""
    wrote = 1 + len(content.get("other_ranks", []))  # files of an earlier version are of one process
    if wrote != processes:
        remedy = "without torchrun" if wrote == 1 else f"with 'torchrun --nproc-per-node {wrote}'"
        raise checkpoint.CheckpointError(
            f"{path}: trained by {wrote} process{'es' * (wrote > 1)}, this run has {processes}; resume {remedy}"
        )
    return content
