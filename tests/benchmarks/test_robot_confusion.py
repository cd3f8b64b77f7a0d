"""The confusion of robot logs: what is hidden, and how a verdict is judged."""

from benchmarks.robot_confusion import OUTSIDE, SIZES, hidden_of, judged, table
from mrwarp.robot_logs.virtual.described_robot import describe
from mrwarp.robot_logs.virtual.hidden_effects import EFFECTS, parse_all

PLACES = describe("mr_go").places


def test_every_cause_comes_at_different_places() -> None:
    """All of the contract's causes, each in a form that the virtual robot takes; pairs are two causes."""
    assert set(SIZES) == {name for name, effect in EFFECTS.items() if effect.catalogued}
    causes = list(SIZES)
    seen = [parse_all(hidden_of("single", k, PLACES, causes), PLACES)[0] for k in range(6 * len(causes))]
    assert {h.cause for h in seen} == set(SIZES)
    assert len({h.where for h in seen if h.cause == "coulomb_friction"}) == 6
    assert all(len({h.cause for h in parse_all(hidden_of("pair", k, PLACES, causes), PLACES)}) == 2 for k in range(50))
    assert {parse_all(hidden_of("outside", k, PLACES, causes), PLACES)[0].cause for k in range(4)} == {
        name.partition("=")[0] for name in OUTSIDE
    }
    assert hidden_of("healthy", 3, PLACES, causes) == []
    assert hidden_of("proposed", 1, PLACES, ["trunk_mass", "imu_tilt"]) == ["imu_tilt=0,0.04"]


def _row(named: list[tuple[str, str]], truth: tuple[str, str] | None, **more: object) -> dict:
    hidden = [{"cause": truth[0], "where": truth[1], "catalogued": True}] if truth else []
    found = [{"name": n, "where": w, "alternatives": more.get("near", [])} for n, w in named]
    return {"hide": ["x=1"], "named": found, "truth": hidden, "unexplained": more.get("unexplained", False)}


def test_verdicts_are_judged_by_cause_and_place() -> None:
    """Another place is no right answer, another cause is wrong unless the truth is among its alternatives."""
    kp = ("kp", "FL_hip")
    assert judged(_row([kp], kp)) == "right"
    assert judged(_row([("link_mass", "_mr_go_FL_calf")], ("link_mass", "FL_calf"))) == "right"
    assert judged(_row([("kp", "FR_hip")], kp)) == "place"
    assert judged(_row([], kp)) == "missed"
    assert judged(_row([("kd", "FL_hip")], kp)) == "wrong"
    assert judged(_row([("kd", "FL_hip")], kp, near=["kp of FL_hip"])) == "ambiguous"
    assert (
        judged(_row([kp, ("kd", "RL_calf")], kp)) == "wrong" or judged(_row([kp, ("kd", "RL_calf")], kp)) == "ambiguous"
    )
    unknown = _row([], kp) | {"cannot_know": ["kp of RL_calf, FL_hip: no size would have shown in this log; turn it"]}
    assert (
        judged(unknown) == "unknowable" and judged(unknown | {"truth": _row([], ("kp", "FR_hip"))["truth"]}) == "missed"
    )
    assert judged(_row([], None)) == "none" and judged(_row([kp], None)) == "wrong"
    assert judged(_row([], None, unexplained=True)) == "unexplained"
    assert table([_row([kp], kp), _row([], kp)])[-1].split() == ["all", "1", "1"]
