"""Figures 10 and 11 on made-up missions: their sentences follow the figures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.energy.power import BatteryCfg, ElectricalCfg, JointLoad
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.trials.mission import PHASES, MissionTrace, PhaseLoad
from paper.reproduce import missions
from paper.reproduce.cache import Job
from paper.reproduce.comparison import Comparison, Findings
from paper.reproduce.missions import fig10, fig11
from paper.reproduce.settings import Settings


def trace(robot: str, *, power: float = 0.0, share: float = 1.0) -> MissionTrace:
    """The paper's figures of a robot, with so many watts more and its depletion and rises times a share."""
    three, t = np.ones(3), np.arange(2.0)
    rise = {name: share * value * three for name, value in paper.MISSION_RISE[robot].items()}
    return MissionTrace(
        power={name: (value + power) * three for name, value in paper.MISSION_POWER[robot].items()},
        seconds={name: 500.0 * three for name in PHASES},
        depletion=share * paper.MISSION_DEPLETION[robot][0] * three,
        rise={**rise, "proximal": paper.proximal_rise(robot) * three, "fluid": 0.0 * three},
        t=t,
        power_over_time=t,
        charge=t,
        calf=t,
        proximal=t,
        fluid=np.zeros((3, 3)),
    )


def made(
    entry, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, traces: dict[str, MissionTrace], **changed
) -> Findings:
    """Findings of an entry in these missions."""
    figures, changes, named = missions._figures(traces)
    found = missions.Mission(
        **{"traces": traces, "figures": figures, "changes": changes, "errors": dict.fromkeys(named, 0.5), "free": 2,
           "electrical": ElectricalCfg(), "thermal": ThermalCfg(), "battery": BatteryCfg(),
           "misfit": 16.0, "held": 0.43, "arrivals": [],
           "loaded": {"0.002": (1.0, 20.0), "nothing": (6.0, 20.0)}, **changed}
    )  # fmt: skip
    monkeypatch.setattr(missions, "read", lambda job: found)
    return entry(Job(settings=Settings(), out=tmp_path))


def row(found: Findings, condition: str, quantity: str) -> Comparison:
    """The row of a condition."""
    return next(r for r in found.rows if (r.condition, r.quantity) == (condition, quantity))


@pytest.mark.parametrize("share", [1.02, 0.98, 0.6])
def test_claims_take_the_least_reduction_from_the_paper(
    share: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A saving 40 % above the paper's saves at least its share, and the sentence says so."""
    traces = {robot: trace(robot) for robot in paper.ROBOTS}
    traces["mr_go_sal"] = trace("mr_go_sal", share=share)
    claims = made(fig10, monkeypatch, tmp_path, traces).claims
    assert claims["by at least 11.5 %"] == (share < 1.0)
    claims = made(fig11, monkeypatch, tmp_path, traces).claims
    assert claims["SAL lowers the calves' rise while walking by at least 48.3 %"] == (share < 1.0)


@pytest.mark.parametrize(("off", "place"), [(15.0, "+15.0 W are within the 16.0 W"), (-20.0, "-20.0 W are beyond")])
def test_a_power_is_held_against_the_misfit(
    off: float, place: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of Go1's calibration rows; SAL's rows show the saving instead."""
    found = made(fig10, monkeypatch, tmp_path, {robot: trace(robot, power=off) for robot in paper.ROBOTS})
    assert row(found, "MR_Go, outbound", "power").why.startswith(place)
    assert "SAL saves 55 W here and 55 W in the paper" in row(found, "MR_Go-SAL, outbound", "power").why


def test_go1s_way_back_is_calibrated_and_its_calves_are_no_prediction(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its 194.8 W fixed the load; its calves the housings. The same figures of MR_Go are predictions."""
    traces = {robot: trace(robot, power=30.0, share=1.4) for robot in paper.ROBOTS}
    found = made(fig10, monkeypatch, tmp_path, traces)
    assert row(found, "Go1, return", "power").calibrated
    assert not row(found, "MR_Go, return", "power").calibrated
    found = made(fig11, monkeypatch, tmp_path, traces)
    own = row(found, "Go1, calves, both walks", "rise")
    assert own.calibrated and own.differs
    assert "prediction" not in own.why
    assert "leaves +7.90 K" in own.why
    assert "A prediction from Go1's calves" in row(found, "MR_Go, calves, both walks", "rise").why


def test_a_robot_stands_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its power has no spread, however many walked; those of the walks have."""
    found = made(fig10, monkeypatch, tmp_path, {robot: trace(robot) for robot in paper.ROBOTS})
    standing = row(found, "MR_Go, standby", "power")
    assert (standing.n, standing.sd) == (1, None)
    assert (standing.error, standing.error_free) == (0.5, 2)
    assert row(found, "MR_Go, outbound", "power").n == 3


def test_figure11_reports_both_shares_of_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Ours next to table 7's, whichever is longer; without ours, neither."""
    traces = {robot: trace(robot, share=1.1) for robot in paper.ROBOTS}
    why = row(made(fig11, monkeypatch, tmp_path, traces, held=0.2), "MR_Go, calves, both walks", "rise").why
    assert "At 3 kg and 0.3 m/s they are held for 20 % of the time and the paper's for 26 % (table 7)" in why
    assert "longer" not in why
    why = row(made(fig11, monkeypatch, tmp_path, traces, held=np.nan), "MR_Go, calves, both walks", "rise").why
    assert "held" not in why


def test_lost_windows_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Once, with the way on which they were lost, in both figures."""
    joints = JointLoad(
        **dict.fromkeys(("torque_square", "speed", "work_out", "work_in", "coil", "friction"), np.zeros((1, 12)))
    )
    whole = PhaseLoad(joints=joints, seconds=np.ones(1), speed=np.ones(1), trial=np.zeros(1), tried=3)
    phases = {"go1": dict.fromkeys(PHASES, whole), "mr_go": {**dict.fromkeys(PHASES, whole)}}
    assert missions.arrivals(phases) == []
    phases["mr_go"]["return"] = replace(whole, fell=1, late=1)
    noted = missions.arrivals(phases)
    assert noted == [
        "Only trials that arrived count. MR_Go, return: 1 fell and 1 came too late of 3. A repetition counts if it "
        "finished both ways."
    ]
    for entry in (fig10, fig11):
        found = made(entry, monkeypatch, tmp_path, {robot: trace(robot) for robot in paper.ROBOTS}, arrivals=noted)
        assert found.notes[0] == noted[0]


def test_a_change_has_the_spread_of_both_robots(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Depletions of 59.3 and 52.5 points, the latter with 10 % SD in ours; the paper's rows give its own."""
    traces = {robot: trace(robot) for robot in paper.ROBOTS}
    scattered = replace(traces["mr_go_sal"], depletion=52.5 * np.array([0.9, 1.0, 1.1]))
    about = "MR_Go to MR_Go-SAL, depletion"
    change = row(made(fig10, monkeypatch, tmp_path, traces | {"mr_go_sal": scattered}), about, "change")
    assert change.n == 3
    assert change.sd == pytest.approx(100.0 * 0.1 * 52.5 / 59.3)
    assert change.paper and change.paper.sd == pytest.approx(100.0 * np.hypot(2.0 / 52.5, 1.5 / 59.3) * 52.5 / 59.3)
    one = {robot: replace(found, depletion=found.depletion[:1]) for robot, found in traces.items()}
    assert row(made(fig10, monkeypatch, tmp_path, one), about, "change").sd is None


def test_cool_hips_are_explained_by_the_price(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One robot's walks by policies that pay and that do not stand in one sentence."""
    reasons = made(fig11, monkeypatch, tmp_path, {robot: trace(robot) for robot in paper.ROBOTS}).reasons
    shares = "5 % where policies pay 0.002 per watt and 30 % where policies pay nothing per watt"
    assert shares in reasons["mission.all_heat"]
