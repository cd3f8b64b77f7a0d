"""mrwarp: identify MR and other semi-active joints from recordings, and simulate robots that have them.

    load_recording  read recordings of one joint: t, q, qd, current, torque
    fit             identify the joint: a model with units and intervals
    diagnose        what that model lacks, how much and how sure
    load_model      read a model.json, or a device of the library
    save_model      write one
    Model           what it holds
    MrParams        the numbers of one joint, each with unit, range and source
    JointBatch      joints without a robot: angle, velocity, current in, torque out
    DriveMR         the joint in a Newton scene
    LearnedTorque   a network in place of, or on top of, the laws
    TaskCfg         choices of the walking task; EnvCfg is another name of it
    EnvCfg          the same class
    WalkEnv         robots that learn to walk, batched
    OnnxPolicy      a trained policy

The joint in plain MuJoCo is ``mrwarp.mujoco.Brake``. Each name is loaded when it is first used, and its docstring has
an example. What the package needs beyond recordings is in its extras: ``pip install 'mrwarp[sim]'``.
"""

from __future__ import annotations

import importlib
import sys
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from mrwarp.rl import register_walk

if TYPE_CHECKING:
    from mrwarp.actuator.joint_batch import JointBatch as JointBatch
    from mrwarp.actuator.newton_drive import DriveMR as DriveMR
    from mrwarp.actuator.residual import LearnedTorque as LearnedTorque
    from mrwarp.diagnose.report.in_python import diagnose_files as diagnose  # noqa: F401
    from mrwarp.diagnose.report.in_python import fit as fit
    from mrwarp.env.cfg import TaskCfg as EnvCfg  # noqa: F401
    from mrwarp.env.cfg import TaskCfg as TaskCfg
    from mrwarp.env.vec_env import WalkEnv as WalkEnv
    from mrwarp.model_file import Model as Model
    from mrwarp.model_file import load_model as load_model
    from mrwarp.model_file import save_model as save_model
    from mrwarp.params import MrParams as MrParams
    from mrwarp.recording.load import load_recording as load_recording
    from mrwarp.rl.policy import OnnxPolicy as OnnxPolicy

__version__: str

_PLACES = {
    "DriveMR": "mrwarp.actuator.newton_drive",
    "EnvCfg": "mrwarp.env.cfg:TaskCfg",
    "JointBatch": "mrwarp.actuator.joint_batch",
    "LearnedTorque": "mrwarp.actuator.residual",
    "Model": "mrwarp.model_file",
    "MrParams": "mrwarp.params",
    "OnnxPolicy": "mrwarp.rl.policy",
    "TaskCfg": "mrwarp.env.cfg",
    "WalkEnv": "mrwarp.env.vec_env",
    "diagnose": "mrwarp.diagnose",
    "fit": "mrwarp.diagnose.report.in_python",
    "load_model": "mrwarp.model_file",
    "load_recording": "mrwarp.recording.load",
    "save_model": "mrwarp.model_file",
}
"""Module of each public name, and the name there if it is another."""

__all__ = sorted(_PLACES)  # pyright: ignore[reportUnsupportedDunderAll]


if "gymnasium" in sys.modules:
    register_walk()


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name == "__version__":
        return version("mrwarp")
    if name not in _PLACES:
        raise AttributeError(f"module 'mrwarp' has no attribute {name!r}; it has {', '.join(__all__)}")
    place, _, other = _PLACES[name].partition(":")
    module = importlib.import_module(place)
    found = module if place == f"mrwarp.{name}" else getattr(module, other or name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
