"""rerun's viewers, as processes of this machine that talk to nobody else: a window, or a page for a browser.

The page that rerun serves reports to an analytics host and fetches fonts, and has no switch for either. Here it is
handed on with a content security policy, which makes the browser refuse every other address.
"""

from __future__ import annotations

import contextlib
import http.client
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import quote, urlsplit

from mrwarp.runtime import has_display

LOCALHOST = "127.0.0.1"
DEFAULT_URL = f"rerun+http://{LOCALHOST}:9876/proxy"
"""Where rerun's own viewer listens."""

DEFAULT_PORT = 9090
"""Port of the page, as rerun's own."""

START_TIMEOUT = 20.0
"""Longest wait for a viewer to start [s]."""


class ViewerError(RuntimeError):
    """A viewer cannot be reached or started; the message says what to do."""

    exit_code = 2


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

    def _await_start(self) -> None:
        end = time.monotonic() + START_TIMEOUT
        while time.monotonic() < end and self.process.poll() is None:
            if listens(LOCALHOST, self.port):
                time.sleep(0.5)  # a viewer without a display listens first and fails then
                break
            time.sleep(0.1)
        if self.process.poll() is None and listens(LOCALHOST, self.port):
            return
        if self.process.poll() is None:
            self.close()
        self._messages.seek(0)
        lines = self._messages.read().decode(errors="replace").strip().splitlines() or ["no message"]
        raise ViewerError(f"rerun's viewer did not start ({lines[-1]}); save a file with --rrd instead")


def check_viewer(url: str | None = None) -> bool:
    """Refuse a viewer that cannot be shown to, in no time: before an engine is loaded.

    Without ``url`` it is rerun's window, which may still have to be opened.

    Returns:
        Whether it runs.

    Raises:
        ViewerError: the address is none of rerun's, nobody listens there, or there is no display for a window.
    """
    parts = urlsplit(url or DEFAULT_URL)
    try:
        port = parts.port or 443
    except ValueError:
        port = 0
    named = parts.scheme in ("rerun", "rerun+http", "rerun+https") and parts.hostname and parts.path == "/proxy"
    if not named or not port:
        raise ViewerError(f"{url}: not the address of a rerun viewer; one looks like {DEFAULT_URL}")
    if listens(str(parts.hostname), port):
        return True
    if url:
        raise ViewerError(f"{url}: no viewer listens there; start one with 'rerun', or save a file with --rrd")
    if not has_display():
        raise ViewerError("no display to open rerun's window on; save a file with --rrd, or use --serve-web")
    return False


def open_window() -> str:
    """Open rerun's window, or find the one that is open; returns where it takes data.

    Raises:
        ViewerError: there is no display, or it did not start.
    """
    if check_viewer():
        return DEFAULT_URL
    return Viewer("--expect-data-soon", "--hide-welcome-screen", port=urlsplit(DEFAULT_URL).port).url


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


class WebViewer:
    """Serves rerun's web viewer on a local port.

    Args:
        port: Port of the page; None takes :data:`DEFAULT_PORT`, or a free one if that is taken.

    Attributes:
        url: Where the page takes data from; connect a recording to it.
        page: Address to open in a browser on this machine.

    Raises:
        ViewerError: rerun did not start.
        OSError: the port is taken.
    """

    def __init__(self, port: int | None = None) -> None:
        self._server = _bind(port)
        self._server.daemon_threads = True
        page_port = self._server.server_port
        inner = free_port()
        try:
            self._rerun = Viewer(
                "--serve-web", "--web-viewer-port", str(inner), "--cors-allow-origin", f"http://{LOCALHOST}:{page_port}"
            )
        except BaseException:
            self._server.server_close()
            raise
        self._server.inner, self._server.policy = inner, security_policy(self._rerun.port)
        threading.Thread(target=self._server.serve_forever, name="web viewer", daemon=True).start()
        self.url = self._rerun.url
        self.page = f"http://{LOCALHOST}:{page_port}/?url={quote(self.url, safe='')}"

    def wait(self) -> None:
        """Serve until Ctrl-C."""
        with contextlib.suppress(KeyboardInterrupt):
            while True:
                time.sleep(1.0)

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._rerun.close()


def security_policy(data_port: int) -> str:
    """Content security policy of the page: itself and the data on ``data_port``, nothing else."""
    return (
        "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
        f"style-src 'self' 'unsafe-inline'; connect-src 'self' http://{LOCALHOST}:{data_port}"
    )


class _Server(ThreadingHTTPServer):
    inner = 0
    policy = ""


class _Handler(BaseHTTPRequestHandler):
    """Hands on what rerun's own server has, with the policy added."""

    server: _Server

    def do_GET(self) -> None:
        """Answer with rerun's file of that name."""
        upstream = http.client.HTTPConnection(LOCALHOST, self.server.inner, timeout=30.0)
        try:
            upstream.request("GET", self.path)
            answer = upstream.getresponse()
            self.send_response(answer.status)
            for name in ("Content-Type", "Content-Length", "rerun-final-length"):
                if value := answer.getheader(name):
                    self.send_header(name, value)
            self.send_header("Content-Security-Policy", self.server.policy)
            self.end_headers()
            shutil.copyfileobj(answer, self.wfile)
        except OSError:
            self.close_connection = True  # the browser or rerun went away
        finally:
            upstream.close()

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing."""


def _bind(port: int | None) -> _Server:
    if port is not None:
        return _Server((LOCALHOST, port), _Handler)
    try:
        return _Server((LOCALHOST, DEFAULT_PORT), _Handler)
    except OSError:
        return _Server((LOCALHOST, 0), _Handler)


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind((LOCALHOST, 0))
        return probe.getsockname()[1]


def listens(host: str, port: int) -> bool:
    """Whether a server takes connections there."""
    try:
        with socket.create_connection((host, port), timeout=2.0):
            return True
    except OSError:
        return False
