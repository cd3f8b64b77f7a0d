"""A fit reaches its optimum at any sizes: micrometres or radians, millinewtons or kilonewtons."""

import numpy as np
import pytest

from mrwarp.identify.dataset import DIMENSIONS
from mrwarp.identify.fit import PARAMETERS, fit
from mrwarp.recording.differentiate import differentiate, quiet_half
from mrwarp.recording.load import Recording, Trajectory
from tests.identify import synthetic


@pytest.mark.parametrize("seed", range(6))
def test_a_fit_scales_with_its_data(seed: int) -> None:
    """A device in other units of motion, current and torque: equal error, parameters in proportion."""
    rng = np.random.default_rng(seed)
    factors = {"q": 10 ** rng.uniform(-6, 1), "current": 10 ** rng.uniform(-3, 3), "torque": 10 ** rng.uniform(-4, 3)}
    recording = synthetic.bench_like(0, runs=4, seconds=2.0)
    plain, scaled = fit(recording), fit(synthetic.scaled(recording, **factors, units=dict(recording.units)))
    assert scaled.nrmse == pytest.approx(plain.nrmse, rel=1e-3)
    for name in PARAMETERS:
        q, current, torque = DIMENSIONS[name]
        factor = factors["q"] ** q * factors["current"] ** current * factors["torque"] ** torque
        estimate = plain.estimates[name]
        assert scaled.estimates[name].value / factor == pytest.approx(estimate.value, abs=0.05 * estimate.half), name
    assert [text.split(":")[0] for text in scaled.warnings] == [text.split(":")[0] for text in plain.warnings]


def _elastic_slip(noise: float, rate: float = 500.0) -> Recording:
    """A contact driven over 0.2 mm: 100 N/mm that yield to 2.35 N of slip, as Dahl has it; the angle has noise [m]."""
    stiffness, slip, rng, runs = 1e5, 2.35, np.random.default_rng(0), []
    for f in (0.1, 0.25, 1.0):
        for stroke in (0.2e-3, 0.12e-3):
            t = np.arange(round(8.0 * rate)) / rate
            fine = 0.5 * stroke * np.sin(2.0 * np.pi * f * np.arange(8 * len(t)) / (8 * rate))
            z = np.zeros(len(fine))
            for i, d in enumerate(np.diff(fine)):
                z[i + 1] = z[i] + d - abs(d) * z[i] * stiffness / slip
            force = stiffness * z[::8] + 0.02 * rng.normal(size=len(t))
            q = fine[::8] + noise * rng.normal(size=len(t))
            half = quiet_half(q, 1.0 / rate)
            runs.append(
                Trajectory(
                    id=f"{f:g} Hz {stroke:g} m",
                    t=t,
                    q=q,
                    qd=differentiate(q, 1.0 / rate, half),
                    qd_derived=True,
                    current=np.zeros(len(t)),
                    torque=force,
                )
            )
    return Recording(trajectories=tuple(runs), units={"q": "m", "current": "none", "torque": "N"})


@pytest.mark.parametrize("noise", [1e-8, 1e-6])
def test_an_elastic_slip_of_two_tenths_of_a_millimetre_is_found(noise: float) -> None:
    """Slow strokes with a micrometre of noise: noise that is summed up as path would wear the stress away (22 %)."""
    result = fit(_elastic_slip(noise))
    assert result.nrmse < 0.02  # force noise alone is 1.2 %
    assert result.estimates["K0"].value == pytest.approx(1e5, rel=0.03)
    assert result.estimates["K0"].value / (
        result.estimates["beta"].value + result.estimates["gamma"].value
    ) == pytest.approx(2.35, rel=0.03)
