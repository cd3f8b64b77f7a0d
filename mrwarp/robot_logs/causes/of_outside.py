"""Effects outside the catalogue that act all the time: untried, they would be blamed on a cause of it."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.cause import Cause, Replayed

FEET = (0.25, 1.0, 4.0)
"""Changes of each foot that are tried, in those of a fault."""


def _pulled(replay: Replayed, change: np.ndarray) -> None:
    if replay.robot.free:
        mj = replay.robot.model
        root = int(mj.jnt_dofadr[mj.body_jntadr[replay.robot.trunk]])
        replay.state("qfrc_applied")[:, root : root + 2] += change


CAUSES = (
    Cause(  # a foot softer or stiffer than the others
        name="soft_foot",
        title="soft foot",
        field="foot",
        place="foot",
        there=lambda at: at.model.free,
        number="factor",
        unit="1",
        step=0.2,
        spread=0.3,
        least=0.6,
        fault=4.0,
        nominal=1.0,
        lowest=-0.9,
        change="inverse",
        outside="the foot of",
        tried=FEET,
        says=lambda value, _: f"meets {value:.2g} times the stiffness that the others do",
    ),
    Cause(  # a force that pulls the trunk sideways
        name="steady_pull",
        title="steady pull",
        field="pull",
        place="pull",
        there=lambda at: at.model.free,
        unit="N",
        step=lambda at: 9.81 * at.total * 0.02,
        spread=lambda at: 9.81 * at.total * 0.005,
        least=lambda at: 9.81 * at.total * 0.02,
        fault=lambda at: 9.81 * at.total * 0.1,
        outside="a force on",
        says=lambda value, axis: f"of {value:+.3g} N along {axis}, all the time",
        acts=_pulled,
    ),
)
