"""Getting frames to rerun: a recording's sink, and a thread that logs so that the simulation never waits for a viewer.

rerun's sinks are asynchronous, but only up to a quota: behind a viewer that hangs, ``log`` blocks once about 100 MB are
waiting, and disconnecting blocks for good. Hence the thread, the queue that drops, and the closing with a time limit.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import rerun as rr

from mrwarp.viewing.frames import Frames

if TYPE_CHECKING:
    from mrwarp.viewing.web import WebViewer

APPLICATION = "mrwarp"
"""rerun's application id: recordings with the same one share a layout in the viewer."""

LOCALHOST = "127.0.0.1"
DEFAULT_URL = f"rerun+http://{LOCALHOST}:9876/proxy"
"""Where rerun's own viewer listens."""


MOST_TOGETHER = 100
"""Most frames in one batch."""


LIVE_INTERVAL = 0.1
"""Least time between two batches to a viewer [s]."""


class ViewerError(RuntimeError):
    """A viewer cannot be reached or started; the message says what to do."""


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


def save_to(recording: rr.RecordingStream, path: Path) -> None:
    """Write everything logged from now on to an ``.rrd`` file."""
    recording.save(path)


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
    if not _listens(parts.hostname, port or 443):
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
        web_port: Port of the page; None takes :data:`mrwarp.viewing.web.DEFAULT_PORT`, or a free one.

    Raises:
        ViewerError: the viewer is not there or does not start.
        OSError: the folder cannot be made, or the port is taken.
    """
    recording = new_recording()
    if rrd is not None:
        rrd.parent.mkdir(parents=True, exist_ok=True)
        save_to(recording, rrd)
        return Sink(recording, live=False)
    if web and not url:
        from mrwarp.viewing.web import WebViewer  # which imports this module

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


class Viewer:
    """A rerun process that only this machine can reach and that reaches nobody.

    Args:
        options: Command line after ``--bind`` and ``--port``.
        port: Port for the data; None takes a free one.

    Raises:
        ViewerError: it did not start.
    """

    def __init__(self, *options: str, port: int | None = None) -> None:
        self.port = port or free_port()
        self.url = f"rerun+http://{LOCALHOST}:{self.port}/proxy"
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as the process
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rerun_cli", "--bind", LOCALHOST, "--port", str(self.port), *options],
            env=offline_environment(),
            stdout=subprocess.DEVNULL,
            stderr=self._messages,
            start_new_session=True,  # Ctrl-C is for the simulation; a window stays open after it
        )
        self._await_start()

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGTERM)
        self.process.wait()

    def _await_start(self, timeout: float = 20.0) -> None:
        end = time.monotonic() + timeout
        while time.monotonic() < end and self.process.poll() is None:
            if _listens(LOCALHOST, self.port):
                time.sleep(0.5)  # a viewer without a display listens first and fails then
                break
            time.sleep(0.1)
        if self.process.poll() is None and _listens(LOCALHOST, self.port):
            return
        if self.process.poll() is None:
            self.close()
        self._messages.seek(0)
        lines = self._messages.read().decode(errors="replace").strip().splitlines() or ["no message"]
        raise ViewerError(f"rerun's viewer did not start ({lines[-1]}); save a file with --rrd instead")


def open_window() -> str:
    """Open rerun's window, or find the one that is open; returns where it takes data.

    Raises:
        ViewerError: there is no display, or it did not start.
    """
    port = urlsplit(DEFAULT_URL).port
    assert port is not None
    if _listens(LOCALHOST, port):
        return DEFAULT_URL
    if sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"} & set(os.environ):
        raise ViewerError("no display to open rerun's window on; save a file with --rrd, or use --serve-web")
    return Viewer("--expect-data-soon", "--hide-welcome-screen", port=port).url


def offline_environment() -> dict[str, str]:
    """Environment in which rerun contacts nobody.

    rerun has no switch for its analytics other than the user's own configuration, which is not ours to change; it keeps
    silent where ``CI`` is set. Its welcome screen fetches examples: a proxy that does not exist keeps it from that.
    """
    nobody = f"http://{LOCALHOST}:9"
    environment = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        environment |= {name: nobody, name.upper(): nobody}
    return environment | {"CI": "true", "NO_PROXY": f"{LOCALHOST},localhost", "no_proxy": f"{LOCALHOST},localhost"}


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind((LOCALHOST, 0))
        return probe.getsockname()[1]


def _listens(host: str, port: int) -> bool:
    try:
        with socket.create_connection((host, port), timeout=2.0):
            return True
    except OSError:
        return False
