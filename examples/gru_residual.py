"""A learned torque of your own shape: train a GRU on bench recordings, then let robots stand on joints that use it.

Run: ``python examples/gru_residual.py``
"""

import torch

from mrwarp.actuator.residual import LearnedTorque
from mrwarp.bench.virtual_bench import BenchCfg, run_bench
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.identify import learn
from mrwarp.runtime import quiet_libraries


class Gru(torch.nn.Module):
    """24 units whose state is carried from sample to sample; the output is added to eq. 14 (paper eq. 16)."""

    state_size = 24

    def __init__(self) -> None:
        super().__init__()
        self.gru, self.out = torch.nn.GRU(3, self.state_size), torch.nn.Linear(self.state_size, 1)

    def step(self, x: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Torque (N,) and next state (N, 24) of one sample (q_c, qd, current) per joint (N, 3)."""
        out, state = self.gru(x[None], state[None])
        return self.out(out[0])[:, 0], state[0]


def main(epochs: int = 60) -> None:
    """Train on six runs, print the error on two others, and stand for a second."""
    torch.manual_seed(0)
    data = run_bench(BenchCfg(seed=0, trajectories=8, samples=8000, evaluation_samples=0)).fit
    device = learn.bench_parameters(None)
    eq14 = learn.bouc_wen_torque(data, device)
    missing = [run.torque - tau for run, tau in zip(data.trajectories, eq14, strict=True)]
    x, y = (  # pieces of 100 samples: (sample, piece, feature) and (sample, piece)
        torch.cat([torch.from_numpy(run[:1000]).float().reshape(10, 100, -1) for run in runs]).transpose(0, 1)
        for runs in (learn.features(data, device), missing)
    )
    net, unseen = Gru(), 20  # the last two runs' pieces
    optimiser = torch.optim.Adam(net.parameters(), lr=1e-2)
    for _ in range(epochs):
        optimiser.zero_grad()
        (net.out(net.gru(x[:, :-unseen])[0]) - y[:, :-unseen]).square().mean().backward()
        optimiser.step()
    before, after = y[:, -unseen:], (net.out(net.gru(x[:, -unseen:])[0]) - y[:, -unseen:]).detach()
    rmse = [mismatch.square().mean().sqrt().item() for mismatch in (before, after)]
    print(f"two unseen runs: RMSE of eq. 14 {rmse[0]:.3f} N·m, with the GRU {rmse[1]:.3f} N·m")

    env = WalkEnv(TaskCfg(num_envs=16, randomize=None), residual=LearnedTorque(net, dt=0.005))
    for _ in range(50):
        env.step(torch.zeros(16, env.num_actions))
    print(f"16 robots stood for 1 s at {env.height.mean():.3f} m")


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    main()
