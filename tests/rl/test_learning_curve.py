"""The picture of a training: axes that fit what is drawn, however it begins."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from mrwarp.rl.progress import Progress, plot
from mrwarp.trials.walking import WalkingGate


@pytest.mark.parametrize("falls", [0.0, 250.0])
def test_axes_hold_what_is_drawn(falls: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No falls lie on the axis, nothing below; an error of 0.9 m/s and a clock match of 0.1 are in the picture."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    progress = Progress()
    for seconds in (6.0, 12.0):
        figures = {"v_x_rmse": 0.9, "reward": -1.0, "falls_per_hour": falls, "clock_match": 0.1}
        progress.rows.append({"seconds": seconds, **figures})
    progress.gate_rows.append({"seconds": 12.0, "passed": False, "v_x_rmse": {"0.5": 0.5}})
    plot(progress, tmp_path / "learning_curve.png", WalkingGate())
    error, _, fallen, match = drawn[0].axes
    assert fallen.get_ylim()[0] == 0.0 and fallen.get_ylim()[1] > falls
    assert error.get_ylim()[1] > 0.9 and match.get_ylim()[0] < 0.1
    assert [text.get_text() for text in drawn[0].legends[0].get_texts()][-1] == "gate check not passed"
