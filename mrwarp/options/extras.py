"""Which extra of the package brings a library: ``pip install mrwarp`` alone has what recordings need."""

from __future__ import annotations

EXTRAS = {
    **dict.fromkeys(("newton", "newton_usd_schemas", "mujoco", "mujoco_warp", "pxr", "trimesh", "torch"), "sim"),
    **dict.fromkeys(("rsl_rl", "tensordict", "safetensors", "onnx", "onnxruntime"), "sim"),
    **dict.fromkeys(("tensorboard", "onnxscript"), "train"),
    "rerun": "view",
    **dict.fromkeys(("pyarrow", "rosbags"), "logs"),
    **dict.fromkeys(("h5py", "openpyxl"), "files"),
}
"""Extra by the name under which a library is imported."""

LABORATORY = "paper"
"""Package of the paper's tables and studies, which a wheel does not have."""


def missing_extra(error: ImportError) -> str:
    """One line on how to install the library that could not be imported; empty where no extra brings it."""
    library = (error.name or "").partition(".")[0]
    if library == LABORATORY:
        return "the paper's tables and studies are not in the wheel: clone the repository and run it there"
    if library not in EXTRAS:
        return ""
    return f"needs {library}, which is not installed: pip install 'mrwarp[{EXTRAS[library]}]'"
