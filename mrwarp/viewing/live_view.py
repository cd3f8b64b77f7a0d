"""A running simulation in rerun: where a recording goes, and what of a training, a sweep or a policy is shown."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from mrwarp.env.sim_model import Scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.impact import ImpactSweep
from mrwarp.trials.walking import measure
from mrwarp.viewing.frames import FrameReader, Frames, FrameStream
from mrwarp.viewing.viewer import DEFAULT_URL, WebViewer, check_viewer, open_window

if TYPE_CHECKING:
    import rerun as rr

APPLICATION = "mrwarp"
"""rerun's application id: recordings with the same one share a layout in the viewer."""


@dataclass(frozen=True)
class Sink:
    """A recording and where it goes; ``live``: to a viewer, not into a file; ``web``: the page it is served on."""

    recording: rr.RecordingStream
    live: bool
    web: WebViewer | None = None


def open_sink(
    *, rrd: Path | None = None, url: str | None = None, web: bool = False, web_port: int | None = None
) -> Sink:
    """A new recording into a file, to a viewer that runs already, to a browser, or else to rerun's window.

    Args:
        rrd: File to write; its folder is made.
        url: Viewer to send to.
        web: Serve a page.
        web_port: Port of the page; None takes :data:`mrwarp.viewing.viewer.DEFAULT_PORT`, or a free one.

    Raises:
        ViewerError: the viewer is not there or does not start.
        OSError: the folder cannot be made, or the port is taken.
    """
    import rerun as rr  # pictures and figures do without

    recording = rr.RecordingStream(APPLICATION)
    if rrd is not None:
        rrd.parent.mkdir(parents=True, exist_ok=True)
        recording.save(rrd)
        return Sink(recording, live=False)
    page = WebViewer(web_port) if web and not url else None
    connect(recording, page.url if page else url or open_window())
    return Sink(recording, live=True, web=page)


def connect(recording: rr.RecordingStream, url: str = DEFAULT_URL) -> None:
    """Send everything logged from now on to a viewer that runs already.

    Raises:
        ViewerError: see :func:`mrwarp.viewing.viewer.check_viewer`.
    """
    check_viewer(url)
    recording.connect_grpc(url)


def disconnect(recording: rr.RecordingStream, timeout: float = 5.0) -> bool:
    """Flush and disconnect within ``timeout`` [s]; False if the viewer did not take everything."""
    try:
        recording.flush(timeout_sec=timeout)
        complete = True
    except RuntimeError:  # too slow, or the viewer went away
        complete = False
    # disconnecting from a viewer that hangs never returns: leave it to a thread that dies with the process
    thread = threading.Thread(target=recording.disconnect, name="rerun disconnect", daemon=True)
    thread.start()
    thread.join(timeout)
    if thread.is_alive():
        import rerun as rr

        rr.unregister_shutdown()  # rerun's own exit handler would wait as well
        return False
    return complete


class LiveView:
    """Robots of one scene, shown while they are simulated.

    Args:
        scene: What is simulated.
        currents: Current I_e of each shown robot [A].
        sink: Where it is shown.
        batch: Least number of frames that are sent together.
        drop: Drop frames rather than wait for a slow viewer.
        impact: Compare the vertical velocity instead of the forward velocity.

    Attributes:
        names: Entity names of the robots.
        log: Shows frames, see :meth:`mrwarp.viewing.frames.FrameStream.log`.
    """

    def __init__(
        self, scene: Scene, currents: Sequence[float], sink: Sink, *, batch: int, drop: bool, impact: bool = False
    ) -> None:
        from mrwarp.viewing.robot_view import RobotLogger, make_blueprint  # loads rerun

        robots = RobotLogger(scene, currents, sink.recording)
        sink.recording.send_blueprint(make_blueprint(robots, live=sink.live, impact=impact))
        self.names = robots.names
        self._sink, self._stream = sink, FrameStream(robots.log, drop=drop, batch=batch)
        self.log = self._stream.log

    @property
    def dropped(self) -> int:
        """Frames that were dropped."""
        return self._stream.dropped

    def close(self, timeout: float = 10.0) -> bool:
        """Send what is left and disconnect; a viewer that went away is survived, a file is written to its end.

        Args:
            timeout: Longest wait for a viewer, twice [s].

        Returns:
            False if the viewer or the file did not take everything.
        """
        recording = self._sink.recording
        if self._sink.live:
            complete = self._stream.close(timeout)
            return disconnect(recording, timeout) and complete and not self.dropped
        complete = self._stream.close()
        recording.flush()
        recording.disconnect()
        return complete


class LiveTraining(LiveView):
    """One robot of each current group of a training; training never waits for the viewer.

    With ``rrd`` a recording is written instead of opening rerun's window; ``url`` is a viewer that runs already.

    Raises:
        ViewerError: no viewer could be reached or opened.
    """

    SHOWN = 4
    """Robots that are shown: one per current group."""

    EVERY = 2
    """Policy steps per shown instant: 25 Hz of simulated time."""

    BATCH = 25
    """Instants sent together: one second of simulated time."""

    def __init__(self, env: WalkEnv, *, rrd: Path | None = None, url: str | None = None) -> None:
        self._env, self._steps = env, 0
        self._shown = [i * env.num_envs // self.SHOWN for i in range(min(self.SHOWN, env.num_envs))]
        currents = [float(env.current_e[i]) for i in self._shown]
        super().__init__(env.sim.scene, currents, open_sink(rrd=rrd, url=url), batch=self.BATCH, drop=True)
        self._reader = FrameReader(env.robot, self._shown)

    def update(self) -> None:
        """Call after every policy step."""
        self._steps += 1
        if self._steps % self.EVERY == 0:
            command = [float(self._env.command[i, 0]) for i in self._shown]
            self.log(self._reader.read(self._steps * self._env.cfg.step_dt, command))


class ImpactView(LiveView):
    """The first trial of every setting of an impact sweep, from just before the impact.

    Args:
        sweep: The sweep; it will be watched.
        sink: Where it is shown; a live viewer that is slow misses frames.

    Attributes:
        minima: Lowest trunk height and largest downward speed of each shown robot after the impact.
    """

    BEFORE = 1.0
    """Walking shown before the impact [s]."""

    def __init__(self, sweep: ImpactSweep, sink: Sink) -> None:
        cfg, self._env = sweep.cfg, sweep.env
        batch = 10 if sink.live else 200
        super().__init__(self._env.sim.scene, cfg.currents, sink, batch=batch, drop=sink.live, impact=True)
        self._shown = [i * cfg.trials for i in range(len(cfg.variants))]
        self._reader = FrameReader(self._env.robot, self._shown)
        self._command = [cfg.speed] * len(self._shown)
        self.minima = [{"robot": name, "min_height": math.inf, "peak_down_velocity": math.inf} for name in self.names]
        sweep.watchers.append(self._watch)

    def _watch(self, since: float) -> None:
        if since < -self.BEFORE:
            return
        self.log(self._reader.read(since + self.BEFORE, self._command))
        if since > 0.0:
            for row, env in zip(self.minima, self._shown, strict=True):
                row["min_height"] = min(row["min_height"], float(self._env.root_pos[env, 2]))
                row["peak_down_velocity"] = min(row["peak_down_velocity"], float(self._env.root_vel[env, 2]))


class Player:
    """One run of a policy, measured, and shown in rerun or kept for a picture.

    Args:
        env: Evaluation environments, see :func:`mrwarp.trials.walking.make_env`.
        actor: Observations to actions (E, 12).
        speed: Commanded forward speed [m/s].
        shown: Environments that are shown, by index.
        sink: Where they are shown; None shows nothing.
        keep: Keep the frames, for a picture.

    Attributes:
        currents: Current I_e of each shown robot [A].
        frames: What was shown, if kept.
    """

    LIVE_BATCH, FILE_BATCH = 5, 50
    """Frames that are sent together: live 0.1 s, so that it stays smooth; to a file 1 s, which costs least."""

    def __init__(
        self,
        env: WalkEnv,
        actor: Callable[[Any], torch.Tensor],
        *,
        speed: float,
        shown: Sequence[int],
        sink: Sink | None = None,
        keep: bool = False,
    ) -> None:
        self.env, self._actor, self._speed = env, actor, speed
        self._shown, self.sink, self._keep = list(shown), sink, keep
        self.currents = [round(float(env.current_e[i]), 6) for i in shown]
        self.frames: list[Frames] = []
        self._reader = FrameReader(env.robot, shown)
        self._view: LiveView | None = None
        if sink is not None:
            batch = self.LIVE_BATCH if sink.live else self.FILE_BATCH
            self._view = LiveView(env.sim.scene, self.currents, sink, batch=batch, drop=sink.live)
        self._steps, self._start = 0, 0.0
        self._falls: list[dict[str, Any]] = []

    @property
    def dropped(self) -> int:
        """Frames that were dropped because a viewer was too slow."""
        return self._view.dropped if self._view else 0

    def play(self, seconds: float, *, warmup: float) -> dict[str, Any]:
        """Run for ``seconds`` [s], the first ``warmup`` [s] of them unmeasured; live at real time, else at full speed.

        Returns:
            Figures of :func:`mrwarp.trials.walking.measure`, and ``falls`` (robot and time [s]), ``speed`` [m/s],
            ``shown_seconds``.

        Raises:
            RuntimeError: frames can no longer be written to the file.
        """
        command = torch.zeros(self.env.num_envs, 3, device=self.env.device)
        command[:, 0] = self._speed
        self.env.set_command(command)
        self._steps, self._start = 0, time.perf_counter()
        figures = measure(self.env, self._act, command, warmup=warmup, seconds=seconds - warmup)
        self._show()
        return {**figures, "speed": self._speed, "shown_seconds": seconds, "falls": self._falls}

    def close(self, timeout: float = 5.0) -> bool:
        """Finish the recording; False if a viewer did not take everything. Never hangs on a viewer."""
        return self._view is None or self._view.close(timeout)

    def _act(self, obs: Any) -> torch.Tensor:
        """The policy, which shows the state that it is asked in."""
        self._show()
        self._steps += 1
        return self._actor(obs)

    def _show(self) -> None:
        now = self._steps * self.env.cfg.step_dt
        self._falls += [
            {"robot": int(i), "current": float(self.env.current_e[i]), "time": round(now, 6)}
            for i in self.env.fallen.nonzero()[:, 0].tolist()
        ]
        if self._view is None and not self._keep:
            return
        frames = self._reader.read(now, [self._speed] * len(self._shown))
        if self._keep:
            self.frames.append(frames)
        if self._view is not None:
            self._view.log(frames)
        if self.sink is not None and self.sink.live:
            time.sleep(max(0.0, self._start + now - time.perf_counter()))
