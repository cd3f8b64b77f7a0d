"""Contents of model files, as tests of many stations of a device take them."""

from collections.abc import Mapping
from typing import Any

from mrwarp.model_file import JOINT_UNITS, Effect, FittedOn, Model, Parameter, parameter_unit
from mrwarp.params import MrParams

LOOP = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")
"""Numbers that a model file must have."""


def model_of(values: Mapping[str, float], *effects: Effect, **origin: Any) -> Model:
    """A joint of these numbers, known without intervals; ``origin`` says more about the recording it came from."""
    parameters = {name: Parameter(value=v, unit=parameter_unit(name, JOINT_UNITS)) for name, v in values.items()}
    known: dict[str, Any] = {"source": "bench", "trajectories": 1, "samples": 1, "rate": 200.0, **origin}
    return Model(parameters=parameters, fitted_on=FittedOn(**known), effects=effects)


def paper_model(*effects: Effect, more: tuple[str, ...] = (), **changes: float) -> Model:
    """The paper's joint with effects, further numbers by name, and numbers that differ."""
    paper = {**MrParams().to_dict(), **changes}
    return model_of({name: paper[name] for name in dict.fromkeys((*LOOP, *more, *changes))}, *effects)
