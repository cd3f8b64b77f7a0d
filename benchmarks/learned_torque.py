"""Speed of walking with the learned torque in the loop against the same walk without it, interleaved in one run.

``python benchmarks/learned_torque.py --policy policy.onnx --model model.safetensors``: nothing else should run.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.nn import network_file as model_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import quiet_libraries
from mrwarp.trials.walking import make_env


def measure_speed(
    policy: OnnxPolicy, file: str, *, num_envs: int = 64, rounds: int = 40, steps: int = 10, threads: int = 0
) -> dict[str, float]:
    """Walk at 0.5 m/s in two batches, one with the learned torque, a few steps of each in turn.

    Args:
        policy: Walking policy.
        file: Trained network.
        num_envs: Environments of each batch.
        rounds: Turns.
        steps: Policy steps per turn.
        threads: CPU threads; 0 = all.

    Returns:
        Median time of a policy step without and with it [ms], their ratio (the speed that is left), and the mean
        number of open windows.
    """
    kind = model_file.load(file).kind
    base: TaskCfg = TaskCfg(num_envs=num_envs, threads=threads)
    learned = TaskCfg(num_envs=num_envs, threads=threads, actuator=kind, actuator_file=file)
    envs = [make_env(cfg, num_envs, 0) for cfg in (base, learned)]
    command = torch.zeros(num_envs, 3)
    command[:, 0] = 0.5
    observations = []
    for env in envs:
        env.set_command(command)
        observations.append(env.get_observations())
    times, windows = np.zeros((rounds, 2)), []
    for k in range(-5, rounds):  # the first turns warm up and are not counted
        for i, env in enumerate(envs):
            begin = time.perf_counter()
            for _ in range(steps):
                observations[i], _, _, _ = env.step(policy(observations[i]))
                env.set_command(command)
            if k >= 0:
                times[k, i] = (time.perf_counter() - begin) / steps * 1e3
        windows.append(float(envs[1].view(envs[1].actuator.m_dyn).sum()))
    without, with_it = np.median(times, axis=0)
    return {
        "without_ms": float(without),
        "with_ms": float(with_it),
        "ratio": float(without / with_it),
        "best_ratio": float(times[:, 0].min() / times[:, 1].min()),
        "open_windows": float(np.mean(windows)),
    }


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True, help="policy.onnx of train/ppo.py")
    parser.add_argument("--model", required=True, help="model.safetensors of mrwarp learn")
    parser.add_argument("--threads", type=int, default=0)
    args = parser.parse_args()
    for name, value in measure_speed(OnnxPolicy(args.policy), args.model, threads=args.threads).items():
        print(f"{name:14s} {value:8.3f}")
