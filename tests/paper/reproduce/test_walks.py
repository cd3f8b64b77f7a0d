"""Entries that read the walks, on made-up trials: falls and late arrivals are reported, else no claim holds."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.power import JointLoad
from mrwarp.trials.power_meter import CHANNELS, GaitTrace
from mrwarp.trials.walk_trials import WalkCfg, WalkResult
from paper.reproduce import cache, support, walks
from paper.reproduce import fig8 as figure8
from paper.reproduce.cache import Job
from paper.reproduce.comparison import Findings
from paper.reproduce.fig8 import fig8
from paper.reproduce.settings import Settings, over_seeds
from paper.reproduce.table6 import fig9, table6
from paper.reproduce.table7 import table7

TRIALS = np.arange(9)
"""Three rollouts of each of three policies."""

MADE: dict[Path, walks.Walks] = {}
"""Walks by the folder that they stand for."""

HOLD = {(0.0, 0.3): 0.4, (0.0, 0.5): 0.3, (3.0, 0.3): 0.5, (3.0, 0.5): 0.35}
"""Share of time held: longer at low speed and with payload, and longer than the paper's."""


def walked(robot: str, payload: float, command: float, trial: np.ndarray = TRIALS, late: int = 0) -> WalkResult:
    """Trials that arrived; calves of MR_Go-SAL turn with less torque, so that all claims hold."""
    n, devices = len(trial), 0 if robot == "go1" else 4
    blank, idle, speed = np.zeros(n), np.zeros((n, 12)), 2.0 * command
    power = paper.TABLE_6["go1", int(payload), command].power
    square = np.full((n, 12), _square(power, speed) * (1.0 if robot == "go1" else 1.1))
    counts = np.zeros((3, 160))
    counts[:, 90] = n * 100.0
    stance = np.zeros((4, 160))
    if robot == "mr_go_sal":
        stance[1, 95], stance[2, 82], stance[3, 95] = 3.0, 9.0, 1.0
        square[:, 2::3] *= 0.2
        counts[2] = np.roll(counts[2], -5)
    return WalkResult(
        robot=robot,
        payload=payload,
        command=command,
        mass=12.0 + payload,
        trial=trial,
        joints=JointLoad(
            torque_square=square,
            speed=idle + speed,
            work_out=idle,
            work_in=idle,
            coil=np.zeros((n, devices)),
            friction=np.zeros((n, devices)),
        ),
        seconds=blank + 30.0 / command,
        motion={"speed": blank + command, "height": blank},
        braking=0.5 * square,
        hold=np.full((n, devices), HOLD[payload, command]) + 0.01 * trial[:, None] % 3,
        dynamic=np.zeros((n, devices)),
        switches=np.zeros((n, devices)),
        counts=counts,
        stance=stance,
        fell=len(TRIALS) - n - late,
        late=late,
        trace=GaitTrace(t=np.arange(2.0), values=dict.fromkeys(CHANNELS, np.zeros(2))),
    )


def _square(power: float, speed: float = 0.0) -> float:
    """Torque squared [(N·m)^2] of motors that draw a power [W] at a speed [rad/s], for some resistance.

    They also have electronics of 60 W and 1 N·m of drive friction.
    """
    return 0.25 * (power - 60.0 - 12.0 * speed)


def folder(tmp_path: Path, *changed: WalkResult, policies: int = 3, sticks: int = 3) -> Path:
    """A folder for walks in which all arrived but for the changed conditions; with a device that sticks all did."""
    results = {(robot, *cell): walked(robot, *cell) for robot in paper.ROBOTS for cell in HOLD}
    sticking = [result for (robot, *_), result in results.items() if robot != "go1"]
    all_arrived = list(results.values())
    results |= {(r.robot, r.payload, r.command): r for r in changed}
    square = _square(paper.MISSION_POWER["go1"]["standby"])
    standing = JointLoad(
        torque_square=np.full(12, square),
        speed=np.zeros(12),
        work_out=np.zeros(12),
        work_in=np.zeros(12),
        coil=np.zeros(0),
        friction=np.zeros(0),
    )
    data = walks.Walks(
        results={
            **dict.fromkeys(walks.VARIANTS, all_arrived),
            "both": list(results.values()),
            "constraint_coupling": sticking,
        },
        standing={
            "go1": standing,
            "mr_go": standing,
            "mr_go_hold": replace(standing, torque_square=0.5 * standing.torque_square),
        },
        policies=dict.fromkeys(walks.VARIANTS, policies) | {"constraint_coupling": sticks},
    )
    MADE[tmp_path] = data
    return tmp_path


@pytest.fixture(autouse=True)
def not_from_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries get the walks that :func:`folder` made; writing and reading them takes longer than the entry."""
    monkeypatch.setattr(walks, "read", lambda job: MADE[job.out.parent])


def job(folder: Path) -> Job:
    """An entry's job on the walks of a folder."""
    (folder / "entry").mkdir(exist_ok=True)
    return Job(settings=Settings(), out=folder / "entry")


def made(entry, folder: Path) -> Findings:
    """Findings of an entry in the walks of a folder."""
    return entry(job(folder))


@pytest.mark.parametrize("entry", [table7, fig8, fig9])
def test_claims_hold_and_nothing_is_said_when_all_arrived(entry, tmp_path: Path) -> None:
    """The made-up robots do as the paper says."""
    found = made(entry, folder(tmp_path))
    assert all(found.claims.values())
    assert not any("fell" in note for note in found.notes)


@pytest.mark.parametrize(
    ("entry", "robot"), [(table7, "mr_go_sal"), (fig8, "mr_go_sal"), (fig8, "go1"), (fig9, "mr_go")]
)
def test_no_claim_holds_without_every_condition(entry, robot: str, tmp_path: Path) -> None:
    """A condition in which nobody arrived is neither lower nor longer than another, and one note counts its trials."""
    found = made(entry, folder(tmp_path, walked(robot, 3.0, 0.5, TRIALS[:0], late=2)))
    others = ("a device that sticks", "at 0.3 and 0.5 m/s")
    own = [holds for name, holds in found.claims.items() if not name.startswith(others)]
    assert own and not any(own)
    noted = [note for note in found.notes if "fell" in note]
    name = paper.NAMES[robot]
    assert noted == [
        f"Only trials that arrived count. {name}, 3 kg, 0.5 m/s: 7 fell and 2 came too late of 9, which leaves no "
        "figure."
    ]


def test_some_lost_trials_are_told_and_do_not_spoil_the_claims(tmp_path: Path) -> None:
    """One note over both conditions that lost some."""
    lost = walked("mr_go_sal", 0.0, 0.3, TRIALS[1:]), walked("mr_go_sal", 0.0, 0.5, TRIALS[2:], late=2)
    found = made(table7, folder(tmp_path, *lost))
    assert all(found.claims.values())
    assert found.notes == (
        "Only trials that arrived count. MR_Go-SAL, 0 kg, 0.3 m/s: 1 fell and 0 came too late of 9; MR_Go-SAL, 0 kg, "
        "0.5 m/s: 0 fell and 2 came too late of 9.",
    )


def test_table7_says_longer_only_where_it_is(tmp_path: Path) -> None:
    """Calves that are held for 10 % of the time stand still for less than the paper's; without a trial it says so."""
    short = walked("mr_go_sal", 3.0, 0.3)
    short = replace(short, hold=np.full((9, 4), 0.1))
    found = made(table7, folder(tmp_path, short, walked("mr_go_sal", 3.0, 0.5, TRIALS[:0])))
    why = {row.condition: row.why for row in found.rows}
    assert "stand still for less time: 10 to 10 %" in why["3 kg, 0.3 m/s, paper's hardware"]
    assert "stand still longer" in why["0 kg, 0.3 m/s, paper's hardware"]
    assert why["3 kg, 0.5 m/s, paper's hardware"] == "No trial arrived."


def test_one_surviving_policy_is_one_seed(tmp_path: Path) -> None:
    """Of three policies one arrived, three times: a single value, unlike three seeds or rollouts of one policy."""
    left = walked("mr_go_sal", 0.0, 0.3, TRIALS[1::3])
    several = walks.read(job(folder(tmp_path, left)))
    assert over_seeds(left.hold.mean(-1), several.seed_of(left))["n"] == 1
    assert over_seeds(left.hold.mean(-1), several.seed_of(left))["sd"] is None
    single = walks.read(job(folder(tmp_path, left, policies=1)))
    assert over_seeds(left.hold.mean(-1), single.seed_of(left))["n"] == 3
    rows = {row.condition: row for row in made(table7, folder(tmp_path, left, sticks=9)).rows}
    assert rows["0 kg, 0.3 m/s, paper's hardware"].n == 1
    assert rows["0 kg, 0.5 m/s, paper's hardware"].n == 3
    assert rows["0 kg, 0.5 m/s, paper's hardware, a device that sticks"].n == 9


def test_a_reduction_counts_seeds_not_trials(tmp_path: Path) -> None:
    """A policy that lost two of its three trials weighs as much as the others, both in the row and in its COT."""
    left = walked("mr_go_sal", 0.0, 0.3, np.array([0, 1, 2, 4, 5, 7, 8]))
    left = replace(
        left, joints=replace(left.joints, torque_square=left.joints.torque_square * (1 + left.trial % 3)[:, None])
    )
    rows = {row.condition: row for row in made(table6, folder(tmp_path, left)).rows}
    after, before = (rows[f"{robot}, 0 kg, 0.3 m/s"].ours for robot in ("MR_Go-SAL", "MR_Go"))
    reduction = rows["SAL against MR_Go, 0 kg, 0.3 m/s"]
    assert reduction.ours == pytest.approx(100.0 * (1.0 - after / before))
    assert reduction.n == 3


def test_lost_trials_of_every_walk_are_reported(tmp_path: Path) -> None:
    """Also of those that only a table next to the rows reads."""
    found = walks.read(job(folder(tmp_path)))
    fallen = [walked("mr_go_sal", 3.0, 0.5, TRIALS[1:])]
    found.results.update(no_power_price=fallen, both=fallen)
    noted = found.arrivals("both", "constraint_coupling", "no_power_price")
    note = "Only trials that arrived count. MR_Go-SAL, 3 kg, 0.5 m/s: 1 fell and 0 came too late of 9."
    assert noted == [note, f"Table 2's policies: {note}"]


def test_savings_stand_beside_their_closed_form(tmp_path: Path) -> None:
    """The table's columns, in percent of MR_Go's power, and the note's factors follow from ``holding_bound``."""
    found = made(table6, folder(tmp_path))
    (table,) = (table for table in found.tables if "closed form" in table.title)
    (note,) = (note for note in found.notes if "closed form" in note)
    figures = found.figures
    before = {(c["payload"], c["command"]): c["power"]["mean"] for c in figures["conditions"] if c["robot"] == "mr_go"}
    factors = []
    for saved, row in zip(figures["savings"], table.rows, strict=True):
        cell = saved["payload"], saved["command"]
        mine = consistency.holding_bound(
            saved["hold_share"], 12.0 + cell[0], standing=figures["standing"]["go1"] - figures["standing"]["mr_go_hold"]
        )
        assert row[4:] == [f"{100.0 * saved['saving'] / before[cell]:.1f}", f"{100.0 * mine / before[cell]:.1f}"]
        factors.append(saved["saving"] / mine)
        hardware = consistency.holding_bound(paper.TABLE_7[cell]["hardware"], paper.MASS["mr_go"] + cell[0])
        assert row[2] == f"{100.0 * hardware / paper.TABLE_6['mr_go', *cell].power:.1f}"
    assert f"{min(factors):.2f} to {max(factors):.2f} times ours" in note


def test_reductions_carry_what_the_calibration_leaves_open(tmp_path: Path) -> None:
    """By the covariance of the three numbers: none where Go1's rows fit exactly, more where they do not."""

    def errors(misfit: float) -> list[float]:
        worse = [
            replace(r, joints=replace(r.joints, torque_square=r.joints.torque_square * (1.0 + misfit * (-1.0) ** k)))
            for k, r in enumerate(walked("go1", *cell) for cell in HOLD)
        ]
        found = made(table6, folder(tmp_path, *worse))
        rows = [row for row in found.rows if row.quantity == "reduction of COT"]
        assert {row.error_free for row in rows} == {2}
        return [row.error for row in rows if row.condition.startswith("SAL against MR_Go, 3 kg")]

    exact, worse = errors(0.0), errors(0.1)
    assert max(exact) < 1e-6 < 0.1 < min(worse)


def test_what_the_devices_cost_is_said_next_to_the_papers(tmp_path: Path) -> None:
    """MR_Go minus Go1 in each condition in which both arrived."""
    found = made(table6, folder(tmp_path, walked("mr_go", 3.0, 0.5, TRIALS[:0], late=2)))
    powers = {(c["robot"], c["payload"], c["command"]): c["power"]["mean"] for c in found.figures["conditions"]}
    more = [powers["mr_go", load, v] - powers["go1", load, v] for load, v in ((0.0, 0.3), (0.0, 0.5), (3.0, 0.3))]
    assert any(f"ours draws {min(more):+.0f} to {max(more):+.0f} W more" in note for note in found.notes)


def test_the_tail_of_the_torque_is_told_by_what_the_gate_does(tmp_path: Path) -> None:
    """Three of four torque steps beyond Go1's 95th percentile come before the calf is held, none while it is."""
    found = made(fig8, folder(tmp_path))
    (tail,) = (table for table in found.tables if table.id == "tail")
    assert tail.rows[0] == ["0 kg, 0.3 m/s", "5.2", "0, 0", "75, 23", "0, 69", "25, 8"]
    why = found.reasons["walk.calf_torque"]
    assert "75 % come before the calf is held" in why and "held come 0 %, after it was let go 25 %" in why
    assert figure8._span(np.array([9.6, 40.2])) == "10 to 40 %"


def test_robots_walk_as_each_table_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the measured speeds but in one variant; what the tables are about is walked by each policy three times.

    Policies with SAL walk on the devices of their training by their records, but for those of another robot.
    """
    asked = []
    monkeypatch.setattr(walks, "walk", lambda cfg, policies, report: asked.append((cfg, policies)) or [])
    monkeypatch.setattr(walks, "ensembles", lambda paths: dict(paths))
    monkeypatch.setattr(walks, "Ensemble", tuple)
    monkeypatch.setattr(walks, "standing_load", lambda *_, **__: (None, {}))
    walks.simulate(Job(settings=Settings(), out=tmp_path))
    by_name = dict(zip(walks.VARIANTS, (cfg for cfg, _ in asked), strict=True))
    assert [name for name, cfg in by_name.items() if not cfg.commanded] == ["as_commanded"]
    assert by_name["both"].commanded["mr_go_sal", 3, 0.3] == 0.33
    assert by_name["both"].trials == 3 * by_name["as_commanded"].trials == 15
    for name, (cfg, policies) in zip(walks.VARIANTS, asked, strict=True):
        if name != "swapped_policies":
            tasks = [json.loads(file.with_suffix(".json").read_text())["task"] for file in policies["mr_go_sal"]]
            assert {task["coupling"] for task in tasks} == {cfg.env.coupling.value}, name


def test_table_7_has_the_papers_simulation_next_to_walks_as_commanded(tmp_path: Path) -> None:
    """Its hardware stands next to walks at the measured speeds."""
    place = folder(tmp_path)
    cache.save(place / "walks.npz", MADE[place])
    data = cache.load(place / "walks.npz", walks.Walks)
    nominal = [replace(r, hold=np.full_like(r.hold, 0.123)) for r in data.results["as_commanded"]]
    MADE[place] = replace(data, results={**data.results, "as_commanded": nominal})
    found = made(table7, place)
    ours = {row.condition: row.ours for row in found.rows}
    holds = {name: found.claims[found.claim_ids[name]] for name in ("longer_when_slow", "commanded_longer_when_slow")}
    assert holds == {"longer_when_slow": True, "commanded_longer_when_slow": False}
    assert ours["3 kg, 0.5 m/s, paper's simulation"] == pytest.approx(12.3)
    assert ours["3 kg, 0.5 m/s, paper's hardware"] > 30.0


class Devices(dict):
    """Parameters of devices by their names, as a choice sets them."""

    actuator = property(lambda self: self)

    def param(self, name: str) -> str:
        """The parameter's array is its name here."""
        return name

    def view(self, name: str) -> np.ndarray:
        """A new array for the parameter."""
        return self.setdefault(name, np.zeros(4))


def test_the_support_branch_is_walked_with_each_choice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Devices that hold in proportion to eps_hold, at a price in proportion to Kp_low; robots of at most 0.72 m/s."""
    given = []

    def walk(cfg: WalkCfg, policies: dict[str, object]) -> list[WalkResult]:
        assert set(cfg.robots) <= set(policies) and cfg.distance == Settings().window
        devices, trials = Devices(), np.arange(cfg.trials)
        if cfg.derate is not None:
            cfg.derate(devices, cfg.robots)
        given.append({name: float(values[0]) for name, values in devices.items()})
        eps_hold, kp_low = given[-1].get("eps_hold", 0.2), given[-1].get("kp_low", 5.0)
        found = []
        for robot, payload, command in itertools.product(cfg.robots, cfg.payloads, cfg.speeds):
            r = walked(robot, payload, min(command, 0.5), trials)
            square = r.joints.torque_square * (1.0 - eps_hold + 0.01 * kp_low)
            motion = r.motion | {"speed": np.full(cfg.trials, min(command, 0.72))}
            joints, hold = replace(r.joints, torque_square=square), np.full_like(r.hold, eps_hold)
            found.append(replace(r, command=command, hold=hold, joints=joints, motion=motion))
        return found

    monkeypatch.setattr(support, "walk", walk)
    found = support.compute(job(folder(tmp_path)))
    assert all(found.claims.values()) and len(found.claims) == 3
    assert [row.ours for row in found.rows] == [0.7]
    assert given[2] == {"eps_hold": pytest.approx(0.1)} and given[-2] == {"coil_time_constant": pytest.approx(0.02)}
    assert found.figures["held"]["eps_hold 0.4 rad/s"] == pytest.approx([40.0] * 4)
