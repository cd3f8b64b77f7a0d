"""What a log cannot tell, and the motion that would."""

from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp.robot_logs.causes import Parameter
from mrwarp.robot_logs.unknowable import MOTIONS, cannot_know, next_experiment
from mrwarp.robot_logs.virtual.motions import AIR, GROUND


@pytest.mark.parametrize("cause", MOTIONS)
def test_a_proposed_motion_can_be_recorded(cause: str) -> None:
    """``mrwarp log record`` takes its motions together: all on the ground, or all in the air."""
    record = MOTIONS[cause].record
    assert set(record) <= set(AIR) or set(record) <= set(GROUND)
    assert MOTIONS[cause].what.endswith(f", {sum(record.values()):.0f} s")


@pytest.mark.parametrize(("amps", "known"), [([0.0, 0.0], False), ([0.0, 0.8], True)])
def test_a_coil_that_was_asked_for_no_current_shows_nothing(amps: list[float], known: bool) -> None:
    """Measured noise that dies away with a coil's lag looks like information about it."""
    p = Parameter(
        cause="coil_lag", where="calf", name="time_constant", unit="s", field="coil_lag", index=0, step=0.004,
        spread=0.001, least=0.003, fault=0.02,
    )  # fmt: skip
    now = SimpleNamespace(covariance=np.array([[1e-8]]), precision=np.array([[1e6]]))
    run = SimpleNamespace(joint={"current_cmd": np.array(amps)[:, None]})
    log = SimpleNamespace(runs=[run], kp=np.ones(1), tau_is="estimate")
    model = SimpleNamespace(free=True, devices=True)
    found = cannot_know(SimpleNamespace(sigma={}), [p], model, log, now)
    assert any(text.startswith("coil_lag") for text in found) != known
    log.runs.append(SimpleNamespace(joint={}))  # nobody knows what this one asked for
    found_with_other = cannot_know(SimpleNamespace(sigma={}), [p], model, log, now)
    assert not any(text.startswith("coil_lag") for text in found_with_other)
    if not known:
        proposed = next_experiment((), found)
        assert proposed is not None and proposed.settings == {"walk": 10.0} and proposed.seconds == 10.0
