"""The written rules that a machine can check: the signature of a kernel is a contract.

Findings read ``file:line: what is wrong``. A signature looks like this; the group ``# parameters`` may be left out::

    @wp.kernel
    def bouc_wen_step_kernel(
        # parameters, shape (E or 1, M)
        beta: wp.array2d[float],
        # in, shape (E, M)
        z_in: wp.array2d[float],
        # out, shape (E, M)
        z_out: wp.array2d[float],
    ):
"""

import ast
import re
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
GROUPS = ("parameters", "in", "out")
GROUP_COMMENT = re.compile(rf"\s*#\s*({'|'.join(GROUPS)})\b(?!-)", re.IGNORECASE)

LAW_IMPORTS = ("warp", "mrwarp.effects.law", "mrwarp.kernels.bouc_wen", "mrwarp.kernels.coil")
LAW_ARGUMENTS = (
    ("s", "Path"), ("values", "wp.array2d[float]"), ("row", "int"), ("at", "int"), ("memory", "wp.array2d[float]"),
    ("line", "int"), ("slot", "int"),
)  # fmt: skip
HYSTERESIS = "mrwarp/effects/laws/"
"""Laws in place of eq. 15: the same arguments with displacement and last value, h in return, with helpers."""
HYSTERESIS_ARGUMENTS = (LAW_ARGUMENTS[0], ("q_c", "float"), ("h", "float"), *LAW_ARGUMENTS[1:])
NEWTON_ALLOWED = (
    "mrwarp/env/sim*.py",
    "mrwarp/env/backend*.py",
    "mrwarp/actuator/newton_drive.py",
    "mrwarp/usd/asset.py",
    "mrwarp/usd/converted.py",
    "mrwarp/robots/newton_robot.py",
)


def decorated(tree: ast.AST, name: str) -> Iterator[ast.FunctionDef]:
    """Functions under the decorator ``wp.<name>``, called or not."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            plain = [ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in node.decorator_list]
            if f"wp.{name}" in plain or f"warp.{name}" in plain:
                yield node


def groups_by_line(kernel: ast.FunctionDef, lines: list[str]) -> list[tuple[int, str]]:
    """Line and name of the group comments in the signature, in the order of the source."""
    numbered = enumerate(lines[kernel.lineno - 1 : kernel.body[0].lineno - 1], start=kernel.lineno)
    return [(number, match[1].lower()) for number, line in numbered if (match := GROUP_COMMENT.match(line))]


def argument_problem(arg: ast.arg, group: str | None) -> str | None:
    """The fault of one argument of a kernel in its group, or None."""
    name = arg.arg
    if arg.annotation is None:
        return f"argument '{name}' has no type"
    if group is None:
        return f"argument '{name}' stands before the first group comment"
    if group == "out" and not name.endswith("_out"):
        return f"argument '{name}' stands after '# out' but does not end in '_out'"
    if group == "in" and "array" in ast.unparse(arg.annotation) and not name.endswith("_in"):
        return f"array '{name}' stands after '# in' but does not end in '_in'"
    if (group != "out" and name.endswith("_out")) or (group == "parameters" and name.endswith("_in")):
        return f"argument '{name}' stands after '# {group}', its name says otherwise"
    return None


def kernel_problems(kernel: ast.FunctionDef, lines: list[str]) -> Iterator[tuple[int, str]]:
    """Line and text of each broken rule of one kernel."""
    args = kernel.args
    if not kernel.name.endswith("_kernel"):
        yield kernel.lineno, f"kernel '{kernel.name}' does not end in '_kernel'"
    if not ast.get_docstring(kernel):
        yield kernel.lineno, f"kernel '{kernel.name}' has no docstring"
    if args.defaults or args.vararg or args.kwonlyargs or args.kwarg:
        yield kernel.lineno, f"kernel '{kernel.name}' has a default, star or keyword-only argument"
    groups = groups_by_line(kernel, lines)
    order = [name for _, name in groups]
    if order not in (["in", "out"], ["parameters", "in", "out"]):
        yield kernel.lineno, f"kernel '{kernel.name}' has groups {order}, want '# parameters' (if any), '# in', '# out'"
    for arg in [*args.posonlyargs, *args.args]:
        group = next((name for line, name in reversed(groups) if line <= arg.lineno), None)
        if problem := argument_problem(arg, group):
            yield arg.lineno, f"{kernel.name}: {problem}"
    for node in ast.walk(kernel):
        if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name):
            if node.value.id in {arg.arg for arg in args.args} and not node.value.id.endswith("_out"):
                yield node.lineno, f"{kernel.name}: writes to '{node.value.id}', which is no output"


def law_problems(law: ast.FunctionDef) -> Iterator[tuple[int, str]]:
    """Line and text of each broken rule of one ``@wp.func``."""
    if law.returns is None:
        yield law.lineno, f"law '{law.name}' has no return type"
    if not ast.get_docstring(law):
        yield law.lineno, f"law '{law.name}' has no docstring"
    for arg in law.args.args:
        if arg.annotation is None:
            yield arg.lineno, f"{law.name}: argument '{arg.arg}' has no type"


def effect_problems(tree: ast.Module, *, hysteresis: bool = False) -> Iterator[tuple[int, str]]:
    """Line and text of what is wrong with the file of one effect: one law, with the arguments that all laws have."""
    laws = [law for law in decorated(tree, "func") if not hysteresis or law.name.endswith("_law")]
    arguments, returns = (HYSTERESIS_ARGUMENTS, "float") if hysteresis else (LAW_ARGUMENTS, "Path")
    if len(laws) != 1:
        yield 1, f"has {len(laws)} functions under @wp.func, want the law alone"
    for law in laws:
        found = tuple((arg.arg, ast.unparse(arg.annotation) if arg.annotation else "") for arg in law.args.args)
        if not law.name.endswith("_law"):
            yield law.lineno, f"law '{law.name}' does not end in '_law'"
        if found != arguments or law.returns is None or ast.unparse(law.returns) != returns:
            yield law.lineno, f"law '{law.name}' has not the arguments of all laws, see mrwarp/effects/law.py"


def is_effect(tree: ast.Module) -> bool:
    """Whether a file defines an effect of the catalogue."""
    return any(isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "LAW" for node in tree.body)


def imports(file: str, tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and absolute name of every module that a file imports, at any depth of nesting."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = file.split("/")[: -node.level] if node.level else []
            base = ".".join([*package, *filter(None, [node.module])])
            # `from mrwarp import env` imports mrwarp.env
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)


def within(module: str, allowed: tuple[str, ...]) -> bool:
    """Whether a module is one of those named, or inside one."""
    return any(module == name or module.startswith(name + ".") for name in allowed)


@cache
def parsed(folder: str, words: str = "") -> list[tuple[str, str, ast.Module]]:
    """Name, source and syntax tree of every Python file under a folder of the repository, with one of some words."""
    texts = [(path, path.read_text(encoding="utf-8")) for path in sorted((ROOT / folder).rglob("*.py"))]
    texts = [(path, text) for path, text in texts if re.search(words, text)]
    return [(path.relative_to(ROOT).as_posix(), text, ast.parse(text)) for path, text in texts]


def test_kernels_and_laws_follow_the_signature_rules() -> None:
    """Every kernel is typed, grouped, named and documented; every law has types and a docstring."""
    kernels, findings = 0, []
    for file, source, tree in parsed("mrwarp", r"\bw(?:ar)?p\.(?:kernel|func)\b"):
        for kernel in decorated(tree, "kernel"):
            kernels += 1
            findings += [f"{file}:{line}: {text}" for line, text in kernel_problems(kernel, source.splitlines())]
        for law in decorated(tree, "func"):
            findings += [f"{file}:{line}: {text}" for line, text in law_problems(law)]
    assert kernels, "no @wp.kernel under mrwarp: does the test look in the right place?"
    assert not findings, "\n" + "\n".join(findings)


def test_newton_is_touched_in_named_files_only() -> None:
    """Who may import whom within the package is written in ``pyproject.toml`` (import-linter)."""
    findings = [
        f"{file}:{line}"
        for folder in ("mrwarp", "paper")
        for file, _, tree in parsed(folder, "newton")
        for line, module in imports(file, tree)
        if within(module, ("newton",)) and not any(fnmatch(file, pattern) for pattern in NEWTON_ALLOWED)
    ]
    assert findings == []


def test_effects_are_one_law_per_file() -> None:
    """Every file of an effect holds one law of the common signature, and knows Warp and the frame of laws only."""
    effects, findings = 0, []
    for file, _, tree in parsed("mrwarp/effects"):
        if is_effect(tree):
            effects += 1
            hysteresis = file.startswith(HYSTERESIS)
            allowed = (*LAW_IMPORTS, "mrwarp.effects.laws.hysteresis") if hysteresis else LAW_IMPORTS
            findings += [f"{file}:{line}: {text}" for line, text in effect_problems(tree, hysteresis=hysteresis)]
            findings += [
                f"{file}:{line}: an effect imports only {', '.join(allowed)}, not {module}"
                for line, module in imports(file, tree)
                if not within(module, allowed)
            ]
    assert effects, "no effect under mrwarp/effects: does the test look in the right place?"
    assert not findings, "\n" + "\n".join(findings)


GOOD_EFFECT = """@wp.func
def a_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    'Doc.'
    return s
LAW = EffectLaw(law=a_law)
"""


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("def a_law(", "def a("), "does not end in '_law'"),
        (("row: int, at: int", "at: int, row: int"), "has not the arguments"),
        (("-> Path", "-> float"), "has not the arguments"),
        (("@wp.func", "@wp.kernel"), "has 0 functions"),
    ],
)
def test_style_check_sees_a_broken_effect(change: tuple[str, str], text: str) -> None:
    """Each rule, broken alone in a good effect, is found; the good one passes."""
    good, broken = (ast.parse(source) for source in (GOOD_EFFECT, GOOD_EFFECT.replace(*change)))
    assert is_effect(good) and not list(effect_problems(good))
    assert any(text in problem for _, problem in effect_problems(broken))


GOOD = """@wp.kernel
def a_kernel(
    # in
    x_in: wp.array[float],
    # out
    y_out: wp.array[float],
):
    'Doc.'
    y_out[0] = x_in[0]
"""


@pytest.mark.parametrize(
    ("change", "line", "text"),
    [
        (("a_kernel", "a"), 2, "does not end in '_kernel'"),
        (("'Doc.'", "pass"), 2, "no docstring"),
        (("# out", "# result"), 2, "has groups ['in']"),
        (("# in", ""), 4, "before the first group comment"),
        (("x_in: wp.array[float]", "x_in"), 4, "has no type"),
        (("y_out: wp.array[float]", "y_out: wp.array[float] = None"), 2, "has a default"),
        (("x_in", "x"), 4, "does not end in '_in'"),
        (("y_out", "y"), 6, "does not end in '_out'"),
        (("y_out[0] =", "x_in[0] +="), 9, "writes to 'x_in'"),
    ],
)
def test_style_check_sees_a_broken_kernel(change: tuple[str, str], line: int, text: str) -> None:
    """Each rule, broken alone in a good kernel, is found at its line; the good kernel passes."""
    good, broken = (
        list(kernel_problems(next(decorated(ast.parse(source), "kernel")), source.splitlines()))
        for source in (GOOD, GOOD.replace(*change))
    )
    assert not good
    assert any(at == line and text in problem for at, problem in broken), broken
