"""Pictures of walks: a device whose coil nobody stated is drawn by its other parts; a legend has what is drawn."""

from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mrwarp.paper import GRAVITY
from mrwarp.trials import own_robot, walk_pictures
from mrwarp.trials.walk_pictures import NOT_WHOLE, shown_cost


def row(robot: str, cot: float | None, **changes: Any) -> dict[str, Any]:
    """One condition of ``result.json``: 100 W of the motors and 20 W of the coils, 12 kg at 0.3 m/s."""
    known = cot is not None and np.isfinite(cot)
    found = {
        **{"robot": robot, "payload": 0.0, "command": 0.3, "current": 1.0, "mass": 12.0, "trials": 3},
        "parts": {"copper": 100.0, "coil": 20.0 if known else cot},
        **{"cot": {"mean": cot, "sd": 0.1 if known else cot}, "speed": {"mean": 0.3, "sd": 0.0}},
        **{"calibrated": False, "paper": None},
    }
    return {**found, **changes}


@pytest.mark.parametrize("unknown", [nan, None])
def test_a_cost_that_is_not_known_is_that_of_the_other_parts(unknown: float | None) -> None:
    """NaN while it runs and None in a file; nothing where no trial arrived."""
    assert shown_cost(row("mr_go", 3.5)) == (3.5, 0.1, True)
    mean, sd, whole = shown_cost(row("mr_go", unknown))
    assert mean == pytest.approx(100.0 / (12.0 * GRAVITY * 0.3)) and np.isnan(sd) and not whole
    assert np.isnan(shown_cost(row("mr_go", unknown, trials=0))[0])


def legends(monkeypatch: pytest.MonkeyPatch, module: Any) -> list[Any]:
    """The figures that a module draws from now on."""
    kept, panels = [], module.panels
    monkeypatch.setattr(module, "panels", lambda *a, **k: (kept.append(panels(*a, **k)), kept[-1])[1])
    return kept


@pytest.mark.parametrize(
    ("last", "entries"),
    [
        (row("mr_go_sal", 3.5), ["Go1", "MR_Go-SAL"]),
        (row("mr_go_sal", nan), ["Go1", "MR_Go-SAL", NOT_WHOLE]),
        (row("mr_go_sal", nan, trials=0), ["Go1"]),
    ],
)
def test_a_legend_has_what_is_drawn(
    last: dict[str, Any], entries: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hollow bar where the coils are not known, none where no trial arrived."""
    drawn = legends(monkeypatch, walk_pictures)
    walk_pictures.cost([row("go1", 4.0), last], tmp_path / "cot.png")
    figure, _ = drawn[0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == entries


def test_a_robot_of_ones_own_has_points_at_every_current(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hollow ones beyond 0 A; the upper one is not cut."""
    drawn = legends(monkeypatch, own_robot)
    rows = [row("", 4.6, current=0.0), row("", nan, current=0.75), row("", nan, current=1.5)]
    own_robot.picture(rows, tmp_path / "cot.png", "robot.usda")
    _, ((axis,),) = drawn[0]
    texts = [text.get_text() for text in axis.get_legend().get_texts()]
    assert sorted(texts) == ["0 kg, 0.3 m/s", f"0 kg, 0.3 m/s, {NOT_WHOLE}"]
    assert axis.get_xlim()[1] > 1.5 and axis.get_ylim()[1] > 4.7


def test_a_mission_of_unknown_power_is_named_and_not_in_the_legend(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where nobody stated the coils; a power that is known at times has gaps."""
    drawn = legends(monkeypatch, walk_pictures)
    t, power = np.arange(3.0), {"go1": [1.0, 2.0, 3.0], "mr_go": [1.0, nan, 3.0], "mr_go_sal": [nan, nan, nan]}
    traces: Any = {
        robot: SimpleNamespace(t=t, power_over_time=np.array(x), charge=np.array(x)) for robot, x in power.items()
    }
    walk_pictures.mission_power(traces, tmp_path / "power.png")
    figure, ((upper,), _) = drawn[0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Go1", "MR_Go, gaps: not known"]
    assert upper.get_title() == "not drawn: MR_Go-SAL, power not known"
