"""WalkEnv: the walking task as an rsl-rl ``VecEnv``. ``step()`` is the method section of the paper."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
import warp as wp
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from mrwarp.actuator.residual import LearnedTorque, with_bouc_wen
from mrwarp.energy.power import ElectricalCfg, copper_factor
from mrwarp.env import randomize, terminations
from mrwarp.env.cfg import LEARNED, EnvCfg
from mrwarp.env.episodes import Episodes
from mrwarp.env.observations import Observations
from mrwarp.env.rewards import Rewards
from mrwarp.env.sim import ActuatedSim, robot_scene
from mrwarp.env.sim_model import Edit
from mrwarp.env.task_kernels import derived
from mrwarp.env.task_kernels.draws import first_key
from mrwarp.env.terrain import Terrain
from mrwarp.env.watch import Watch
from mrwarp.kernels.launch import Around, Work, in_graphs, in_turn, record
from mrwarp.nn import network_file
from mrwarp.usd.asset import JointActuator, load_robot, with_model
from mrwarp.usd.robot import DEFAULT_Q, LEGS


class WalkEnv(VecEnv):
    """A batch of quadrupeds that follow velocity commands.

    Args:
        cfg: The task.
        edit: Changes to the MuJoCo specification, e.g. a body that falls on the robot.

    Attributes (kept in place: the next step writes into them):
        command: Commanded v_x, v_y [m/s] and yaw rate [rad/s], shape (E, 3).
        phase: Gait clock in [0, 1), shape (E,).
        clock_match: Whether each foot's contact is what the clock wants, bool, shape (E, 4).
        body_velocity: Trunk velocity in the heading frame [m/s], shape (E, 3).
        gravity: Direction of gravity in the trunk frame, shape (E, 3).
        height: Height of the trunk over the ground [m], shape (E,).
        key: What the random draws of the control step follow from, see ``task_kernels.draws``, int64, shape (2,).
        terrain: The height field and where each environment stands on it; None on flat ground.
        ground, foot_ground: Height of the ground below the trunk and below each foot [m], shapes (E,) and (E, 4).
        rewards: Terms and sum of the last policy step.
        push: Kicks the trunks at random; called in every policy step.
        substep_hooks: Called after every torque step of 5 ms, e.g. to record or to push; empty in training.
        fallen: Environments that ended by a fall in the last step, bool, shape (E,).
        broken: Those of them in which a number went wrong, bool, shape (E,); see :class:`mrwarp.env.watch.Watch`.
        watch: Counts them and keeps their last states.
    """

    cfg: EnvCfg

    def __init__(self, cfg: EnvCfg, *, edit: Edit | None = None) -> None:
        self.cfg = cfg
        self.num_envs = cfg.sim.num_envs
        self.device = torch.device(cfg.sim.device)
        self.key = torch.tensor(first_key(cfg.seed), device=self.device)
        asset = load_robot(cfg.asset, robot=cfg.robot, payload=cfg.payload)
        if cfg.actuator_model == "none":
            asset = without_devices(asset)
        if cfg.model is not None:
            asset = with_model(asset, cfg.model)
        residual = None
        if cfg.actuator_model in LEARNED:
            asset, residual = with_learned_torque(asset, cfg)
        self.terrain = Terrain(cfg.terrain, self.num_envs, self.device, seed=cfg.seed) if cfg.terrain else None
        field = self.terrain.field if self.terrain else None
        scene = robot_scene(asset, cfg.sim, cfg.actuator.coupling, edit, field)
        self.robot = ActuatedSim(scene, cfg.sim, cfg.actuator, residual=residual, share_params=False)
        self.sim, self.actuator = self.robot.sim, self.robot.actuator
        if cfg.gains is not None:
            self._set_gains(*cfg.gains)

        sim = self.sim
        self.q, self.qd, self.f_foot = self.view(sim.q), self.view(sim.qd), self.view(sim.f_foot)
        self.root_pos, self.root_quat = self.view(sim.root_pos), self.view(sim.root_quat)
        self.root_vel, self.root_ang = self.view(sim.root_vel), self.view(sim.root_ang)
        self.qvel = self.view(sim.backend.field("qvel"))
        self.q_des = self.view(self.robot.q_des)
        self.current_e = self.view(self.robot.current_e)
        self.substep_hooks: list[Callable[[], None]] = []
        self.nominal_mr = {name: self.view(self.actuator.param(name)).clone() for name in randomize.SCALED}
        self.trunk_mass = float(sim.body_mass("trunk"))

        num_envs = self.num_envs
        self.num_actions = len(DEFAULT_Q)
        self.max_episode_length = cfg.episode_steps
        self.default_q = torch.tensor(DEFAULT_Q, device=self.device)
        group = torch.arange(num_envs, device=self.device) * len(cfg.currents) // num_envs  # eq. 20
        self.current_e.copy_(torch.tensor(cfg.currents, device=self.device)[group])
        self.action = self._zeros(num_envs, self.num_actions)
        self.last_action, self.last_qd = (
            self._zeros(num_envs, self.num_actions),
            self._zeros(num_envs, self.num_actions),
        )
        self.command, self.phase = self._zeros(num_envs, 3), self._zeros(num_envs)
        self.leg_phase = self._zeros(num_envs, len(LEGS))
        self.clock_match = self._zeros(num_envs, len(LEGS)).bool()
        self.gravity, self.body_velocity = self._zeros(num_envs, 3), self._zeros(num_envs, 3)
        self.height, self.ground = self._zeros(num_envs), self._zeros(num_envs)
        self.foot_ground = self._zeros(num_envs, len(LEGS))
        self.effort, self.power = self._zeros(num_envs), self._zeros(num_envs)
        self.privileged = self._zeros(num_envs, 2)
        self.fallen, self.broken = self._zeros(num_envs).bool(), self._zeros(num_envs).bool()
        self._episode_length = torch.zeros(num_envs, dtype=torch.long, device=self.device)
        self.watch = Watch(self.robot, self.action)
        self._around = self._control_step()
        self._apart: list[Work] | None = None
        randomize.at_start(self)
        self.restart()

    @torch.no_grad()
    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One policy step of 20 ms: four torque and physics steps, then rewards, resets and observations.

        On MuJoCo-Warp all of it is one captured graph, see :meth:`_control_step`; the host reads no number.

        Args:
            actions: Joint targets relative to the neutral stance, in units of ``action_scale``, shape (E, 12).

        Returns:
            Observations, rewards (E,), dones (E,) and extras with ``time_outs`` (E,) for bootstrapping.
        """
        self._actions.copy_(actions)
        if self.substep_hooks:
            self._step_with_hooks()
        else:
            self.robot.step(self.cfg.decimation, self._around)
        self.fallen, self.broken, time_outs, done = self._terminations.flags()
        self.last_observations = self._copied_observations()
        return self.last_observations, self._terminations.reward(), done, {"time_outs": time_outs}

    @torch.no_grad()
    def get_observations(self) -> TensorDict:
        """Observation groups ``actor`` (E, 47) and ``critic``; see ``observations.py``.

        The noise belongs to the policy step: seen twice, the same state has the same noise.
        """
        self._observe.launch.launch()
        return self._copied_observations()

    @torch.no_grad()
    def restart(self) -> None:
        """Start over in every environment: same robots, same random draws as a new object of this configuration."""
        self.key.copy_(torch.tensor(first_key(self.cfg.seed)))
        self.actuator.begin_session()
        if self.terrain is not None:
            self.terrain.restart()
        self._reset(torch.ones(self.num_envs, dtype=torch.bool, device=self.device))
        self.effort.zero_()
        self.power.zero_()
        self.fallen, self.broken = torch.zeros_like(self.fallen), torch.zeros_like(self.broken)
        self.watch.forget()
        self.last_observations = self.get_observations()

    def copy_envs(self, source: torch.Tensor) -> None:
        """Make every environment a bit-equal copy of another: environment e continues as ``source[e]``, shape (E,).

        Their currents I_e and what randomisation gave them stay their own.
        """
        state = self.state()
        copied = {
            name: value[source] if value.ndim and value.shape[0] == self.num_envs and name != "key" else value
            for name, value in state.items()
            if name not in ("actuator/params", "actuator/effects_values", "privileged")
        }
        self.load_state({**state, **copied})

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Policy steps since each episode began, shape (E,); rsl-rl's name. Assigning writes into it."""
        return self._episode_length

    @episode_length_buf.setter
    def episode_length_buf(self, steps: torch.Tensor) -> None:
        self._episode_length.copy_(steps)

    def set_command(self, command: torch.Tensor) -> None:
        """Command v_x, v_y [m/s] and yaw rate [rad/s] from now on, shape (E, 3) or (3,)."""
        self.command.copy_(command)

    def state(self) -> dict[str, torch.Tensor]:
        """Copy of everything a resumed run needs, by name; see :meth:`load_state`."""
        own = {name: getattr(self, name).clone() for name in _OWN_STATE}
        own |= {f"last_{group}": self.last_observations[group].clone() for group in ("actor", "critic")}
        physics = {f"sim/{name}": self.view(self.sim.backend.field(name)).clone() for name in _PHYSICS_STATE}
        arrays = {f"sim/{name}": self.view(getattr(self.sim, name)).clone() for name in _SIM_ARRAYS}
        device = {f"actuator/{name}": torch.from_numpy(value) for name, value in self.actuator.state().items()}
        ground = {f"terrain/{name}": value.clone() for name, value in self._terrain_state()}
        return {**own, **physics, **arrays, **device, **ground}

    def load_state(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state` of an environment with the same configuration; it goes on bit-equal."""
        for name in _OWN_STATE:
            getattr(self, name).copy_(state[name])
        for name in _PHYSICS_STATE:
            self.view(self.sim.backend.field(name)).copy_(state[f"sim/{name}"])
        for name in _SIM_ARRAYS:
            self.view(getattr(self.sim, name)).copy_(state[f"sim/{name}"])
        for name, value in self._terrain_state():
            value.copy_(state[f"terrain/{name}"])
        prefix = "actuator/"
        self.actuator.load_state({k.removeprefix(prefix): v.numpy() for k, v in state.items() if k.startswith(prefix)})
        self._update_derived()
        self.last_observations = TensorDict(
            {"actor": state["last_actor"], "critic": state["last_critic"]}, batch_size=[self.num_envs]
        )

    def view(self, array: wp.array) -> torch.Tensor:
        """Torch tensor over the memory of a Warp array."""
        return wp.to_torch(array)

    def _terrain_state(self) -> list[tuple[str, torch.Tensor]]:
        """What the terrain knows of each environment, by name; nothing on flat ground."""
        return [(name, getattr(self.terrain, name)) for name in Terrain.STATE] if self.terrain else []

    def _reset(self, mask: torch.Tensor) -> None:
        """Start a new episode in masked environments, bool (E,), on the tile where each is."""
        self._terminations.end(mask)
        for work in self._episodes.works:
            work()

    def _step_with_hooks(self) -> None:
        """The same torque steps one by one, with every hook called after each."""
        if self._apart is None:
            around, captured = (self._around.before, self._around.after), self.cfg.sim.capture
            self._apart = [in_graphs(works, (), self.sim.device)[0] if captured else in_turn(works) for works in around]
        self._apart[0]()
        for _ in range(self.cfg.decimation):
            self.robot.step()
            for hook in self.substep_hooks:
                hook()
        self._apart[1]()

    def _copied_observations(self) -> TensorDict:
        actor, critic = self._observe.copies()
        return TensorDict({"actor": actor, "critic": critic}, batch_size=[self.num_envs])

    def _update_derived(self) -> None:
        """Quantities that rewards, terminations and observations share."""
        for launch in self._derive:
            launch()

    def derive(self, mask: wp.array) -> list[wp.Launch]:
        """What computes them where the mask, bool (E,), is set."""
        sim, array = self.sim, wp.from_torch
        shared = (self.height, self.gravity, self.body_velocity, self.leg_phase, self.clock_match)
        launch = record(
            derived.derived_kernel,
            dim=self.num_envs,
            inputs=[
                CONTACT_FORCE, mask, sim.root_pos, sim.root_quat, sim.root_vel, array(self.phase), sim.f_foot,
                array(self.ground),
            ],
            outputs=[array(tensor) for tensor in shared],
            device=sim.device,
        )  # fmt: skip
        return [self.terrain.record(self, mask), launch] if self.terrain else [launch]

    def _control_step(self) -> Around:
        """What a policy step does before and after its torque and physics steps, in this order; all on the device."""
        sim, cfg, array = self.sim, self.cfg, wp.from_torch
        self._spent = wp.zeros(self.num_envs, dtype=wp.vec2, device=sim.device)
        motors = ElectricalCfg(winding_resistance=cfg.rewards.winding_resistance)
        self._copper = copper = wp.array(copper_factor(motors), dtype=float, device=sim.device)
        self._actions = self._zeros(self.num_envs, self.num_actions)
        self._everywhere = wp.full(self.num_envs, True, dtype=wp.bool, device=sim.device)
        self._terminations = ends = terminations.Terminations(self, self.watch.broken, self.watch.reward)
        self.rewards, self._observe = Rewards(self, self.watch.reward), Observations(self)
        self.push, self._episodes = randomize.Pushes(self), Episodes(self, ends.done)
        self._derive = [launch.launch for launch in self.derive(self._everywhere)]
        course = self.terrain.record_course(self, ends.rows).launch if self.terrain else None

        def recorded(kernel: Any, inputs: list[Any], outputs: list[Any]) -> Work:
            return record(kernel, dim=self.num_envs, inputs=inputs, outputs=outputs, device=sim.device).launch

        remembered = [array(self.action), array(self.last_action), self.robot.q_des, array(self.last_qd)]
        begin = recorded(
            derived.begin_kernel,
            [cfg.action_scale, array(self.default_q), copper, array(self._actions), sim.qd, self.actuator.ledger],
            [*remembered, self._spent],
        )
        end = recorded(
            derived.end_kernel,
            [
                cfg.gait_frequency * cfg.step_dt, cfg.step_dt, copper, self.actuator.ledger, self._spent,
                array(self.phase),
            ],
            [array(self.effort), array(self.power), array(self.phase), array(self.key)],
        )  # fmt: skip
        return Around(
            before=[begin, self.push],
            after=[
                end,
                *self._derive,
                self.rewards.launch.launch,
                self.watch.check.launch,
                ends.launch.launch,
                self.watch.clear(ends.done).launch,
                *([course] if course else []),
                *self._episodes.works,
                self._observe.launch.launch,
            ],
        )

    def _set_gains(self, kp: float, kd: float) -> None:
        """Give all motors these gains; those with a device keep their low gain while holding."""
        for name, plain, gain in (("kp_base", self.actuator.kp, kp), ("kd", self.actuator.kd, kd)):
            self.view(plain).fill_(gain)
            if self.actuator.mr_joints:
                self.view(self.actuator.param(name)).fill_(gain)

    def _zeros(self, *shape: int) -> torch.Tensor:
        return torch.zeros(*shape, device=self.device)


_OWN_STATE = (
    "action",
    "last_action",
    "last_qd",
    "command",
    "phase",
    "privileged",
    "episode_length_buf",
    "q_des",
    "effort",
    "power",
    "key",
)
_PHYSICS_STATE = ("qpos", "qvel", "qacc_warmstart", "qfrc_applied", "xfrc_applied")
_SIM_ARRAYS = (
    "q", "qd", "friction", "f_foot", "root_pos", "root_quat", "root_vel", "root_ang", "residual", "unsolved",
)  # fmt: skip

CONTACT_FORCE = 5.0
"""Foot force above which a foot counts as touching the ground [N]; the gates' f_th."""


def without_devices(asset: Any) -> Any:
    """The same robot as if no MR device were there: plain motors on all joints."""
    from dataclasses import replace

    plain: tuple[JointActuator, ...] = tuple(replace(actuator, mr=None) for actuator in asset.actuators)
    return replace(asset, actuators=plain)


def with_learned_torque(asset: Any, cfg: EnvCfg) -> tuple[Any, LearnedTorque]:
    """The robot whose devices have the Bouc-Wen coefficients of the learned model's file, and that model in the loop.

    Raises:
        NetworkFileError: the file cannot be used, or holds another kind of model than ``cfg.actuator_model``.
        SamplingRateError: the model was trained at another rate than the torque loop's.
    """
    from dataclasses import replace

    assert cfg.actuator_file is not None  # EnvCfg has checked
    model = network_file.load(cfg.actuator_file)
    if model.kind != cfg.actuator_model:
        raise network_file.NetworkFileError(
            f"{cfg.actuator_file}: holds a {model.kind} model; use --actuator {model.kind} or another file"
        )
    residual = LearnedTorque(
        model, dt=cfg.sim.dt, lstm_state=cfg.lstm_state, threads=cfg.sim.threads, capacity=cfg.window_capacity
    )
    actuators = tuple(replace(a, mr=with_bouc_wen(a.mr, model)) if a.mr else a for a in asset.actuators)
    return replace(asset, actuators=actuators), residual
