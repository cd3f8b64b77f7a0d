"""``result.json``: the keys that other programs rely on, for every verdict."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp.diagnose.held_out import Account, Share
from mrwarp.diagnose.result import Tried
from mrwarp.diagnose.verdict_text import sentence_of
from mrwarp.sysid.verdict import Unexplained, Value
from tests.diagnose import made_up

CONTRACT = {
    "schema", "verdict", "causes", "parameter_shift", "unexplained", "detectable", "baseline", "extended", "gain",
    "next_experiment", "seconds", "seed", "versions", "command",
}  # fmt: skip
VERDICTS = ("none", "named", "unexplained", "named_and_unexplained", None)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_the_keys_of_the_contract(verdict, tmp_path: Path) -> None:
    """All keys are there for any verdict; the file is JSON without NaN."""
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


def test_no_verdict_contradicts_itself() -> None:
    """Structure along a variable names the effect that lies there; what repeats and what can be learned go together."""
    inertia = Tried(name="rotor_inertia", gain=0.01, error=0.01, values={}, outcome="rejected: it only fits noise")
    along = Unexplained(depends_on=("qdd",), form="smooth", share=0.5)
    said = sentence_of(made_up.make("unexplained", unexplained=along, tried=(inertia,)))
    assert "along the acceleration that inertia does not explain" in said and "catalogue" not in said

    def share(x: float) -> Share:
        return Share(share=x, ci95=(x, x))

    account = Account(
        named=share(0.0),
        repeatable=share(0.29),
        not_repeatable=share(0.71),
        left=0.3,
        cycle_spread=0.2,
        learnable=share(0.01),
    )
    said = sentence_of(made_up.make("unexplained", account=account))
    assert "29 % of the squared mismatch comes again where the same motion does" in said
    assert "takes only 1 % off" in said and "needs more runs" in said and "up to 16 %" in said
    assert "in every run" in sentence_of(
        made_up.make("unexplained", account=dataclasses.replace(account, learnable=share(0.15)))
    )
