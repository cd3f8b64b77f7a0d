"""rsl-rl's PPO written out for small networks: the same mathematics, to rounding, in a fraction of the calls.

Outputs and gradients go without autograd (:mod:`mrwarp.rl.net_gradient`).
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import torch
from rsl_rl import algorithms
from rsl_rl.models import MLPModel
from rsl_rl.modules import GaussianDistribution
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch.optim.adam import adam

from mrwarp.rl.mirror import Mirror, NoMirrorError
from mrwarp.rl.net_gradient import NetGradient, inputs, linear_layers, output
from mrwarp.rl.symmetry import SymmetricNetwork, symmetric_networks

COVERED = {
    "schedule": "adaptive",
    "use_clipped_value_loss": True,
    "normalize_advantage_per_mini_batch": False,
    "use_mixed_precision": False,
    "rnd": None,
    "symmetry": None,
}
"""The values of rsl-rl's settings that are written out here."""

_Losses = dict[str, list[torch.Tensor]]


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """N samples of a rollout with J actions, in a shuffled order that all passes share."""

    actor_inputs: torch.Tensor
    """Normalised observations of the actor, shape (N, inputs)."""
    critic_inputs: torch.Tensor
    """Normalised observations of the critic, shape (N, inputs)."""
    actions: torch.Tensor
    """Actions, shape (N, J)."""
    means: torch.Tensor
    """Means of the collecting policy, shape (N, J)."""
    log_probs: torch.Tensor
    """Log-probabilities of the actions under the collecting policy, shape (N,)."""
    costs: torch.Tensor
    """Advantages with the sign of a cost, shape (N,)."""
    values: torch.Tensor
    """Values that the critic gave when collecting, shape (N,)."""
    returns: torch.Tensor
    """Returns, shape (N,)."""

    @classmethod
    def of(cls, storage: RolloutStorage, actor: MLPModel, critic: MLPModel, order: torch.Tensor) -> Rollout:
        """The samples of a storage, in another order.

        Args:
            storage: A full rollout of a policy whose first distribution parameter is the mean.
            actor: Normalises its observations.
            critic: Normalises its observations.
            order: Numbers step * num_envs + environment of the samples, shape (N,).
        """

        def taken(values: torch.Tensor) -> torch.Tensor:
            return values.flatten(0, 1).index_select(0, order)

        def taken_by(model: MLPModel) -> torch.Tensor:
            return inputs(model, {group: taken(storage.observations[group]) for group in model.obs_groups})

        assert storage.distribution_params is not None
        return cls(
            actor_inputs=taken_by(actor),
            critic_inputs=taken_by(critic),
            actions=taken(storage.actions),
            means=taken(storage.distribution_params[0]),
            log_probs=taken(storage.actions_log_prob)[:, 0],
            costs=taken(storage.advantages)[:, 0].neg(),
            values=taken(storage.values)[:, 0],
            returns=taken(storage.returns)[:, 0],
        )

    def split(self, size: int) -> list[Rollout]:
        """Mini-batches of ``size`` samples."""
        parts = {name: values.split(size) for name, values in vars(self).items()}
        count = len(self.actions) // size
        return [Rollout(**{name: values[k] for name, values in parts.items()}) for k in range(count)]


class PPO(algorithms.PPO):
    """rsl-rl's PPO for plain networks and a Gaussian policy.

    All passes over a rollout take the same mini-batches, so these are gathered and normalised once; nothing is drawn
    that is not used. On a CPU the critic learns in a second thread.

    Attributes:
        critic_only: Whether updates leave the actor's weights and noise as they are, until a new critic knows it.

    Raises:
        ValueError: a setting or network that is not written out here.
    """

    def __init__(self, actor: MLPModel, critic: MLPModel, storage: RolloutStorage, **settings: Any) -> None:
        super().__init__(actor, critic, storage, **settings)
        for name, covered in COVERED.items():
            if (found := getattr(self, name, "no such setting")) != covered:
                raise ValueError(f"PPO with {name} = {found!r}: only {covered!r} is covered; use rsl-rl's own PPO")
        if type(self.optimizer) is not torch.optim.Adam:
            raise ValueError(f"PPO with {type(self.optimizer).__name__}: only Adam is covered; use rsl-rl's own PPO")
        distribution = actor.distribution
        if type(distribution) is not GaussianDistribution or distribution.std_type != "scalar":
            raise ValueError(f"PPO with {distribution}: only a GaussianDistribution of std_type 'scalar' is covered")
        self.critic_only = False
        self._symmetric: dict[MLPModel, SymmetricNetwork] = {}
        self._distribution = distribution
        self._std_then = self.std
        self._actor_layers, self._critic_layers = linear_layers(actor), linear_layers(critic)
        weights = [*self.actor.parameters(), *self.critic.parameters()]
        self.optimizer = torch.optim.Adam(weights, lr=self.learning_rate, fused=True)
        self._observations = dict(storage.observations.items())
        self._means = torch.zeros_like(storage.actions)
        self._time_outs = torch.zeros_like(storage.rewards)
        self._helper = ThreadPoolExecutor(1, thread_name_prefix="critic")  # idle, and not started, until work comes

    def load(self, loaded_dict: dict, load_cfg: dict | None, strict: bool) -> bool:
        """Load networks and optimiser; see :meth:`rsl_rl.algorithms.PPO.load`."""
        optimizer = loaded_dict["optimizer_state_dict"]
        # a file of rsl-rl's own PPO says otherwise, and torch places what it loads by that
        groups = [{**group, "fused": True} for group in optimizer["param_groups"]]
        fused = {**loaded_dict, "optimizer_state_dict": {**optimizer, "param_groups": groups}}
        found = super().load(fused, load_cfg, strict)
        if self._symmetric and not self._symmetric[self.actor].holds():  # it began with a policy that was not
            self._symmetric = {}
        return found

    def be_symmetric(self, mirror: Mirror, *, drawn: bool) -> None:
        """Make both networks symmetric and keep them so; ``drawn``: their weights were drawn at random.

        Raises:
            NoMirrorError: they were not drawn, and the actor is not symmetric: its average with its mirror image would
                be another policy.
        """
        actor, critic = symmetric_networks(self.actor, self.critic, mirror)
        if not drawn and not actor.holds():
            raise NoMirrorError("the policy that it begins with has none")
        self._symmetric = {self.actor: actor, self.critic: critic}
        for network in self._symmetric.values():
            network.begin(drawn=drawn)

    @torch.no_grad()
    def get_policy(self) -> MLPModel:
        """The actor, with the deviation of now: it is not called in training, which would set it."""
        self._distribution.update(self._means[0])
        return super().get_policy()

    @property
    def std(self) -> torch.Tensor:
        """Standard deviation of the actions, shape (J,)."""
        return self._distribution.std_param.detach().clamp(*self._distribution.std_range)

    @torch.no_grad()
    def act(self, obs: TensorDict) -> torch.Tensor:
        """Draw actions, shape (E, J); the storage takes them and what they were drawn from."""
        storage = self.storage
        step = storage.step
        mean = output(self._actor_layers, inputs(self.actor, obs))
        actions = torch.addcmul(mean, torch.randn_like(mean), self.std)
        for group, kept in self._observations.items():
            kept[step].copy_(obs[group])
        storage.actions[step].copy_(actions)
        self._means[step].copy_(mean)
        return actions

    @torch.no_grad()
    def process_env_step(
        self, obs: TensorDict, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, torch.Tensor]
    ) -> None:
        """Take what a step gave: rewards, dones, and ``time_outs`` if there are any, shapes (E,)."""
        storage = self.storage
        step = storage.step
        storage.rewards[step, :, 0].copy_(rewards)
        storage.dones[step, :, 0].copy_(dones)
        self._time_outs[step, :, 0] = extras["time_outs"] if "time_outs" in extras else 0.0
        storage.step += 1

    @torch.no_grad()
    def compute_returns(self, obs: TensorDict) -> None:
        """Complete the rollout: values, log-probabilities, rewards beyond time-outs, returns and advantages.

        Values and log-probabilities of all steps at once cost less than those of one step after the other.
        """
        storage, std = self.storage, self.std
        storage.values.copy_(output(self._critic_layers, inputs(self.critic, storage.observations)))
        storage.rewards += self.gamma * storage.values * self._time_outs
        z = (storage.actions - self._means).div_(std)
        storage.actions_log_prob[:, :, 0] = z.square_().sum(-1).mul_(-0.5).sub_(_log_norm(std))
        storage.distribution_params = (self._means, std.expand_as(self._means).contiguous())
        super().compute_returns(obs)

    @torch.no_grad()
    def update(self) -> dict[str, float]:
        """Learn from the rollout.

        Returns:
            Means over all mini-batches of the ``value`` and ``surrogate`` losses and of the ``entropy``.
        """
        storage = self.storage
        size = storage.num_envs * storage.num_transitions_per_env // self.num_mini_batches
        order = torch.randperm(self.num_mini_batches * size, device=self.device)
        batches = Rollout.of(storage, self.actor, self.critic, order).split(size) * self.num_learning_epochs
        actor, critic = _Learner(self, self.actor, size), _Learner(self, self.critic, size)
        assert storage.distribution_params is not None
        self._std_then = storage.distribution_params[1][0, 0]  # that of all samples
        learn = self._learn_in_turn if self.is_multi_gpu or order.is_cuda else self._learn_side_by_side
        losses = learn(actor, critic, batches)
        storage.clear()
        return {name: float(torch.stack(values).mean()) for name, values in losses.items()}

    def _learn_in_turn(self, actor: _Learner, critic: _Learner, batches: list[Rollout]) -> _Losses:
        """Both networks take a mini-batch before the next one."""
        losses: _Losses = {"value": [], "surrogate": [], "entropy": []}
        for batch in batches:
            kl = self._actor_gradient(actor, batch, losses)
            self._adapt_learning_rate(kl)
            self._critic_gradient(critic, batch, losses)
            if self.is_multi_gpu:
                self.reduce_parameters()
            if not self.critic_only:
                actor.step(self.learning_rate)
            critic.step(self.learning_rate)
        observations = self.storage.observations.flatten(0, 1)
        self._update_normalization(self.actor, observations)
        self._update_normalization(self.critic, observations)
        return losses

    def _learn_side_by_side(self, actor: _Learner, critic: _Learner, batches: list[Rollout]) -> _Losses:
        """The critic learns in a second thread, which torch's operators leave free to run.

        All it needs of the actor are the learning rates. Each network's work is done by one thread in the same order,
        so the bits are those of :meth:`_learn_in_turn`.
        """
        losses: _Losses = {"value": [], "surrogate": [], "entropy": []}
        rates: SimpleQueue[float | None] = SimpleQueue()
        observations = self.storage.observations.flatten(0, 1)
        threads = torch.get_num_threads()
        work = self._helper.submit(self._learn_critic, threads, critic, batches, rates, observations, losses)
        try:
            for batch in batches:
                kl = self._actor_gradient(actor, batch, losses)
                self._adapt_learning_rate(kl)
                rates.put(self.learning_rate)
                if not self.critic_only:
                    actor.step(self.learning_rate)
            self._update_normalization(self.actor, observations)
        finally:
            rates.put(None)  # should there be no more, the critic must not wait for them
            work.result()
        return losses

    @torch.no_grad()
    def _learn_critic(
        self,
        threads: int,
        critic: _Learner,
        batches: list[Rollout],
        rates: SimpleQueue[float | None],
        observations: TensorDict,
        losses: _Losses,
    ) -> None:
        """The critic's part, until the rates end."""
        torch.set_num_threads(threads)  # a new thread's first product would take all cores, and give other bits
        for batch in batches:
            self._critic_gradient(critic, batch, losses)
            if (rate := rates.get()) is None:
                return
            critic.step(rate)
        self._update_normalization(self.critic, observations)

    def symmetric_of(self, model: MLPModel) -> SymmetricNetwork | None:
        """The symmetry that a network is held to; None for a plain one."""
        return self._symmetric.get(model)

    def _update_normalization(self, model: MLPModel, observations: TensorDict) -> None:
        model.update_normalization(observations)
        if symmetric := self.symmetric_of(model):
            symmetric.average_normaliser()

    def _actor_gradient(self, net: NetGradient, batch: Rollout, losses: _Losses) -> torch.Tensor:
        """Gradient of surrogate loss and entropy bonus; returns the divergence from the collecting policy.

        With z = (action - mean) / std, an action's log-probability is -sum(z^2 / 2 + log(std) + log(2 pi) / 2); its
        gradient is z / std for the mean and (z^2 - 1) / std for the standard deviation.
        """
        std = self.std
        mean = net.forward(batch.actor_inputs)
        z = (batch.actions - mean).div_(std)
        square = z.square()
        log_norm = _log_norm(std)
        ratio = square.sum(1).mul_(-0.5).sub_(log_norm).sub_(batch.log_probs).exp_()

        # added up in torch.distributions' order: exactly 0 before the first step, when no rate is to be adapted
        shrink = (self._std_then / std).square()
        divergence = (batch.means - mean).div_(std).square_().add_(shrink).sub_(1.0).sub_(shrink.log())

        surrogate = batch.costs * ratio
        clipped = batch.costs * ratio.clamp(1.0 - self.clip_param, 1.0 + self.clip_param)
        # the surrogate is its own derivative by the log-probability; a larger clipped one does not change
        slope = torch.where(surrogate < clipped, 0.0, surrogate).div_(len(ratio))
        parameter = self._distribution.std_param
        of_std = torch.mv(square.sub_(1.0).t(), slope).sub_(self.entropy_coef).div_(std)
        net.gradients[parameter].copy_(of_std.mul_(parameter == std))  # no slope where the range holds it
        net.backward(z.mul_(slope[:, None]).div_(std))
        losses["surrogate"].append(torch.maximum(surrogate, clipped).mean())
        losses["entropy"].append(log_norm + 0.5 * len(std))
        return divergence.sum(1).mean() * 0.5

    def _critic_gradient(self, net: NetGradient, batch: Rollout, losses: _Losses) -> None:
        """Gradient of the value loss, in which a value may change by ``clip_param``."""
        values = net.forward(batch.critic_inputs)[:, 0]
        change = values - batch.values
        within = change.clamp(-self.clip_param, self.clip_param)
        off = values - batch.returns
        loss, clipped = off.square(), (batch.values + within).sub_(batch.returns).square_()
        moves = (within == change).logical_or_(loss >= clipped)
        net.backward((off * moves).mul_(2.0 * self.value_loss_coef / len(off))[:, None])
        losses["value"].append(torch.maximum(loss, clipped).mean())

    def _adapt_learning_rate(self, kl: torch.Tensor) -> None:
        """Keep the divergence near the desired one; all ranks take the rate of the first."""
        if self.is_multi_gpu:
            torch.distributed.all_reduce(kl)
            kl /= self.gpu_world_size
        if self.gpu_global_rank == 0:
            found = float(kl)
            if found > 2.0 * self.desired_kl:
                self.learning_rate = max(1e-5, self.learning_rate / 1.5)
            elif 0.0 < found < 0.5 * self.desired_kl:
                self.learning_rate = min(1e-2, self.learning_rate * 1.5)
        if self.is_multi_gpu:
            rate = torch.tensor(self.learning_rate, device=self.device)
            torch.distributed.broadcast(rate, src=0)
            self.learning_rate = rate.item()
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate


class _Learner(NetGradient):
    """A network with its part of the optimiser, whose steps the networks take separately."""

    def __init__(self, ppo: PPO, model: MLPModel, batch: int) -> None:
        super().__init__(model, batch)
        self._max_norm, self._symmetric = ppo.max_grad_norm, ppo.symmetric_of(model)
        self._group = ppo.optimizer.param_groups[0]
        self._to_move: list[torch.Tensor] = [*self.gradients]
        self._along = [*self.gradients.values()]
        states = [ppo.optimizer.state[parameter] for parameter in self.gradients]
        for state, parameter in zip(states, self.gradients, strict=True):
            if not state:
                state["step"] = torch.zeros((), device=parameter.device)
                state["exp_avg"] = torch.zeros_like(parameter)
                state["exp_avg_sq"] = torch.zeros_like(parameter)
        self._steps, self._means, self._squares = (
            [state[name] for state in states] for name in ("step", "exp_avg", "exp_avg_sq")
        )

    def step(self, rate: float) -> None:
        """Clip the gradient, averaged with its mirror image where the network is symmetric; take a step along it."""
        if self._symmetric is not None:
            self._symmetric.average(self.row)
        self.row *= (self._max_norm / (torch.linalg.vector_norm(self.row) + 1e-6)).clamp_(max=1.0)
        beta1, beta2 = self._group["betas"]
        adam(
            self._to_move,
            self._along,
            self._means,
            self._squares,
            [],
            self._steps,
            lr=rate,
            beta1=beta1,
            beta2=beta2,
            eps=self._group["eps"],
            weight_decay=0.0,
            amsgrad=False,
            maximize=False,
            fused=True,
        )


def _log_norm(std: torch.Tensor) -> torch.Tensor:
    """Logarithm of the factor by which the density of a Gaussian with these deviations is divided, shape ()."""
    return std.log().sum() + 0.5 * len(std) * math.log(2.0 * math.pi)
