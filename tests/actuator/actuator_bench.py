"""A few joints with devices over a toy plant, for tests of the actuator."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.mr_actuator import ActuatorInputs, MrActuator
from mrwarp.model_file import Effect
from mrwarp.params import MrParams
from tests.kernels.law_kernels import f32

EPS = float(np.finfo(np.float32).eps)
DT = 0.005
LEGS = [0, 0, 0, 1, 1, 1]
CALVES = (2, 5)
INERTIA = 0.02
"""Inertia of a joint of the toy plant [kg·m^2], about that of a calf."""


@dataclass(frozen=True)
class Joint:
    """The least that an actuator needs to know of a joint."""

    joint: str
    mr: MrParams | None
    effects: tuple[Effect, ...] = ()
    kp: float = 25.0
    kd: float = 0.6
    tau_limit: float = 23.7


def make_inputs(num_envs: int, joints: int, legs: int = 1, device: str = "cpu") -> ActuatorInputs:
    """An actuator's arrays, all 0."""
    columns = {"q_des": joints, "q": joints, "qd": joints, "f_foot": legs, "friction": joints}
    arrays = {name: wp.zeros((num_envs, count), dtype=float, device=device) for name, count in columns.items()}
    return ActuatorInputs(**arrays, current_e=wp.zeros(num_envs, dtype=float, device=device))


def make_joints(mr: bool = True, effects: tuple[Effect, ...] = ()) -> list[Joint]:
    """Two legs of three joints; the calves carry a device, and the two devices differ: the second has the effects."""
    devices = {2: MrParams(), 5: MrParams().replace(coil_time_constant=0.02, K1=5.0)}
    return [
        Joint(f"joint_{i}", devices.get(i) if mr else None, effects if i == 5 else (), kp=25.0 + i) for i in range(6)
    ]


@wp.kernel
def toy_plant_kernel(
    # parameters [kg·m^2, s]
    inertia: float,
    dt: float,
    # in, shape (E, J)
    tau_in: wp.array2d[float],
    bound_in: wp.array2d[float],
    # out, shape (E, J)
    q_out: wp.array2d[float],
    qd_out: wp.array2d[float],
    friction_out: wp.array2d[float],
):
    """Free joints with dry friction, by semi-implicit Euler: friction stops the joint if its bound allows."""
    env, joint = wp.tid()
    free = qd_out[env, joint] + dt * tau_in[env, joint] / inertia
    friction = wp.clamp(-free * inertia / dt, -bound_in[env, joint], bound_in[env, joint])
    qd = free + dt * friction / inertia
    qd_out[env, joint] = qd
    q_out[env, joint] = q_out[env, joint] + dt * qd
    friction_out[env, joint] = friction


class Bench:
    """An actuator on its own input arrays and the toy plant."""

    def __init__(
        self,
        num_envs: int,
        cfg: MrActuatorCfg | None = None,
        joints: Sequence[Joint] | None = None,
        residual: Any = None,
        share_params: bool = True,
        legs: Sequence[int] = LEGS,
    ) -> None:
        self.joints = list(joints or make_joints())
        self.inputs = make_inputs(num_envs, len(legs), max(legs) + 1)
        self.actuator = MrActuator(
            self.joints, legs, self.inputs, dt=DT, cfg=cfg, residual=residual, share_params=share_params
        )
        for name in ("m_dyn", "m_hold", "tau_dyn", "tau_mr", "tau_motor", "tau", "bound"):
            getattr(self.actuator, name).fill_(float("nan"))

    def write(self, **values: np.ndarray | float) -> None:
        """Overwrite input arrays."""
        for name, value in values.items():
            array = getattr(self.inputs, name)
            array.assign(np.ascontiguousarray(np.broadcast_to(f32(value), array.shape)))

    def step(self, **values: np.ndarray | float) -> None:
        """One torque step and its account on inputs that the caller gives."""
        self.write(**values)
        self.actuator.step()
        self.actuator.account()

    def substep(self) -> None:
        """One torque step, one step of the toy plant, and the account."""
        self.actuator.step()
        i, a = self.inputs, self.actuator
        outputs = [i.q, i.qd, i.friction]
        wp.launch(toy_plant_kernel, dim=i.q.shape, inputs=[INERTIA, DT, a.tau, a.bound], outputs=outputs, device="cpu")
        a.account()

    def everything(self) -> dict[str, np.ndarray]:
        """State, outputs and inputs, copied."""
        outputs = {name: getattr(self.actuator, name).numpy().copy() for name in ("tau", "tau_motor", "bound")}
        inputs = {name: getattr(self.inputs, name).numpy().copy() for name in ("q", "qd", "friction")}
        return self.actuator.state() | outputs | inputs


def random_inputs(rng: np.random.Generator, num_envs: int, legs: Sequence[int] = LEGS) -> dict[str, np.ndarray]:
    """States that open and close both gates."""
    shape = (num_envs, len(legs))
    return {
        "q_des": rng.normal(-1.5, 0.1, shape),
        "q": rng.normal(-1.5, 0.2, shape),
        "qd": rng.normal(0, 1, shape) * rng.choice([0.1, 1.0, 10.0], shape),
        "f_foot": rng.uniform(0, 20, (num_envs, max(legs) + 1)),
        "current_e": rng.uniform(0.2, 2, num_envs),
        "friction": rng.normal(0, 3, shape),
    }


def rows(arrays: dict[str, np.ndarray], envs: Sequence[int] | np.ndarray) -> dict[str, np.ndarray]:
    """Rows of the arrays that have one per environment; what is shared stays as it is."""
    shared = ("head", "params", "effects_clock", "effects_values")
    return {name: x if name in shared else x[list(envs)] for name, x in arrays.items()}


def assert_bit_equal(got: dict[str, np.ndarray], want: dict[str, np.ndarray]) -> None:
    """Same names and same bytes, NaN included."""
    assert got.keys() == want.keys()
    differing = [name for name in want if got[name].tobytes() != want[name].tobytes()]
    assert differing == []
