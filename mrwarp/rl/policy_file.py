"""Description of a policy's file, read without an engine: whether it fits a robot is known in a second."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import onnx

from mrwarp.resources import META
from mrwarp.run_dir import no_file, one_line
from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot

REMEDY = "use a policy that 'mrwarp train' exported"


class PolicyError(ValueError):
    """A policy file cannot be used; the message names the file and the remedy."""


def read_policy(path: Path) -> tuple[onnx.ModelProto, dict[str, Any]]:
    """Graph and description of a policy; what the description says is not checked.

    Raises:
        PolicyError: the file is missing, no ONNX, or without a description.
    """
    if not path.is_file():
        raise PolicyError(f"{path}: {no_file(path, 'policy')}; name an .onnx file that 'mrwarp train' wrote")
    try:
        proto = onnx.load(str(path), load_external_data=False)
        onnx.checker.check_model(proto)
    except Exception as error:  # onnx and protobuf raise many types for a file that is no model
        raise PolicyError(f"{path}: not a readable ONNX model ({one_line(error)}); export it again") from error
    props = {entry.key: entry.value for entry in proto.metadata_props}
    if META not in props:
        raise PolicyError(f"{path}: no mrwarp metadata; {REMEDY}")
    try:
        description = dict(json.loads(props[META]))
        dict(description.get("task", {}))
    except (ValueError, TypeError, RecursionError) as error:
        raise PolicyError(f"{path}: unreadable mrwarp metadata ({one_line(error)}); {REMEDY}") from error
    return proto, description


def robot_of(description: dict[str, Any]) -> str | None:
    """USD file of the robot of one's own that a policy was trained on; None: a shipped robot."""
    robot = str(description.get("task", {}).get("robot"))
    return robot if robot.endswith(ROBOT_SUFFIXES) else None


def check_robot(path: Path, robot: str | None, asset: str | None = None) -> str:
    """Whether a policy is meant for a robot.

    Args:
        path: The policy.
        robot: As ``load_robot`` takes it; None: the policy's own file, else ``mr_go``.
        asset: USD file in place of the shipped one.

    Returns:
        A note where it was trained on another robot, else nothing.

    Raises:
        PolicyError: the file cannot be used, or was made for another number of joints than the robot has.
        AssetError: the robot cannot be used.
    """
    description = read_policy(path)[1]
    own, terms = robot_of(description), description.get("observations")
    if robot is None and own and not Path(own).is_file():
        raise PolicyError(f"{path}: was trained on {own}, which is not there; name its robot with --robot FILE")
    robot = robot or own or "mr_go"
    joints = terms.get("q") if isinstance(terms, dict) else None
    layout = load_robot(asset, robot=robot).layout
    if not layout.legs:
        raise PolicyError(
            f"{asset or robot}: has no legs to walk with; 'mrwarp play --agent sine' and 'mrwarp impact' move it "
            "without a policy"
        )
    found = len(layout.joints)
    trained_on = own or "the shipped robot"
    if isinstance(joints, int) and joints != found:
        raise PolicyError(
            f"{path}: made for the {joints} joints of {trained_on}, {asset or robot} has {found}; train one for it: "
            f"'mrwarp train --robot {robot}'"
        )
    same = Path(own or "").name == (Path(robot).name if robot.endswith(ROBOT_SUFFIXES) else "")
    return "" if same else f"note: {path} was trained on {trained_on}; {robot} need not walk with it"
