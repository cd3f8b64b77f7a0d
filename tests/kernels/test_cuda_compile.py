"""Every kernel compiles for a GPU, as it would be launched there, on a machine that has none.

Warp's wheel holds NVRTC, which compiles CUDA without a driver. The kernels are found in what the package's modules have
registered with Warp, so a new one is checked without being named here.
"""

import ast
import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import warp as wp
from warp._src.context import Kernel, Module, runtime, user_modules
from warp._src.types import type_is_generic

import mrwarp

CPU_ONLY = {"mrwarp.kernels.lstm_lanes"}
"""Modules whose kernels hold vector instructions of a CPU; a GPU runs those of ``mrwarp.kernels.learned_torque``."""

OTHER_SIMULATORS = "mrwarp.integrations."
"""Modules that import a simulator which is not installed here; they have no kernels of their own."""

SOLVER_FLOAT = wp.float32
"""Numbers of the solver on a GPU (MuJoCo-Warp): generic kernels are launched on arrays of them."""

pytestmark = pytest.mark.skipif(not runtime.is_cuda_enabled, reason="this build of Warp cannot compile CUDA")


@pytest.fixture(scope="module")
def kernel_modules() -> Iterator[list[Module]]:
    """Warp's modules with the kernels of the package, whose generic ones have their overloads."""
    modules = {}
    for found in pkgutil.walk_packages(mrwarp.__path__, "mrwarp."):
        if not found.name.endswith("__main__") and not found.name.startswith(OTHER_SIMULATORS):
            made = [x for x in vars(importlib.import_module(found.name)).values() if isinstance(x, Kernel)]
            modules |= {id(kernel.module): kernel.module for kernel in made}  # generated ones have modules of their own
    modules |= {id(m): m for name, m in user_modules.items() if name.startswith("mrwarp.") and m.kernels}
    generic = [k for m in modules.values() for k in m.kernels.values() if k.is_generic]
    before = [dict(kernel.overloads) for kernel in generic]
    for kernel in generic:
        kernel.overloads.clear()
        wp.overload(kernel, solver_types(kernel))
    yield sorted(modules.values(), key=lambda m: m.name)
    for kernel, overloads in zip(generic, before, strict=True):  # or the next launch would compile them for the CPU
        kernel.overloads = overloads
        kernel.module.mark_modified()


def solver_types(kernel: Kernel) -> dict[str, object]:
    """Types of a kernel's generic arguments on a GPU, by name."""
    generic = [arg for arg in kernel.adj.args if type_is_generic(arg.type)]
    return {arg.label: wp.array(dtype=SOLVER_FLOAT, ndim=arg.type.ndim) for arg in generic}


def failures(modules: list[Module], arch: int, folder: Path) -> list[str]:
    """Names of the modules that do not compile to PTX for an architecture."""
    failed = []
    for module in modules:
        try:
            wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=True)
        except Exception as error:  # NVRTC's status comes as a plain Exception, its messages on stderr
            failed.append(f"{module.name}: {error}")
    return failed


@pytest.mark.slow
@pytest.mark.parametrize("arch", [80, 90])
def test_every_kernel_compiles_for_a_gpu(arch: int, kernel_modules: list[Module], tmp_path: Path) -> None:
    """PTX for sm_80 and sm_90 of all modules but the LSTM in a CPU's lanes."""
    names = {module.name for module in kernel_modules}
    assert names > CPU_ONLY, "a module of CPU_ONLY is gone"
    wanted = [module for module in kernel_modules if module.name not in CPU_ONLY]
    assert failures(wanted, arch, tmp_path) == []
    assert len(list(tmp_path.glob("*.ptx"))) == len(wanted) > 10


def test_no_kernel_is_left_out(kernel_modules: list[Module]) -> None:
    """Each ``@wp.kernel`` of the sources is among those found, one that a function makes on demand, too."""
    found = {kernel.func.__name__ for module in kernel_modules for kernel in module.kernels.values()}
    written = set()
    for path in Path(mrwarp.__path__[0]).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any("wp.kernel" in ast.unparse(d) for d in node.decorator_list):
                written.add(node.name)
    assert len(written) > 20
    assert written - found == set()


@wp.func_native("return no_such_function(x);")
def not_on_a_gpu(x: float) -> float:
    """Native code that no compiler takes."""
    ...


@wp.kernel(module="unique")
def broken_kernel(x_out: wp.array[float]):
    """Does not compile."""
    x_out[0] = not_on_a_gpu(x_out[0])


@wp.kernel(module="unique")
def missing_kernel(x_out: wp.array[float]):
    """Names what Warp does not know; refused before any compiler sees it."""
    x_out[0] = wp.no_such_function(x_out[0])  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("kernel", [broken_kernel, missing_kernel], ids=["CUDA", "Warp"])
def test_a_kernel_that_does_not_compile_is_found(kernel: Kernel, tmp_path: Path) -> None:
    """The check above would name its module."""
    assert [text.partition(":")[0] for text in failures([kernel.module], 80, tmp_path)] == [kernel.module.name]
