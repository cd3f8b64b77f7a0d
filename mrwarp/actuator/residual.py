"""The learned torque in the loop: reads the history ring where it lies, writes the torque of the open windows.

The torch module is the master (``mrwarp.nn``); here its weights are laid out once, its standardisation folded in, for
Warp kernels that compute the same function. torch's own LSTM would need the windows in time order (a copy), the number
of open ones on the host (a wait on a GPU, and no graph capture), and its bits depend on the size of the batch.
Modules of other shapes run in torch all the same, see :mod:`mrwarp.actuator.torch_residual`.
"""

from __future__ import annotations

import math
import os
import threading
import weakref
from collections.abc import Callable, Iterable
from dataclasses import replace
from queue import SimpleQueue

import numpy as np
import torch
import warp as wp
from torch import nn

from mrwarp.actuator.torch_residual import CarriedNet, TorchTorque, rest_states
from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.enums import LstmState, ResidualEngine
from mrwarp.kernels import learned_torque as learned
from mrwarp.kernels import lstm_lanes
from mrwarp.kernels.launch import Launch, in_one_thread, record
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.model_file import Effect, acting
from mrwarp.nn.models import LstmTorque, MlpTorque
from mrwarp.nn.network_file import LearnedModel
from mrwarp.params import BoucWenParams, MrParams, ParameterError

KINDS = ("mlp", "lstm", "pg_rlstm")
"""Learned models that can run in the loop."""


_WORTH_WAKING = 16
"""Parts of carried states, 7 us each, that a thread must find to be worth waking, which costs 50 us."""


class LearnedTorque:
    """A trained network as ``MrActuator(residual=...)``; one object serves one actuator.

    ``pg_rlstm`` is added to tau_BW (eq. 16); ``mlp`` and ``lstm`` take its place. Both only where the dynamic gate is
    open: elsewhere the device keeps the Bouc-Wen drag.

    Any other ``torch.nn.Module`` runs too, in torch: one that maps raw windows of 50 samples (N, 50, 3), features
    (q_c, qd, current), to torques (N,), or a :class:`~mrwarp.actuator.torch_residual.CarriedNet`, which takes one
    sample and a carried state.

    Example:
        >>> import mrwarp, torch
        >>> class Drag(torch.nn.Module):
        ...     def forward(self, window):  # (N, 50, 3): displacement, velocity, current
        ...         return 0.1 * window[:, -1, 1]
        >>> env = mrwarp.WalkEnv(mrwarp.TaskCfg(num_envs=2), residual=mrwarp.LearnedTorque(Drag(), dt=0.005))

    An LSTM's state is carried on from step to step for all joints, open or not; a joint's first one after a reset is
    that of its history, which a reset fills with rest. With ``LstmState.WINDOW`` it is made from the last 50 samples
    at every step, for open gates only: fifty times the work (eq. 12 to the letter).

    Args:
        model: The network: one of ``mrwarp learn``, or any module.
        dt: Torque step [s]; of a bare module it is taken as right.
        engine: Warp kernels, or torch on the same arrays; a bare module runs in torch.
        adds: A bare module's torque is added to tau_BW; False replaces it.
        lstm_state: What an LSTM begins each sample with; an MLP has no state.
        threads: CPU threads for the LSTM; 0 = all. The results are the same bits for any number.
        evaluate_all: Compute closed windows too, without using them (to test that nothing depends on it).
        capacity: Threads of the kernels over windows that a GPU runs, as a share of all windows in (0, 1]. If more are
            open, threads take several in turn: the same bits, later.

    Raises:
        SamplingRateError: the model was trained at another rate than 1/dt.
        ValueError: the capacity is out of its range.
    """

    def __init__(
        self,
        model: LearnedModel | nn.Module,
        *,
        dt: float,
        engine: ResidualEngine = ResidualEngine.KERNELS,
        adds: bool = True,
        lstm_state: LstmState = LstmState.CARRIED,
        threads: int = 0,
        evaluate_all: bool = False,
        capacity: float = 1.0,
    ) -> None:
        if isinstance(model, LearnedModel):
            model.check_rate(dt)
            self.net, self._samples, self._whole = model.net, model.samples, not model.is_residual
        else:
            self.net, self._samples, self._whole, engine = model, WINDOW, not adds, ResidualEngine.TORCH
        if not 0.0 < capacity <= 1.0:
            raise ValueError(f"capacity = {capacity} must lie in (0, 1], a share of all windows")
        self.capacity = capacity
        self.model, self.engine = model, engine
        self.threads = threads or os.cpu_count() or 1
        self.evaluate_all = evaluate_all
        self.carries = isinstance(self.net, CarriedNet) and lstm_state is LstmState.CARRIED
        self._arrays: tuple[int | None, ...] = ()
        self._helpers: list[_Helper] = []
        self._gather: Launch | None = None
        self._units: tuple[Launch, ...] = ()

    def bind(self, ring: wp.array, head: wp.array, m_dyn: wp.array, tau_dyn: wp.array) -> None:
        """Prepare to work on these arrays, see :meth:`__call__`; every state is reset."""
        if ring.shape[2:] != (WINDOW, FEATURES) or not all(a.is_contiguous for a in (ring, m_dyn, tau_dyn)):
            raise ValueError(f"history of shape {ring.shape}; need contiguous arrays and (E, M, {WINDOW}, {FEATURES})")
        self._arrays = (ring.ptr, head.ptr, m_dyn.ptr, tau_dyn.ptr)
        self._device, self._shape = wp.get_device(str(tau_dyn.device)), m_dyn.shape
        self._helpers = []
        self._gather, self._units = None, ()
        if self.engine is ResidualEngine.TORCH:
            self._torch = self._evaluate = TorchTorque(
                self.net,
                ring,
                head,
                m_dyn,
                tau_dyn,
                samples=self._samples,
                carries=self.carries,
                whole=self._whole,
                evaluate_all=self.evaluate_all,
            )
            self._fresh, self._keep = self._torch.fresh, (ring, head, m_dyn, tau_dyn)
            return
        state = {name: t.double().numpy() for name, t in self.net.state_dict().items()}
        if self.carries:
            self._bind_carried(state, ring, head, m_dyn, tau_dyn)
        else:
            self._bind_windows(state, ring, head, m_dyn, tau_dyn)
        self._keep = (ring, head, m_dyn, tau_dyn)

    def __call__(self, ring: wp.array, head: wp.array, m_dyn: wp.array, tau_dyn: wp.array) -> None:
        """Write the predicted torque to ``tau_dyn`` (E, M) where ``m_dyn`` (E, M) is open.

        Args:
            ring: History, shape (E, M, 50, 3), one sample newer than at the last call.
            head: Row of its newest sample, shape (1,).
            m_dyn: Dynamic gate, shape (E, M).
            tau_dyn: tau_BW on entry, the prediction on return [N·m], shape (E, M).
        """
        if self._arrays != (ring.ptr, head.ptr, m_dyn.ptr, tau_dyn.ptr):
            self.bind(ring, head, m_dyn, tau_dyn)
        capturing = self._device.is_capturing
        if self._helpers and capturing:
            for helper in self._helpers:
                helper.settle()  # one that is still awake would be recorded
        if self._gather is not None:
            self._count.zero_()
            self._gather()
        if self._helpers and not capturing:
            parts = len(self._helpers) + 1 if self.carries else (int(self._open[0]) + 7) // 8
            for helper in self._helpers[: max(parts - 1, 0)]:
                helper.wake(self._help)
        for launch in self._units:
            launch()
        self._evaluate()

    def reset(self, mask: wp.array) -> None:
        """Reset the joints of masked environments, bool (E,); they begin with what their history then holds."""
        if self.carries:
            wp.launch(
                learned.begin_kernel, dim=self._fresh.size, inputs=[mask], outputs=[self._fresh], device=self._device
            )

    @property
    def trained_step(self) -> str | None:
        """Step of eq. 15 that the network was trained on top of; None for a whole torque or a bare module."""
        return self.model.z_step if isinstance(self.model, LearnedModel) and self.model.is_residual else None

    @property
    def graphable(self) -> bool:
        """Whether a graph loses nothing: kernels on one thread. Threads that help, and torch, run between graphs."""
        return not self._helpers and self.engine is ResidualEngine.KERNELS

    def state(self) -> dict[str, np.ndarray]:
        """Copy of what a resumed run needs, by name; empty where nothing is carried.

        Hidden and cell states, shape (E, M, 2, HIDDEN), of torch (E, M, state_size), and 1 for joints that begin
        again, shape (E, M).
        """
        if not self.carries:
            return {}
        if self.engine is ResidualEngine.TORCH:
            states = self._torch.states.cpu().numpy().reshape(*self._shape, -1).copy()
            return {"net_state": states, "net_fresh": self._fresh.numpy().reshape(self._shape).copy()}
        count = self._fresh.size
        now = 0 if not self._units else int(self._keep[1].numpy()[0]) % 2  # see lstm_unit_kernel
        state = self._state.numpy()[[now, 2], :, :count].transpose(2, 0, 1).reshape(*self._shape, 2, learned.HIDDEN)
        return {"lstm": np.ascontiguousarray(state), "lstm_fresh": self._fresh.numpy().reshape(self._shape).copy()}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore :meth:`state`, bit-equal."""
        if not self.carries:
            return
        count = self._fresh.size
        if self.engine is ResidualEngine.TORCH:
            self._torch.load(state["net_state"].reshape(count, -1), state["net_fresh"].reshape(-1))
            return
        hidden, cell = state["lstm"].reshape(count, 2, learned.HIDDEN).transpose(1, 2, 0)
        values = self._state.numpy()
        values[:, :, :count] = hidden, hidden, cell
        self._state.assign(values)
        self._fresh.assign(np.ascontiguousarray(state["lstm_fresh"], dtype=np.int32).reshape(-1))

    def _bind_carried(
        self, state: dict[str, np.ndarray], ring: wp.array, head: wp.array, m_dyn: wp.array, tau_dyn: wp.array
    ) -> None:
        device, joints = self._device, m_dyn.size
        parts = -(-joints // lstm_lanes.LANES)
        whole = int(self._whole)
        self._fresh = wp.full(joints, 1, dtype=int, device=device)
        self._state = wp.zeros((3, learned.HIDDEN, parts * lstm_lanes.LANES), dtype=float, device=device)
        out = self._array(output_layer(state))
        if in_one_thread(device):
            threads = max(min(self.threads, parts // _WORTH_WAKING), 1)
            weights, inputs = self._array(lane_weights(lstm_weights(state))), [head, ring, m_dyn]
            outputs = [wp.zeros(2, dtype=wp.int64, device=device), self._fresh, self._state, tau_dyn]
            self._evaluate, self._help = (
                record(
                    lstm_lanes.lstm_carried_lanes_kernel,
                    1,
                    [weights, out, whole, owner, threads, *inputs],
                    outputs,
                    device,
                )
                for owner in (1, 0)
            )
            self._helpers = [_Helper() for _ in range(threads - 1)]
        else:
            assert isinstance(self.net, LstmTorque)  # or nothing would be carried
            rest = self._array(states_at_rest(self.net))
            weights, fours = self._array(lstm_weights(state)), -(-joints // learned.UNITS)
            self._units = (
                record(learned.lstm_rest_kernel, joints, [rest, head, ring, self._fresh], [self._state], device),
                record(
                    learned.lstm_unit_kernel,
                    (learned.HIDDEN // learned.UNITS, fours),
                    [weights, head, ring],
                    [self._state],
                    device,
                ),
            )
            self._evaluate = record(
                learned.lstm_torque_kernel,
                m_dyn.shape,
                [out, whole, head, self._state, m_dyn, tau_dyn],
                [self._fresh, tau_dyn],
                device,
            )

    def _bind_windows(
        self, state: dict[str, np.ndarray], ring: wp.array, head: wp.array, m_dyn: wp.array, tau_dyn: wp.array
    ) -> None:
        device, windows = self._device, m_dyn.size
        places = math.ceil(self.capacity * windows)
        self._count = wp.zeros(1, dtype=int, device=device)
        index = wp.zeros(max(windows, 1), dtype=int, device=device)
        self._gather = record(
            learned.open_windows_kernel, m_dyn.shape, [int(self.evaluate_all), m_dyn], [self._count, index], device
        )
        inputs = [self._count, index, head, ring, m_dyn]
        whole = int(self._whole)

        def scratch(rows: int) -> wp.array:
            return wp.empty((rows, learned.HIDDEN, places), dtype=float, device=device)

        if isinstance(self.net, MlpTorque):
            layers = [self._array(layer) for layer in mlp_layers(state)]
            self._evaluate = record(
                learned.mlp_window_kernel, places, [*layers, whole, *inputs, tau_dyn], [scratch(2), tau_dyn], device
            )
        elif in_one_thread(device):
            weights, out = self._array(lane_weights(lstm_weights(state))), self._array(output_layer(state))
            threads = max(min(self.threads, windows // 8), 1)
            outputs = [wp.zeros(2, dtype=wp.int64, device=device), tau_dyn]
            self._evaluate, self._help = (
                record(lstm_lanes.lstm_lanes_kernel, 1, [weights, out, whole, owner, threads, *inputs], outputs, device)
                for owner in (1, 0)
            )
            self._open = self._count.numpy()  # the same memory
            self._helpers = [_Helper() for _ in range(threads - 1)]
        else:
            weights, out = self._array(lstm_weights(state)), self._array(output_layer(state))
            self._evaluate = record(
                learned.lstm_window_kernel,
                places,
                [weights, out, whole, *inputs, tau_dyn],
                [scratch(3), tau_dyn],
                device,
            )

    def _array(self, values: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=float, device=self._device)


class _Helper:
    """A thread that repeats a launch when woken; it ends with this object.

    A ``concurrent.futures`` pool wakes its threads half as fast, and waits for their answers: here the kernel itself
    waits for work that a helper has taken, and nobody for a helper that came too late.
    """

    def __init__(self) -> None:
        self._calls: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        threading.Thread(target=_repeat, args=(self._calls,), name="residual", daemon=True).start()
        weakref.finalize(self, self._calls.put, None)

    def wake(self, launch: Launch) -> None:
        """Launch on the thread, unless it has not yet got round to the last one."""
        if self._calls.empty():
            self._calls.put(launch)

    def settle(self) -> None:
        """Wait until the thread sleeps."""
        done = threading.Event()
        self._calls.put(done.set)
        done.wait()


def _repeat(calls: SimpleQueue[Callable[[], object] | None]) -> None:
    while (call := calls.get()) is not None:
        call()


def with_bouc_wen(mr: MrParams, model: LearnedModel, effects: Iterable[Effect] = ()) -> MrParams:
    """A joint's parameters with the Bouc-Wen coefficients that the model was trained with.

    The joint keeps its own neutral angle; the bench's displacement is about its own zero. ``effects`` are what acts in
    the joint in addition to eqs. 14 and 15.

    Raises:
        ParameterError: the model's coefficients are not those of ``BoucWenParams`` or out of a joint's range, or it was
            trained on top of a law and effects that are not the joint's.
        OtherDeviceError: it learned another device than the joint's.
    """
    model.check_device(mr.to_dict())
    ours = acting(effects)
    # a residual on plain eqs. 14 and 15 may run with effects, but not with another law
    if model.is_residual and model.trained_with != ours and (model.trained_with or HYSTERESIS.keys() & ours.keys()):
        theirs, own = (", ".join(x) or "eqs. 14 and 15 alone" for x in (model.trained_with, ours))
        raise ParameterError(
            f"this pg_rlstm model was trained on top of {theirs}, the joint has {own}"
            f"{'' if theirs != own else ' with other numbers'}; give both the same model.json (--bouc-wen, --model)"
        )
    if model.is_residual and not model.bouc_wen:
        raise ParameterError("this pg_rlstm model is a residual on another physical model and cannot run in the loop")
    try:
        bouc_wen = BoucWenParams(**{**model.bouc_wen, "q_neutral": mr.bouc_wen.q_neutral})
    except TypeError as error:
        raise ParameterError(f"the {model.kind} model's Bouc-Wen parameters are not ours ({error})") from None
    return replace(mr, bouc_wen=bouc_wen)


def window_now(ring: wp.array, head: wp.array) -> torch.Tensor:
    """The history in time order, oldest first, shape (E, M, 50, 3): a copy, for checks against the torch module."""
    rows = (int(head.numpy()[0]) + 1 + torch.arange(WINDOW)) % WINDOW
    return wp.to_torch(ring)[:, :, rows]


def lstm_weights(state: dict[str, np.ndarray]) -> np.ndarray:
    """LSTM weights as ``lstm_window_kernel`` wants them, float64, shape (HIDDEN, 1 + FEATURES + HIDDEN, 4).

    The standardisation is folded in: W (x - mean)/std + b = (W/std) x + (b - W mean/std).
    """
    scale, mean = 1.0 / state["scaler.std"], state["scaler.mean"]
    w_in = state["lstm.weight_ih_l0"] * scale
    bias = state["lstm.bias_ih_l0"] + state["lstm.bias_hh_l0"] - w_in @ mean
    rows = np.concatenate([bias[:, None], w_in, state["lstm.weight_hh_l0"]], axis=1)
    return rows.reshape(learned.GATES, learned.HIDDEN, -1).transpose(1, 2, 0)


def lane_weights(weights: np.ndarray) -> np.ndarray:
    """Weights of :func:`lstm_weights` for ``lstm_lanes_kernel``, flat: [fours of units][row][gate][unit of four]."""
    hidden, rows, gates = weights.shape
    return weights.reshape(hidden // lstm_lanes.UNITS, lstm_lanes.UNITS, rows, gates).transpose(0, 2, 3, 1).reshape(-1)


def output_layer(state: dict[str, np.ndarray]) -> np.ndarray:
    """Output weights with the bias last, shape (HIDDEN + 1,)."""
    return np.concatenate([state["out.weight"][0], state["out.bias"]])


def mlp_layers(state: dict[str, np.ndarray]) -> list[np.ndarray]:
    """The MLP's three layers with the bias as the last column, the standardisation folded into the first."""
    layers = [np.concatenate([state[f"net.{i}.weight"], state[f"net.{i}.bias"][:, None]], axis=1) for i in (0, 2, 4)]
    scale = np.tile(1.0 / state["scaler.std"], learned.MLP_SAMPLES)
    mean = np.tile(state["scaler.mean"], learned.MLP_SAMPLES)
    layers[0][:, :-1] *= scale
    layers[0][:, -1] -= layers[0][:, :-1] @ mean
    return layers


def states_at_rest(net: LstmTorque) -> np.ndarray:
    """:func:`~mrwarp.actuator.torch_residual.rest_states` of an LSTM, shape (2, HIDDEN, REST_POINTS), hidden first."""
    return rest_states(net.step, net.state_size).numpy().T.reshape(2, learned.HIDDEN, learned.REST_POINTS)
