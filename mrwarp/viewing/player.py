"""Player: rolls a policy out, measures it, and shows every policy step in rerun or keeps it for a picture."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch

from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.walking import measure
from mrwarp.viewing.frames import FrameReader, Frames
from mrwarp.viewing.live_view import LiveView
from mrwarp.viewing.robot_pictures import contact_sheet
from mrwarp.viewing.stream import Sink, open_sink
from mrwarp.viewing.viewer import DEFAULT_URL

LIVE_BATCH, FILE_BATCH = 5, 50
"""Frames that are sent together: live 0.1 s, so that it stays smooth; to a file 1 s, which costs least."""


class Player:
    """One run of a policy that can be watched.

    Args:
        env: Evaluation environments, see :func:`mrwarp.trials.walking.make_env`.
        actor: Observations to actions (E, 12).
        speed: Commanded forward speed [m/s].
        shown: Environments that are shown, by index.

    Attributes:
        currents: Current I_e of each shown robot [A].
        frames: What was shown, if kept.
        page: Address of the page in a browser, or None.
        dropped: Frames that a slow viewer missed.
    """

    def __init__(
        self, env: WalkEnv, actor: Callable[[Any], torch.Tensor], *, speed: float, shown: Sequence[int]
    ) -> None:
        self.env, self._actor, self._speed = env, actor, speed
        self._shown = list(shown)
        self.currents = [round(float(env.current_e[i]), 6) for i in shown]
        self.frames: list[Frames] = []
        self.page: str | None = None
        self._reader = FrameReader(env.robot, shown)
        self._sink: Sink | None = None
        self._view: LiveView | None = None
        self._rrd: Path | None = None
        self._keep = False
        self._steps, self._start = 0, 0.0
        self._falls: list[dict[str, Any]] = []

    @property
    def dropped(self) -> int:
        """Frames that were dropped because a viewer was too slow."""
        return self._view.dropped if self._view else 0

    def open(
        self,
        *,
        rrd: Path | None = None,
        url: str | None = None,
        web: bool = False,
        web_port: int | None = None,
        window: bool = False,
        keep: bool = False,
    ) -> None:
        """Choose where to show; at most one of file, running viewer, browser and window.

        Args:
            rrd: Recording to write.
            url: Viewer to send to; "default" is rerun's own address.
            web: Serve a page.
            web_port: Its port, or None.
            window: Open rerun's window.
            keep: Keep the frames for :meth:`picture`.

        Raises:
            ViewerError: the viewer is not there or does not start.
            OSError: the file cannot be written, or the port is taken.
        """
        self._keep = keep
        if not (rrd or url or web or window):
            return
        sink = self._sink = open_sink(
            rrd=_partial(rrd) if rrd else None,
            url=DEFAULT_URL if url == "default" else url,
            web=web,
            web_port=web_port,
        )
        self._rrd, self.page = rrd, sink.web.page if sink.web else None
        batch = LIVE_BATCH if sink.live else FILE_BATCH
        self._view = LiveView(self.env.sim.scene, self.currents, sink, batch=batch, drop=sink.live)

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
        complete = self._view is None or self._view.close(timeout)
        if self._rrd is not None:
            _partial(self._rrd).replace(self._rrd)
        return complete

    def end(self) -> None:
        """Take the page away; a window stays."""
        if self._sink is not None and self._sink.web is not None:
            self._sink.web.close()

    def picture(self, path: Path, title: str) -> None:
        """Write the contact sheet of what was kept."""
        contact_sheet(self.env.sim.scene, Frames.join(self.frames), self.currents, path, title=title)

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
        if self._sink is not None and self._sink.live:
            time.sleep(max(0.0, self._start + now - time.perf_counter()))


def _partial(path: Path) -> Path:
    return path.with_name(path.name + ".part")
