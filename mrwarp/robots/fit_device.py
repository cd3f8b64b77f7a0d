"""MR devices put onto joints of a robot's USD file."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pxr import Sdf, Usd

from mrwarp.model_file import Model, Parameter
from mrwarp.params import MrParams, ParameterError
from mrwarp.runtime import closest
from mrwarp.usd.asset import load_robot, masses
from mrwarp.usd.open_stage import SCHEMA, AssetError
from mrwarp.usd.record import LAW, PD, PREFIX, RECORD, record_text
from mrwarp.usd.robot import MASS

MOTOR_SCHEMAS = ("NewtonPDControlAPI", "NewtonMaxEffortClampingAPI")

LIMIT = MrParams().motor.tau_limit
"""Torque limit of the paper's calf joint [N·m], whose device a scale of ``limit`` is in proportion to."""

KP_LOW = 5.0 / 35.0
"""Share of Kp while the device holds: the paper's 5 of 35 N·m/rad (section 7)."""


def fit_device(
    file: Path,
    patterns: Sequence[str],
    model: Model | None,
    *,
    scale: float | None = 1.0,
    remove: bool = False,
    extrapolate: bool = False,
) -> Sdf.Layer:
    """Change the drives of joints in a copy of the file.

    Args:
        file: Robot with a layout of its own.
        patterns: Joints, by names that may hold * and ?.
        model: The device; None is the paper's.
        scale: How many times stronger the device is made, see :func:`stronger`; None: the joint's torque limit over
            :data:`LIMIT`.
        remove: Take devices off.
        extrapolate: As in :meth:`mrwarp.model_file.Model.to_params`.

    Raises:
        AssetError: the file cannot be used, or a pattern names no joint.
    """
    asset = load_robot(robot=str(file))
    names = [a.joint for a in asset.actuators]
    for pattern in patterns:
        if not fnmatch.filter(names, pattern):
            raise AssetError(
                f"{file}: no joint is called {pattern}; {closest(pattern, names)}choose among {', '.join(names)}"
            )
    weight = sum(masses(asset).values()) / MASS  # a heavier robot's foot is loaded from a larger force on
    layer = Sdf.Layer.OpenAsAnonymous(str(file))
    stage = Usd.Stage.Open(layer)
    for actuator in asset.actuators:
        if not any(fnmatch.fnmatchcase(actuator.joint, pattern) for pattern in patterns):
            continue
        prim = stage.GetPrimAtPath(actuator.prim_path)
        for name in [p.GetName() for p in prim.GetProperties() if p.GetName().startswith(PREFIX)] + [RECORD, *PD]:
            prim.RemoveProperty(name)
        for schema in (SCHEMA, *MOTOR_SCHEMAS):
            prim.RemoveAppliedSchema(schema)
        if remove:
            for schema in MOTOR_SCHEMAS:
                prim.AddAppliedSchema(schema)
            for name, value in zip(PD, (actuator.kp, actuator.kd, actuator.tau_limit), strict=True):
                prim.CreateAttribute(name, Sdf.ValueTypeNames.Float, custom=False).Set(value)
            continue
        own, factor = MrParams(), actuator.tau_limit / LIMIT if scale is None else scale
        motor = replace(
            own.motor, kp_base=actuator.kp, kp_low=KP_LOW * actuator.kp, kd=actuator.kd, tau_limit=actuator.tau_limit
        )
        neutral = asset.layout.neutral[actuator.joint]
        gate = replace(own.gate, f_th=round(own.gate.f_th * weight, 3))
        own = replace(own, motor=motor, bouc_wen=replace(own.bouc_wen, q_neutral=neutral), gate=gate)
        params = own if model is None else model.to_params(own, extrapolate=extrapolate)
        try:
            params, scaled = stronger(params, model, factor)
        except ParameterError as error:
            raise ValueError(f"--scale {factor:g}: {error}") from None
        prim.AddAppliedSchema(SCHEMA)
        for name, value in params:
            prim.CreateAttribute(PREFIX + name, Sdf.ValueTypeNames.Double, custom=False).Set(value)
        if scaled is not None:
            prim.CreateAttribute(RECORD, Sdf.ValueTypeNames.String).Set(record_text(scaled, params))
            if scaled.law is not None:
                prim.CreateAttribute(LAW, Sdf.ValueTypeNames.String, custom=False).Set(scaled.law.name)
    return layer


def stronger(params: MrParams, model: Model | None, factor: float) -> tuple[MrParams, Model | None]:
    """A device of the same kind and another size, with the same currents.

    Torques grow in proportion to the volume of fluid, so every torque, stiffness and inertia gets the factor, and what
    is per joule its inverse. The coil makes the same field in lengths that grow with the factor's third root: turns
    grow with it, and so does the coil's resistance (turns squared, times their length, over the window's area).
    """
    if factor == 1.0:
        return params, model

    def scaled(parameter: Parameter) -> Parameter:
        by = factor if parameter.unit.startswith(("N·m", "kg·m²")) else 1.0
        by = 1.0 / factor if parameter.unit.startswith(("1/J", "1/(N·m")) else by
        ci95 = parameter.ci95 and (by * parameter.ci95[0], by * parameter.ci95[1])
        return replace(parameter, value=by * parameter.value, ci95=ci95)

    torques = [s for s in params.specs() if s.group in ("BoucWenParams", "HoldParams") and s.unit.startswith("N·m")]
    changes = {spec.name: factor * value for spec in torques for name, value in params if name == spec.name}
    resistance = params.coil.coil_resistance * factor ** (1.0 / 3.0)
    if model is not None:
        numbers = {name: scaled(parameter) for name, parameter in model.parameters.items()}
        if (coil := numbers.get("coil_resistance")) is not None:
            numbers["coil_resistance"] = replace(coil, value=resistance, ci95=None)
        effects = tuple(
            replace(effect, parameters={name: scaled(parameter) for name, parameter in effect.parameters.items()})
            for effect in model.effects
        )
        mass = model.device_mass and replace(model.device_mass, value=factor * model.device_mass.value)
        model = replace(model, parameters=numbers, effects=effects, device_mass=mass)
    return params.replace(**changes, coil_resistance=resistance), model
