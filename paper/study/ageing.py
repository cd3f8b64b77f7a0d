"""How soon a worn device is noticed: virtual calibrations, one a day, healthy and with a loss of yield.

A calibration is what a standing robot can do with each knee: sines at four currents, 20 s in all. It is recorded on the
virtual bench with its default hidden effects: from run to run gain and zero of the torque differ, and the device is
another bit warm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.bench.bench_effects import LOG_DT, SUBSTEPS
from mrwarp.bench.excitation import FIT_CURRENTS, Excitation
from mrwarp.bench.virtual_bench import BenchCfg, record
from mrwarp.identify.monitor import MonitorCfg, monitor
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording
from mrwarp.runtime import panels, text_table
from mrwarp.trials.statistics import interval, share
from paper.study.plan import kept

SECONDS = 5.0
"""Length of a move at one current [s]."""

BATCH = 12
"""Calibrations that are simulated together."""

MOVES = ((0.15, 0.6), (0.10, 1.3))
"""Amplitudes [rad] and frequencies [Hz] of the sines that a move adds up: a standing knee's, within 0.25 rad."""


@dataclass(frozen=True, kw_only=True)
class AgeingCfg:
    """The simulated ageing."""

    devices: int = 3
    """Devices, each with its own days."""
    days: int = 200
    """Healthy days of each after the baseline."""
    losses: tuple[float, ...] = (0.05, 0.10, 0.20)
    """Sudden losses of yield [1]."""
    follow: int = 60
    """Days after a loss."""
    monitor: MonitorCfg = MonitorCfg()
    seed: int = 0
    """Seed of noise, and of what differs from run to run."""


def calibrations(count: int, loss: float, rng: np.random.Generator) -> list[Recording]:
    """Calibrations of a device that has lost so much of its yield: the same move at 0, 0.5, 1.0 and 1.5 A each time."""
    samples = round(SECONDS / LOG_DT)
    time = np.arange(samples * SUBSTEPS) * LOG_DT / SUBSTEPS
    q = np.clip(time / 0.5, 0.0, 1.0) ** 2 * sum(a * np.sin(2.0 * np.pi * f * time) for a, f in MOVES)
    move = [Excitation(id=f"{amps:g}A", kind="sine", q=q, command=np.full(samples, amps)) for amps in FIT_CURRENTS]
    mr = MrParams()
    worn = mr.replace(K0=(1.0 - loss) * mr.bouc_wen.K0, K1=(1.0 - loss) * mr.bouc_wen.K1)
    runs = record(move * count, BenchCfg(params=worn), rng, {"made_by": "mrwarp study ageing"}).trajectories
    size = len(move)
    return [Recording(trajectories=runs[k * size : (k + 1) * size], header={}) for k in range(count)]


def run(cfg: AgeingCfg, out: Path, report: Callable[[str, float], None] = lambda text, share: None) -> dict[str, Any]:
    """Follow healthy devices over all days, and each of them again with a loss after the baseline.

    What ``out`` holds of a device is not simulated again.

    Returns:
        ``healthy``: devices, days, the first false alarms of each, and the ``share`` of devices with one; ``losses``:
        by size, after how many records each device's loss was noticed (None: not within the days that follow), the
        share that was, and the change that was reported.

    Raises:
        ValueError: a file in ``out`` is damaged or of other choices.
    """
    asked = {name: value for name, value in asdict(cfg).items() if name != "devices"}
    devices = []
    for device in range(cfg.devices):

        def show(text: str, share: float, device: int = device) -> None:
            report(f"device {device + 1}, {text}", (device + share) / cfg.devices)

        path = out / "devices" / f"{device}.json"
        devices.append(kept(path, asked, partial(follow, cfg, device, show)))
    false = sum(bool(own["alarms"]) for own in devices)
    losses = {}
    for name in devices[0]["losses"]:
        records, changes = ([own["losses"][name][key] for own in devices] for key in ("records", "told"))
        seen = share(sum(r is not None for r in records), len(records))
        losses[name] = {"records": records, "told": interval(changes), "noticed": seen}
    return {
        "healthy": {
            "devices": cfg.devices,
            "days": cfg.days,
            "alarms": [own["alarms"] for own in devices],
            "share": share(false, cfg.devices),
        },
        "losses": losses,
        "series": devices[0]["series"],
    }


def follow(cfg: AgeingCfg, device: int, report: Callable[[str, float], None]) -> dict[str, Any]:
    """One device, healthy over all days and again with each loss after the baseline.

    Returns:
        ``alarms``: by what changed, days after the baseline; ``losses``: by size, ``records`` until it was noticed or
        None, and the reported change; ``series``: yield of the baseline by record, of each loss and healthy (``0``).
    """
    first = cfg.monitor.baseline
    done, total = 0, first + cfg.days + len(cfg.losses) * cfg.follow

    def days(count: int, loss: float, stream: Sequence[int]) -> dict[str, Recording]:
        nonlocal done
        rng, found = np.random.default_rng([cfg.seed, *stream]), []
        while len(found) < count:
            found += calibrations(min(BATCH, count - len(found)), loss, rng)
            report(f"loss {loss:.0%}", (done + len(found)) / total)
        done += count
        return {f"{stream}-{k:03d}": recording for k, recording in enumerate(found)}

    healthy = days(first + cfg.days, 0.0, (device, 0))
    health = monitor(healthy, cfg.monitor)
    begin, losses, series = dict(list(healthy.items())[:first]), {}, {}
    for k, loss in enumerate(cfg.losses):
        worn = monitor(begin | days(cfg.follow, loss, (device, k + 1)), cfg.monitor)
        alarm = worn.alarms.get("yield")
        change = float(worn.values["yield"][first:].mean() - 1.0)
        losses[f"{loss:g}"] = {"records": alarm["number"] - first if alarm else None, "told": change}
        series[f"{loss:g}"] = worn.values["yield"].tolist()
    series["0"] = health.values["yield"].tolist()
    alarms = {name: alarm["number"] - first for name, alarm in health.alarms.items()}
    return {"alarms": alarms, "losses": losses, "series": series}


def lines(found: Mapping[str, Any]) -> list[str]:
    """The table."""
    healthy = found["healthy"]
    rows = []
    for name, own in found["losses"].items():
        seen = [r for r in own["records"] if r is not None]
        change = own["told"]
        rows.append((f"{float(name):.0%}", f"{len(seen)} of {len(own['records'])}",
                     f"{np.median(seen):g} ({min(seen)} to {max(seen)})" if seen else "",
                     f"{100.0 * change['mean']:+.1f} ± {100.0 * change['half_width']:.1f} %"))  # fmt: skip
    false, rate = sum(bool(a) for a in healthy["alarms"]), healthy["share"]
    return [
        f"healthy: {false} of {healthy['devices']} devices gave an alarm over {healthy['days']} days "
        f"({rate['share']:.0%}, {rate['low']:.0%} to {rate['high']:.0%})",
        *text_table(("loss", "noticed", "after records: median (range)", "reported change"), rows),
    ]


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Yield of the first device over the records, healthy and with each loss."""
    figure, ((axis,),) = panels((9, 4))
    for name, series in found["series"].items():
        axis.plot(np.arange(1, len(series) + 1), series, ".-", linewidth=0.7, label=f"loss {float(name):.0%}")
    axis.set(xlabel="record", ylabel="yield of the baseline")
    axis.legend()
    figure.savefig(path, dpi=120)
