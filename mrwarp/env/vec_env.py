"""WalkEnv: the walking task as an rsl-rl ``VecEnv``; :meth:`WalkEnv._policy_step` is the paper's method as code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
import warp as wp
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from mrwarp.actuator.mr_actuator import PROPERTIES
from mrwarp.actuator.residual import LearnedTorque, with_bouc_wen
from mrwarp.energy.power import ElectricalCfg, copper_as_go1, copper_factor
from mrwarp.enums import LEARNED, CurrentCommand
from mrwarp.env import commands, events, gait, observations, rewards, terminations
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.nan_guard import NanGuard
from mrwarp.env.natural_units import in_natural_units, scales
from mrwarp.env.rng import MOST_JOINTS, first_key
from mrwarp.env.sim import ActuatedSim, robot_scene
from mrwarp.env.sim_model import Edit
from mrwarp.env.state import WalkState
from mrwarp.env.terrain import Terrain
from mrwarp.kernels.launch import Launch
from mrwarp.nn import network_file
from mrwarp.params import MrParams
from mrwarp.usd.asset import RobotAsset, load_robot, most_current, with_model
from mrwarp.usd.robot import MR_GO, CurrentShares


class WalkEnv(VecEnv):
    """A batch of legged robots that follow velocity commands: an rsl-rl ``VecEnv``.

    Example:
        >>> import mrwarp, torch
        >>> env = mrwarp.WalkEnv(mrwarp.TaskCfg(num_envs=4))
        >>> observations, reward, done, extras = env.step(torch.zeros(4, env.num_actions))
        >>> observations["actor"].shape[0], reward.shape
        (4, torch.Size([4]))

    Args:
        cfg: The task, in numbers of the shipped robot; ``env.cfg`` has them in proportion to its own.
        edit: Changes to the MuJoCo specification, e.g. a body that falls on the robot.
        residual: Learned torque of all devices, e.g. ``LearnedTorque(my_module, dt=cfg.dt)``, in place of one of
            ``cfg.actuator_file``. The devices keep their own coefficients of eqs. 14 and 15.

    Attributes:
        arrays: Everything the task computes with, kept in place: the next step writes into it. The arrays that are
            read most stand here too, e.g. ``env.q``; see :class:`mrwarp.env.state.WalkState` for all of them.
        layout, scales: Trunk, legs and joints of the robot; its size relative to the shipped one's.
        robot, sim, actuator: The robot, its physics, its motors and devices.
        terrain: The height field and its curriculum; None on flat ground.
        contact_force: Foot force above which a foot touches the ground [N], the gates' ``f_th``.
        step_graph: The sequence of a policy step, and its captured graphs.
        nan_guard: Counts the environments in which a number went wrong, and keeps their last states.
        substep_hooks: Called after every torque step of 5 ms, e.g. to record or to push; empty in training.
        fallen: Environments that ended by a fall in the last step, bool, shape (E,).
        diverged: Those of them in which a number went wrong, bool, shape (E,).
        last_observations: What the last step returned.
    """

    cfg: TaskCfg
    task: TaskCfg
    """As given, in numbers of the shipped robot."""

    def __init__(self, cfg: TaskCfg, *, edit: Edit | None = None, residual: LearnedTorque | None = None) -> None:
        rewards.check(cfg.rewards)
        self.task = cfg
        self.num_envs = cfg.num_envs
        self.device = torch.device(cfg.device)
        self.max_episode_length = cfg.episode_steps
        asset, trained = _asset(cfg)
        if (driven := len(asset.actuators)) > MOST_JOINTS:
            raise ValueError(
                f"{asset.path}: {driven} joints are driven; at most {MOST_JOINTS} are simulated: hold some"
            )
        _check_price(cfg, asset)
        if trained is not None and residual is not None:
            raise ValueError(f"actuator = {cfg.actuator!r} brings a learned torque; give no other residual")
        self.terrain = Terrain(cfg.terrain, self.num_envs, seed=cfg.seed) if cfg.terrain else None
        scene = robot_scene(asset, cfg, cfg.coupling, edit, self.terrain and self.terrain.field)
        commanded = cfg.current_by is not CurrentCommand.FIXED
        choices = {"residual": residual or trained, "share_params": False, "commanded": commanded}
        self.robot = ActuatedSim(scene, cfg, cfg, **choices)
        self.sim, self.actuator, self.substep_hooks = self.robot.sim, self.robot.actuator, self.robot.hooks
        if cfg.gains is not None:
            self._set_gains(*cfg.gains)

        self.layout, self.scales = scene.layout, scales(scene)
        gates = [a.mr.gate.f_th for a in asset.actuators if a.mr]
        self.contact_force = gates[0] if gates else MrParams().gate.f_th * self.scales.mass
        self.cfg = cfg = in_natural_units(cfg, scene)
        joints, legs, devices = len(scene.actuators), len(scene.layout.legs), len(self.actuator.mr_joints)
        currents = devices if cfg.current_by is CurrentCommand.LEARNED else 0
        self.num_actions = joints + currents
        columns = observations.critic_columns(joints, self.sim.f_foot.shape[1], devices, currents)
        observed = sum(observations.actor_terms(joints, currents).values())
        sizes = {"E": self.num_envs, "A": self.num_actions, "J": joints, "L": legs, "M": devices}
        sizes |= {"T": len(rewards.TERMS)}
        self.arrays = s = WalkState.of(self.robot, self.device, **sizes, O=observed, C=columns)
        self.q, self.qd, self.q_des, self.f_foot = s.q, s.qd, s.q_des, s.f_foot
        self.root_pos, self.root_quat, self.root_vel, self.root_ang = s.root_pos, s.root_quat, s.root_vel, s.root_ang
        self.qvel, self.current_e, self.default_q, self.privileged = s.qvel, s.current_e, s.default_q, s.privileged
        self.action, self.last_action, self.command, self.phase = s.action, s.last_action, s.command, s.phase
        self.height, self.gravity, self.body_velocity = s.height, s.gravity, s.body_velocity
        self.clock_match, self.effort, self.power, self.key = s.clock_match, s.effort, s.power, s.key
        self.default_q.copy_(torch.tensor(scene.layout.default_q))
        s.strength.fill_(1.0)
        if isinstance(cfg.currents, CurrentShares):
            self.cfg = cfg = replace(cfg, currents=cfg.currents.of(most_current(asset.actuators)))
        group = torch.arange(self.num_envs, device=self.device) * len(cfg.currents) // self.num_envs  # eq. 20
        self.current_e.copy_(torch.tensor(cfg.currents, device=self.device)[group])
        self.nan_guard = NanGuard(self.robot, s)
        self._record_parts()
        self._observe_end: list[Launch] = []
        self.step_graph = self.robot.graph(self._policy_step())
        if cfg.randomize is not None:
            events.randomize_robots(s, cfg.randomize, cfg.seed, self.sim, self.actuator)
        self.restart()

    @torch.no_grad()
    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One policy step of 20 ms: what :meth:`_policy_step` lists, run as captured graphs.

        On MuJoCo-Warp all of it is one graph; the host reads no number.

        Args:
            actions: Joint targets relative to the neutral stance, in units of ``action_scale``, and where the policy
                commands the coils a current each, see :mod:`mrwarp.env.commands`; shape (E, A).

        Returns:
            Observations, rewards (E,), dones (E,) and extras with ``time_outs`` (E,) for bootstrapping; tensors of
            their own, which later steps do not write into.
        """
        self.arrays.actions.copy_(actions)
        self.step_graph.run(self.robot.on_host())
        self.fallen, self.diverged, time_outs, done = self.arrays.flags.clone().unbind()
        self.last_observations = self._observed()
        return self.last_observations, self.arrays.reward.clone(), done, {"time_outs": time_outs}

    def _policy_step(self) -> list[Launch]:
        """A policy step from top to bottom, as the launches that :meth:`step` repeats."""
        robot, actuator = self.robot, self.actuator
        torque_step = [
            robot.before_step,
            actuator.predict,  # gates (eqs. 5, 8), coil, history (eq. 12), Bouc-Wen laws (eqs. 14, 15)
            actuator.add_residual,  # learned residual (eq. 16)
            actuator.torque,  # torques of motor and device, or the brake's bound (eqs. 2, 6, 9, 19)
            self.nan_guard.keep,
            *robot.physics,  # torques to the solver, engine, state from the solver
            actuator.account,  # energy ledger
            robot.after_step,
        ]
        return [
            self._take_actions,
            *self._command_current,
            *self._push,
            *torque_step * self.cfg.decimation,
            self._account,  # effort, power, gait clock
            *self._derive,  # what the following share
            self._reward,
            self.nan_guard.check,
            self._terminate,
            *self._observe_end,
            *self._curriculum,
            *self._begin_episodes,
            self._draw_commands,
            self._observe,
        ]

    def _record_parts(self) -> None:
        """Prepare the launches of the task's parts, each defined in a file of its own."""
        s, cfg, terrain, actuator = self.arrays, self.cfg, self.terrain, self.actuator
        everywhere = wp.full(self.num_envs, True, dtype=wp.bool, device=self.sim.device)
        done = wp.from_torch(s.flags[terminations.DONE])
        legs = gait.legs_of(self.sim.scene, str(self.sim.device))

        def derive(mask: wp.array) -> list[Launch]:
            ground = [terrain.heights(s, legs, mask)] if terrain else []
            return [*ground, gait.derive(s, mask, self.contact_force, legs)]

        copper = wp.array(self._copper(), dtype=float, device=str(self.sim.device))
        self._take_actions = commands.take_actions(s, cfg.action_scale, copper)
        self._command_current = commands.command_current(s, cfg.current_by, actuator.params, actuator.joint_of)
        self._account = commands.account(s, copper, cfg.step_dt, cfg.gait_frequency)
        self._push = events.push(s, cfg.randomize, cfg.step_dt)
        self._derive = derive(everywhere)
        self._reward = rewards.reward(s, cfg.rewards, cfg.step_dt, legs)
        self._terminate = terminations.terminate(s, cfg.fall_height, cfg.fall_tilt, cfg.episode_steps, cfg.fall_cost)
        self._curriculum = [terrain.curriculum(s, cfg.step_dt)] if terrain else []
        self._begin_episodes = [
            *events.begin_episodes(s, self.sim, done, terrain.origins if terrain else None),
            *events.draw_devices(s, cfg.randomize, actuator, done),
            partial(actuator.reset, done),
            *derive(done),
        ]
        self._draw_commands = commands.draw_commands(s, cfg.commands, cfg.step_dt, done)
        self._observe = observations.observe(s, cfg.noise)

    @torch.no_grad()
    def get_observations(self) -> TensorDict:
        """Observation groups ``actor`` (E, O) and ``critic``; see ``observations.py``.

        The noise belongs to the policy step: seen twice, the same state has the same noise.
        """
        self._observe()
        return self._observed()

    def keep_final_observations(self) -> TensorDict:
        """Let each step also observe how episodes end, before the next ones begin; returns where that then stands."""
        s = self.arrays
        final = TensorDict(
            {"actor": torch.zeros_like(s.actor), "critic": torch.zeros_like(s.critic)}, batch_size=[self.num_envs]
        )
        self._observe_end = [observations.observe(s, self.cfg.noise, (final["actor"], final["critic"]))]
        self.step_graph = self.robot.graph(self._policy_step())
        return final

    @torch.no_grad()
    def begin_episodes(self, mask: torch.Tensor) -> None:
        """Begin another episode in masked environments, bool, shape (E,); the random draws go on."""
        self._reset(mask)
        self._update_derived()
        self.last_observations = self.get_observations()

    @torch.no_grad()
    def restart(self, seed: int | None = None) -> None:
        """Start over in every environment: same robots, same random draws as a new object of this configuration.

        Args:
            seed: Seed of the draws from now on; None is the configuration's. Robots and ground stay as they were made.
        """
        s = self.arrays
        s.key.copy_(torch.tensor(first_key(self.cfg.seed if seed is None else seed)))
        self.actuator.begin_session()
        if self.terrain is not None:
            self.terrain.restart(s)
        self._reset(torch.ones(self.num_envs, dtype=torch.bool, device=self.device))
        s.effort.zero_()
        s.power.zero_()
        self.fallen, self.diverged = torch.zeros_like(s.flags[0]), torch.zeros_like(s.flags[0])
        self.nan_guard.forget()
        self.last_observations = self.get_observations()

    def copy_envs(self, source: torch.Tensor, state: Mapping[str, torch.Tensor] | None = None) -> None:
        """Make every environment a bit-equal copy of another: environment e continues as ``source[e]``, shape (E,).

        Their currents I_e and what randomisation gave them stay their own.

        Args:
            source: Number of the environment that each continues as.
            state: :meth:`state` of other environments of the same task, of any number, to copy from.
        """
        own, saved = self.state(), list(self.arrays.saved(terrain=True))
        state = own if state is None else state
        kept = {*(f"actuator/{name}" for name in PROPERTIES), *(name for name, spec, _ in saved if spec.own)}
        shared = {name for name, spec, _ in saved if spec.shape[0] != "E"}
        shared |= {name for name, value in own.items() if len(value) != self.num_envs}
        copied = {name: state[name] if name in shared else state[name][source] for name in own.keys() - kept}
        self.load_state(own | copied)

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Policy steps since each episode began, shape (E,); rsl-rl's name. Assigning writes into it."""
        return self.arrays.episode_length_buf

    @episode_length_buf.setter
    def episode_length_buf(self, steps: torch.Tensor) -> None:
        self.arrays.episode_length_buf.copy_(steps)

    def set_command(self, command: torch.Tensor) -> None:
        """Command v_x, v_y [m/s] and yaw rate [rad/s] from now on, shape (E, 3) or (3,)."""
        self.command.copy_(command)

    def state(self) -> dict[str, torch.Tensor]:
        """Copy of everything a resumed run needs, by name; see :meth:`load_state`."""
        arrays = {name: value.clone() for name, _, value in self.arrays.saved(terrain=self.terrain is not None)}
        device = {f"actuator/{name}": torch.from_numpy(value) for name, value in self.actuator.state().items()}
        seen = {f"last_{group}": self.last_observations[group].clone() for group in ("actor", "critic")}
        return {**arrays, **device, **seen}

    def load_state(self, state: dict[str, torch.Tensor]) -> None:
        """Restore :meth:`state` of an environment with the same configuration; it goes on bit-equal."""
        for name, _, value in self.arrays.saved(terrain=self.terrain is not None):
            value.copy_(state[name])
        prefix = "actuator/"
        self.actuator.load_state({k.removeprefix(prefix): v.numpy() for k, v in state.items() if k.startswith(prefix)})
        self._update_derived()
        seen = {group: state[f"last_{group}"].to(self.device) for group in ("actor", "critic")}
        self.last_observations = TensorDict(seen, batch_size=[self.num_envs])

    def view(self, array: wp.array) -> torch.Tensor:
        """Torch tensor over the memory of a Warp array."""
        return wp.to_torch(array)

    def _reset(self, mask: torch.Tensor) -> None:
        """Start a new episode in masked environments, bool (E,), on the tile where each is."""
        self.arrays.flags[terminations.DONE] = mask
        for launch in (*self._begin_episodes, self._draw_commands):
            launch()

    def _update_derived(self) -> None:
        """Quantities that rewards, terminations and observations share."""
        for launch in self._derive:
            launch()

    def _observed(self) -> TensorDict:
        """Copies of what actor and critic see."""
        s = self.arrays
        return TensorDict({"actor": s.actor.clone(), "critic": s.critic.clone()}, batch_size=[self.num_envs])

    def _copper(self) -> np.ndarray:
        """Copper loss of each motor per torque squared [W/(N·m)^2], shape (J,)."""
        cfg, actuators = ElectricalCfg(winding_resistance=self.cfg.rewards.winding_resistance), self.sim.scene.actuators
        if self.layout == MR_GO:
            return copper_factor(cfg)
        return copper_as_go1(np.array([actuator.tau_limit for actuator in actuators]), self.scales.power, cfg)

    def _set_gains(self, kp: float, kd: float) -> None:
        """Give all motors these gains; those with a device keep their low gain while holding."""
        for name, plain, gain in (("kp_base", self.actuator.kp, kp), ("kd", self.actuator.kd, kd)):
            self.view(plain).fill_(gain)
            if self.actuator.mr_joints:
                self.view(self.actuator.param(name)).fill_(gain)


def _check_price(cfg: TaskCfg, asset: RobotAsset) -> None:
    """Refuse a price of power where what the coils take is not known: the policy would take them for free.

    Raises:
        ValueError: a device's coil has no resistance, and may be used.
    """
    dark = [a.joint for a in asset.actuators if a.mr and a.mr.coil.coil_resistance == 0.0]
    price = 0.0 - rewards.weight(cfg.rewards, "power")
    if price and cfg.sal and max(cfg.currents) > 0.0 and dark:
        raise ValueError(
            f"--power-price {price:g}: the coil resistance of {', '.join(dark)} is not known, so coils "
            "would cost nothing; state it with 'mrwarp fit --coil-resistance R', or leave the price out"
        )


def _asset(cfg: TaskCfg) -> tuple[RobotAsset, LearnedTorque | None]:
    """The robot with the devices of the task, and a learned torque to run in the loop.

    A learned model brings its own Bouc-Wen coefficients; ``actuator`` none leaves plain motors on all joints.

    Raises:
        NetworkFileError: the network's file cannot be used, or holds another kind of model than the task's, or one that
            learned another device than the joints'.
        SamplingRateError: the network was trained at another rate than the torque loop's.
    """
    asset = load_robot(cfg.asset, robot=cfg.robot, payload=cfg.payload)
    if cfg.actuator == "none":
        asset = replace(asset, actuators=tuple(replace(a, mr=None) for a in asset.actuators))
    if cfg.model is not None:
        asset = with_model(asset, cfg.model, extrapolate=cfg.extrapolate)
    own = {"coil_time_constant": cfg.coil_lag, "eps_hold": cfg.hold_speed}
    if given := {name: value for name, value in own.items() if value is not None}:
        actuators = (replace(a, mr=a.mr.replace(**given)) if a.mr else a for a in asset.actuators)
        asset = replace(asset, actuators=tuple(actuators))
    if cfg.actuator not in LEARNED:
        return asset, None
    file = cfg.network
    assert file is not None  # TaskCfg has checked
    model = network_file.load(file)
    if model.kind != cfg.actuator:
        raise network_file.NetworkFileError(
            f"{file}: holds a {model.kind} model; use --actuator {model.kind} or another file"
        )
    residual = LearnedTorque(
        model,
        dt=cfg.dt,
        engine=cfg.residual_engine,
        lstm_state=cfg.lstm_state,
        threads=cfg.threads,
        capacity=cfg.window_capacity,
    )
    try:
        actuators = tuple(replace(a, mr=with_bouc_wen(a.mr, model, a.effects)) if a.mr else a for a in asset.actuators)
    except network_file.OtherDeviceError as error:
        raise network_file.NetworkFileError(f"{file}: {error}") from None
    return replace(asset, actuators=actuators), residual
