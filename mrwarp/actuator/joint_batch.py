"""A batch of MR joints alone, without a robot: angle, velocity and current in, torque out."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.effect_runtime import added_inertia
from mrwarp.actuator.mr_actuator import ActuatorInputs, DeviceAlone, MrActuator
from mrwarp.enums import Coupling, ZStep
from mrwarp.model_file import Model
from mrwarp.params import MrParams


class JointBatch:
    """Many joints with one device, stepped together by the kernels of the simulated robots.

    The torque has the sign that a bench logs: it is positive against a positive velocity. A simulator applies its
    negative. Angles are those of the recordings that the model was fitted to.

    Example:
        >>> import numpy as np, mrwarp
        >>> joints = mrwarp.JointBatch(num=4, dt=0.005)
        >>> for _ in range(40):  # 0.2 s at 1 rad/s, from no current to the largest
        ...     torque = joints.step(q=np.zeros(4), qd=np.ones(4), current=[0.0, 0.5, 1.0, 1.5])
        >>> torque.shape, bool((np.diff(torque) > 0).all())
        ((4,), True)

    Args:
        model: The device: a model of :func:`mrwarp.load_model`, or parameters; None is the paper's.
        num: Number of environments N.
        joints: Joints of each environment; None takes and gives arrays of shape (N,), else (N, joints).
        dt: Step [s].
        device: Warp device, ``cpu`` or ``cuda:0``.
        z_step: Step of the hysteresis: the exact one, or the paper's explicit Euler.

    Attributes:
        inertia: Rotor inertia of the model's effects [kg·m²]: add it to the joint, it is no part of the torque.

    Raises:
        ModelFileError: the model is in other units than rad, A and N·m.
        ValueError: a number is out of range.
    """

    def __init__(
        self,
        model: Model | MrParams | None = None,
        num: int = 1,
        *,
        joints: int | None = None,
        dt: float,
        device: str = "cpu",
        z_step: ZStep = ZStep.EXACT,
    ) -> None:
        for name, value in (("num", num), ("joints", 1 if joints is None else joints)):
            if value < 1:
                raise ValueError(f"{name} = {value} must be at least 1")
        if not 0.0 < dt < np.inf:
            raise ValueError(f"dt = {dt} s must be positive and finite")
        mr = model.to_params() if isinstance(model, Model) else model or MrParams()
        effects = model.effects if isinstance(model, Model) else ()
        self.shape = (num,) if joints is None else (num, joints)
        self.dt, self.inertia = dt, added_inertia(effects)
        count = num * (joints or 1)
        self._q, self._qd, nothing, load = (wp.zeros((count, 1), dtype=float, device=device) for _ in range(4))
        self._current = wp.zeros(count, dtype=float, device=device)
        inputs = ActuatorInputs(
            q_des=nothing, q=self._q, qd=self._qd, f_foot=load, current_e=self._current, friction=nothing
        )
        cfg = MrActuatorCfg(coupling=Coupling.CONSTRAINT, z_step=z_step, gated=False)
        self._actuator = MrActuator([DeviceAlone(mr=mr.alone(), effects=effects)], [-1], inputs, dt=dt, cfg=cfg)
        self._fresh = True

    def step(self, q: Any, qd: Any, current: Any, *, out: Any = None) -> Any:
        """Torque over the step that begins in this state.

        Arrays of NumPy, torch or Warp, or plain numbers for all joints; nothing passes the host that was not there.
        The first step, and the first after a reset, takes ``q`` for the place where the joint has rested.

        Args:
            q: Angle [rad], shape (N,) or (N, joints).
            qd: Velocity [rad/s], same shape.
            current: Commanded coil current [A], same shape; cut to the device's largest.
            out: Array to write to, of the same kind as ``q``; None makes a new one.

        Returns:
            Torque [N·m] of the same kind as ``q``, shape (N,) or (N, joints).

        Raises:
            ValueError: an array has another shape.
        """
        for name, given, own in (("q", q, self._q), ("qd", qd, self._qd), ("current", current, self._current)):
            self._take(name, given, own)
        if self._fresh:
            self._actuator.reset()
            self._fresh = False
        self._actuator.step()
        return self._give(self._actuator.tau_dyn, q, out)

    def bound(self, like: Any = None) -> Any:
        """Dry friction that the device may use in the step just made [N·m], to make it a brake that sticks.

        At rest it is the yield torque of eq. 18, while sliding the magnitude of the torque.

        Args:
            like: An array of the kind to return; None is NumPy.
        """
        return self._give(self._actuator.bound, like, None)

    def reset(self, mask: Any = None) -> None:
        """No stress and no current; the joints have rested at the angles of the last step.

        Args:
            mask: Environments to reset, bool, shape (N,); None resets all. Others keep every bit.
        """
        if mask is None:
            self._fresh = True
            return
        chosen = np.broadcast_to(
            _on_host(mask).astype(bool).reshape(-1, 1), (self.shape[0], self._q.size // self.shape[0])
        )
        self._actuator.reset(wp.array(np.ascontiguousarray(chosen).reshape(-1), dtype=wp.bool, device=self._q.device))

    def state(self) -> dict[str, np.ndarray]:
        """Copy of all that a later run needs to go on, by name."""
        return {**self._actuator.state(), "fresh": np.array(self._fresh)}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from :meth:`state`, bit-equal."""
        self._actuator.load_state(state)
        self._fresh = bool(state["fresh"])

    def _take(self, name: str, given: Any, own: wp.array) -> None:
        if isinstance(given, wp.array):
            values = given
        elif _is_tensor(given):
            values = wp.from_torch(given.detach().float().contiguous())
        else:
            host = np.asarray(given, dtype=np.float32)
            values = np.ascontiguousarray(np.broadcast_to(host, self.shape) if host.ndim == 0 else host)
        if tuple(values.shape) != self.shape:
            raise ValueError(f"{name} has shape {tuple(values.shape)}, need {self.shape}")
        if isinstance(values, wp.array):
            wp.copy(own.flatten(), values.flatten())
        else:
            own.flatten().assign(values.reshape(-1))

    def _give(self, own: wp.array, like: Any, out: Any) -> Any:
        own = own.flatten()
        if isinstance(like, wp.array):
            out = wp.empty(self.shape, dtype=float, device=own.device) if out is None else out
            wp.copy(out.flatten(), own)
            return out
        if _is_tensor(like):
            result = wp.to_torch(own).reshape(self.shape)
            return result.to(like.device, copy=True) if out is None else out.copy_(result)
        result = own.numpy().reshape(self.shape)
        if out is None:
            return result.copy()
        out[...] = result
        return out


def _is_tensor(given: Any) -> bool:
    """Whether it is torch's, which need not be installed."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(given, torch.Tensor)


def _on_host(given: Any) -> np.ndarray:
    return given.numpy() if isinstance(given, wp.array) else np.asarray(given.cpu() if _is_tensor(given) else given)
