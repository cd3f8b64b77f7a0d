"""Short pieces of a log from which simulations begin: stamps, commands, readings, and the state at their start."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import warp as wp
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_filter

from mrwarp.robot_logs.channels.joint_torque import gravity_along
from mrwarp.robot_logs.drive_kernel import memory_kernel
from mrwarp.robot_logs.replay_model import LONGEST_DELAY, LONGEST_STEP, ReplayModel, Stance
from mrwarp.robot_logs.robot_log import LARGEST_GAP, LogRun, RobotLog, reads_torque

SECONDS = {"fixed": 0.6, "free": 0.3, "driven": 0.3}
"""Length of a window [s]. In the air errors fade with the drives' damping; a legged robot's grow, and nothing brings
joints back that torque alone drives."""

SPEED_STEPS = 0.05, 0.03
"""Uncertainty of the speed of joints [rad/s] and trunk [m/s] at a window's start."""

SLIPS = 3.0 * SPEED_STEPS[1]
"""Speed of a foot on the ground that is no error of reading, nor creep: where virtual robots stand, squat or lean it is
below 0.08 m/s, in a hundredth of a walk beyond 0.4 m/s."""

REPEATED = 0.02
"""Windows whose joints nowhere differ by more than this repeat each other [rad]: what the simulation of a robot at rest
gets wrong, it gets wrong in every window, and they say together what one of them says."""


@dataclass(frozen=True, kw_only=True)
class Windows:
    """W windows of S samples each, all of one run or several with the same step; J joints."""

    h: float
    """Physics step [s]."""
    steps: int
    """Physics steps of a window, K."""
    run: np.ndarray
    """Run of each window, shape (W,)."""
    start: np.ndarray
    """First sample in its run, shape (W,)."""
    t: np.ndarray
    """Time of each sample since the window's start [s], shape (W, S)."""
    feed: np.ndarray
    """Torque that commands ask for without ``-kp*q - kd*qd`` [N·m]: ``kp*q_des``, ``kd*qd_des``, ``tau_ff``; shape
    (3, W, K + 2*M, J), M steps lie before the window and as many after it."""
    before: int
    """M: steps of commands before and after the window, for delays and late stamps."""
    coil: np.ndarray
    """Coil current that was commanded [A], at the steps of ``feed``, shape (W, K + 2*M, J); 0 where none was logged."""
    coil_rows: np.ndarray
    """Coil current that rows of the log command [A], from before the window to after it, shape (W, R, J)."""
    coil_t: np.ndarray
    """Time of these rows since the window's start [s], shape (W, R)."""
    start_coil: np.ndarray
    """Coil current at the start [A], shape (W, J)."""
    kp: np.ndarray
    """[N·m/rad] at the steps of ``feed``, shape (W, K + 2*M, J)."""
    kd: np.ndarray
    """[N·m·s/rad], shape (W, J)."""
    q: np.ndarray
    """Angle at the start [rad], shape (W, J)."""
    qd: np.ndarray
    """[rad/s], shape (W, J)."""
    root: np.ndarray
    """Pose and velocity of the trunk at the start as in qpos and qvel, shape (W, 13); zero for a fixed base."""
    loaded: np.ndarray
    """Whether each of the model's feet bears load at the start, shape (W, F)."""
    measured: dict[str, np.ndarray]
    """Readings by channel, shape (W, S, C)."""
    gravity: np.ndarray
    """Torque that holds the links of a held robot at rest [N·m], at the steps of ``feed``, shape (W, K + 2*M, J)."""
    gravity_read: np.ndarray
    """Its value at the samples, shape (W, S, J)."""
    hidden: np.ndarray
    """Torque of a motion that the log does not have [N·m], at the steps of ``feed``, shape (W, K + 2*M, J)."""
    memory: np.ndarray
    """Hysteresis of each joint's device at the start [rad], by the motion since its run began, shape (W, J)."""

    @property
    def count(self) -> int:
        """W."""
        return len(self.start)

    def coarse(self, times: int) -> Windows:
        """Windows with steps ``times`` as long."""
        skip = self.before % times  # the window's start stays on the grid
        ends = skip + np.arange(0, self.kp.shape[1] - skip, times)

        def mean(x: np.ndarray, axis: int) -> np.ndarray:
            counts = np.diff(np.append(ends, x.shape[axis]))
            return np.add.reduceat(x, ends, axis=axis) / counts.reshape(-1, 1)

        return replace(
            self,
            h=self.h * times,
            steps=-(-self.steps // times),
            before=self.before // times,
            feed=mean(self.feed, 2),
            coil=mean(self.coil, 1),
            gravity=mean(self.gravity, 1),
            hidden=mean(self.hidden, 1),
            kp=mean(self.kp, 1),
        )

    def some(self, own: np.ndarray) -> Windows:
        """Some of the windows, by index."""
        common = {"h", "steps", "before", "feed", "measured"}
        each = {f.name: getattr(self, f.name)[own] for f in fields(self) if f.name not in common}
        return replace(
            self, **each, feed=self.feed[:, own], measured={name: x[own] for name, x in self.measured.items()}
        )

    @cached_property
    def distinct(self) -> np.ndarray:
        """One over how many windows repeat each window of a free robot, itself among them, shape (W,)."""
        if not self.root.any():
            return np.ones(self.count)
        q = self.measured["q"]
        return 1.0 / np.array([_repeating(q, own).sum() for own in q])

    @cached_property
    def nearest(self) -> tuple[np.ndarray, np.ndarray]:
        """Step below each sample and the share of the next, shapes (W, S), for interpolation among K + 1 states."""
        x = np.clip(self.t / self.h, 0.0, self.steps - 1e-9)
        low = x.astype(int)
        return low, x - low


def cut_windows(
    model: ReplayModel, log: RobotLog, *, budget: float = 60.0, longest_delay: float = LONGEST_DELAY
) -> list[Windows]:
    """Windows of a log, side by side; where it is longer than ``budget`` [s], evenly chosen ones.

    Runs of about the same step share a group.
    """
    settings = model.settings.robot
    length = SECONDS[log.base if (log.kp > 0.0).any() else "driven"]
    groups: dict[tuple[int, int], list] = {}
    every = max(1.0, log.seconds / budget)
    for index, run in enumerate(log.runs):
        count = max(4, round(length / run.dt))
        usual = LARGEST_GAP * run.dt
        gaps, path = np.flatnonzero(np.diff(run.t) > usual), run.joint["q"]
        first, chosen, credit = max(3, round(longest_delay / run.dt)), [], 0.0
        rough, wait = _roughness(model, run) if model.free else None, round(settings.quiet * count)
        while first + count < run.samples - 3:
            if rough is not None:
                first += int(np.argmin(rough[first : min(first + wait, run.samples - 3 - count)]))
            hit = gaps[(gaps >= first - 1) & (gaps < first + count)]
            if len(hit):
                first = int(hit[-1]) + 2
                continue
            credit += 1.0
            if credit >= every:
                if rough is None or _repeats(path, chosen, first, count) < settings.windows:
                    chosen.append(first)
                credit -= every
            first += count
        if chosen:
            groups.setdefault((count, round(np.log(run.dt) / 0.02)), []).append((index, run, chosen))
    return [_group(model, log, members, count, longest_delay) for (count, _), members in groups.items()]


def _repeats(q: np.ndarray, chosen: list[int], first: int, count: int) -> int:
    """How many of the windows that begin at ``chosen`` the one at ``first`` repeats, in angles along a run, (N, J)."""
    others = np.array([q[k : k + count] for k in chosen]).reshape(-1, count, q.shape[1])
    return int(_repeating(others, q[first : first + count]).sum())


def _repeating(others: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Which windows' angles, (W, S, J), are those of one, (S, J), where it begins and ends and between."""
    at = np.linspace(0, len(own) - 1, 4).astype(int)
    return np.abs(others[:, at] - own[at]).max(axis=(1, 2)) < REPEATED


def _group(model: ReplayModel, log: RobotLog, members: list, count: int, longest_delay: float) -> Windows:
    dt = float(np.median([run.dt for _, run, _ in members]))
    h = dt / max(1, round(np.ceil(dt / LONGEST_STEP)))
    span = max(float(run.t[s + count - 1] - run.t[s]) for _, run, starts in members for s in starts)
    steps, before = int(np.ceil(span / h)) + 1, int(np.ceil(longest_delay / h)) + 1
    rows: dict[str, list] = {
        name: []
        for name in (
            "run", "start", "t", "feed", "coil", "coil_rows", "coil_t", "start_coil", "kp", "kd", "q", "qd", "root",
            "memory", "loaded", "gravity", "gravity_read", "hidden",
        )
    }  # fmt: skip
    beyond = int(np.ceil(longest_delay / dt)) + 1
    around = np.arange(-beyond, count + beyond)
    channels: dict[str, list] = {}
    for index, run, starts in members:
        feed, kp, kd = _commands(log, run)
        speed = _speeds(run)
        coil = np.nan_to_num(run.joint.get("current_cmd", run.joint.get("current", np.zeros(speed.shape))))
        flowing = np.nan_to_num(run.joint.get("current", coil))
        begin = _roots(model, run, speed) if log.base == "free" else np.zeros((run.samples, 13))
        gravity = np.zeros(speed.shape) if log.base == "free" else gravity_along(model, run.joint["q"])
        hidden = model.hidden.torque[index] if model.hidden else np.zeros(speed.shape)
        readings, loaded, memory = _readings(log, run), _loaded(model, run), _memory(model, run, speed)
        for s in starts:
            t = run.t[s : s + count] - run.t[s]
            grid = run.t[s] + h * np.arange(-before, steps + before)
            # a row's command was computed after the row was read: it acts between this row and the next
            rows["run"].append(index)
            rows["start"].append(s)
            rows["t"].append(t)
            rows["feed"].append(np.stack([held_rows(x, run.t, grid, h) for x in feed]))
            rows["kp"].append(held_rows(kp, run.t, grid, h))
            rows["coil"].append(held_rows(coil, run.t, grid, h))
            rows["gravity"].append(held_rows(gravity, run.t, grid, h))
            rows["hidden"].append(held_rows(hidden, run.t, grid, h))
            rows["gravity_read"].append(gravity[s : s + count])
            near = np.clip(s + around, 0, run.samples - 1)
            rows["coil_rows"].append(coil[near])
            rows["coil_t"].append(run.t[near] - run.t[s])
            rows["start_coil"].append(flowing[s])
            rows["kd"].append(kd[s : s + count].mean(axis=0))
            rows["q"].append(run.joint["q"][s])
            rows["qd"].append(speed[s])
            rows["root"].append(begin[s])
            rows["loaded"].append(loaded[s])
            rows["memory"].append(memory[s])
            for name, values in readings.items():
                channels.setdefault(name, []).append(values[s : s + count])
    arrays = {name: np.array(values) for name, values in rows.items()}
    arrays["feed"] = np.ascontiguousarray(np.moveaxis(arrays["feed"], 1, 0))
    measured = {name: np.array(values) for name, values in channels.items() if len(values) == len(rows["start"])}
    return Windows(h=h, steps=steps, before=before, measured=measured, **arrays)


def _memory(model: ReplayModel, run: LogRun, speed: np.ndarray) -> np.ndarray:
    """Hysteresis of each joint's device along a run [rad], by its speed [rad/s], shapes (N, J).

    A device forgets after a path of some ``1 / (beta + gamma)`` [rad], however long that takes: 0.17 rad of the shipped
    one's, several strides of a leg that moves little. It is 0 where the run begins; what moved in a gap is not known.
    """
    found, at = np.zeros(speed.shape), model.devices.joint
    if not model.devices:
        return found
    seconds = np.minimum(np.diff(run.t, append=run.t[-1]), LARGEST_GAP * run.dt)
    mean = 0.5 * (speed + np.concatenate([speed[1:], speed[-1:]]))[:, at]
    z = wp.zeros(mean.shape, dtype=float, device="cpu")
    inputs = [wp.array(x, dtype=float, device="cpu") for x in (seconds, mean)]
    wp.launch(memory_kernel, len(at), [model.devices.structs(), *inputs], [z], device="cpu")
    found[:, at] = z.numpy()
    return found


def held_rows(x: np.ndarray, t: np.ndarray, grid: np.ndarray, h: float) -> np.ndarray:
    """Mean of rows (N, J) at times ``t``, each held until the next, over the steps of ``h`` that begin at ``grid``."""
    sums = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(np.diff(t)[:, None] * x[:-1], axis=0)])

    def sum_until(times: np.ndarray) -> np.ndarray:
        row = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 1)
        return sums[row] + (times - t[row])[:, None] * x[row]

    return (sum_until(grid + h) - sum_until(grid)) / h


def _commands(log: RobotLog, run: LogRun) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parts of the commanded torque without the feedback, shape (3, N, J), and both gains, (N, J), along a run."""
    joint, shape = run.joint, run.joint["q"].shape
    kp = np.broadcast_to(np.where(np.isfinite(log.kp), log.kp, 0.0), shape)
    kd = np.broadcast_to(np.where(np.isfinite(log.kd), log.kd, 0.0), shape)
    if "kp" in joint:
        kp = np.where(np.isfinite(joint["kp"]), joint["kp"], kp)
    if "kd" in joint:
        kd = np.where(np.isfinite(joint["kd"]), joint["kd"], kd)
    target = joint.get("q_des", np.full(shape, np.nan))
    kp = np.where(np.isfinite(target), kp, 0.0)
    torque = joint.get("tau_ff", np.zeros(shape))
    if "tau_ff" not in joint and "q_des" not in joint:
        torque, kd = joint["tau"], np.zeros(shape)  # no command at all: what the motors gave drives the replay
    feed = np.stack([kp * np.nan_to_num(target), kd * np.nan_to_num(joint.get("qd_des", np.zeros(shape))), torque])
    return np.nan_to_num(feed), kp, kd


def _speeds(run: LogRun) -> np.ndarray:
    """Velocity of the joints along a run, smoothed over five samples; shape (N, J)."""
    q = run.joint["q"]
    width = min(7, 2 * ((run.samples - 1) // 2) + 1)
    found = np.asarray(savgol_filter(q, width, 2, deriv=1, delta=run.dt, axis=0))
    logged = run.joint.get("qd")
    if logged is None:
        return found
    read = np.isfinite(logged).all(axis=0)
    return np.where(read, np.asarray(savgol_filter(np.nan_to_num(logged), min(5, width), 2, axis=0)), found)


def _roughness(model: ReplayModel, run: LogRun) -> np.ndarray:
    """How much joints and trunk change their speed about each sample, in what is not known of a start; shape (N,)."""
    speed = _speeds(run)
    trunk = _roots(model, run, speed)[:, 7:10]
    change = np.gradient(speed, axis=0) / SPEED_STEPS[0], np.gradient(trunk, axis=0) / SPEED_STEPS[1]
    return maximum_filter1d((change[0] ** 2).sum(axis=1) + (change[1] ** 2).sum(axis=1), 5)


def _readings(log: RobotLog, run: LogRun) -> dict[str, np.ndarray]:
    """Channels that a replay is compared with, shape (N, C)."""
    found = {"q": run.joint["q"]}
    if "qd" in run.joint and np.isfinite(run.joint["qd"]).any():
        found["qd"] = run.joint["qd"]
    if "current" in run.joint and "current_cmd" in run.joint:
        found["current"] = run.joint["current"]
    if reads_torque(log, run):
        found["tau"] = run.joint["tau"]
    for name in ("quat", "gyro", "pos", "vel"):
        if log.base == "free" and name in run.base:
            found[name] = run.base[name]
    return found


def _roots(model: ReplayModel, run: LogRun, speed: np.ndarray) -> np.ndarray:
    """Pose and velocity of the trunk along a run, shape (N, 13); what was not logged follows from the feet.

    Feet that bear load have sunk into the ground by their share of the weight, and roll on it without slip.
    """
    count = run.samples
    found, speeds = np.zeros((count, 13)), np.zeros((count, 3))
    found[:, 3:7], found[:, 10:13] = _attitude(run)
    place, velocity = run.base.get("pos"), run.base.get("vel")
    for k, (height, steady) in enumerate(_by_feet(model, run, speed)):
        found[k, 2], speeds[k] = height, steady.mean(axis=0)
    width = min(9, 2 * ((count - 1) // 2) + 1)
    found[:, 7:10] = savgol_filter(speeds, width, 1, axis=0)
    if place is not None:
        found[:, :3] = place
    if velocity is not None:
        found[:, 7:10] = velocity
    return found


def _attitude(run: LogRun) -> tuple[np.ndarray, np.ndarray]:
    """Orientation, (N, 4), and angular velocity, (N, 3) [rad/s], of the trunk along a run; level and 0 without.

    Without a gyroscope the velocity is the change of the orientation over four rows.
    """
    quat = run.base.get("quat", np.tile([1.0, 0.0, 0.0, 0.0], (run.samples, 1)))
    quat = quat / np.linalg.norm(quat, axis=1, keepdims=True)
    if "gyro" in run.base:
        return quat, run.base["gyro"]
    k = np.arange(run.samples)
    begin, end = np.maximum(k - 2, 0), np.minimum(k + 2, run.samples - 1)
    return quat, turn_between(quat[begin], quat[end]) / (run.t[end] - run.t[begin])[:, None]


def _by_feet(model: ReplayModel, run: LogRun, speed: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Motion of the trunk by feet that bear load along a run, see :meth:`Stance.by_feet`; joints' speed (N, J)."""
    mj, stance, loaded, (quat, gyro) = model.model, Stance(model, model.model), _loaded(model, run), _attitude(run)
    qpos, qvel = mj.qpos0.copy(), np.zeros(mj.nv)
    for k in range(run.samples):
        qpos[3:7], qvel[3:6] = quat[k], gyro[k]
        qpos[model.q_adr], qvel[model.v_adr] = run.joint["q"][k], speed[k]
        yield stance.by_feet(qpos, qvel, loaded[k])


def foot_slipped(model: ReplayModel, log: RobotLog) -> bool:
    """Whether a foot that bore load moved on the ground: by more than :data:`SLIPS` from the mean of those feet."""
    return any(
        float(np.abs(steady - steady.mean(axis=0))[:, :2].max()) > SLIPS
        for run in log.runs
        for _, steady in _by_feet(model, run, _speeds(run))
    )


def _loaded(model: ReplayModel, run: LogRun) -> np.ndarray:
    """Whether each of the model's feet bears load, by the log's foot forces or switches, shape (N, F).

    A foot that the log does not have bears none; one whose reading hardly changes stands all the time.
    """
    mj, found = model.model, np.zeros((run.samples, len(model.feet)), dtype=bool)
    for k, foot in enumerate(model.feet):
        names = f"{mj.geom(foot).name} {mj.body(int(mj.geom_bodyid[foot])).name}".lower()
        own = [x for name, x in run.feet.items() if name.lower() in names]
        if len(own) == 1:
            least, most = np.nanquantile(own[0], (0.1, 0.9))
            if most > 0.0:
                bears = own[0] > least + model.settings.gain.half * (most - least)
                found[:, k] = bears if most - least > model.settings.gain.half * most else True
    return found


def turned(quat: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Quaternions (w, x, y, z) turned about their own axes by rotation vectors; shapes (..., 4) and (..., 3)."""
    return product(quat, quaternion(by))


def quaternion(turn: np.ndarray) -> np.ndarray:
    """Quaternions (w, x, y, z) of rotation vectors; shapes (..., 3) and (..., 4)."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * turn], axis=-1)


def turn_between(quat: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Rotation vectors from ``quat`` to ``other``, in the axes of ``quat``; shapes (..., 4), result (..., 3)."""
    turn = product(quat * np.array([1.0, -1.0, -1.0, -1.0]), other)
    turn = np.where(turn[..., :1] < 0.0, -turn, turn)
    sine = np.linalg.norm(turn[..., 1:], axis=-1, keepdims=True)
    return 2.0 * np.arctan2(sine, turn[..., :1]) / np.maximum(sine, 1e-30) * turn[..., 1:]


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton's product of quaternions (w, x, y, z), shapes (..., 4)."""
    (aw, ax, ay, az), (bw, bx, by, bz) = (np.moveaxis(x, -1, 0) for x in (a, b))
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw,
        ], axis=-1,
    )  # fmt: skip


def mismatch(measured: dict[str, np.ndarray], predicted: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Measured minus predicted by channel, shape (E, S, C); orientations as rotation vectors."""
    return {
        name: turn_between(predicted[name], values) if name == "quat" else values - predicted[name]
        for name, values in measured.items()
    }


def side_by_side(x: dict[str, np.ndarray]) -> np.ndarray:
    """All channels of each of E windows in one row, (E, N)."""
    return np.concatenate([values.reshape(len(values), -1) for values in x.values()], axis=1)
