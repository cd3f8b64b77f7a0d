"""A model.json, effects included, on a robot's MR joints, and one line about what acts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from mrwarp.actuator.device_effects import acts, effect_text, silent_note
from mrwarp.effects.model_entries import check_effects
from mrwarp.model_file import Effect, Model, ModelFileError, load_model
from mrwarp.usd.asset import JointActuator, RobotAsset


def with_model(asset: RobotAsset, model: Model | str | Path) -> RobotAsset:
    """The asset with the numbers and effects of a model on every MR joint, in place of its own.

    What the model does not hold (neutral angle, gates, motor) stays each joint's.

    Args:
        asset: Robot or bench.
        model: A model, or the file that holds one.

    Raises:
        ModelFileError: it cannot be used, or no joint of the asset has a device.
    """
    name = model.fitted_on.source if isinstance(model, Model) else str(model)
    model = model if isinstance(model, Model) else load_model(model)
    if not any(actuator.mr for actuator in asset.actuators):
        raise ModelFileError(f"{name}: robot {asset.robot!r} has no MR joint to take the model; leave the model out")
    check_effects(model.effects, name)
    actuators = []
    for a in asset.actuators:
        if a.mr is not None:
            mr = model.to_params(a.mr)
            kp, kd, limit = mr.motor.kp_base, mr.motor.kd, mr.motor.tau_limit
            a = replace(a, mr=mr, kp=kp, kd=kd, tau_limit=limit, effects=model.effects, lost="")
        actuators.append(a)
    return replace(asset, actuators=tuple(actuators))


def effect_lines(actuators: Sequence[JointActuator]) -> Iterator[str]:
    """What acts on which joints, and what does not; nothing for joints without effects."""
    groups: list[tuple[tuple[Effect, ...], list[str]]] = []
    for a in actuators:
        if a.mr is not None and a.effects:
            same = next((joints for effects, joints in groups if effects == a.effects), None)
            if same is None:
                groups.append((a.effects, [a.joint]))
            else:
                same.append(a.joint)
    for effects, joints in groups:
        if acting := [effect_text(effect) for effect in effects if acts(effect)]:
            yield f"effects on {', '.join(joints)}: {'; '.join(acting)}"
        if note := silent_note(effects):
            yield f"note: {note}"
