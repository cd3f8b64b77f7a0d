"""A changed setting changes a whole diagnosis, and reaches it from ``mrwarp.diagnose``."""

from dataclasses import replace

import pytest

import mrwarp
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.sysid.settings import Data, Gain, Settings
from tests.diagnose import known

pytestmark = pytest.mark.usefixtures("few_trees")
HIDDEN = {"torque_sensor_lag": {"time_constant": 0.006}}


def recording(seed: int = 50):
    """Four runs of 2.6 s with a sensor that lags."""
    at = known.motion(seed, runs=4, seconds=2.6)
    return known.recording(at, known.problem(HIDDEN, seed=seed, at=at).motion.torque)


@pytest.mark.slow
def test_a_cause_becomes_a_suspect_where_a_proof_needs_more() -> None:
    """The lag is named by default; ``test_proof`` has the settings of a proof one by one."""
    for gain, named in ((Gain(), True), (Gain(one_error=10.0), False)):
        d = diagnose(recording(), effects=list(HIDDEN), settings=replace(known.QUICK, gain=gain))
        found = [cause.name for cause in d.causes], [suspect.name for suspect in d.suspects]
        assert found == ((list(HIDDEN), []) if named else ([], list(HIDDEN)))


def test_the_public_function_passes_settings_on() -> None:
    """More runs are asked for than there are."""
    found = mrwarp.diagnose(recording(), settings=Settings(data=Data(runs=5)))
    assert found.verdict is None and "only 4 trajectories" in found.diagnosis.sentence
