"""Pictures: complete, small, and the same robot for any heading."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from mrwarp.env.sim import robot_scene
from mrwarp.usd.asset import load_robot
from mrwarp.viewing.frames import Gate
from mrwarp.viewing.robot_pictures import SideView, _spans, contact_sheet
from mrwarp.viewing.shapes import GATE_COLORS, robot_shapes


@pytest.fixture(scope="module")
def sheet(walk: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The picture of four robots, in a new folder."""
    path = tmp_path_factory.mktemp("sheet") / "new" / "sheet.png"
    contact_sheet(walk.env.sim.scene, walk.frames, walk.currents, path, title="test")
    return path


def test_contact_sheet_is_not_blank(sheet: Path) -> None:
    """The picture is written in one piece, small enough for a repository, and shows the gates' colours."""
    path = sheet
    assert [p.name for p in path.parent.iterdir()] == ["sheet.png"]
    assert path.stat().st_size < 300_000
    pixels = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3).astype(int)
    share = np.mean(np.any(pixels < 245, axis=1))
    assert 0.05 < share < 0.6
    for gate in Gate:
        near = np.abs(pixels - GATE_COLORS[gate]).max(axis=1) < 12
        assert near.sum() > 200, gate


def test_contact_sheet_without_devices(walk: Any, sheet: Path, tmp_path: Path) -> None:
    """``go1`` has fewer panels and no gates."""
    contact_sheet(robot_scene(load_robot(robot="go1")), walk.without_devices(), [0.0], tmp_path / "go1.png")
    assert Image.open(tmp_path / "go1.png").height < Image.open(sheet).height


def extents(walk: Any, qpos: np.ndarray) -> np.ndarray:
    """Reach of every outline of a robot in 16 directions [m], shape (shapes, 16)."""
    axis = Figure().add_subplot()
    SideView(walk.env.sim.scene).draw(axis, qpos, np.zeros(4, dtype=int), np.zeros((4, 3)))
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    directions = np.stack([np.cos(angle), np.sin(angle)])
    paths = [
        patch.get_patch_transform().transform_path(patch.get_path()) for patch in axis.patches[1:]
    ]  # the first is the ground
    return np.array([(path.vertices @ directions).max(axis=0) for path in paths])


def test_side_view_follows_the_heading(walk: Any) -> None:
    """A robot turned by 1.1 rad about the vertical and moved is drawn the same, to rounding."""
    qpos = walk.frames.qpos[30, 2].copy()
    w, x, y, z = qpos[3:7]
    c, s = np.cos(0.55), np.sin(0.55)
    turned = qpos.copy()
    turned[3:7] = (c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)
    turned[:2] += (3.0, -7.0)
    first = extents(walk, qpos)
    assert len(first) == len(robot_shapes(walk.env.sim.scene))
    np.testing.assert_allclose(extents(walk, turned), first, atol=1e-9)


def test_spans_of_a_gate() -> None:
    """Runs of True become (begin, length); a single instant lasts one step."""
    time = np.arange(6) * 0.02
    spans = _spans(time, np.array([True, True, False, False, True, False]))
    np.testing.assert_allclose(spans, [(0.0, 0.04), (0.08, 0.02)])
    assert _spans(time, np.zeros(6, dtype=bool)) == []
