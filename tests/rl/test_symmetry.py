"""Networks stay symmetric through training, without a step that differs from that of the symmetrised loss."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict

from mrwarp.env.cfg import TaskCfg
from mrwarp.rl import trainer as trainer_module
from mrwarp.rl.mirror import SignedPermutation, mirror_of
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.rl.symmetry import SymmetricNetwork
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from tests.rl.test_mirror import image

UNITS = 128
"""Terms of the longest sum in a layer: two sums of n terms in another order differ by up to n machine epsilons of the
largest term."""


def outputs(model: MLPModel, inputs: torch.Tensor) -> torch.Tensor:
    """Outputs of a network."""
    with torch.no_grad():
        return model.mlp(model.obs_normalizer(inputs))


def make_trainer(out: Path, *, symmetry: bool = True) -> Trainer:
    """A short training with 8 robots."""
    learning = PpoCfg(symmetry=symmetry)
    return Trainer(TrainCfg(task=TaskCfg(num_envs=8), ppo=learning, run=RunCfg(out=out, iterations=3)))


@pytest.mark.usefixtures("short_gate")
def test_networks_stay_symmetric_through_training(tmp_path: Path) -> None:
    """The mirrored observation's action is the mirrored action, its value the same; without the setting neither is."""
    for symmetry in (True, False):
        run = make_trainer(tmp_path / str(symmetry), symmetry=symmetry)
        mirror = mirror_of(run.env)
        for _ in range(3):
            run.update()
        actor, critic = run.algorithm.actor, run.algorithm.critic
        seen, known = (torch.randn(20, len(part.index)) for part in (mirror.actor, mirror.critic))
        action, value = outputs(actor, seen), outputs(critic, known)
        off_action = outputs(actor, image(seen, mirror.actor)) - image(action, mirror.action)
        off_value = outputs(critic, image(known, mirror.critic)) - value
        bound = UNITS * torch.finfo(torch.float32).eps * 10.0  # normalised inputs reach 10
        largest = float(off_action.abs().max() / action.abs().max()), float(off_value.abs().max() / value.abs().max())
        assert all(off < bound for off in largest) if symmetry else all(off > 0.01 for off in largest)
        std = run.algorithm.std
        assert torch.equal(std, std[torch.from_numpy(mirror.action.index)]) == symmetry


def test_the_averaged_gradient_is_that_of_the_symmetrised_loss() -> None:
    """By autograd in float64: a loss over samples and their mirror images, each with half the weight."""
    torch.manual_seed(0)
    seen = SignedPermutation(index=np.array([1, 0, 2]), sign=np.array([1.0, 1.0, -1.0]))
    given = SignedPermutation(index=np.array([1, 0]), sign=np.array([-1.0, -1.0]))
    model = _plain(3, 2)
    network = SymmetricNetwork(model, seen, given)
    network.begin(drawn=True)
    inputs, wanted = torch.randn(40, 3), torch.randn(40, 2)

    def gradient(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        model.zero_grad()
        (model.mlp(x) - y).square().mean().backward()
        parts = [torch.zeros_like(p) if p.grad is None else p.grad for p in model.parameters()]
        return torch.cat([part.flatten() for part in parts])

    row = gradient(inputs, wanted)
    both = 0.5 * (row + gradient(image(inputs, seen), image(wanted, given)))
    network.average(row)
    assert torch.allclose(row, both, rtol=0.0, atol=40 * torch.finfo(torch.float32).eps * float(both.abs().max()))


def test_an_odd_layer_is_refused() -> None:
    """Its units cannot be exchanged in pairs."""
    keep = SignedPermutation.keep
    with pytest.raises(ValueError, match="a hidden layer of 5 units"):
        SymmetricNetwork(_plain(3, 2, hidden=5), keep(1.0, 1.0, -1.0), keep(1.0, -1.0))


@pytest.mark.usefixtures("short_gate")
def test_a_robot_without_a_mirror_is_trained_without_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A note names the reason; training goes on."""

    def none(env: object) -> None:
        raise trainer_module.NoMirrorError("leg RL: no leg stands at its mirror image")

    monkeypatch.setattr(trainer_module, "mirror_of", none)
    run = make_trainer(tmp_path)
    run.update()
    assert "note: trained without left-right symmetry (leg RL: no leg" in capsys.readouterr().out


@pytest.mark.usefixtures("short_gate")
def test_an_asymmetric_policy_is_not_averaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A training that begins with one keeps its actor and says why; one that begins with a symmetric one stays so."""
    cfg = TrainCfg(task=TaskCfg(num_envs=8), run=RunCfg(out=tmp_path / "on", iterations=1))
    make_trainer(tmp_path / "off", symmetry=False).run()
    asymmetric = tmp_path / "off" / "policy.onnx"
    old = OnnxPolicy(asymmetric)
    capsys.readouterr()
    run = Trainer(cfg, start_from=asymmetric)
    assert "without left-right symmetry (the policy that it begins with has none)" in capsys.readouterr().out
    seen = run.env.get_observations()["actor"]
    assert torch.allclose(outputs(run.algorithm.actor, seen), old(seen), atol=1e-4)
    Trainer(TrainCfg(task=TaskCfg(num_envs=8), run=RunCfg(out=tmp_path / "first", iterations=1))).run()
    second = Trainer(cfg, start_from=tmp_path / "first" / "checkpoint.pt")
    assert second.algorithm.symmetric_of(second.algorithm.actor) is not None


def _plain(inputs: int, outputs_: int, hidden: int = 8) -> MLPModel:
    """A small network as PPO has them."""
    seen = TensorDict({"actor": torch.zeros(1, inputs)}, batch_size=[1])
    groups = {"actor": ["actor"]}
    return MLPModel(seen, groups, "actor", outputs_, hidden_dims=[hidden], activation="elu", obs_normalization=True)
