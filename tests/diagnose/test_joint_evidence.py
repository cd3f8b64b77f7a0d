"""A joint as a plant of evidence: what its signals say."""

import numpy as np

from mrwarp.diagnose.joint_evidence import JointPlant
from mrwarp.diagnose.problem import covariance
from mrwarp.diagnose.screening import Models
from mrwarp.sysid.evidence import learned, posterior
from tests.diagnose import known


def test_errors_of_a_law_change_no_size() -> None:
    """Without a current, nothing of an inertia may differ by the current: it is known as well as by least squares."""
    hidden = {"rotor_inertia": {"inertia": 0.02}}
    for current, most in ((0.0, 1.5), (None, 4.0)):
        problem = known.problem(hidden, at=known.motion(5, runs=6, seconds=3.0, current=current))
        models = Models(problem, known.fitted(problem))
        fit = known.fitted(problem, hidden)
        signals = JointPlant(models, []).signals(fit)
        found = learned(signals, 1.0)
        spread = posterior(signals, found.reduced(signals).sum(axis=0), (), found.common).covariance
        own = fit.parameters.own("rotor_inertia")[0]
        by_evidence = np.sqrt(spread[signals.live.index(own)][signals.live.index(own)])
        assert by_evidence < most * np.sqrt(covariance(fit)[own, own])
