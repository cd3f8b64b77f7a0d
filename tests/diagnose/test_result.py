"""``result.json``: the keys that other programs rely on, for every verdict."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp.diagnose.result import Value
from tests.diagnose import made_up

CONTRACT = {
    "schema", "verdict", "causes", "parameter_shift", "unexplained", "detectable", "baseline", "extended", "gain",
    "next_experiment", "seconds", "seed", "versions", "command",
}  # fmt: skip
VERDICTS = ("none", "named", "unexplained", "named_and_unexplained", None)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_the_keys_of_the_contract(verdict, tmp_path: Path) -> None:
    """All keys are there whatever the verdict; the file is JSON without NaN."""
    path = made_up.make(verdict).write(tmp_path, "mrwarp diagnose data")
    content = json.loads(path.read_text(), parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))
    assert set(content) >= CONTRACT
    assert content["verdict"] == verdict
    assert content["command"] == "mrwarp diagnose data"
    assert content["seed"] == 7
    assert set(content["baseline"]) == {"rmse", "nrmse", "unit"}
    assert set(content["extended"]) == {"rmse", "nrmse"}
    assert set(content["gain"]) >= {"rmse_reduction", "ci95", "held_out"}
    assert (content["unexplained"] is not None) == (verdict in ("unexplained", "named_and_unexplained"))
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_causes_shifts_and_sizes_keep_their_form(tmp_path: Path) -> None:
    """Values with interval and unit as the contract has them, NumPy numbers as plain ones."""
    d = made_up.make("named")
    numpy_value = Value(value=np.float32(0.25), ci95=(np.float64(0.2), np.float64(0.3)), unit="s")
    cause = dataclasses.replace(d.causes[0], parameters={"time_constant": numpy_value})
    content = json.loads(dataclasses.replace(d, causes=(cause,)).write(tmp_path, "c").read_text())
    [found] = content["causes"]
    assert set(found) >= {"name", "parameters", "p_value", "alternatives"}
    assert found["parameters"] == {"time_constant": {"value": 0.25, "ci95": [0.2, 0.3], "unit": "s"}}
    assert set(content["parameter_shift"][0]) >= {"name", "value", "ci95", "alternatives"}
    assert content["detectable"]["wear"] == {"value": 1e-5, "unit": "1/s"}


def test_an_infinite_interval_is_null(tmp_path: Path) -> None:
    """JSON has no infinity."""
    d = made_up.make("named")
    value = Value(value=1.0, ci95=(-np.inf, np.inf), unit="s")
    cause = dataclasses.replace(d.causes[0], parameters={"x": value})
    content = json.loads(dataclasses.replace(d, causes=(cause,)).write(tmp_path, "c").read_text())
    assert content["causes"][0]["parameters"]["x"]["ci95"] == [None, None]
