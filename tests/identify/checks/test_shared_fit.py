"""One description of all runs: what does not vary within the runs has no coefficient."""

import numpy as np

from mrwarp.identify.checks.shared_fit import SharedFit


def test_a_feature_that_is_constant_in_each_run_has_no_coefficient() -> None:
    """Its mean is rounded; a coefficient of what rounding leaves would depend on the processor.

    With a held current it was -1.3 or -4.0 N by the library of linear algebra, and moved the offsets of the runs.
    """
    rng = np.random.default_rng(0)
    levels = np.linspace(0.1, 1.3, 12) / 1.3
    rows = [np.column_stack([rng.normal(size=1001), np.full(1001, level)]) for level in levels]
    assert any(np.ptp(x[:, 1] - x[:, 1].mean()) == 0.0 != x[0, 1] - x[:, 1].mean() for x in rows), "no mean is rounded"
    torque = [x[:, 0] * 2.0 + rng.normal(size=1001) + 100.0 * (k > 8) for k, x in enumerate(rows)]
    found = SharedFit(rows, torque).coefficients
    assert found[1] == 0.0 and abs(found[0] - 2.0) < 5.0 / np.sqrt(12 * 1001)
