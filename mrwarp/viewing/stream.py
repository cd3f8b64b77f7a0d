"""Getting frames to rerun: a recording's sink, and a thread that logs so that the simulation never waits for a viewer.

rerun's sinks are asynchronous, but only up to a quota: behind a viewer that hangs, ``log`` blocks once about 100 MB are
waiting, and disconnecting blocks for good. Hence the thread, the queue that drops, and the closing with a time limit.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import rerun as rr

from mrwarp.viewing.frames import Frames
from mrwarp.viewing.viewer import DEFAULT_URL, ViewerError, WebViewer, listens, open_window

APPLICATION = "mrwarp"
"""rerun's application id: recordings with the same one share a layout in the viewer."""

MOST_TOGETHER = 100
"""Most frames in one batch."""

LIVE_INTERVAL = 0.1
"""Least time between two batches to a viewer [s]."""


class FrameStream:
    """Logs frames on a thread of its own, in batches.

    Args:
        log: What takes the frames, e.g. ``RobotLogger.log``; called on the thread only.
        drop: With a full queue drop frames (live) instead of waiting (file).
        batch: Least number of frames that are logged together, up to MOST_TOGETHER.
        capacity: Longest queue, in frames.

    Attributes:
        dropped: Frames that were dropped.
    """

    def __init__(self, log: Callable[[Frames], None], *, drop: bool, batch: int, capacity: int = 500) -> None:
        self.dropped = 0
        self._log, self._drop, self._batch = log, drop, batch
        self._queue: queue.Queue[Frames | None] = queue.Queue(capacity)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="frame stream", daemon=True)
        self._thread.start()

    def log(self, frames: Frames) -> None:
        """Queue frames; never blocks when dropping.

        Raises:
            RuntimeError: logging failed earlier, and frames may not be dropped.
        """
        if self._error is not None:
            if not self._drop:
                raise RuntimeError(f"frames cannot be logged: {self._error}") from self._error
            self.dropped += len(frames)
        elif self._drop:
            try:
                self._queue.put_nowait(frames)
            except queue.Full:
                self.dropped += len(frames)
        else:
            self._queue.put(frames)

    def close(self, timeout: float | None = None) -> bool:
        """Log what is queued and end the thread; False if that failed or took longer than ``timeout`` [s]."""
        try:
            self._queue.put(None, timeout=timeout)
        except queue.Full:
            return False
        self._thread.join(timeout)
        return not self._thread.is_alive() and self._error is None

    def _run(self) -> None:
        waiting: list[Frames] = []
        logged = -LIVE_INTERVAL
        while True:
            frames = self._queue.get()
            if frames is not None:
                waiting.append(frames)
            # behind a fast simulation the batches grow: each frame costs less, and leaves the interpreter to others
            rested = not self._drop or time.monotonic() - logged >= LIVE_INTERVAL
            full = len(waiting) >= self._batch and rested and self._queue.empty() or len(waiting) >= MOST_TOGETHER
            if waiting and (frames is None or full):
                try:
                    if self._error is None:
                        self._log(Frames.join(waiting))
                except Exception as error:  # whatever it is: the simulation goes on, or hears of it in log()
                    self._error = error
                waiting, logged = [], time.monotonic()
            if frames is None:
                return


def new_recording() -> rr.RecordingStream:
    """A recording without a sink yet."""
    return rr.RecordingStream(APPLICATION)


def connect(recording: rr.RecordingStream, url: str = DEFAULT_URL) -> None:
    """Send everything logged from now on to a viewer that runs already.

    Raises:
        ViewerError: the address is none of rerun's, or nobody listens there.
    """
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError:
        port = None
    if parts.scheme not in ("rerun", "rerun+http", "rerun+https") or not parts.hostname or parts.path != "/proxy":
        raise ViewerError(f"{url}: not the address of a rerun viewer; one looks like {DEFAULT_URL}")
    if not listens(parts.hostname, port or 443):
        raise ViewerError(f"{url}: no viewer listens there; start one with 'rerun', or save a file with --rrd")
    recording.connect_grpc(url)


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
    recording = new_recording()
    if rrd is not None:
        rrd.parent.mkdir(parents=True, exist_ok=True)
        recording.save(rrd)
        return Sink(recording, live=False)
    if web and not url:
        page = WebViewer(web_port)
        connect(recording, page.url)
        return Sink(recording, live=True, web=page)
    connect(recording, url or open_window())
    return Sink(recording, live=True)


def close(recording: rr.RecordingStream, timeout: float = 5.0) -> bool:
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
        rr.unregister_shutdown()  # rerun's own exit handler would wait as well
        return False
    return complete
