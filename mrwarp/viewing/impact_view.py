"""An impact sweep in rerun: the first trial of every current side by side, from just before the impact."""

from __future__ import annotations

import math
import time
from pathlib import Path

import rerun as rr

from mrwarp.trials.impact import ImpactSweep
from mrwarp.viewing.blueprint import make_blueprint
from mrwarp.viewing.frames import FrameReader
from mrwarp.viewing.robot_view import RobotLogger
from mrwarp.viewing.stream import FrameStream, close, open_sink
from mrwarp.viewing.web import WebViewer

BEFORE = 1.0
"""Walking shown before the impact [s]."""


class ImpactView:
    """Streams the first trial of every setting of a sweep.

    Args:
        sweep: The sweep; it will be watched.
        recording: rerun recording with its sink set.
        live: Drop frames rather than wait for the viewer.

    Attributes:
        minima: Lowest trunk height and largest downward speed of each shown robot after the impact.
    """

    def __init__(self, sweep: ImpactSweep, recording: rr.RecordingStream, *, live: bool) -> None:
        trials = sweep.cfg.trials
        shown = [i * trials for i in range(len(sweep.cfg.variants))]
        env = sweep.env
        self._env, self._shown, self._recording = env, shown, recording
        self._robots = RobotLogger(env.sim.scene, sweep.cfg.currents, recording)
        recording.send_blueprint(make_blueprint(self._robots, live=live, impact=True))
        self._reader = FrameReader(env.robot, shown)
        self._stream = FrameStream(self._robots.log, drop=live, batch=10 if live else 200)
        self._command = [sweep.cfg.speed] * len(shown)
        self.minima = [
            {"robot": name, "min_height": math.inf, "peak_down_velocity": math.inf} for name in self._robots.names
        ]
        self._web: WebViewer | None = None
        sweep.watchers.append(self._watch)

    @classmethod
    def open(
        cls, sweep: ImpactSweep, *, live: bool, rrd: Path | None, connect: str | None, serve_web: bool
    ) -> ImpactView | None:
        """Attach the view that the options ask for, or none.

        Raises:
            ViewerError: no viewer could be reached or started.
        """
        if not (live or rrd or connect or serve_web):
            return None
        sink = open_sink(rrd=rrd, url=connect, web=serve_web)
        view = cls(sweep, sink.recording, live=sink.live)
        view._web = sink.web
        return view

    def close(self) -> None:
        """Send what is left and disconnect; a viewer that went away is survived."""
        self._stream.close(timeout=10.0)
        close(self._recording)

    def wait(self) -> None:
        """Keep a web viewer served until Ctrl-C."""
        if self._web is None:
            return
        print(f"open {self._web.page} in a browser on this machine; Ctrl-C ends", flush=True)
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            self._web.close()

    def _watch(self, since: float) -> None:
        if since < -BEFORE:
            return
        self._stream.log(self._reader.read(since + BEFORE, self._command))
        if since > 0.0:
            for row, env in zip(self.minima, self._shown, strict=True):
                row["min_height"] = min(row["min_height"], float(self._env.root_pos[env, 2]))
                row["peak_down_velocity"] = min(row["peak_down_velocity"], float(self._env.root_vel[env, 2]))
