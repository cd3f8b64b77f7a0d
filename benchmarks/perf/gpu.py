"""The figures of a GPU: walking robots on MuJoCo-Warp as captured graphs, the joint's kernels alone, training.

Everything runs on any Warp device, so that the CPU tests what only a GPU makes fast.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import warp as wp

from benchmarks.perf import training
from benchmarks.perf.perf_cfg import GpuCfg
from benchmarks.perf.timing import Spread, Times, Turn, interleave, ratio
from benchmarks.perf.walks import Walk, variant_cfg
from mrwarp.env.backend import BackendKind
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels.launch import capture
from mrwarp.trials.walking import Policy

VARIANTS = ("pd", "explicit", "bouc_wen", "lstm", "mjwarp_eager")
"""Robots of :data:`benchmarks.perf.walks.VARIANTS`, all on MuJoCo-Warp."""

AIMED_AT = 4096
"""Number of robots for which the limits hold."""

REPEATS = 20
"""Torque steps in the graph that times the joint's kernels."""

COPIED = 2**28
"""Bytes of the copy that measures the memory's bandwidth."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """Targets of the figures at :data:`AIMED_AT` robots."""

    unit: str
    """Its unit; 1 for a ratio."""
    limit: float
    """The limit."""
    least: bool
    """Whether it is the least value (a speed); otherwise the largest (a cost)."""

    def met(self, value: float) -> bool:
        """Whether a value holds it."""
        return value >= self.limit if self.least else value <= self.limit


TARGETS = {
    "physics steps": Target(unit="1/s", limit=3e6, least=True),
    "bouc_wen/pd": Target(unit="1", limit=1.0 / 0.9, least=False),
    "gates, Bouc-Wen and LSTM": Target(unit="µs", limit=50.0, least=False),
    "training": Target(unit="policy steps/s", limit=450_000.0, least=True),
}
"""Targets by figure; ``bouc_wen/pd`` is the cost of the robot's step in units of that with plain motors."""


def run_all(cfg: GpuCfg, policy: Policy, progress: Callable[[str, float], None]) -> dict[str, Any]:
    """Measure; times, ratios by ``name @robots`` and the rows of the table.

    Args:
        cfg: What to measure.
        policy: Policy that walks the robots.
        progress: Called with what is measured and the share of it that is done.

    Raises:
        NotWalkingError: what was timed does not walk.
    """
    device = wp.get_device(cfg.device)
    figures: dict[str, Any] = {"device": {"name": device.name, "alias": cfg.device}, "walking": {}, "joint": {}}
    ratios: dict[str, Spread] = {}
    values: dict[str, float] = {}
    for count in cfg.num_envs if "walking" in cfg.parts else ():
        found, own = walking(cfg, count, policy, lambda s, n=count: progress(f"walking, {n} robots", s))
        figures["walking"][str(count)] = found
        ratios |= own
        values[f"physics steps @{count}"] = found["physics_steps_per_second"]
    values |= {name: spread.median for name, spread in ratios.items()}
    for count in cfg.num_envs if "joint" in cfg.parts else ():
        figures["joint"][str(count)] = found = joint(cfg, count, lambda s, n=count: progress(f"joints, {n} robots", s))
        values[f"gates, Bouc-Wen and LSTM @{count}"] = found["microseconds"]["lstm"]["median"]
    if "training" in cfg.parts and cfg.updates:
        count = AIMED_AT if AIMED_AT in cfg.num_envs else max(cfg.num_envs)
        with tempfile.TemporaryDirectory() as folder:
            figures["training"] = {
                str(count): training.measure(
                    Path(folder),
                    num_envs=count,
                    updates=cfg.updates,
                    device=cfg.device,
                    progress=lambda share: progress(f"training, {count} robots", share),
                )
            }
        found = figures["training"][str(count)]
        values[f"training @{count}"] = found["steps_per_second"]
        ratios[f"learn share @{count}"] = Spread(**found["learn_share"])
    figures["ratios"] = {name: {**spread.plain(), "limit": _limit(name)} for name, spread in ratios.items()}
    figures["targets"] = [
        {"figure": name, "unit": target.unit, "value": value, "limit": target.limit, "met": target.met(value)}
        for name, target in TARGETS.items()
        if (value := values.get(f"{name} @{AIMED_AT}")) is not None
    ]
    return figures


def walking(
    cfg: GpuCfg, count: int, policy: Policy, progress: Callable[[float], None]
) -> tuple[dict[str, Any], dict[str, Spread]]:
    """Plain motors, Bouc-Wen as explicit torque and as constraint, the LSTM residual, and no graph; all walking."""
    walks = {
        name: Walk(
            name, policy, num_envs=count, steps=cfg.steps, seconds=1.0, device=cfg.device, backend=BackendKind.MJWARP
        )
        for name in VARIANTS
        if name != "mjwarp_eager" or count <= cfg.eager_up_to
    }
    times = interleave({name: walk.turn for name, walk in walks.items()}, rounds=cfg.rounds, progress=progress)
    checks = {name: walk.check() for name, walk in walks.items()}
    decimation = walks["bouc_wen"].env.cfg.decimation
    at = f" @{count}"
    ratios = {f"{name}/pd{at}": ratio(times, f"{name}.robot", "pd.robot") for name in ("explicit", "bouc_wen", "lstm")}
    ratios[f"env/robot{at}"] = ratio(times, "bouc_wen.env", "bouc_wen.robot")
    if "mjwarp_eager" in walks:
        ratios[f"captured/eager{at}"] = ratio(times, "bouc_wen.robot", "mjwarp_eager.robot")
    return {
        "seconds": {part: Spread.of(seconds).plain() for part, seconds in times.items()},
        "physics_steps_per_second": count * decimation / Spread.of(times["bouc_wen.robot"]).median,
        "env_steps_per_second": count / Spread.of(times["bouc_wen.env"]).median,
        "checks": checks,
    }, ratios


def joint(cfg: GpuCfg, count: int, progress: Callable[[float], None]) -> dict[str, Any]:
    """The joints' kernels of a torque step, without and with the LSTM, and what share of the bandwidth they reach."""
    turns: dict[str, Turn] = {"copy": _copy(cfg.device)}
    for name in ("bouc_wen", "lstm"):
        env = WalkEnv(variant_cfg(name, num_envs=count, device=cfg.device, backend=BackendKind.MJWARP))
        turns[name] = _torque_steps(env)
        if name == "bouc_wen":
            moved = bytes_moved(env)
    times: Times = interleave(turns, rounds=2 * cfg.rounds, progress=progress)
    bandwidth = 2.0 * COPIED / Spread.of(times["copy.step"]).median
    laws = Spread.of(times["bouc_wen.step"]).median
    return {
        "microseconds": {name: Spread.of(1e6 * t for t in times[f"{name}.step"]).plain() for name in turns},
        "bytes_moved": moved,
        "copy_bandwidth": bandwidth,
        "share_of_bandwidth": moved / laws / bandwidth,
    }


def bytes_moved(env: WalkEnv) -> int:
    """Bytes that the joints' laws have to read and write in a torque step: parameters, inputs, state, outputs."""
    a = env.actuator
    read = [a.params, a.kp, a.kd, a.tau_limit, *vars(a.inputs).values(), a.z, a.current]
    read = [array for array in read if array is not None and array is not a.inputs.friction]  # the ledger's
    written = [a.m_dyn, a.m_hold, a.z, a.current, a.tau_dyn, a.tau_mr, a.tau_motor, a.tau, a.bound]
    newest = 4 * a.ring.size // a.ring.shape[2]
    return newest + sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in (*read, *written))


def _torque_steps(env: WalkEnv) -> Turn:
    """Seconds of a torque step in a graph of several."""
    env.actuator.step()  # compiles what the graph records
    graph = capture(lambda: [env.actuator.step() for _ in range(REPEATS)], env.sim.device)

    def turn() -> dict[str, float]:
        # asked of env, which is held so: the graph works on its arrays
        return {"step": _timed(lambda: wp.capture_launch(graph), env.sim.device) / REPEATS}

    return turn


def _copy(device: Any) -> Turn:
    """Seconds of a copy of :data:`COPIED` bytes."""
    source, target = (wp.zeros(COPIED // 4, dtype=float, device=device) for _ in range(2))

    def turn() -> dict[str, float]:
        return {"step": _timed(lambda: wp.copy(target, source), device)}

    return turn


def _timed(work: Callable[[], object], device: Any) -> float:
    wp.synchronize_device(device)
    begin = time.perf_counter()
    work()
    wp.synchronize_device(device)
    return time.perf_counter() - begin


def _limit(name: str) -> float | None:
    base, _, count = name.partition(" @")
    target = TARGETS.get(base)
    return target.limit if target is not None and int(count) == AIMED_AT else None
