"""A batch of MR joints alone, without a robot: angle, velocity and current in, torque out."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard, TypeVar, overload

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.effect_runtime import added_inertia
from mrwarp.actuator.mr_actuator import ActuatorInputs, DeviceAlone, MrActuator
from mrwarp.enums import Coupling, ZStep
from mrwarp.model_file import Device, Model, read_device

if TYPE_CHECKING:
    from torch import Tensor  # which not every installation has

Numbers: TypeAlias = "ArrayLike | Tensor | wp.array"
"""Numbers for all joints: one, or an array of NumPy, torch or Warp, or nested sequences."""
TensorT = TypeVar("TensorT", bound="Tensor")


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
        model: The device: a model.json or a name of the library, a model, what :func:`mrwarp.fit` returned, or
            parameters; None is the paper's.
        num: Number of environments N.
        joints: Joints of each environment; None takes and gives arrays of shape (N,), else (N, joints).
        dt: Step [s].
        device: Warp device, ``cpu`` or ``cuda:0``.
        z_step: Step of the hysteresis: the exact one, or the paper's explicit Euler.

    Attributes:
        inertia: Rotor inertia of the model's effects [kg·m²]: add it to the joint, it is no part of the torque.

    Raises:
        ModelFileError: the model file cannot be used, or is in other units than rad, A and N·m.
        TypeError: an argument is of another type.
        ValueError: a number is out of range, or there is no such device of Warp.
    """

    def __init__(
        self,
        model: Device = None,
        num: int = 1,
        *,
        joints: int | None = None,
        dt: float,
        device: str = "cpu",
        z_step: ZStep | str = ZStep.EXACT,
    ) -> None:
        num, count = _count("num", num), _count("joints", 1 if joints is None else joints)
        if isinstance(dt, bool) or not isinstance(dt, int | float | np.number):
            raise TypeError(f"dt = {dt!r}: give the step as a number [s]")
        if not 0.0 < dt < np.inf:
            raise ValueError(f"dt = {dt} s must be positive and finite")
        _check_device(device)
        steps = [step.value for step in ZStep]
        if not isinstance(z_step, ZStep) and z_step not in steps:
            raise ValueError(f"z_step = {z_step!r} is unknown; choose from {', '.join(steps)}")
        found = read_device(model)
        mr, effects = (found.to_params(), found.effects) if isinstance(found, Model) else (found, ())
        self.shape = (num,) if joints is None else (num, joints)
        self.dt, self.inertia = float(dt), added_inertia(effects)
        count *= num
        self._q, self._qd, nothing, load = (wp.zeros((count, 1), dtype=float, device=device) for _ in range(4))
        self._current = wp.zeros(count, dtype=float, device=device)
        inputs = ActuatorInputs(
            q_des=nothing, q=self._q, qd=self._qd, f_foot=load, current_e=self._current, friction=nothing
        )
        cfg = MrActuatorCfg(coupling=Coupling.CONSTRAINT, z_step=ZStep(z_step), gated=False)
        self._actuator = MrActuator([DeviceAlone(mr=mr.alone(), effects=effects)], [-1], inputs, dt=dt, cfg=cfg)
        self._fresh = True

    @overload
    def step(self, q: TensorT, qd: Numbers, current: Numbers, *, out: Tensor | None = None) -> TensorT: ...
    @overload
    def step(self, q: wp.array, qd: Numbers, current: Numbers, *, out: wp.array | None = None) -> wp.array: ...
    @overload
    def step(self, q: ArrayLike, qd: Numbers, current: Numbers, *, out: np.ndarray | None = None) -> np.ndarray: ...
    def step(
        self, q: Numbers, qd: Numbers, current: Numbers, *, out: np.ndarray | Tensor | wp.array | None = None
    ) -> np.ndarray | Tensor | wp.array:
        """Torque over the step that begins in this state.

        Arrays of NumPy, torch or Warp, or plain numbers for all joints; nothing passes the host that was not there.
        The first step, and the first after a reset, takes ``q`` for the place where the joint has rested. A joint that
        gets NaN or an infinite number gives NaN; if it was the velocity, until the joint is reset. The others take no
        notice.

        Args:
            q: Angle [rad], shape (N,) or (N, joints).
            qd: Velocity [rad/s], same shape.
            current: Commanded coil current [A], same shape; cut to the device's largest. A negative one acts by its
                size; with remanence it takes the field out of the core first.
            out: Array to write to, of the same kind as ``q``; None makes a new one.

        Returns:
            Torque [N·m] of the same kind as ``q``, shape (N,) or (N, joints).

        Raises:
            TypeError: an array does not hold real numbers, or ``out`` is of another kind than ``q``.
            ValueError: an array has another shape, or requires a gradient: the kernels give none.
        """
        taken = [self._checked(name, given) for name, given in (("q", q), ("qd", qd), ("current", current))]
        self._check_out(q, out)
        for values, own in zip(taken, (self._q, self._qd, self._current), strict=True):
            if isinstance(values, wp.array):
                wp.copy(own.flatten(), values.contiguous().flatten())
            else:
                own.flatten().assign(values.reshape(-1))
        if self._fresh:
            self._actuator.reset()
            self._fresh = False
        self._actuator.step()
        return self._give(self._actuator.tau_dyn, q, out)

    @overload
    def bound(self, like: TensorT) -> TensorT: ...
    @overload
    def bound(self, like: wp.array) -> wp.array: ...
    @overload
    def bound(self, like: ArrayLike | None = None) -> np.ndarray: ...
    def bound(self, like: Numbers | None = None) -> np.ndarray | Tensor | wp.array:
        """Dry friction that the device may use in the step just made [N·m], to make it a brake that sticks.

        At rest it is the yield torque of eq. 18, while sliding the magnitude of the torque.

        Args:
            like: An array of the kind to return; None is NumPy.
        """
        return self._give(self._actuator.bound, like, None)

    def reset(self, mask: Numbers | None = None) -> None:
        """No stress and no current; the joints have rested at the angles of the last step.

        Args:
            mask: Environments to reset, bool, shape (N,); None resets all. Others keep every bit.

        Raises:
            TypeError: the mask is not bool.
            ValueError: the mask has another shape.
        """
        if mask is None:
            self._fresh = True
            return
        host = _array("mask", mask)
        if host.dtype != np.bool_:
            raise TypeError(f"mask is of {host.dtype}; give bool, as in mask = numbers > 0")
        if host.shape != self.shape[:1]:
            raise ValueError(f"mask has shape {host.shape}, need {self.shape[:1]}")
        chosen = np.repeat(host, self._q.size // self.shape[0])
        self._actuator.reset(wp.array(chosen, dtype=wp.bool, device=self._q.device))

    def state(self) -> dict[str, np.ndarray]:
        """Copy of all that a later run needs to go on, by name."""
        return {**self._actuator.state(), "fresh": np.array(self._fresh)}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from :meth:`state`, bit-equal.

        Raises:
            ValueError: it is the state of a batch with another device or number of joints.
        """
        for name, array in self.state().items():
            given = np.shape(state[name]) if name in state else None
            if given != array.shape:
                raise ValueError(f"state: {name!r} has shape {given}, need {array.shape}: it is of another batch")
        self._actuator.load_state(state)
        self._fresh = bool(state["fresh"])

    def _checked(self, name: str, given: Numbers) -> wp.array | np.ndarray:
        """The numbers as float32 of this batch's shape, on the host if they were there."""
        if isinstance(given, wp.array):
            if given.dtype not in (wp.float32, float):
                raise TypeError(f"{name} is a Warp array of {given.dtype.__name__}; give float32")
            values = given
        elif _is_tensor(given):
            if given.requires_grad:
                raise ValueError(f"{name} requires a gradient, and the kernels give none; pass {name}.detach()")
            if given.is_complex() or str(given.dtype) == "torch.bool":
                raise TypeError(f"{name} is of {given.dtype}; give real numbers")
            values = wp.from_torch(given.float().contiguous())
        else:
            host = _array(name, given)
            if host.dtype.kind not in "fiu":
                raise TypeError(f"{name} is of {host.dtype}; give real numbers")
            host = host.astype(np.float32)
            values = np.ascontiguousarray(np.broadcast_to(host, self.shape) if host.ndim == 0 else host)
        if tuple(values.shape) != self.shape:
            raise ValueError(f"{name} has shape {tuple(values.shape)}, need {self.shape}")
        return values

    def _check_out(self, like: Numbers, out: np.ndarray | Tensor | wp.array | None) -> None:
        if out is None:
            return
        if isinstance(like, wp.array):
            fits, wanted = isinstance(out, wp.array) and out.dtype in (wp.float32, float), "Warp array of float32"
        elif _is_tensor(like):
            fits, wanted = _is_tensor(out) and out.is_floating_point() and not out.requires_grad, "tensor of floats"
        else:
            fits, wanted = isinstance(out, np.ndarray) and out.dtype.kind == "f", "NumPy array of floats"
        if not fits:
            raise TypeError(
                f"out is a {type(out).__name__} of {getattr(out, 'dtype', None)}; with this q give a {wanted}"
            )
        if tuple(out.shape) != self.shape:
            raise ValueError(f"out has shape {tuple(out.shape)}, need {self.shape}")

    def _give(self, own: wp.array, like: Numbers | None, out: Any) -> Any:
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


def _count(name: str, value: object) -> int:
    """A whole number from 1."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} = {value!r} must be a whole number")
    if value < 1:
        raise ValueError(f"{name} = {value} must be at least 1")
    return int(value)


def _check_device(device: str) -> None:
    known = [str(found) for found in wp.get_devices()]
    if str(device) not in (*known, "cuda"):
        raise ValueError(f"device = {device!r}: Warp has none such here; choose from {', '.join(known)}")


def _is_tensor(given: object) -> TypeGuard[Tensor]:
    """Whether it is torch's, which need not be installed."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(given, torch.Tensor)


def _array(name: str, given: Numbers) -> np.ndarray:
    """As an array of NumPy, on the host."""
    if isinstance(given, wp.array):
        return given.numpy()
    try:
        return np.asarray(given.cpu() if _is_tensor(given) else given)
    except ValueError:
        raise ValueError(f"{name} has rows of different lengths; give an array") from None
