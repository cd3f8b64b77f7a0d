"""The arrays of the walking task, each listed once; checkpoint, reset and copy follow from what is said of it here."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, Self

import torch
import warp as wp

from mrwarp.env.sim import ActuatedSim

_PREFIX = {"task": "", "robot": "", "sim": "sim/", "engine": "sim/", "terrain": "terrain/"}
"""Beginning of an array's name in a checkpoint, by its owner; the actuator saves its own."""


@dataclass(frozen=True, kw_only=True)
class ArraySpec:
    """Description of an array."""

    shape: str
    """Axes: E environments, J joints, A actions, L legs, M devices, T reward terms, O and C observations; or sizes."""
    unit: str
    """Unit; empty for plain numbers and for axes of several units."""
    dtype: torch.dtype = torch.float32
    """Type of its numbers."""
    owner: str = "task"
    """Who holds the memory: ``task``, ``terrain`` (of the task, on a height field), ``robot``, ``sim``, ``engine``
    (a field of the physics backend) or ``device`` (the actuator)."""
    saved: bool = False
    """Part of a checkpoint."""
    cleared: bool = False
    """Zero when an episode begins; ``robot``, ``sim``, ``engine`` and ``device`` reset theirs themselves."""
    own: bool = False
    """A property of its robot: stays where it is when one environment's state is copied to another."""


def array(shape: str, unit: str = "", **said: Any) -> Any:
    """Field of :class:`WalkState`, see :class:`ArraySpec`."""
    return field(metadata={"array": ArraySpec(shape=shape, unit=unit, **said)})


@dataclass(kw_only=True, eq=False)
class WalkState:
    """The arrays that the parts of the task read and write, as torch tensors that stay where they are."""

    # action
    actions: torch.Tensor = array("E A")
    """The policy's actions of this step."""
    action: torch.Tensor = array("E A", saved=True, cleared=True)
    """Action in use: joint targets relative to the neutral stance, in units of the action scale."""
    last_action: torch.Tensor = array("E A", saved=True, cleared=True)
    """Action of the step before."""
    default_q: torch.Tensor = array("J", "rad")
    """Neutral stance."""
    q_des: torch.Tensor = array("E J", "rad", owner="robot", saved=True)
    """Joint targets."""
    current_e: torch.Tensor = array("E", "A", owner="robot")
    """Current I_e that an environment may use."""
    current_command: torch.Tensor = array("E M", "A", owner="robot")
    """Current that is commanded of each device, see :mod:`mrwarp.env.commands`."""
    strength: torch.Tensor = array("E M")
    """Yield torque that the current's law expects of each device, as a share of the nominal one."""

    # physics
    q: torch.Tensor = array("E J", "rad", owner="sim", saved=True)
    """Joint positions."""
    qd: torch.Tensor = array("E J", "rad/s", owner="sim", saved=True)
    """Joint velocities."""
    last_qd: torch.Tensor = array("E J", "rad/s", saved=True, cleared=True)
    """Joint velocities at the begin of the policy step."""
    f_foot: torch.Tensor = array("E L", "N", owner="sim", saved=True)
    """Norm of the contact force of each foot."""
    root_pos: torch.Tensor = array("E 3", "m", owner="sim", saved=True)
    """Position of the trunk in the world."""
    root_quat: torch.Tensor = array("E 4", owner="sim", saved=True)
    """Orientation of the trunk, quaternion (w, x, y, z)."""
    root_vel: torch.Tensor = array("E 3", "m/s", owner="sim", saved=True)
    """Velocity of the trunk in the world."""
    root_ang: torch.Tensor = array("E 3", "rad/s", owner="sim", saved=True)
    """Angular velocity of the trunk in its own frame."""
    friction: torch.Tensor = array("E J", "N·m", owner="sim", saved=True)
    """Torque of the brake constraint in the last physics step."""
    residual: torch.Tensor = array("E", "N·m", owner="sim", saved=True)
    """Largest component of the constraint solver's residual in the last physics step."""
    unsolved: torch.Tensor = array("E", dtype=torch.int32, owner="sim", saved=True)
    """Physics steps whose residual was too large, since the beginning."""
    qpos: torch.Tensor = array("E nq", owner="engine", saved=True)
    """Positions in MuJoCo's layout, in the engine's precision."""
    qvel: torch.Tensor = array("E nv", owner="engine", saved=True)
    """Velocities in MuJoCo's layout, in the engine's precision."""
    qacc_warmstart: torch.Tensor = array("E nv", owner="engine", saved=True)
    """Where the solver begins its next solve."""
    qfrc_applied: torch.Tensor = array("E nv", owner="engine", saved=True)
    """Torques in MuJoCo's layout."""
    xfrc_applied: torch.Tensor = array("E nbody 6", owner="engine", saved=True)
    """Forces and torques that push bodies."""

    # devices
    m_dyn: torch.Tensor = array("E M", owner="device")
    """Dynamic gate (eq. 5)."""
    m_hold: torch.Tensor = array("E M", owner="device")
    """Holding gate (eq. 8)."""
    current: torch.Tensor = array("E M", "A", owner="device")
    """Coil current."""
    tau_motor: torch.Tensor = array("E J", "N·m", owner="device")
    """Motor torque."""
    ledger: torch.Tensor = array("E J entries", owner="device")
    """Energy ledger since the episode began, see :mod:`mrwarp.kernels.ledger`."""

    # what rewards, terminations and observations share
    height: torch.Tensor = array("E", "m")
    """Height of the trunk over the ground."""
    gravity: torch.Tensor = array("E 3")
    """Direction of gravity in the trunk frame."""
    body_velocity: torch.Tensor = array("E 3", "m/s")
    """Velocity of the trunk in the heading frame."""
    leg_phase: torch.Tensor = array("E L")
    """Phase of each leg in [0, 1): stance in the first half, swing in the second."""
    clock_match: torch.Tensor = array("E L", dtype=torch.bool)
    """Whether a foot's contact is what the gait clock wants."""
    effort: torch.Tensor = array("E", "(N·m)^2", saved=True)
    """Squared motor torques, mean over the policy step."""
    power: torch.Tensor = array("E", "W", saved=True)
    """Electrical power of motors and coils, mean over the policy step."""
    spent: torch.Tensor = array("E 2", "(N·m)^2 s, J")
    """Integral of the squared motor torques and electrical energy up to the begin of the policy step."""

    # terrain
    ground: torch.Tensor = array("E", "m")
    """Height of the ground below the trunk."""
    foot_ground: torch.Tensor = array("E L", "m")
    """Height of the ground below each foot."""
    level: torch.Tensor = array("E", dtype=torch.int64, owner="terrain", saved=True)
    """Level of the tile of each environment."""
    kind: torch.Tensor = array("E", dtype=torch.int64, owner="terrain", saved=True)
    """Kind of the tile of each environment."""
    walked: torch.Tensor = array("E", "m", owner="terrain", saved=True, cleared=True)
    """Path length along the heading in this episode."""
    commanded: torch.Tensor = array("E", "m", owner="terrain", saved=True, cleared=True)
    """Path length that was commanded in this episode."""

    # episode
    command: torch.Tensor = array("E 3", "m/s, m/s, rad/s", saved=True)
    """Commanded v_x, v_y and yaw rate."""
    phase: torch.Tensor = array("E", saved=True)
    """Gait clock in [0, 1)."""
    episode_length_buf: torch.Tensor = array("E", "policy steps", dtype=torch.int64, saved=True, cleared=True)
    """Age of the episode; rsl-rl's name."""
    torque_steps: torch.Tensor = array("E", "torque steps", dtype=torch.int32, cleared=True)
    """Age of the episode as the NaN guard counts it."""
    privileged: torch.Tensor = array("E 2", "1, kg", saved=True, own=True)
    """Friction of the ground and mass added to the trunk."""
    key: torch.Tensor = array("2", dtype=torch.int64, saved=True)
    """Origin of random draws: seed and policy step, see :mod:`mrwarp.env.rng`."""

    # what a policy step gives
    terms: torch.Tensor = array("E T")
    """Reward terms in the order of ``rewards.TERMS``."""
    total: torch.Tensor = array("E")
    """Weighted sum of the terms over the policy step; 0 between policy steps."""
    reward: torch.Tensor = array("E")
    """Reward that reaches the learner."""
    diverged: torch.Tensor = array("E", dtype=torch.int32)
    """1 where a number went wrong in this policy step."""
    flags: torch.Tensor = array("4 E", dtype=torch.bool)
    """Who has fallen, who diverged, whose time is up, who is done: rows of ``terminations``."""
    actor: torch.Tensor = array("E O")
    """Observations of the actor."""
    critic: torch.Tensor = array("E C")
    """Observations of the critic."""

    @classmethod
    def of(cls, robot: ActuatedSim, device: torch.device, **sizes: int) -> Self:
        """Arrays of a robot's simulation, and zeros for those of the task.

        Args:
            robot: The simulation.
            device: Device of the task's arrays.
            sizes: Sizes of the task's axes by their letters.
        """
        owners = {"robot": robot, "sim": robot.sim, "device": robot.actuator}
        sizes |= {str(n): n for n in range(10)}
        arrays = {}
        for name, spec in _SPECS.items():
            if spec.owner == "engine":
                arrays[name] = wp.to_torch(robot.sim.backend.field(name))
            elif spec.owner in owners:
                arrays[name] = wp.to_torch(getattr(owners[spec.owner], name))
            else:
                shape = [sizes[axis] for axis in spec.shape.split()]
                arrays[name] = torch.zeros(shape, dtype=spec.dtype, device=device)
        return cls(**arrays)

    def saved(self, *, terrain: bool) -> Iterator[tuple[str, ArraySpec, torch.Tensor]]:
        """Name in a checkpoint, specification and tensor of every array that is saved; those of a terrain if asked."""
        for name, spec in _SPECS.items():
            if spec.saved and (terrain or spec.owner != "terrain"):
                yield f"{_PREFIX[spec.owner]}{name}", spec, getattr(self, name)

    def cleared(self) -> tuple[wp.array, wp.array]:
        """Addresses of the arrays that a reset clears, and how many words one environment has; for clear_rows."""
        arrays = [getattr(self, name) for name, spec in _SPECS.items() if spec.cleared]
        pointers = [tensor.data_ptr() for tensor in arrays]
        words = [tensor[0].numel() * tensor.element_size() // 4 for tensor in arrays]
        device = str(arrays[0].device)
        return wp.array(pointers, dtype=wp.uint64, device=device), wp.array(words, dtype=int, device=device)


_SPECS: dict[str, ArraySpec] = {entry.name: entry.metadata["array"] for entry in fields(WalkState)}


@wp.func_native("""
for (int k = 0; k < pointers.shape[0]; ++k) {
    int* row = (int*)pointers.data[k] + size_t(env) * words.data[k];
    for (int i = 0; i < words.data[k]; ++i) row[i] = 0;
}
""")
def clear_rows(pointers: wp.array[wp.uint64], words: wp.array[int], env: int) -> None:
    """Zero an environment's rows of the arrays of :meth:`WalkState.cleared`."""
    ...
