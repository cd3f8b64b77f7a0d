"""Mission: the models carry windows over phases as they should; a short mission from the command line."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.cli import main
from mrwarp.energy import model_numbers
from mrwarp.energy.power import BatteryCfg, ElectricalCfg, JointLoad, battery_power, depletion
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.trials import mission, walk_figures
from mrwarp.trials.mission import PHASES, PhaseLoad, calibrate, run
from mrwarp.trials.walk_trials import WalkCfg


def phase(square: float, seconds: float, *, seeds: int = 2, coil: float = 0.0) -> PhaseLoad:
    """A phase in which all joints do the same."""
    joints = JointLoad(
        torque_square=np.full((seeds, 12), square),
        speed=np.zeros((seeds, 12)),
        work_out=np.zeros((seeds, 12)),
        work_in=np.zeros((seeds, 12)),
        coil=np.full((seeds, 4), coil),
        friction=np.zeros((seeds, 4)),
    )
    return PhaseLoad(joints=joints, seconds=np.full(seeds, seconds), speed=np.full(seeds, 0.3))


PHASE_USES = {
    "outbound": phase(20.0, 500.0, coil=1.0),
    "standby": phase(9.0, 600.0, seeds=1),
    "return": phase(25.0, 500.0),
}
NUMBERS = (ElectricalCfg(winding_resistance=0.128), ThermalCfg(), BatteryCfg())  # a public motor


def test_power_and_charge_are_those_of_the_phases() -> None:
    """Constant phases: power as the electrical model says, depletion as the battery's sum over phases."""
    trace = run(PHASE_USES, *NUMBERS, feedback=False)
    expected = {name: float(battery_power(PHASE_USES[name].joints, NUMBERS[0]).total[0]) for name in PHASES}
    for name in PHASES:
        np.testing.assert_allclose(trace.power[name], expected[name])
    phases = [depletion(expected[name], float(PHASE_USES[name].seconds[0]), NUMBERS[2]) for name in PHASES]
    np.testing.assert_allclose(trace.depletion, sum(phases))
    assert trace.t[-1] == pytest.approx(1600.0)
    assert np.all(np.diff(trace.charge) > 0.0)


def test_all_motors_are_the_mean_of_calves_and_the_others() -> None:
    """(4 calves + 8 others)/12, and the calves' rise is walking plus standing."""
    rise = run(PHASE_USES, *NUMBERS, feedback=False).rise
    calves = rise["calf_walking"] + rise["calf_standby"]
    np.testing.assert_allclose(rise["all"], (4.0 * calves + 8.0 * rise["proximal"]) / 12.0)
    assert np.all(rise["proximal"] > calves)  # the same torque behind a smaller gear
    assert np.all(rise["fluid"] > 0.0)


def test_feedback_costs_power_and_is_off_by_default() -> None:
    """Warm windings draw more, in the way back more than on the way out."""
    cold, warm = (run(PHASE_USES, *NUMBERS, feedback=on) for on in (False, True))
    added = {name: float((warm.power[name] - cold.power[name])[0]) for name in PHASES}
    assert 0.0 < added["outbound"] < added["return"]
    # a few tens of kelvin at 0.4 % per kelvin of the copper loss
    assert added["return"] < 0.2 * float(battery_power(PHASE_USES["return"].joints, NUMBERS[0]).copper[0])


def test_calibration_meets_go1() -> None:
    """Calves and depletion of Go1 come out as in the paper when its own windows are carried over."""
    heat, battery, _ = calibrate(PHASE_USES, *NUMBERS)
    trace = run(PHASE_USES, NUMBERS[0], heat, battery, feedback=False)
    assert trace.depletion.mean() == pytest.approx(64.7)
    assert trace.rise["calf_walking"].mean() == pytest.approx(19.75, abs=0.05)
    assert trace.rise["calf_standby"].mean() == pytest.approx(4.5, abs=0.05)


def test_a_repetition_counts_if_it_finished_both_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    """Number 0 falls on the way out and number 2 comes back too late: number 1 alone is left, with its own figures."""
    ways = {2.8: np.array([1, 2]), 3.0: np.array([0, 1])}

    def walk(cfg: WalkCfg, *_: object) -> list[SimpleNamespace]:
        load = cfg.payloads[0]
        trial = ways[round(load, 1)]
        joints = replace(
            PHASE_USES["outbound"].joints, torque_square=np.full((2, 12), 1.0) * (10.0 * load + trial[:, None])
        )
        fell, late = (1, 0) if load < 3.0 else (0, 1)
        return [
            SimpleNamespace(
                robot="go1",
                joints=joints,
                speed=0.1 * (1 + trial),
                trial=trial,
                fell=fell,
                late=late,
                paper_device=True,
            )
        ]

    monkeypatch.setattr(mission, "walk", walk)
    monkeypatch.setattr(mission, "standing_load", lambda *_, **__: PHASE_USES["standby"].joints)
    found = mission.measure(mission.MissionCfg(robots=("go1",)), {})["go1"]
    for name, load in (("outbound", paper.arm_load()), ("return", 3.0)):
        np.testing.assert_array_equal(found[name].trial, [1])
        np.testing.assert_allclose(found[name].speed, 0.2)
        np.testing.assert_allclose(found[name].seconds, paper.DISTANCE / 0.2)
        np.testing.assert_allclose(found[name].joints.torque_square, 10.0 * load + 1.0)
    assert [(found[n].tried, found[n].fell, found[n].late) for n in ("outbound", "return")] == [(3, 1, 0), (3, 0, 1)]
    assert run(found, *NUMBERS, feedback=False).depletion.shape == (1,)
    assert walk_figures.mission_windows({"go1": found})["go1"] == {
        "outbound": {"tried": 3, "fell": 1, "late": 0, "counted": 1},
        "return": {"tried": 3, "fell": 0, "late": 1, "counted": 1},
    }
    ways[3.0] = np.array([0, 3])
    with pytest.raises(mission.MissionError, match="Go1: no repetition finished both windows"):
        mission.measure(mission.MissionCfg(robots=("go1",)), {})


def test_walks_of_different_repetitions_are_not_joined() -> None:
    """An equal number of rows is not enough."""
    out, back = (replace(PHASE_USES["outbound"], trial=np.array(trial)) for trial in ([0, 1], [1, 2]))
    with pytest.raises(ValueError, match=r"\[0 1\] went out and \[1 2\] came back"):
        run({**PHASE_USES, "outbound": out, "return": back}, *NUMBERS, feedback=False)


def test_all_powers_of_go1_are_calibrated() -> None:
    """Its way back fixed the load and the speed; no power of another robot fixed anything."""
    trace = run(PHASE_USES, *NUMBERS, feedback=False)
    for robot in paper.ROBOTS:
        cells = walk_figures.mission_row(robot, trace)["power"].values()
        assert [cell["calibrated"] for cell in cells] == [robot == "go1"] * 3


def test_another_device_has_no_paper_figure_beside_it() -> None:
    """Go1 keeps the paper's figures; the robots with devices have none, nor has the change between them."""
    other = {name: replace(load, paper_device=False) for name, load in PHASE_USES.items()}
    traces = {robot: run(other, *NUMBERS, feedback=False) for robot in ("mr_go", "mr_go_sal")}
    traces["go1"] = run(PHASE_USES, *NUMBERS, feedback=False)
    rows = {robot: walk_figures.mission_row(robot, trace) for robot, trace in traces.items()}
    for robot, row in rows.items():
        cells = (*row["power"].values(), row["depletion"], row["rise"]["all"], row["rise"]["proximal"])
        assert [cell["paper"] is not None for cell in cells] == [robot == "go1"] * len(cells)
    for change in walk_figures.mission_changes(rows).values():
        assert change["paper"] is None and change["paper_sd"] is None and change["ours"] == 0.0


def test_figures_of_given_numbers_are_not_called_calibrated() -> None:
    """With another winding Go1's powers fixed nothing; its depletion and calves only what is fitted with it."""
    groups = {"electrical": ElectricalCfg(winding_resistance=0.2), "thermal": ThermalCfg(), "battery": BatteryCfg()}
    assert model_numbers.calibrated(groups) == ()
    assert model_numbers.calibrated(groups, ("battery.capacity",)) == ("battery",)
    assert model_numbers.calibrated({**groups, "electrical": ElectricalCfg()}) == tuple(groups)
    row = walk_figures.mission_row("go1", run(PHASE_USES, *NUMBERS, feedback=False), calibrated=("battery",))
    assert not any(cell["calibrated"] for cell in (*row["power"].values(), *row["rise"].values()))
    assert row["depletion"]["calibrated"]


def test_a_short_mission_from_the_command_line(tmp_path: Path) -> None:
    """MR_Go and MR_Go-SAL over a window of 0.3 m: result, pictures, predictions marked as such."""
    out = tmp_path / "mission"
    options = ["--robot", "mr_go", "mr_go_sal", "--window", "0.3", "--trials", "1", "--threads", "1"]
    assert main(["mission", "--out", str(out), *options]) == 0
    result = json.loads((out / "result.json").read_text())
    for robot in ("mr_go", "mr_go_sal"):
        row = result["robots"][robot]
        assert not any(cell["calibrated"] for cell in (*row["power"].values(), *row["rise"].values(), row["depletion"]))
        assert {walk["counted"] for walk in result["windows"][robot].values()} == {1}
    assert set(result["changes"]) >= {"depletion", "calf_walking_rise"}
    assert {path.name for path in out.iterdir()} == {"result.json", "power.png", "temperature.png"}
