"""Numbers of a robot, and what a log says of them, as a test states them."""

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.likelihood import Likelihood


def made_parameter(**changes: object) -> Parameter:
    """A number that any size of a fault can have, but for what is changed of it."""
    size = {"step": 1.0, "spread": 1e3, "least": 0.0, "fault": 1e3}
    own = {"cause": "kp", "where": "a", "name": "gain", "unit": "1", "field": "kp", "index": 0, **size}
    return Parameter(**(own | changes))


def made_likelihood(a: np.ndarray, b: np.ndarray) -> Likelihood:
    """Of W windows, shapes (W, P, P) and (W, P)."""
    count = len(a)
    return Likelihood(
        information=a,
        score=b,
        square=np.zeros(count),
        weight=np.ones(count),
        scale=1.0,
        sigma={},
        samples=count,
        run=np.zeros(count),
        lost=0,
        keep=np.ones(count, dtype=bool),
    )
