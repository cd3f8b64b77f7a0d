"""Films: rendered robots whose devices have the colours of their gates."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mrwarp.viewing.shapes import GATE_COLORS

SCRIPT = """
import sys
from mrwarp.runtime import render_offscreen
render_offscreen()  # before MuJoCo is imported
from pathlib import Path
import numpy as np
from mrwarp.env.sim import robot_scene
from mrwarp.usd.asset import load_robot
from mrwarp.viewing.film import NoRenderer, film
from mrwarp.viewing.frames import Frames, Gate
scene = robot_scene(load_robot())
qpos = np.zeros((3, 2, scene.model.nq))
qpos[..., :7] = (0.0, 0.0, scene.stand_height, 1.0, 0.0, 0.0, 0.0)
qpos[..., scene.q_adr] = scene.layout.default_q
qpos[..., 0] = 0.1 * np.arange(3)[:, None]
gate = np.tile([Gate.HOLD, Gate.DYNAMIC, Gate.HOLD, Gate.DYNAMIC], (3, 2, 1))
series = {name: np.zeros((3, 2)) for name in ("v_x", "v_z", "v_x_command")}
series |= {name: np.zeros((3, 2, 4)) for name in ("tau_mr", "current")} | {"tau_motor": np.zeros((3, 2, 12))}
series |= {"foot_force": np.zeros((3, 2, 4, 3)), "ledger": np.zeros((3, 2, 12, 7))}
frames = Frames(time=0.06 * np.arange(3), qpos=qpos, gate=gate, **series)
try:
    film(scene, frames, [0.0, 1.5], Path(sys.argv[1]))
except NoRenderer as error:
    print(error)
    sys.exit(2)
"""


def test_a_film_shows_the_gates(tmp_path: Path) -> None:
    """Three pictures, none blank, with links in the colours of both gates."""
    path = tmp_path / "film.webp"
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(path)], capture_output=True, text=True, check=False)
    if done.returncode == 2:
        pytest.skip(f"nothing to render with: {done.stdout.strip()}")
    assert done.returncode == 0, done.stderr
    film = Image.open(path)
    assert getattr(film, "n_frames", 1) == 3
    pixels = np.asarray(film.convert("RGB")).astype(int)[40:-40].reshape(-1, 3)  # without the legend
    for color in GATE_COLORS.values():
        hue = pixels - pixels.mean(axis=1, keepdims=True)
        wanted = np.array(color) - np.mean(color)
        cosine = (hue @ wanted) / np.maximum(np.linalg.norm(hue, axis=1) * np.linalg.norm(wanted), 1e-9)
        assert (cosine[np.linalg.norm(hue, axis=1) > 0.3 * np.linalg.norm(wanted)] > 0.97).sum() > 50, color
