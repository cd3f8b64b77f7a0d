"""Pictures of the pages: each comes from commands that the gallery, a device's page or the page itself names."""

import re
from pathlib import Path
from types import ModuleType

import pytest

from tests.test_docs import PAGES, ROOT

MEASURED = {"perf_breakdown.png", "perf_cost.png", "perf_gpu.png"}
"""Times of the machines that `docs/performance.md` names; another machine draws others."""


@pytest.fixture(scope="module")
def gallery() -> ModuleType:
    """``tools/gallery.py``, which is a program."""
    from importlib.util import module_from_spec, spec_from_file_location

    spec = spec_from_file_location("gallery", ROOT / "tools" / "gallery.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_picture_of_a_page_can_be_made_again(gallery: ModuleType) -> None:
    """And every picture that is kept is shown."""
    shown = {
        (page.parent / link).resolve().relative_to(ROOT / "docs" / "images")
        for page in PAGES
        for link in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    }
    assert {str(path) for path in shown if path.parent == Path(".")} == {*gallery.PICTURES, *MEASURED}
    of_devices = {path.stem for path in shown if path.parent != Path(".")}
    assert of_devices == {page.stem for page in (ROOT / "docs" / "devices").glob("*.md")}


def test_a_picture_is_old_once_what_it_shows_has_changed(gallery: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shipped policies are on four of them."""
    digest = gallery.digest
    monkeypatch.setattr(gallery, "digest", lambda path: "changed" if path.suffix == ".onnx" else digest(path))
    record = {
        name: {"picture": digest(gallery.IMAGES / name), "shows": {p: digest(ROOT / p) for p in picture.shows}}
        for name, picture in gallery.PICTURES.items()
    }
    found = [line.split(":")[0] for line in gallery.old(record)]
    wanted = ["walk.webp", "walk.png", "impact.png", "walk_energy.png"]
    assert found == [f"docs/images/{name}" for name in wanted]
