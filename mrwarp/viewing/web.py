"""rerun's web viewer for this machine only: the page may talk to nobody but the simulation.

The page that rerun serves reports to an analytics host and fetches fonts, and has no switch for either. Here it is
handed on with a content security policy, which makes the browser refuse every other address.
"""

from __future__ import annotations

import http.client
import shutil
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import quote

from mrwarp.viewing.stream import LOCALHOST, Viewer, free_port

DEFAULT_PORT = 9090
"""Port of the page, as rerun's own."""


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
        self._server.inner, self._server.policy = inner, policy(self._rerun.port)
        threading.Thread(target=self._server.serve_forever, name="web viewer", daemon=True).start()
        self.url = self._rerun.url
        self.page = f"http://{LOCALHOST}:{page_port}/?url={quote(self.url, safe='')}"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._rerun.close()


def policy(data_port: int) -> str:
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
        """Keep quiet."""


def _bind(port: int | None) -> _Server:
    if port is not None:
        return _Server((LOCALHOST, port), _Handler)
    try:
        return _Server((LOCALHOST, DEFAULT_PORT), _Handler)
    except OSError:
        return _Server((LOCALHOST, 0), _Handler)
