"""Numbers of a device that its motion does not give, and that somebody states: the coil's resistance and the mass.

They come from an option, else from the recording's header (``# coil_resistance: 30`` in a CSV). Without them they are
not known, and no figure that hangs on them is given: the paper's device has others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from mrwarp.model_file import MAX_MASS, Model, Parameter
from mrwarp.params import MrParams
from mrwarp.recording.data import Recording, RecordingError

STATED = {"coil_resistance": ("Ohm", MrParams.spec("coil_resistance").high), "device_mass": ("kg", MAX_MASS)}
"""Unit and largest value of each number, by its name in a header; as an option it has hyphens."""


def stated_numbers(recording: Recording, given: Mapping[str, float | None] | None = None) -> dict[str, Parameter]:
    """Statements on the device that was recorded, by name.

    Args:
        recording: Its header may hold the numbers.
        given: The same from options, which win; None leaves one to the header.

    Raises:
        RecordingError: the header's number is none that makes sense.
        ValueError: a resistance is given where no current is recorded.
    """
    found, control = {}, recording.units.get("current")
    for name, (unit, most) in STATED.items():
        option = "--" + name.replace("_", "-")
        value, source = (given or {}).get(name), f"given as {option}"
        if value is not None and name == "coil_resistance" and control != "A":
            raise ValueError(
                f"{option} {value:g}: the recording's control input is in {control!r}, no current in A; leave it out"
            )
        if value is None and name in recording.header and (name != "coil_resistance" or control == "A"):
            value, source = recording.header[name], "the recording's header"
            number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if not number or not 0.0 < value <= most:
                raise RecordingError(
                    f"{recording.source or 'recording'}: header: {name} = {value!r}; allowed: above 0, at most "
                    f"{most:g} {unit}; correct or remove it"
                )
        if value is not None:
            found[name] = Parameter(value=float(value), unit=unit, source=source)
    return found


def coil_resistance(recording: Recording, model: Model | None) -> float:
    """Resistance of the recorded device's coil [Ohm], of its model or stated with the recording; 0 if not known."""
    if recording.units.get("current") != "A":
        return 0.0
    stated = stated_numbers(recording).get("coil_resistance")
    return (model.values.get("coil_resistance", 0.0) if model else 0.0) or (stated.value if stated else 0.0)
