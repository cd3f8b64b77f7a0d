"""Figure 10: power per phase and state of charge of the pickup-and-return mission."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.paper import PaperValue
from mrwarp.reproduce import missions
from mrwarp.reproduce.experiment import Findings, Job, compare, over_seeds
from mrwarp.reproduce.missions import Mission
from mrwarp.trials import mission_figures, walk_pictures


def compute(job: Job) -> Findings:
    """Rows per robot and phase, the changes by SAL, and what the paper's own numbers say of each other.

    A robot stands once, for all seeds.
    """
    found = missions.read(job)
    rows = []
    figures = {robot: mission_figures.row(robot, trace) for robot, trace in found.traces.items()}
    for robot, trace in found.traces.items():
        name = paper.NAMES[robot]
        for phase, values in trace.power.items():
            cell, quantity = figures[robot]["power"][phase], ("power", "W", 1)
            standing = phase == "standby"
            why = _standing(found, cell["paper"]) if standing else _walking(robot, found, phase)
            ours, fitted = over_seeds(values[:1] if standing else values), cell["calibrated"]
            rows.append(compare(f"{name}, {phase}", quantity, cell["paper"], ours, why, calibrated=fitted))
        cell, quantity = figures[robot]["depletion"], ("depletion", "points", 1)
        theirs = PaperValue(mean=cell["paper"], sd=cell["paper_sd"])
        ours, why = over_seeds(trace.depletion), _depletion(robot, found)
        rows.append(compare(name, quantity, theirs, ours, why, calibrated=cell["calibrated"]))
    changes = mission_figures.changes(figures)
    check = consistency.check()
    first = check["by_speed"][0]
    for name in ("outbound_power", "return_power", "depletion"):
        why = _change(found, name, first["energy_ratio"])
        rows.append(missions.change_row(found, changes[name], name.replace("_", " "), "change", why))
    walk_pictures.mission_power(found.traces, job.out / "power.png")
    return Findings(
        rows=rows,
        claims={
            "SAL lowers the depletion against MR_Go": changes["depletion"]["ours"] < 0.0,
            f"by at least {-100.0 * changes['depletion']['paper']:.1f} %": changes["depletion"]["ours"]
            <= changes["depletion"]["paper"],
        },
        notes=[
            *found.arrivals,
            f"The paper's own numbers: SAL walks on {check['walking_power_ratio']:.3f} of MR_Go's power, so at equal "
            f"speeds on {first['energy_ratio']:.3f} of its energy, but depletes {check['depletion_ratio']:.3f} of its "
            f"charge ({first['deviation_in_sd']:.1f} SD apart). A walk of MR_Go-SAL at "
            f"{first['reconciled_by']['sal_speed']:.2f} m/s would reconcile them.",
        ],
        pictures={"power.png": "Battery power and state of charge over the mission, mean over seeds"},
        figures={"robots": figures, "changes": changes, "consistency": check},
    )  # fmt: skip


def _standing(found: Mission, theirs: float) -> str:
    electronics = found.electrical.electronics
    return (
        f"Of our standing power {electronics:.0f} W are electronics, calibrated on Go1's rows with a wide interval "
        f"(table 6); the paper's {theirs:.0f} W bound them from above."
    )


def _change(found: Mission, name: str, energy_ratio: float) -> str:
    """Why MR_Go and MR_Go-SAL differ by another share than in the paper."""
    if name != "depletion":
        return _walking("mr_go_sal", found, name.removesuffix("_power"))
    return (
        f"The paper's own powers ask for {100.0 * (energy_ratio - 1.0):+.1f} % at equal speeds; what SAL saves while "
        "walking is in the rows above."
    )


def _walking(robot: str, found: Mission, phase: str) -> str:
    ours, theirs = float(found.traces[robot].power[phase].mean()), paper.MISSION_POWER
    if robot != "mr_go_sal":
        off = ours - theirs[robot][phase]
        place = "within" if abs(off) <= found.misfit else "beyond"
        return f"{off:+.1f} W are {place} the {found.misfit:.1f} W (RMS) to which Go1's rows fit, see table 6."
    before = float(found.traces["mr_go"].power[phase].mean())
    saved = theirs["mr_go"][phase] - theirs[robot][phase]
    return f"SAL saves {before - ours:.0f} W here and {saved:.0f} W in the paper, see table 6 for the parts."


def _depletion(robot: str, found: Mission) -> str:
    trace = found.traces[robot]
    walked = float(sum(trace.seconds[name].mean() for name in ("outbound", "return")))
    energy = {name: float((trace.power[name] * trace.seconds[name]).mean()) / 3600.0 for name in trace.power}
    theirs = {
        name: paper.MISSION_POWER[robot][name] * float(trace.seconds[name].mean()) / 3600.0 for name in trace.power
    }
    return (
        f"{walked:.0f} s of walking: our phases draw {sum(energy.values()):.1f} W·h, the paper's powers over the same "
        f"times {sum(theirs.values()):.1f} W·h of the {found.battery.capacity:.0f} W·h that Go1's depletion gives."
    )
