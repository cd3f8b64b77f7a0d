"""A few robots of a running training in rerun, live or into a file; training never waits for the viewer."""

from __future__ import annotations

from pathlib import Path

from mrwarp.env.vec_env import WalkEnv
from mrwarp.viewing import stream
from mrwarp.viewing.blueprint import make_blueprint
from mrwarp.viewing.frames import FrameReader
from mrwarp.viewing.robot_view import RobotLogger

SHOWN = 4
"""Robots that are shown: one per current group."""

EVERY = 2
"""Policy steps per shown instant: 25 Hz of simulated time."""

BATCH = 25
"""Instants sent together: one second of simulated time."""


class LiveTraining:
    """Streams one robot of each current group.

    Args:
        env: The training's environments.
        rrd: Write a recording instead of opening rerun's window.
        url: Send to a viewer that runs already instead.

    Raises:
        ViewerError: no viewer could be reached or opened.
    """

    def __init__(self, env: WalkEnv, *, rrd: Path | None = None, url: str | None = None) -> None:
        sink = stream.open_sink(rrd=rrd, url=url)
        self._recording = sink.recording
        shown = [i * env.num_envs // SHOWN for i in range(min(SHOWN, env.num_envs))]
        robots = RobotLogger(env.sim.scene, [float(env.current_e[i]) for i in shown], self._recording)
        self._recording.send_blueprint(make_blueprint(robots, live=sink.live))
        self._stream = stream.FrameStream(robots.log, drop=True, batch=BATCH)
        self._env, self._shown, self._steps = env, shown, 0
        self._reader = FrameReader(env.robot, shown)

    def update(self) -> None:
        """Call after every policy step."""
        self._steps += 1
        if self._steps % EVERY == 0:
            command = [float(self._env.command[i, 0]) for i in self._shown]
            self._stream.log(self._reader.read(self._steps * self._env.cfg.step_dt, command))

    def close(self) -> None:
        """Send what is left and disconnect; a viewer that went away is survived."""
        self._stream.close(timeout=10.0)
        stream.close(self._recording)
