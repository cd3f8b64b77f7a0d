"""One device in every host: the torque that each gives along one motion, next to :class:`mrwarp.JointBatch`'s.

``python -m benchmarks.hosts`` writes ``docs/results/hosts.json``, whose table ``mrwarp reproduce docs`` puts on
docs/integrations.md. Hosts that cannot be imported keep the figures that are there: run it again with mjlab's Python.
"""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import host_rigs as rigs
from benchmarks.host_cases import NUMBERS, STRENGTHS, TIMES, Case, Trace, case
from mrwarp.run_dir import plain, write_text

RESULTS = Path(__file__).parents[1] / "docs/results/hosts.json"
"""The committed figures."""

GROUPS: dict[str, tuple[str, ...]] = {
    "lag and delay": ("coil_lag", "command_delay"),
    "heat and wear": ("temperature_drift", "wear"),
    "play and spring": ("backlash", "series_compliance"),
    "cogging, friction by direction": ("cogging", "friction_asymmetry"),
    "all of them": tuple(STRENGTHS),
}
"""Rows of the table beyond the laws alone."""


@dataclass(frozen=True, kw_only=True)
class Host:
    """A place where the joint runs."""

    name: str
    run: Callable[[Case], Trace]
    needs: str
    """Module, or the C compiler, that it cannot do without."""
    bound: float
    """Largest difference from ``JointBatch``, as a share of the case's largest torque."""

    @property
    def missing(self) -> str:
        """Module or program that it lacks here; empty where it can be run."""
        if self.needs == "cc":
            return "" if rigs.COMPILER else "a C compiler 'cc'"
        try:
            importlib.import_module(self.needs)
        except ImportError:
            return self.needs
        return ""


SAME = 1e-6
"""One kernel on the same numbers: rounding of a dozen operations in 32 bits."""

SHIFTED = 1e-4
"""One kernel on angles that are stored about another zero, rounded to 1e-7 rad of it; a device that is wound by
its spring bears some ten N·m/rad, and a step of a law's sign may come a rounding earlier."""

OTHER = 1e-4
"""Those laws by another compiler, or in 64 bits."""

HOSTS = (
    Host(name="`Brake`", run=rigs.mujoco_brake, needs="mujoco", bound=SAME),
    Host(name="`DriveMR`, explicit", run=rigs.drive_explicit, needs="newton", bound=SAME),
    Host(name="`DriveMR`, bound", run=rigs.drive_bound, needs="newton", bound=SAME),
    Host(name="`MrActuator`, explicit", run=rigs.environment_explicit, needs="mrwarp.env.sim", bound=SHIFTED),
    Host(name="`MrActuator`, bound", run=rigs.environment_bound, needs="mrwarp.env.sim", bound=SHIFTED),
    Host(name="exported C", run=rigs.c_export, needs="cc", bound=OTHER),
    Host(name="exported NumPy", run=rigs.python_export, needs="numpy", bound=OTHER),
    Host(name="mjlab, explicit", run=rigs.mjlab_explicit, needs="mjlab", bound=SAME),
    Host(name="mjlab, bound", run=rigs.mjlab_bound, needs="mjlab", bound=SAME),
)


def difference(got: Trace, wanted: Trace, qd: np.ndarray) -> float:
    """Largest difference of what a host gives, as a share of the largest torque; NaN counts as infinite."""
    assert wanted.torque is not None
    expected = {"torque": wanted.torque, "effort": -np.sign(qd) * np.abs(wanted.torque), "bound": wanted.bound}
    worst, scale = 0.0, float(np.abs(wanted.torque).max())
    for name, value in expected.items():
        if (found := getattr(got, name)) is not None:
            assert value is not None
            gap = float(np.abs(found - value).max()) / scale
            worst = max(worst, gap) if np.isfinite(gap) else float("inf")
    return worst


def rows(*, every: bool) -> dict[str, list[Case]]:
    """Cases by row of the table: with ``every`` all laws with all effects at all steps, else some that cover them."""
    found: dict[str, list[Case]] = {}
    for k, law in enumerate(NUMBERS):
        times = TIMES if every else (TIMES[k % len(TIMES)],)
        found[f"law: {law}"] = [case(law, (), dt, sign) for dt in times for sign in ((1.0, -1.0) if every else (1.0,))]
    for k, (group, effects) in enumerate(GROUPS.items()):
        laws, times = (tuple(NUMBERS), TIMES) if every else (("bouc_wen", "dahl")[k % 2 :][:1], (TIMES[(k + 1) % 3],))
        found[group] = [case(law, effects, dt, -1.0 if k % 2 else 1.0) for law in laws for dt in times]
    return found


def measured(hosts: Sequence[Host], cases: dict[str, list[Case]]) -> dict[str, dict[str, float]]:
    """Largest difference by row and host."""
    found: dict[str, dict[str, float]] = {}
    for row, members in cases.items():
        for one in members:
            wanted = rigs.joint_batch(one)
            for host in hosts:
                gap = difference(host.run(one), wanted, one.qd)
                found.setdefault(row, {})[host.name] = max(gap, found.get(row, {}).get(host.name, 0.0))
        print(row, *(f"{name} {gap:.1e}" for name, gap in found[row].items()), sep="; ", flush=True)
    return found


def main() -> None:
    """Measure the hosts that are here and write their figures to those of the others."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS, help="file of figures")
    out: Path = parser.parse_args().out
    before: dict[str, Any] = json.loads(out.read_text(encoding="utf-8")) if out.is_file() else {}
    cases = rows(every=True)
    found = measured([host for host in HOSTS if not host.missing], cases)
    bounds = {host.name: host.bound for host in HOSTS}
    table = {row: {**before.get("rows", {}).get(row, {}), **found[row]} for row in cases}
    table = {row: {name: gaps[name] for name in bounds if name in gaps} for row, gaps in table.items()}
    count = {row: len(members) for row, members in cases.items()}
    content = {"command": "python -m benchmarks.hosts", "bounds": bounds, "cases": count, "rows": table}
    write_text(out, json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
