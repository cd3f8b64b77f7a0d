"""A running simulation in rerun: the robots' log, their layout and the stream to the viewer put together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mrwarp.env.sim_model import Scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.viewing import stream
from mrwarp.viewing.frames import FrameReader, Frames
from mrwarp.viewing.robot_view import RobotLogger, make_blueprint

SHOWN = 4
"""Robots of a training that are shown: one per current group."""

EVERY = 2
"""Policy steps of a training per shown instant: 25 Hz of simulated time."""

BATCH = 25
"""Instants of a training sent together: one second of simulated time."""


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
        robots: What logs the frames.
    """

    def __init__(
        self,
        scene: Scene,
        currents: Sequence[float],
        sink: stream.Sink,
        *,
        batch: int,
        drop: bool,
        impact: bool = False,
    ) -> None:
        self.robots = RobotLogger(scene, currents, sink.recording)
        sink.recording.send_blueprint(make_blueprint(self.robots, live=sink.live, impact=impact))
        self._sink = sink
        self._stream = stream.FrameStream(self.robots.log, drop=drop, batch=batch)

    @property
    def dropped(self) -> int:
        """Frames that were dropped."""
        return self._stream.dropped

    def log(self, frames: Frames) -> None:
        """Show frames; see :meth:`mrwarp.viewing.stream.FrameStream.log`."""
        self._stream.log(frames)

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
            return stream.close(recording, timeout) and complete and not self.dropped
        complete = self._stream.close()
        recording.flush()
        recording.disconnect()
        return complete


class LiveTraining:
    """One robot of each current group of a training; training never waits for the viewer.

    Args:
        env: The training's environments.
        rrd: Write a recording instead of opening rerun's window.
        url: Send to a viewer that runs already instead.

    Raises:
        ViewerError: no viewer could be reached or opened.
    """

    def __init__(self, env: WalkEnv, *, rrd: Path | None = None, url: str | None = None) -> None:
        sink = stream.open_sink(rrd=rrd, url=url)
        self._env, self._steps = env, 0
        self._shown = [i * env.num_envs // SHOWN for i in range(min(SHOWN, env.num_envs))]
        currents = [float(env.current_e[i]) for i in self._shown]
        self._view = LiveView(env.sim.scene, currents, sink, batch=BATCH, drop=True)
        self._reader = FrameReader(env.robot, self._shown)

    def update(self) -> None:
        """Call after every policy step."""
        self._steps += 1
        if self._steps % EVERY == 0:
            command = [float(self._env.command[i, 0]) for i in self._shown]
            self._view.log(self._reader.read(self._steps * self._env.cfg.step_dt, command))

    def close(self) -> None:
        """Send what is left and disconnect."""
        self._view.close()
