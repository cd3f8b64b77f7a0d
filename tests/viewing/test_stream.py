"""Streaming: the simulation never waits for a viewer, a viewer may vanish or hang, and nobody else can listen."""

import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import rerun as rr

from mrwarp.viewing import live_view
from mrwarp.viewing.frames import MOST_TOGETHER, FrameStream
from mrwarp.viewing.robot_view import RobotLogger
from mrwarp.viewing.viewer import Viewer, ViewerError, free_port


def test_live_stream_drops_instead_of_waiting(walk: Any) -> None:
    """Behind a logger that hangs, 50 frames are taken in no time and what does not fit the queue is counted."""
    release, taken = threading.Event(), []

    def hang(frames: Any) -> None:
        release.wait(30.0)
        taken.append(len(frames))

    frames = FrameStream(hang, drop=True, batch=5, capacity=10)
    started = time.perf_counter()
    for i in range(50):
        frames.log(walk.frames[i : i + 1])
    assert time.perf_counter() - started < 2.0
    assert frames.dropped >= 50 - 10 - 5
    assert not frames.close(timeout=0.2)
    release.set()
    frames._thread.join(10.0)
    # a full queue had no room for the end: the frames in it are logged all the same
    assert sum(taken) >= 10


def test_batches_grow_behind_a_fast_simulation(walk: Any) -> None:
    """Frames that waited while the logger was busy are logged at once."""
    release, batches = threading.Event(), []

    def hang(frames: Any) -> None:
        batches.append(len(frames))
        release.wait(30.0)

    frames = FrameStream(hang, drop=False, batch=5)
    for i in range(5):
        frames.log(walk.frames[i : i + 1])
    while not batches:
        time.sleep(0.001)
    for i in range(5, 60):
        frames.log(walk.frames[i : i + 1])
    release.set()
    assert frames.close(10.0)
    assert sum(batches) == 60 and batches[0] <= 5 and len(batches) == 2


def test_file_stream_keeps_every_frame_in_order(walk: Any) -> None:
    """With a slow logger and a short queue nothing is lost, nothing is reordered, and no batch is too small."""
    batches: list[list[float]] = []

    def slow(frames: Any) -> None:
        time.sleep(0.005)
        batches.append(list(frames.time))

    frames = FrameStream(slow, drop=False, batch=7, capacity=3)
    for i in range(60):
        frames.log(walk.frames[i : i + 1])
    assert frames.close()
    assert [t for batch in batches for t in batch] == list(walk.frames.time)
    assert all(7 <= len(batch) <= MOST_TOGETHER for batch in batches[:-1]) and frames.dropped == 0


@pytest.mark.parametrize("drop", [True, False])
def test_failed_logging_is_reported_or_counted(walk: Any, drop: bool) -> None:
    """After an error a file's stream raises; a live one goes on and counts what is lost."""

    def fail(frames: Any) -> None:
        raise OSError("no space left")

    frames = FrameStream(fail, drop=drop, batch=1)
    frames.log(walk.frames[:1])
    assert not frames.close(10.0)
    if drop:
        frames.log(walk.frames[1:4])
        assert frames.dropped == 3
    else:
        with pytest.raises(RuntimeError, match="no space left"):
            frames.log(walk.frames[1:4])


@pytest.mark.parametrize("end", ["killed", "hangs"])
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs POSIX signals")
def test_viewer_that_goes_away_is_survived(walk: Any, viewer: Viewer, end: str) -> None:
    """Killed or frozen in the middle: no call takes longer than 0.5 s, and closing ends within its time limit."""
    recording = rr.RecordingStream("test")
    live_view.connect(recording, viewer.url)
    robots = RobotLogger(walk.env.sim.scene, walk.currents, recording)
    frames = FrameStream(robots.log, drop=True, batch=5)
    longest = 0.0
    for i in range(60):
        if i == 20:
            os.killpg(viewer.process.pid, signal.SIGKILL if end == "killed" else signal.SIGSTOP)
        started = time.perf_counter()
        frames.log(walk.frames[i : i + 1])
        longest = max(longest, time.perf_counter() - started)
        time.sleep(0.005)
    started = time.perf_counter()
    frames.close(timeout=5.0)
    assert not live_view.disconnect(recording, timeout=1.0)
    assert longest < 0.5 and time.perf_counter() - started < 8.0


def test_connect_refuses_what_is_no_viewer() -> None:
    """Nobody there, and addresses that are none of rerun's: a message that says what to do."""
    recording = rr.RecordingStream("test")
    with pytest.raises(ViewerError, match=r"no viewer listens there.*--rrd"):
        live_view.connect(recording, f"rerun+http://127.0.0.1:{free_port()}/proxy")
    for url in (
        "http://127.0.0.1:9876/proxy",
        "rerun+http://127.0.0.1:9876",
        "rerun+http://:9876/proxy",
        "9876",
        "rerun+http://127.0.0.1:99999/proxy",
    ):
        with pytest.raises(ViewerError):
            live_view.connect(recording, url)


def test_sink_is_what_was_asked_for(tmp_path: Path, viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in a new folder, a running viewer, a page in a browser, and without any of them rerun's window."""
    path = tmp_path / "new/robots.rrd"
    file = live_view.open_sink(rrd=path)
    assert not file.live and file.web is None
    live_view.disconnect(file.recording)
    assert path.exists()

    sink = live_view.open_sink(url=viewer.url)
    assert sink.live and sink.web is None
    assert live_view.disconnect(sink.recording)

    page = live_view.open_sink(web=True, web_port=free_port())
    assert page.live and page.web is not None and page.web.page.startswith("http://127.0.0.1:")
    live_view.disconnect(page.recording)
    page.web.close()

    monkeypatch.setattr(live_view, "open_window", lambda: viewer.url)
    window = live_view.open_sink()
    assert window.live and window.web is None
    assert live_view.disconnect(window.recording)
