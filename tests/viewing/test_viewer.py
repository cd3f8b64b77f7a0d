"""rerun's viewers: they listen on this machine only, ask nobody else, and say why they do not start."""

import json
import os
import shutil
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
import rerun as rr

from mrwarp.viewing import live_view
from mrwarp.viewing import viewer as viewer_module
from mrwarp.viewing.robot_view import RobotLogger, make_blueprint
from mrwarp.viewing.viewer import Viewer, ViewerError, WebViewer, free_port, open_window, security_policy


@pytest.fixture
def web() -> Iterator[WebViewer]:
    """A page on a free port."""
    viewer = WebViewer(free_port())
    yield viewer
    viewer.close()


def test_page_names_this_machine_only(web: WebViewer) -> None:
    """Every answer carries the policy, the page opens on the data's address, and both are 127.0.0.1."""
    page = urlsplit(web.page)
    assert page.hostname == "127.0.0.1"
    assert parse_qs(page.query)["url"] == [web.url] and web.url.startswith("rerun+http://127.0.0.1:")
    for path in ("/", "/re_viewer.js"):
        with urllib.request.urlopen(f"http://{page.netloc}{path}", timeout=20.0) as answer:
            assert answer.status == 200 and len(answer.read()) > 1000
            assert answer.headers["Content-Security-Policy"] == security_policy(urlsplit(web.url).port or 0)
    with pytest.raises(urllib.error.HTTPError):
        urllib.request.urlopen(f"http://{page.netloc}/no-such-file", timeout=20.0)


def test_policy_allows_no_other_address() -> None:
    """The only host in the policy is 127.0.0.1, with the port of the data."""
    words = security_policy(4711).replace(";", " ").split()
    assert [word for word in words if "://" in word] == ["http://127.0.0.1:4711"]
    assert not {"*", "http:", "https:", "ws:", "wss:"} & set(words)
    assert words[:2] == ["default-src", "'self'"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc/net/tcp")
def test_viewer_listens_on_this_machine_only(viewer: Viewer) -> None:
    """The data port is bound to 127.0.0.1, in IPv4 and not at all in IPv6."""
    port = f"{viewer.port:04X}"
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    assert [row[1] for row in rows if row[1].endswith(":" + port) and row[3] == "0A"] == [f"0100007F:{port}"]
    assert f":{port} 0000" not in Path("/proc/net/tcp6").read_text()


def test_viewer_runs_without_the_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Analytics are off even where someone forces them on, and every proxy leads nowhere; own addresses are exempt."""
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    monkeypatch.setenv("HTTPS_PROXY", "http://proxy.example:3128")
    environment = viewer_module.offline_environment()
    assert environment["CI"] and "FORCE_RERUN_ANALYTICS" not in environment
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "http_proxy", "https_proxy", "all_proxy"):
        assert environment[name] == "http://127.0.0.1:9"
    assert environment["NO_PROXY"] == environment["no_proxy"] == "127.0.0.1,localhost"
    assert environment["PATH"] == os.environ["PATH"]


def test_viewer_that_does_not_start_says_why() -> None:
    """A wrong option: rerun's own last line is in the message."""
    with pytest.raises(ViewerError, match="did not start .*; save a file with --rrd"):
        Viewer("--no-such-option")


def test_window_needs_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a display there is one clear message, not a failed process."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(viewer_module, "DEFAULT_URL", f"rerun+http://127.0.0.1:{free_port()}/proxy")
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(ViewerError, match="no display"):
        open_window()


@pytest.mark.slow
def test_browser_shows_the_robots(walk: Any, web: WebViewer, tmp_path: Path) -> None:
    """A headless Chromium draws the layout, and asks nobody but this machine for anything that it gets."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium drives the browser")
    if not shutil.which("chromium") or not shutil.which("chromedriver"):
        pytest.skip("no chromium with its driver")
    recording = rr.RecordingStream("test")
    live_view.connect(recording, web.url)
    robots = RobotLogger(walk.env.sim.scene, walk.currents, recording)
    recording.send_blueprint(make_blueprint(robots))
    robots.log(walk.frames)
    assert live_view.disconnect(recording, timeout=20.0)

    options = webdriver.ChromeOptions()
    for option in (
        "--headless=new",
        "--no-sandbox",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--ignore-gpu-blocklist",
        "--window-size=1600,900",
    ):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    browser = webdriver.Chrome(options=options, service=service)
    try:
        browser.get(web.page)
        end = time.monotonic() + 90.0
        colors = 0
        while time.monotonic() < end and colors < 1000:
            time.sleep(3.0)
            colors = count_colors(browser.get_screenshot_as_png())
        events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    finally:
        browser.quit()
    assert colors >= 1000  # the loading page has a few dozen
    asked = {
        e["params"]["requestId"]: e["params"]["request"]["url"]
        for e in events
        if e["method"] == "Network.requestWillBeSent"
    }
    answered = {e["params"]["requestId"] for e in events if e["method"] == "Network.responseReceived"}
    hosts = {urlsplit(url).hostname for request, url in asked.items() if request in answered}
    assert hosts == {"127.0.0.1"}


def count_colors(png: bytes) -> int:
    """Number of different colours in a picture."""
    import io

    from PIL import Image

    return len(Image.open(io.BytesIO(png)).convert("RGB").getcolors(2**24) or [])
