"""How much a viewer on four of 64 environments slows the walking environments down: medians of turns in one run."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.runtime import quiet_libraries
from mrwarp.trials.walking import make_env
from mrwarp.viewing.live_view import LiveTraining


def measure(policy: OnnxPolicy, *, num_envs: int = 64, rounds: int = 12, steps: int = 50) -> dict[str, float]:
    """Median time of a policy step without and with the view [ms], and the speed that is left.

    Args:
        policy: Walking policy.
        num_envs: Environments; four of them are shown.
        rounds: Turns, alternating.
        steps: Policy steps per turn.
    """
    env = make_env(TaskCfg(num_envs=num_envs), num_envs, 0)
    env.set_command(torch.tensor([0.5, 0.0, 0.0]))
    obs = env.get_observations()
    with tempfile.TemporaryDirectory() as folder:
        view = LiveTraining(env, rrd=Path(folder) / "live.rrd")
        times = np.zeros((rounds, 2))
        for k in range(-2, rounds):  # the first turns warm up
            for watched in (0, 1):
                begin = time.perf_counter()
                for _ in range(steps):
                    obs, _, _, _ = env.step(policy(obs))
                    if watched:
                        view.update()
                if k >= 0:
                    times[k, watched] = 1e3 * (time.perf_counter() - begin) / steps
        view.close()
    without, with_view = np.median(times, axis=0)
    return {"without_ms": float(without), "with_ms": float(with_view), "speed_left": float(without / with_view)}


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", default=DEFAULT_POLICY, help="exported walking policy")
    for name, value in measure(OnnxPolicy(parser.parse_args().policy)).items():
        print(f"{name:12s} {value:7.3f}")
