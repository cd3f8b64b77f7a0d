"""The written-out PPO is rsl-rl's: rollout, update, learning rate and checkpoints; its two threads give one's bits."""

import copy
import threading
from typing import Any

import pytest
import torch
from rsl_rl import algorithms
from rsl_rl.modules import MLP
from tensordict import TensorDict

from mrwarp.rl.net_gradient import NetGradient, linear_layers, output
from mrwarp.rl.ppo import PPO
from mrwarp.rl.ppo_cfg import STEPS_PER_UPDATE, make_ppo_cfg
from mrwarp.runtime import one_torch_thread, silent
from tests.rl.test_trainer import assert_same_bits

ENVS, ACTIONS, COLUMNS = 64, 5, {"actor": 7, "critic": 10}
"""64 environments have two mini-batches of 768 samples."""

SAMPLES = 768
"""Terms of the sums that make a gradient. Two sums of n terms in another order differ by up to n machine epsilons."""

EDGE = 1e-4
"""Distance, as a share of a threshold, from which a decision is the same for all processors: eight hundred float32 eps.

A sample at the edge of a clip has its whole gradient or none, by a rounding: with two mini-batches such a sample moved
``mlp.0.weight`` by 6e-4 of its largest number. A comparison in float32 needs rollouts without one.
"""


class Shape:
    """Interface of an environment for a PPO."""

    num_envs, num_actions = ENVS, ACTIONS


@pytest.fixture(autouse=True)
def one_thread() -> Any:
    """As in a training."""
    with one_torch_thread():
        yield


def observations(dtype: torch.dtype = torch.float32) -> TensorDict:
    """Observations of environments: of unequal size, and away from zero."""
    shown = {group: (3.0 * torch.randn(ENVS, count) + 1.0).to(dtype) for group, count in COLUMNS.items()}
    return TensorDict(shown, batch_size=[ENVS])


def construct(cls: type[algorithms.PPO], dtype: torch.dtype = torch.float32, **settings: Any) -> Any:
    """An algorithm as a training has it, always with the same weights."""
    torch.manual_seed(3)
    cfg = make_ppo_cfg(ENVS, hidden=(32, 16))
    cfg["algorithm"] |= {"class_name": cls, **settings}
    torch.set_default_dtype(dtype)
    try:
        with silent():
            return cls.construct_algorithm(observations(dtype), Shape(), cfg, "cpu")
    finally:
        torch.set_default_dtype(torch.float32)


def collect(algorithm: algorithms.PPO, seed: int, dtype: torch.dtype = torch.float32) -> None:
    """A rollout in which episodes end, some by time-out, with rewards that depend on what was done."""
    torch.manual_seed(seed)
    with torch.inference_mode():
        obs = observations(dtype)
        for k in range(STEPS_PER_UPDATE):
            actions = algorithm.act(obs)
            rewards = obs["actor"][:, 0] * actions[:, 0] - 0.1 * actions.square().sum(1)
            dones = torch.rand(ENVS) < 0.1
            obs = observations(dtype)
            late = {"time_outs": dones & (torch.rand(ENVS) < 0.5)} if k % 3 else {}
            algorithm.process_env_step(obs, rewards, dones, late)
        algorithm.compute_returns(obs)


def give(rollout: Any, to: Any) -> None:
    """Let another algorithm learn from the same rollout."""
    for name in ("rewards", "actions", "dones", "values", "actions_log_prob", "returns", "advantages"):
        setattr(to.storage, name, getattr(rollout.storage, name).clone())
    to.storage.observations = rollout.storage.observations.clone()
    to.storage.distribution_params = tuple(part.clone() for part in rollout.storage.distribution_params)


def move(algorithm: algorithms.PPO, k: int) -> None:
    """Shift actions and values after the rollout, so that ratios and values are clipped, from both sides."""
    with torch.no_grad():
        list(algorithm.actor.mlp.parameters())[-1].add_(0.05 * k)
        list(algorithm.critic.mlp.parameters())[-1].sub_(0.3 * k)


def rounding(dtype: torch.dtype) -> float:
    """Relative difference that the order of a gradient's sum may make: 9e-5 in float32, 2e-13 in float64."""
    return SAMPLES * torch.finfo(dtype).eps


def assert_close(found: Any, expected: Any, rtol: float) -> None:
    """Networks, statistics and moments of the optimiser, each relative to its largest number."""
    found, expected = found.save(), expected.save()
    pairs = [(found[net], expected[net]) for net in ("actor_state_dict", "critic_state_dict")]
    states = [networks["optimizer_state_dict"]["state"] for networks in (found, expected)]
    assert states[0].keys() == states[1].keys() and len(states[0]) == 13
    for ours, theirs in [*pairs, *((states[0][k], states[1][k]) for k in states[0])]:
        assert list(ours) == list(theirs)
        for name in theirs:
            scale = float(theirs[name].abs().max())
            torch.testing.assert_close(ours[name], theirs[name], rtol=rtol, atol=rtol * scale, msg=name)


@pytest.mark.parametrize("batch", [1, 96])
def test_gradient_is_that_of_autograd(batch: int) -> None:
    """Float64, a random linear loss: output and gradient of all weights to 1e-12."""
    model = construct(PPO, torch.float64).actor
    inputs, slope = torch.randn(batch, 7).double(), torch.randn(batch, ACTIONS).double()
    found = model.mlp(inputs)
    expected = torch.autograd.grad(found, list(model.mlp.parameters()), slope)
    with torch.no_grad():
        net = NetGradient(model, batch)
        net.row.fill_(float("nan"))
        for _ in range(2):
            torch.testing.assert_close(net.forward(inputs), found, rtol=1e-12, atol=1e-12)
            net.backward(slope)
        torch.testing.assert_close(output(linear_layers(model), inputs), found, rtol=1e-12, atol=1e-12)
    for parameter, gradient in zip(model.mlp.parameters(), expected, strict=True):
        torch.testing.assert_close(parameter.grad, gradient, rtol=1e-12, atol=1e-12)


def test_rollout_is_that_of_rsl_rl() -> None:
    """Same draws, so the same actions, values, log-probabilities, rewards beyond time-outs, returns and advantages."""
    ours, theirs = construct(PPO), construct(algorithms.PPO)
    for algorithm in (ours, theirs):
        collect(algorithm, 4)
        algorithm.storage.clear()
        collect(algorithm, 5)
    names = ("actions", "rewards", "dones", "values", "actions_log_prob", "returns", "advantages")
    for name in names:
        torch.testing.assert_close(
            getattr(ours.storage, name), getattr(theirs.storage, name), rtol=1e-4, atol=2e-5, msg=name
        )
    for found, expected in zip(ours.storage.distribution_params, theirs.storage.distribution_params, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-5)
    assert_same_bits(ours.storage.observations.to_dict(), theirs.storage.observations.to_dict())
    assert ours.storage.step == theirs.storage.step == STEPS_PER_UPDATE


@pytest.fixture(scope="module")
def first_rollout() -> int:
    """Seed of the first of three rollouts in whose updates no decision hangs on a rounding.

    Clips and the desired divergence a little wider or narrower give the same bits.
    """
    first, found = 6, []
    with one_torch_thread():
        for share in (1.0 - EDGE, 1.0, 1.0 + EDGE):
            algorithm = construct(PPO)
            algorithm.clip_param *= share
            algorithm.desired_kl *= share
            for k in range(3):
                collect(algorithm, first + k)
                move(algorithm, k)
                torch.manual_seed(k)
                algorithm.update()
            found.append([algorithm.actor.state_dict(), algorithm.critic.state_dict()])
    assert_same_bits(found[0], found[1])
    assert_same_bits(found[2], found[1])
    return first


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_update_is_that_of_rsl_rl(dtype: torch.dtype, first_rollout: int) -> None:
    """Three updates on the same rollouts and mini-batches: weights, statistics, optimiser, learning rates, losses."""
    ours, theirs = construct(PPO, dtype), construct(algorithms.PPO, dtype)
    rates, rtol = [], rounding(dtype)
    for k in range(3):
        collect(ours, first_rollout + k, dtype)
        give(ours, theirs)
        for algorithm in (ours, theirs):
            move(algorithm, k)
            torch.manual_seed(k)
            losses = algorithm.update()
            rates.append((algorithm.learning_rate, losses))
            assert algorithm.storage.step == 0
        (found, our_losses), (expected, their_losses) = rates[-2:]
        assert found == expected
        assert our_losses == pytest.approx(their_losses, rel=rtol, abs=rtol)
        assert_close(ours, theirs, rtol)
    assert len({rate for rate, _ in rates}) > 1


def test_a_policy_that_did_not_move_leaves_the_learning_rate() -> None:
    """Before the first step the divergence is 0, not a rounding error above it that would raise the rate."""
    ours = construct(PPO, num_learning_epochs=1, num_mini_batches=1)
    collect(ours, 5)
    ours.update()
    assert ours.learning_rate == 1e-3


@pytest.mark.parametrize("side_by_side", [True, False])
def test_the_critic_learns_alone_when_told(side_by_side: bool) -> None:
    """Actor, noise and learning rate stay as they are while the critic moves; then the actor does too."""
    algorithm = construct(PPO)
    if not side_by_side:
        algorithm._learn_side_by_side = algorithm._learn_in_turn
    actor = [parameter.clone() for parameter in algorithm.actor.parameters()]
    critic = [parameter.clone() for parameter in algorithm.critic.parameters()]
    algorithm.critic_only = True
    for k in range(2):
        collect(algorithm, k)
        algorithm.update()
    assert all(map(torch.equal, algorithm.actor.parameters(), actor))
    assert not any(map(torch.equal, algorithm.critic.parameters(), critic))
    assert algorithm.learning_rate == 1e-3
    algorithm.critic_only = False
    collect(algorithm, 2)
    algorithm.update()
    assert not any(map(torch.equal, algorithm.actor.parameters(), actor))


def test_a_deviation_outside_its_range_is_left_there() -> None:
    """As by autograd, it has no gradient."""
    ours, theirs = construct(PPO, torch.float64), construct(algorithms.PPO, torch.float64)
    for algorithm in (ours, theirs):
        algorithm.actor.distribution.std_range = [0.01, 0.5]  # all start at 0.6
    collect(ours, 5, torch.float64)
    give(ours, theirs)
    for algorithm in (ours, theirs):
        torch.manual_seed(0)
        algorithm.update()
    assert ours.actor.distribution.std_param.detach().eq(0.6).all()
    assert_close(ours, theirs, rounding(torch.float64))


def test_two_threads_give_the_bits_of_one() -> None:
    """Networks, optimiser, rates and losses of four updates; the helper's torch runs on one thread too."""
    found = []
    for name in ("_learn_side_by_side", "_learn_in_turn"):
        algorithm = construct(PPO)
        algorithm._learn_side_by_side = getattr(algorithm, name)
        losses = []
        for k in range(4):
            collect(algorithm, k)
            losses.append(algorithm.update())
        found.append({"networks": algorithm.save(), "rate": algorithm.learning_rate, "losses": losses})
        threads = algorithm._helper.submit(lambda: (threading.current_thread().name, torch.get_num_threads())).result()
        assert threads == ("critic_0", 1)
    assert_same_bits(found[0], found[1])


@pytest.mark.parametrize("net", ["actor", "critic"])
def test_an_error_in_either_thread_ends_the_update(net: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C between the actor's mini-batches, or an error of the critic: nobody waits for ever, and the next works."""
    algorithm = construct(PPO)
    collect(algorithm, 1)
    gradient, calls = getattr(algorithm, f"_{net}_gradient"), []

    def failing(*args: Any) -> Any:
        calls.append(net)
        if len(calls) == 3:
            raise KeyboardInterrupt if net == "actor" else RuntimeError("broken")
        return gradient(*args)

    with monkeypatch.context() as patch:
        patch.setattr(algorithm, f"_{net}_gradient", failing)
        with pytest.raises(KeyboardInterrupt if net == "actor" else RuntimeError):
            algorithm.update()
    algorithm.update()


def test_goes_on_from_what_rsl_rl_saved() -> None:
    """A checkpoint of rsl-rl's PPO, whose optimiser is of another kind, and back."""
    theirs = construct(algorithms.PPO, torch.float64)
    collect(theirs, 1, torch.float64)
    theirs.update()
    ours = construct(PPO, torch.float64)
    ours.load(copy.deepcopy(theirs.save()), None, strict=True)
    assert ours.learning_rate == theirs.learning_rate
    collect(ours, 2, torch.float64)
    give(ours, theirs)
    for algorithm in (ours, theirs):
        torch.manual_seed(0)
        algorithm.update()
    assert_close(ours, theirs, rounding(torch.float64))
    assert ours.optimizer.param_groups[0]["fused"]
    back = construct(algorithms.PPO, torch.float64)
    back.load(copy.deepcopy(ours.save()), None, strict=True)
    assert_close(back, ours, 0.0)


def test_policy_has_the_deviation_of_now() -> None:
    """After an update, and after loading."""
    algorithm = construct(PPO)
    collect(algorithm, 1)
    algorithm.update()
    assert torch.equal(algorithm.get_policy().output_std[0], algorithm.std)
    assert not torch.equal(algorithm.std, torch.full((ACTIONS,), 0.6))
    other = construct(PPO)
    other.load(copy.deepcopy(algorithm.save()), None, strict=True)
    assert torch.equal(other.get_policy().output_std[0], algorithm.std)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"schedule": "fixed"}, "schedule = 'fixed': only 'adaptive'"),
        ({"use_clipped_value_loss": False}, "use_clipped_value_loss = False"),
        ({"normalize_advantage_per_mini_batch": True}, "normalize_advantage_per_mini_batch = True"),
        ({"optimizer": "sgd"}, "SGD: only Adam"),
    ],
)
def test_refuses_what_it_does_not_cover(settings: dict[str, Any], message: str) -> None:
    """Settings of rsl-rl that are not written out, by name."""
    with pytest.raises(ValueError, match=message):
        construct(PPO, **settings)


def test_refuses_other_networks() -> None:
    """Another activation is named, not computed as if it were ELU."""
    model = construct(PPO).actor
    model.mlp = MLP(7, ACTIONS, (32, 16), "relu")
    with pytest.raises(ValueError, match="with ELU between them, got MLPModel"):
        NetGradient(model, 4)
