"""Joints of a bag, each with its own readings: publishers of one topic may send different joints, in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.robot_logs.robot_log import MIN_SAMPLES, LogError

ARRAYS = ("Float64MultiArray", "Float32MultiArray")
"""Messages that are arrays of numbers without names."""

COMMANDS = ("q_des", "qd_des", "tau_ff")
"""Meanings that an array of commands can have."""

OPTIONAL = ("qd", "tau")
"""Channels without which a joint is still one."""


@dataclass
class JointMessages:
    """Numbers of joints by name, of one topic."""

    t: dict[str, list[float]] = field(default_factory=dict)
    """Stamps of each joint's messages [s]."""
    values: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    """By joint and channel; NaN in a message that lacks the channel."""

    @property
    def names(self) -> list[str]:
        """Joints, in the order in which they appeared."""
        return list(self.t)

    def add(self, t: float, names: Sequence[str], channels: Mapping[str, Any]) -> None:
        """Take a message."""
        for k, name in enumerate(names):
            own = self.values.setdefault(name, {})
            stamps = self.t.setdefault(name, [])
            for channel in (*own, *(c for c in channels if c not in own)):
                line = own.setdefault(channel, [np.nan] * len(stamps))
                line.append(float(channels[channel][k]) if channel in channels else np.nan)
            stamps.append(t)

    def of(self, name: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Rising stamps of a joint, (N,), and its channels, (N,)."""
        t, first = np.unique(np.array(self.t[name]), return_index=True)
        return t, {channel: np.array(x)[first] for channel, x in self.values[name].items()}

    def merged(
        self, path: Path, topic: str, wanted: Sequence[str]
    ) -> tuple[np.ndarray, dict[str, np.ndarray], list[str]]:
        """Joints that are wanted on common stamps, (N,), by channel (N, J), and remarks.

        Rows are those of the publisher of most of them; readings of others are taken on a line between neighbours.

        Raises:
            LogError: a joint has too few messages, or angles that are no numbers.
        """
        each, notes = {name: self.of(name) for name in wanted}, list[str]()
        for name, (t, x) in each.items():
            if len(t) < MIN_SAMPLES:
                raise LogError(
                    f"{path}: {topic} holds {len(t)} messages of {name}, {MIN_SAMPLES} or more are needed; record "
                    "longer, or leave the joint out of the map's joints"
                )
            _whole(path, topic, name, x, notes)
        publishers: dict[bytes, list[str]] = {}
        for name, (t, _) in each.items():
            publishers.setdefault(t.tobytes(), []).append(name)
        first = max(publishers.values(), key=lambda names: (len(names), len(each[names[0]][0])))
        begin, end = (f(at(t) for t, _ in each.values()) for f, at in ((max, np.min), (min, np.max)))
        rows = each[first[0]][0]
        rows = rows[(rows >= begin) & (rows <= end)]
        if len(rows) < MIN_SAMPLES:
            raise LogError(
                f"{path}: {topic}: {first[0]} and {next((n for n in wanted if n not in first), first[0])} are together "
                f"in {len(rows)} rows, {MIN_SAMPLES} or more are needed; leave one out of the map's joints"
            )
        for names in publishers.values():
            if names is not first:
                notes.append(
                    f"{topic}: {', '.join(names)} came in messages of their own: their readings are interpolated to "
                    f"the stamps of {first[0]}"
                )
        channels = dict.fromkeys(c for _, x in each.values() for c in x)
        blank = np.full(len(rows), np.nan)
        found = {
            c: np.stack([np.interp(rows, t, x[c]) if c in x else blank for t, x in each.values()], axis=1)
            for c in channels
        }
        return rows, {c: x for c, x in found.items() if np.isfinite(x).any()}, notes


def _whole(path: Path, topic: str, name: str, channels: dict[str, np.ndarray], notes: list[str]) -> None:
    """Take out channels of a joint that are no numbers, in place.

    Raises:
        LogError: these are angles.
    """
    for channel, x in list(channels.items()):
        bad = np.flatnonzero(~np.isfinite(x))
        if not len(bad):
            continue
        if channel not in OPTIONAL:
            raise LogError(
                f"{path}: {topic}: {len(bad)} of {len(x)} angles of {name} are no number; leave the joint out of the "
                "map's joints"
            )
        if len(bad) < len(x):
            said = {"qd": "velocities", "tau": "efforts"}[channel]
            notes.append(f"{topic}: {len(bad)} of {len(x)} {said} of {name} are no number: {channel} of it is left out")
        del channels[channel]


def order_of(path: Path, topic: str, m: Mapping[str, Any], width: int) -> tuple[list[str | None], str]:
    """Joints of an array of commands in its order, None for one that is not taken, and what the numbers are.

    Raises:
        LogError: the map does not say it, or not of as many numbers.
    """
    order, meaning = m.get("command_order"), m.get("command_is", "q_des")
    order = order.get(topic) if isinstance(order, dict) else order  # of several topics each has its own
    if not isinstance(order, list) or not order:
        raise LogError(
            f"{path}: {topic} holds arrays of {width} numbers without names; name their joints in the map: "
            f'{{"command": "{topic}", "command_order": [...], "command_is": "q_des"}}, or {{"command": null}}'
        )
    if len(order) != width:
        raise LogError(
            f"{path}: the map's command_order names {len(order)} joints, {topic} holds {width}; name as many"
        )
    if meaning not in COMMANDS:
        raise LogError(f"{path}: the map's command_is = {meaning!r}; allowed: {', '.join(COMMANDS)}")
    return [str(x) if x else None for x in order], meaning
