"""Choices of the MR joint's model. Loads no engine, so that command lines are read from them."""

from __future__ import annotations

from dataclasses import dataclass

from tyro.conf import Fixed

from mrwarp.enums import HoldCurrent
from mrwarp.options.option_types import DeviceChoice, OnOff


@dataclass(frozen=True, kw_only=True)
class MrActuatorCfg(DeviceChoice):
    """Choices of the actuator model."""

    hold_current: HoldCurrent = HoldCurrent.SUPPORT
    """current while holding: as much as the load needs, or the environment's own"""
    sal: OnOff = True
    """whether the gates may open; off closes both branches"""
    damping: Fixed[bool] = True
    """Whether the dynamic damping branch may open (eq. 5)."""
    holding: Fixed[bool] = True
    """Whether the holding branch may open (eq. 8); False leaves damping alone, as in the paper's section 6.3."""
    gated: Fixed[bool] = True
    """False: no gates, a plain current-driven device. The coil gets ``inputs.current_e``, a learned torque always acts,
    and as a brake constraint it holds what is slow or turns round."""
    latch: Fixed[float] = 5.0
    """Speed at which a device with ``inputs.command`` that holds lets go, in eps_hold of eq. 8: the gate's hysteresis
    keeps a joint that creeps about the threshold from switching its coil. 1 is the paper's gate; 2 saves nothing, 5
    saves a watt of 110 (docs/beyond.md)."""
