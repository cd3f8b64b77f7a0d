"""The recording of an impact in a real browser."""

import shutil
import time
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.viewing.viewer import Viewer, free_port
from tests.viewing.test_viewer import count_colors


@pytest.mark.slow
def test_browser_shows_the_impact(tmp_path: Path) -> None:
    """rerun's web viewer in a headless Chromium draws robots and plots from ``mrwarp impact --rrd``."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium drives the browser")
    if not shutil.which("chromium") or not shutil.which("chromedriver"):
        pytest.skip("no chromium with its driver")
    rrd = tmp_path / "impact.rrd"
    argv = ["--out", str(tmp_path / "out"), "--trials", "1", "--coupling", "constraint", "--rrd", str(rrd)]
    assert main(["impact", *argv]) == 0
    page = free_port()
    viewer = Viewer("--serve-web", "--web-viewer-port", str(page), str(rrd))
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
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        browser.get(f"http://127.0.0.1:{page}/?url={viewer.url.replace('+', '%2B')}")
        colors, end = 0, time.monotonic() + 90.0
        while time.monotonic() < end and colors < 1000:
            time.sleep(3.0)
            colors = count_colors(browser.get_screenshot_as_png())
    finally:
        browser.quit()
        viewer.close()
    assert colors >= 1000  # the loading page has a few dozen
