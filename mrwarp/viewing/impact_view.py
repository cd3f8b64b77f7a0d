"""An impact sweep in rerun: the first trial of every current side by side, from just before the impact."""

from __future__ import annotations

import math
import time
from pathlib import Path

from mrwarp.trials.impact import ImpactSweep
from mrwarp.viewing.frames import FrameReader
from mrwarp.viewing.live_view import LiveView
from mrwarp.viewing.stream import Sink, open_sink

BEFORE = 1.0
"""Walking shown before the impact [s]."""


class ImpactView:
    """Streams the first trial of every setting of a sweep.

    Args:
        sweep: The sweep; it will be watched.
        sink: Where it is shown; a live viewer that is slow misses frames.

    Attributes:
        minima: Lowest trunk height and largest downward speed of each shown robot after the impact.
    """

    def __init__(self, sweep: ImpactSweep, sink: Sink) -> None:
        trials = sweep.cfg.trials
        shown = [i * trials for i in range(len(sweep.cfg.variants))]
        env = sweep.env
        self._env, self._shown, self._web = env, shown, sink.web
        batch = 10 if sink.live else 200
        self._view = LiveView(env.sim.scene, sweep.cfg.currents, sink, batch=batch, drop=sink.live, impact=True)
        self._reader = FrameReader(env.robot, shown)
        self._command = [sweep.cfg.speed] * len(shown)
        names = self._view.robots.names
        self.minima = [{"robot": name, "min_height": math.inf, "peak_down_velocity": math.inf} for name in names]
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
        return cls(sweep, open_sink(rrd=rrd, url=connect, web=serve_web))

    def close(self) -> None:
        """Send what is left and disconnect; a viewer that went away is survived."""
        self._view.close()

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
        self._view.log(self._reader.read(since + BEFORE, self._command))
        if since > 0.0:
            for row, env in zip(self.minima, self._shown, strict=True):
                row["min_height"] = min(row["min_height"], float(self._env.root_pos[env, 2]))
                row["peak_down_velocity"] = min(row["peak_down_velocity"], float(self._env.root_vel[env, 2]))
