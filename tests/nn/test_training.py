"""Training: learns, keeps the best epoch, stops early, and gives the same bits for the same seed."""

import numpy as np
import pytest
import torch

from mrwarp.nn.models import make_net
from mrwarp.nn.training import FitCfg, History, WindowSet, fit, rmse


def make_sets(samples: int, seed: int = 0, noise: float = 0.0) -> tuple[WindowSet, WindowSet]:
    """Training and validation set of torque = qd(t) - 0.5*qd(t - 2 samples) + current."""
    rng = np.random.default_rng(seed)

    def part(count: int) -> WindowSet:
        features, targets = [], []
        for _ in range(count):
            x = rng.normal(size=(300, 3)) * [0.3, 3.0, 0.5] + [0.1, 0.0, 0.7]
            y = x[:, 1] - 0.5 * np.concatenate([[0.0, 0.0], x[:-2, 1]]) + x[:, 2]
            features.append(x)
            targets.append(y + noise * rng.normal(size=300))
        return WindowSet(features, targets, samples)

    return part(8), part(2)


def test_mlp_learns_a_function_of_three_samples() -> None:
    """The error falls below a tenth of the target's spread, on trajectories that were not trained on."""
    train, validation = make_sets(3)
    net = make_net("mlp", seed=0)
    cfg = FitCfg(epochs=40, windows_per_epoch=1000, batch=32, average=0.99)
    history = fit(net, train, validation, cfg)
    assert rmse(net, validation) < 0.1 * float(validation.targets.std())
    assert history.validation_rmse[history.best_epoch - 1] == min(history.validation_rmse)


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_training_is_reproducible(kind: str) -> None:
    """Same seed, same bits; another seed, other weights."""
    weights = []
    for seed in (1, 1, 2):
        train, validation = make_sets(3 if kind == "mlp" else 50)
        net = make_net(kind, seed=seed)
        fit(net, train, validation, FitCfg(epochs=2, windows_per_epoch=300, batch=100, seed=seed))
        weights.append(torch.cat([p.detach().flatten() for p in net.parameters()]))
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def test_training_fits_the_scaler_on_the_training_set_only() -> None:
    """Validation samples far away do not move the scaler."""
    train, validation = make_sets(3)
    mean = train.features.mean(0)
    validation.features += 100.0
    net = make_net("mlp")
    fit(net, train, validation, FitCfg(epochs=1, windows_per_epoch=100))
    assert torch.allclose(net.scaler.mean, mean, atol=1e-6)


def test_training_stops_early_and_keeps_the_best_epoch() -> None:
    """On pure noise the validation error soon rises: patience ends the run and the best weights are returned."""
    train, validation = make_sets(3)
    generator = torch.Generator().manual_seed(0)
    train.targets = torch.randn(train.targets.shape, generator=generator)
    validation.targets = torch.randn(validation.targets.shape, generator=generator)
    net = make_net("mlp")
    history = fit(net, train, validation, FitCfg(epochs=200, windows_per_epoch=3000, batch=32, average=0.9, patience=3))
    assert history.stopped == "patience"
    assert len(history.epoch) == history.best_epoch + 3
    assert rmse(net, validation) == pytest.approx(min(history.validation_rmse), rel=1e-6)


def test_ctrl_c_ends_the_training_with_the_best_weights() -> None:
    """An interrupt during the third epoch returns a usable network and says so."""
    train, validation = make_sets(3)

    def interrupt(history: History, cfg: FitCfg) -> None:
        del cfg
        if len(history.epoch) == 3:
            raise KeyboardInterrupt

    net = make_net("mlp")
    history = fit(net, train, validation, FitCfg(epochs=50, windows_per_epoch=500, average=0.9), interrupt)
    assert history.stopped == "interrupted"
    assert rmse(net, validation) == pytest.approx(min(history.validation_rmse), rel=1e-6)


def test_training_refuses_empty_sets_and_nonsense() -> None:
    """Trajectories shorter than a window, and recipes out of range."""
    train, validation = make_sets(50)
    short = WindowSet([np.zeros((20, 3))], [np.zeros(20)], 50)
    with pytest.raises(ValueError, match="validation set is as long as a window of 50"):
        fit(make_net("lstm"), train, short, FitCfg(epochs=1))
    assert len(validation) > 0
