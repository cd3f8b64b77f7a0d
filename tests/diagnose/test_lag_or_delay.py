"""Single steps of the command: a lag and a delay of parts of a sample are distinguished, and the delay is measured."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mrwarp.diagnose import lag_or_delay
from mrwarp.diagnose.lag_or_delay import DELAY, LAG, StepResponses, decided_by_steps, more_likely, size_from
from mrwarp.diagnose.problem import Fit
from mrwarp.sysid.settings import Settings

DT = 0.005


def steps(
    effect: str, size: float, *, count: int = 60, noise: float = 0.08, seed: int = 0, common: bool = False
) -> StepResponses:
    """Steps at times between two samples that the log does not know; ``common``: the same in each of six runs."""
    rng = np.random.default_rng(seed)
    trajectory = np.arange(count) * 6 // count
    age = rng.uniform(0.0, DT, 6)[trajectory] if common else rng.uniform(0.0, DT, count)
    since = age[:, None] + DT * np.arange(3)
    late = np.exp(-since / size) if effect == LAG else (since < size).astype(float)
    late = late + noise * rng.normal(size=late.shape)
    return StepResponses(late=late, error=np.full(late.shape, noise), trajectory=trajectory, dt=DT)


@pytest.mark.parametrize(("size", "common"), [(0.002, True), (0.004, False)])
@pytest.mark.parametrize("effect", [LAG, DELAY])
def test_truth_is_told(effect: str, size: float, common: bool) -> None:
    """In 10 sets the truth is named or nothing, and mostly the truth."""
    known = [more_likely(steps(effect, size, seed=seed, common=common), 12.0) for seed in range(10)]
    assert set(known) <= {effect, None}
    assert known.count(effect) >= (6 if common else 10)


def test_delay_is_measured_to_parts_of_a_sample() -> None:
    """The interval covers the truth in most sets, and is far shorter than a sample."""
    found = [size_from(steps(DELAY, 0.0027, seed=seed), DELAY) for seed in range(20)]
    assert sum(low <= 0.0027 <= high for _, low, high in found) >= 17
    assert np.median([high - low for _, low, high in found]) < 0.4 * DT


@pytest.mark.parametrize("delay", [1.2, 1.5, 2.0])
def test_delay_on_the_logs_own_clock_is_known_to_a_sample_only(delay: float) -> None:
    """Where each step falls on a sample, delays up to the next whole sample give one record: the interval has them."""
    rng = np.random.default_rng(2)
    late = (np.arange(6) < 2).astype(float) + 0.08 * rng.normal(size=(40, 6))
    found = StepResponses(late=late, error=np.full(late.shape, 0.08), trajectory=np.arange(40) // 4, dt=DT)
    _, low, high = size_from(found, DELAY)
    assert low < delay * DT < high < 3.0 * DT


def test_without_steps_that_are_late_nothing_is_told() -> None:
    """Noise alone speaks for neither."""
    rng = np.random.default_rng(1)
    none = StepResponses(
        late=0.08 * rng.normal(size=(40, 3)), error=np.full((40, 3), 0.08), trajectory=np.zeros(40, int), dt=DT
    )
    assert more_likely(none, 12.0) is None


@pytest.mark.parametrize(("named", "other"), [(LAG, DELAY), (DELAY, LAG)])
@pytest.mark.parametrize("known", ["nothing", "too few steps", "one of them", "fits of other sizes"])
def test_undecided_is_an_alternative(named: str, other: str, known: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the steps do not speak, the other one stays an alternative, unless its fit is far behind."""
    final, without = SimpleNamespace(total=10.0), SimpleNamespace(total=100.0)
    rival = SimpleNamespace(total=90.0 if known == "fits of other sizes" else 30.0)
    found = None if known == "too few steps" else steps(named, 0.004, noise=0.08 if known == "one of them" else 20.0)
    models: Any = SimpleNamespace(
        problem=SimpleNamespace(settings=Settings()),
        added=lambda fit: ["wear", named],
        without=lambda fit, name: without,
        screened=lambda fit, effects: effects,
        grown=lambda fit, candidate: rival,
    )
    monkeypatch.setattr(lag_or_delay, "find_steps", lambda *given: found)
    said = decided_by_steps(models, cast(Fit, final), [named, other])
    assert said.model is final
    assert said.undecided == (other if known in ("nothing", "too few steps") else None)
    assert said.excluded == (other if known == "one of them" else None)
