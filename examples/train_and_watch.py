"""A quadruped with brakes at its calves: a walking policy on four currents, then a few updates of a training.

Run: ``python examples/train_and_watch.py`` (``mrwarp train`` and ``mrwarp play`` do this in full)
"""

from pathlib import Path

import torch

import mrwarp
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from mrwarp.runtime import quiet_libraries


def main(out: Path = Path("runs/example-training"), updates: int = 2) -> None:
    """Walk 4 s at 0.4 m/s by the shipped policy, then train a new one for some updates."""
    policy, env = mrwarp.OnnxPolicy(DEFAULT_POLICY), mrwarp.WalkEnv(mrwarp.TaskCfg(num_envs=4, randomize=None))
    observations = env.get_observations()
    command = torch.tensor([[0.4, 0.0, 0.0]]).expand(4, 3)
    start = env.root_pos[:, 0].clone()
    for _ in range(200):
        env.set_command(command)
        observations, _, done, _ = env.step(policy(observations))
        assert not done.any(), "a robot fell"
    for current, metres in zip(env.current_e.tolist(), (env.root_pos[:, 0] - start).tolist(), strict=True):
        print(f"coil current up to {current:.1f} A: {metres:.2f} m in 4 s")

    cfg = TrainCfg(task=mrwarp.TaskCfg(num_envs=16), run=RunCfg(out=out, iterations=updates, no_gate=True))
    result = Trainer(cfg).run()
    print(f"{result['iterations']} updates, policy in {out}; watch it: mrwarp play --policy {out / 'policy.onnx'}")


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    main()
