"""Functions of an export as text: C of 1999 in single precision, and Python in double precision."""

from __future__ import annotations

import ast
import copy
import re
from collections.abc import Mapping

import numpy as np

from mrwarp.export.specialise import Function, Program, kind_of_expression

_C_NAMES = {"where": "", "abs": "fabsf", "min": "fminf", "max": "fmaxf", "pow": "powf"}
_C_TYPES = {"float": "float", "int": "int"}
_LEVELS = {ast.Or: 1, ast.And: 2, ast.Not: 3, ast.Add: 5, ast.Sub: 5, ast.Mult: 6, ast.Div: 6, ast.Mod: 6, ast.USub: 7}
_COMPARISON = 4
_SIGNS: dict[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Mod: "%",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.And: "&&",
    ast.Or: "||",
}


def c_number(value: float | int) -> str:
    """A number as the kernels hold it: a whole one, or the nearest of single precision."""
    if isinstance(value, int):
        return str(value)
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = repr(float(np.float32(value)))
    short = str(np.float32(value))
    text = short if np.float32(short) == np.float32(value) else text
    return (text if re.search(r"[.e]", text) else f"{text}.0") + "f"


class CWriter:
    """C text of a program's functions.

    Args:
        program: The functions.
        name: Front of every name.
    """

    def __init__(self, program: Program, name: str) -> None:
        self.program, self.name = program, name
        self.types = {**_C_TYPES, "Path": f"{name}_path", "floats": "float *", "Any": f"{name} *"}

    def constant(self, name: str) -> str:
        """Name of a constant."""
        return f"{self.name.upper()}_{name}"

    def function(self, function: Function) -> str:
        """One function."""
        self.kinds = dict(function.parameters)
        arguments = ", ".join(self._declared(kind, name) for name, kind in function.parameters) or "void"
        head = f"static inline {self._declared(function.returns, f'{self.name}_{function.name}')}({arguments})"
        lines = [f"/* {_ascii(function.doc)} */", head, "{"]
        lines += [f"    {self._declared(kind, name)};" for name, kind in self._late(function)]
        lines += self._block(function.body, 1)
        return "\n".join([*lines, "}"])

    def _declared(self, kind: str, name: str) -> str:
        found = self.types[kind]
        return f"{found}{name}" if found.endswith("*") else f"{found} {name}"

    def _late(self, function: Function) -> list[tuple[str, str]]:
        """Locals that are first set within a branch; the others are declared where they are set."""
        self.declared = dict(function.parameters)
        first, found = set(), []
        for statement in function.body:
            if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
                first.add(statement.targets[0].id)
                self._learn(statement)
                continue
            for node in _assignments(statement):
                target = node.targets[0]
                if isinstance(target, ast.Name):
                    known = target.id in self.kinds
                    self._learn(node)
                    if not known and target.id not in first:
                        found.append((target.id, self.kinds[target.id]))
                        self.declared[target.id] = self.kinds[target.id]
        return found

    def _learn(self, node: ast.Assign) -> None:
        target = node.targets[0]
        if isinstance(target, ast.Name) and target.id not in self.kinds:
            self.kinds[target.id] = kind_of_expression(node.value, self.kinds, self.program)

    def _block(self, body: list[ast.stmt], depth: int) -> list[str]:
        space, lines = "    " * depth, []
        for node in body:
            match node:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    kind = "" if name in self.declared else self.kinds[name]
                    self.declared.setdefault(name, self.kinds[name])
                    target = self._declared(kind, name) if kind else name
                    made = "{0}" if ast.unparse(value) == "Path()" else self.text(value)
                    lines.append(f"{space}{target} = {made};")
                case ast.Assign(targets=[target], value=value):
                    lines.append(f"{space}{self.text(target)} = {self.text(value)};")
                case ast.AugAssign(target=target, op=op, value=value):
                    lines.append(f"{space}{self.text(target)} {_SIGNS[type(op)]}= {self.text(value)};")
                case ast.Return(value=ast.expr() as value):
                    lines.append(f"{space}return {self.text(value)};")
                case ast.If(test=test, body=inner, orelse=other):
                    lines.append(f"{space}if ({self.text(test)}) {{")
                    lines += self._block(inner, depth + 1)
                    if len(other) == 1 and isinstance(other[0], ast.If):
                        inside = self._block(other, depth)
                        lines += [f"{space}}} else {inside[0].strip()}", *inside[1:-1]]
                    elif other:
                        lines += [f"{space}}} else {{", *self._block(other, depth + 1)]
                    lines.append(f"{space}}}")
                case ast.For(target=ast.Name(id=k), iter=count, body=inner):
                    self.kinds[k] = "int"
                    lines.append(f"{space}for (int {k} = 0; {k} < {self.text(count)}; {k}++) {{")
                    lines += [*self._block(inner, depth + 1), f"{space}}}"]
                case _:
                    lines.append(f"{space}{ast.unparse(node)};")  # break and continue
        return lines

    def text(self, node: ast.expr, level: int = 0) -> str:
        """An expression; with parentheses where what is around it binds more tightly."""
        own, text = self._text(node)
        return f"({text})" if own < level else text

    def _text(self, node: ast.expr) -> tuple[int, str]:
        match node:
            case ast.Constant(value=int() | float() as value):
                return (9 if value >= 0 else 7), c_number(value)
            case ast.Name(id=name):
                constant = name in self.program.numbers and name not in self.kinds
                return 9, self.constant(name) if constant else name
            case ast.Attribute(value=inner, attr=attribute):
                pointer = isinstance(inner, ast.Name) and self.kinds.get(inner.id) == "Any"
                if isinstance(inner, ast.Name) and inner.id == "wp":
                    return 9, "INFINITY"
                return 9, f"{self.text(inner, 9)}{'->' if pointer else '.'}{attribute}"
            case ast.Subscript(value=inner, slice=place):
                return 9, f"{self.text(inner, 9)}[{self.text(place)}]"
            case ast.UnaryOp(op=op, operand=inner):
                return _LEVELS[type(op)], f"{'!' if isinstance(op, ast.Not) else '-'}{self.text(inner, 8)}"
            case ast.BinOp(left=left, op=op, right=right):
                own = _LEVELS[type(op)]
                return own, f"{self.text(left, own)} {_SIGNS[type(op)]} {self.text(right, own + 1)}"
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                parts = self.text(left, _COMPARISON + 1), self.text(right, _COMPARISON + 1)
                return _COMPARISON, f"{parts[0]} {_SIGNS[type(op)]} {parts[1]}"
            case ast.BoolOp(op=op, values=values):
                return _LEVELS[type(op)], f" {_SIGNS[type(op)]} ".join(self.text(value, 4) for value in values)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self._call(name, arguments)
        raise TypeError(ast.dump(node))

    def _call(self, name: str, arguments: list[ast.expr]) -> tuple[int, str]:
        if name in self.program.functions:
            given = [self.text(x) for x in arguments]
            return 9, f"{self.name}_{name}({', '.join(given)})"
        if name == "where":
            test, yes, no = (self.text(x, 1) for x in arguments)
            return 0, f"{test} ? {yes} : {no}"
        if name in ("float", "int"):
            if kind_of_expression(arguments[0], self.kinds, self.program) == name:
                return self._text(arguments[0])
            return 8, f"({name}){self.text(arguments[0], 9)}"
        given = ", ".join(self.text(x) for x in arguments)
        called = f"{self.name}_{name}" if name in ("sign", "clamp") else _C_NAMES.get(name, f"{name}f")
        return 9, f"{called}({given})"


class _Python(ast.NodeTransformer):
    """Python of an export: conditional expressions, and functions of the standard library."""

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        name = ast.unparse(node.func)
        if name == "where":
            return ast.IfExp(*node.args)
        if name == "float" and isinstance(node.args[0], ast.Constant | ast.Attribute):
            return node.args[0]
        if name in ("tanh", "sqrt", "sin", "cos", "atan", "floor"):
            node.func = ast.Name(f"math.{name}")
        return node

    def visit_For(self, node: ast.For) -> ast.For:
        self.generic_visit(node)
        node.iter = ast.Call(ast.Name("range"), [node.iter], [])
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        self.generic_visit(node)
        return ast.Name("math.inf") if ast.unparse(node) == "wp.inf" else node


def python_function(function: Function) -> str:
    """One function of an export as Python."""
    arguments = ", ".join(name for name, _ in function.parameters)
    body = [_Python().visit(copy.deepcopy(statement)) for statement in function.body]
    text = ast.unparse(ast.fix_missing_locations(ast.Module(body, [])))
    lines = "\n".join(f"    {line}" if line else "" for line in text.splitlines())
    return f'def {function.name}({arguments}):\n    """{function.doc}"""\n{lines}'


def c_constants(program: Program, writer: CWriter, docs: Mapping[str, str]) -> list[str]:
    """Lines of the constants that the functions name."""
    found = []
    for name, (value, unit) in program.numbers.items():
        if name in program.used:
            remark = ", ".join(part for part in (_ascii(unit), _ascii(docs.get(name, ""))) if part)
            number = c_number(0 if value is None else value)
            number = f"({number})" if number.startswith("-") else number
            found.append(f"#define {writer.constant(name)} {number} /* {remark} */")
    return found


def _ascii(text: str) -> str:
    return text.replace("·", "*").replace("²", "^2").encode("ascii", "replace").decode()


def _assignments(statement: ast.stmt) -> list[ast.Assign]:
    """Assignments within a statement, in the order of the text."""
    found: list[ast.Assign] = []

    class Visitor(ast.NodeVisitor):
        def visit_Assign(self, node: ast.Assign) -> None:
            found.append(node)

    Visitor().visit(statement)
    return found
