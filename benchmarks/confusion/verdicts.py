"""Compare a diagnosis with the truth: outcome of a case, coverage of its intervals."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from benchmarks.confusion.case import Truth

OUTCOMES = ("right", "ambiguous", "missed", "wrong", "other", "failed")
"""Outcomes of a case: named exactly; named with alternatives that include the truth; (one of) it not named; something
else named; right in the name but not in the rest (see ``remark``); the diagnosis raised."""

PARAMETER_NAMES: dict[tuple[str, str], tuple[str, ...]] = {
    ("friction_asymmetry", "torque"): ("coulomb",),
    ("friction_asymmetry", "viscosity"): ("viscous",),
}
"""Names under which a diagnosis reports a parameter, by effect and :class:`~benchmarks.confusion.effects.Spec` name.
Where none of them occurs the same name is looked for, then the first parameter is taken."""

_EITHER_SIGN = frozenset({"encoder_offset"})
"""Effects whose sign is a convention."""


def record_of(result: Any) -> dict[str, Any]:
    """The parts of a diagnosis that are judged, as plain data."""
    return {
        "verdict": result.verdict,
        "causes": [
            {
                "name": cause.name,
                "parameters": {name: _parameter(p) for name, p in cause.parameters.items()},
                "p_value": cause.p_value,
                "alternatives": list(cause.alternatives),
            }
            for cause in result.causes
        ],
        "parameter_shift": [
            {
                "name": shift.name, "value": float(shift.value), "ci95": [float(x) for x in shift.ci95],
                "alternatives": list(shift.alternatives),
            }
            for shift in result.parameter_shift
        ],
        "unexplained": None if result.unexplained is None else {
            "depends_on": list(result.unexplained.depends_on), "share": result.unexplained.share,
        },
        "gain": None if result.gain is None else result.gain.rmse_reduction,
        "law": None if result.law is None else result.law.name,
        "faults": [fault.kind for fault in result.recording_faults],
        "suspects": {suspect.name: suspect.reason for suspect in result.suspects},
        "baseline": None if result.account is None else result.baseline.nrmse,
        "account": None if result.account is None else asdict(result.account),
        "seconds": result.seconds,
    }  # fmt: skip


def _parameter(p: Any) -> dict[str, Any]:
    return {"value": float(p.value), "ci95": [float(x) for x in p.ci95] if p.ci95 else None, "unit": p.unit}


def judge(truth: Truth, calibration: bool, found: dict[str, Any]) -> tuple[str, str]:
    """Outcome of a case and a remark.

    Args:
        truth: What was hidden.
        calibration: Whether it is a shift of calibration, which may be reported as a shift.
        found: What was diagnosed, from :func:`record_of`.
    """
    groups = [{c["name"], *c["alternatives"]} for c in found["causes"]]
    groups = [group for group in groups if not group & {*truth.also}]
    shifts = [{s["name"], *s["alternatives"]} for s in found["parameter_shift"]]
    if calibration:
        groups, shifts = groups + shifts, []
    if truth.law:  # structure unexplained next to a name, or without one, is the law's
        if truth.kinds:
            return _judge_names(set(truth.kinds), groups), ""
        return ("wrong", "false alarm") if groups else ("right", found["verdict"] or "no verdict")
    remark = "shift too: " + ", ".join(s["name"] for s in found["parameter_shift"]) if shifts else ""
    if not truth.kinds and not truth.background:
        if groups or found["verdict"] not in ("none", None):
            return "wrong", "false alarm"
        return ("other", remark) if shifts else ("right", "" if found["verdict"] else "no verdict")
    if not truth.kinds:
        return _judge_unexplained(truth, found, bool(groups))
    outcome = _judge_names(set(truth.kinds), groups)
    if outcome not in ("right", "ambiguous") or calibration:
        return outcome, remark
    wanted = "named_and_unexplained" if truth.background else "named"
    if found["verdict"] != wanted:
        return "other", f"{outcome}, but {found['verdict']}"
    return outcome, remark


def _judge_names(truth: set[str], groups: list[set[str]]) -> str:
    if any(not group & truth for group in groups):
        return "wrong"
    if not truth <= set().union(*groups):
        return "missed"
    return "right" if all(len(group) == 1 for group in groups) else "ambiguous"


def _judge_unexplained(truth: Truth, found: dict[str, Any], named: bool) -> tuple[str, str]:
    if named:
        return "wrong", "named"
    if found["verdict"] != "unexplained" or found["unexplained"] is None:
        return "missed", ""
    first = found["unexplained"]["depends_on"][:2]
    return ("right", "") if truth.depends_on & set(first) else ("other", f"on {', '.join(first)}")


def coverage(truth: Truth, found: dict[str, Any]) -> list[dict[str, Any]]:
    """For each parameter that was found and should be: true value, value, interval and whether it covers the truth."""
    named = [(c["name"], c["parameters"]) for c in found["causes"]]
    named += [(s["name"], {"": {"value": s["value"], "ci95": s["ci95"]}}) for s in found["parameter_shift"]]
    out = []
    for name, parameters in named:
        stated = truth.parameters.get(name)
        if stated is None or not stated["exact"] or not parameters:
            continue
        own = stated["parameter"]
        names = (*PARAMETER_NAMES.get((name, own), ()), own, next(iter(parameters)))
        got = _amplitude(parameters) if own == "amplitude" else parameters[next(n for n in names if n in parameters)]
        if got["ci95"] is None:
            continue
        sign = -1.0 if name in _EITHER_SIGN and got["value"] * stated["value"] < 0.0 else 1.0
        low, high = sorted(sign * x for x in got["ci95"])
        out.append(
            {
                "name": name, "truth": stated["value"], "value": sign * got["value"], "ci95": [low, high],
                "covered": low <= stated["value"] <= high,
            }
        )  # fmt: skip
    return out


def _amplitude(parameters: dict[str, Any]) -> dict[str, Any]:
    """Amplitude of a sine and a cosine, with its interval to first order."""
    sine, cosine = parameters["sine"], parameters["cosine"]
    size = math.hypot(sine["value"], cosine["value"])
    half = [0.5 * (p["ci95"][1] - p["ci95"][0]) * p["value"] / size for p in (sine, cosine)]
    return {"value": size, "ci95": [size - math.hypot(*half), size + math.hypot(*half)]}
