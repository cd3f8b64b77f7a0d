"""Series compliance: ``(q - y)/c = K*z/(1 + alpha*|qd|) + B*qd``, z driven by the shaft's way y.

An elastic element of compliance c (stiffness 1/c) stands between the encoder at q and the device's shaft at y: a
coupling, a belt, the teeth of a gear, the frame. The shaft has no mass, so what winds the element is the device's
stress and drag. Where stress builds up by dz/dy, the shaft takes the share ``1/(1 + c*K*dz/dy)`` of the joint's way:
little of it at a stiff stress, all of it when the device slides. The sliding torque is the same; the loop reaches it
over a longer way, by c times that torque, so at a high current later than at a low one. At a single current it is hard
to distinguish from a softer K.

Its two sides may differ, as the stops of a coupling do that is harder one way than the other: ``c*(1 + d)`` where the
torque is positive, ``c*(1 - d)`` where it is negative; behind play that is play with different stops.

Each step finds the shaft's way at which both bear the same, within a bracket that holds it for any length of the step;
no mass and no time step are in it. D, C*q_c, I1*I and the torques of other effects act at the joint. Drag and
weakening are those of the joint's speed: weakened by its own, a shaft without mass would stick and slip. Behind play
(:mod:`mrwarp.effects.backlash`) both are solved together (:func:`mrwarp.effects.path.play_and_spring`), and drag is the
shaft's. With another hysteresis than eq. 15's the shaft's speed is found with that law
(:func:`mrwarp.effects.path.law_behind_shaft`), and drag is the shaft's.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path
from mrwarp.kernels.bouc_wen import bouc_wen_behind_spring, bouc_wen_exact, bouc_wen_release


@wp.func
def series_compliance_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Between encoder and device there is an elastic element."""
    if values[row, at] > 0.0:
        ratio = values[row, at] * s.stiffness / (1.0 + s.alpha * wp.abs(s.qd))
        drag = values[row, at] * s.viscosity * s.qd
        if values[row, at + 1] != 0.0:
            # where the shaft would stand without stress says on which side the element is wound
            side = s.z
            if s.begins == 0:
                side = memory[line, slot] + s.path_1 + s.path_2
                side = side - bouc_wen_release(s.z, s.beta - s.gamma, 0.0, 0.0, 0.0, s.dt)
            uneven = 1.0 + values[row, at + 1] * wp.sign(side)
            ratio = ratio * uneven
            drag = drag * uneven
        wound = float(ratio * s.z + drag)  # what is steady winds the element
        if s.begins == 0:
            z = float(s.z)
            wound = memory[line, slot] + s.path_1
            if s.path_1 != 0.0:
                first = bouc_wen_behind_spring(wound, z, ratio, s.beta, s.gamma)
                wound = wound - first
                z = bouc_wen_exact(first, z, s.beta, s.gamma, 1.0)
                s.path_1 = first
            wound = wound + s.path_2
            second = bouc_wen_behind_spring(wound - drag, z, ratio, s.beta, s.gamma)
            wound = wound - second
            s.path_2 = second
        memory[line, slot] = wound
    return s


LAW = EffectLaw(
    name="series_compliance",
    title="series compliance",
    sentence="Between encoder and device there is an elastic element.",
    equation="(q - y)/c = K*z/(1 + alpha*|qd|) + B*qd, dz by dy; c times 1 + d*sgn(torque)",
    kind="mechanism",
    stage="shaft",
    parameters=(
        EffectParameter(
            name="compliance",
            unit="rad/(N·m)",
            scale=(1, 0, -1),
            negative=False,
            low=lambda r: 1e-4 * r.q / r.torque,
            high=lambda r: 0.5 * r.q / r.torque,
            # the way within a step is known to a few per cent (benchmarks.confusion)
            resolution=0.03,
            starts=lambda r: tuple(x * r.q / r.torque for x in (0.001, 0.003, 0.01, 0.03, 0.1)),
        ),
        EffectParameter(name="difference", unit="1", form=True, low=lambda r: -0.9, high=lambda r: 0.9),
    ),
    law=series_compliance_law,
    states=1,
    source="elastic joint, Spong 1987, here before a device without mass",
    depends_on=("qd", "memory"),
    remedy="stiffen the coupling, or put the encoder on the device's shaft",
    yields=True,
    hidden_by="backlash",
)
