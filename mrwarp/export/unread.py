"""Takes locals out of a function that nothing reads any more, once branches have been cut."""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Callable


def without_unread(body: list[ast.stmt], pure: Callable[[str], bool]) -> list[ast.stmt]:
    """The statements without locals that nothing reads."""
    while True:
        stored = _stores(body)
        loads = Counter(x.id for statement in body for x in _loads(statement))
        left = _dropped(copy.deepcopy(body), {name for name in stored if not loads[name]}, pure)
        if [ast.dump(x) for x in left] == [ast.dump(x) for x in body]:
            return body
        body = left


def _stores(body: list[ast.stmt]) -> set[str]:
    """Locals that are only assigned by plain statements without side effects."""
    found = set()
    for statement in body:
        for node in ast.walk(statement):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                found.add(node.targets[0].id)
    return found


def _loads(statement: ast.stmt) -> list[ast.Name]:
    """Names that a statement reads."""
    written = {
        id(node.targets[0])
        for node in ast.walk(statement)
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    return [x for x in ast.walk(statement) if isinstance(x, ast.Name) and id(x) not in written]


def _computes(node: ast.expr, pure: Callable[[str], bool]) -> bool:
    """Whether an expression changes no state."""
    return all(pure(ast.unparse(x.func)) for x in ast.walk(node) if isinstance(x, ast.Call))


def _dropped(body: list[ast.stmt], dead: set[str], pure: Callable[[str], bool]) -> list[ast.stmt]:
    found: list[ast.stmt] = []
    for statement in body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            if statement.targets[0].id in dead and _computes(statement.value, pure):
                continue
        if isinstance(statement, ast.If):
            statement.body, statement.orelse = (
                _dropped(part, dead, pure) for part in (statement.body, statement.orelse)
            )
            if not statement.body and not statement.orelse:
                continue
            if not statement.body:
                statement = ast.If(ast.UnaryOp(ast.Not(), statement.test), statement.orelse, [])
        if isinstance(statement, ast.For):
            statement.body = _dropped(statement.body, dead, pure)
        found.append(statement)
    return found
