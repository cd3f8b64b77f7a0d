"""The kernels' own functions, reduced to one device: what does not act in it is gone, what is left has its numbers.

A law is a ``@wp.func``, Python of few forms. Here its source is read, branches that the device's numbers decide are
cut, static loops are written out, and a number of the device becomes a constant with a name. So an export has the same
statements as the kernels, an effect that is added to the catalogue is exported without a line here, and a form that is
not known is an error, never another law.
"""

from __future__ import annotations

import ast
import inspect
import operator
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import warp as wp

from mrwarp.export.unread import without_unread

Value = int | float | bool | None
"""Value of an expression where it is known when a device is exported; None: it is not."""

DROPPED = ("p", "values", "row", "line")
"""Arguments that one device does not need: its numbers are constants, its states a list of their own."""

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
}
_COMPARED: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_OF_INTS: dict[str, Callable[..., Any]] = {"min": min, "max": max, "abs": abs, "int": int, "float": float}


class NotExportableError(ValueError):
    """A function has a form that is not exported; the message names function and line."""


@dataclass
class Function:
    """One function of the export."""

    name: str
    body: list[ast.stmt]
    parameters: list[tuple[str, str]]
    """Name and type: ``float``, ``int``, ``Path``, ``Joint`` or ``floats``, an array."""
    returns: str
    doc: str


@dataclass
class Program:
    """All functions that a device needs, those that are called first.

    Attributes:
        numbers: Named constants of the device: value, unit and what it is.
        fixed: Fields of a step that never change, with their values.
        known: Values of functions that only ask which laws the device has.
        replaced: Names of the kernels' modules that have another value here.
    """

    numbers: dict[str, tuple[Value, str]]
    """Value and unit of every constant, by name."""
    effects: Mapping[int, str]
    """Name of the constant of each column of a row of values."""
    fixed: Mapping[str, Value]
    known: Mapping[str, Value]
    replaced: Mapping[str, Any]
    functions: dict[str, Function] = field(default_factory=dict)
    slots: dict[int, int] = field(default_factory=dict)
    """Place in the device's own list of each state of the catalogue that it has."""
    used: set[str] = field(default_factory=set)
    """Constants that the functions name."""
    fields: set[str] = field(default_factory=set)
    """Fields of a step that the functions name."""
    _made: dict[Any, Function] = field(default_factory=dict)

    def function(self, source: Callable[..., Any], bound: Mapping[str, Value]) -> Function:
        """The function of these whole-number arguments, made when it is first asked for."""
        key = (source, *sorted(bound.items()))
        if key not in self._made:
            made = _Reader(self, source, bound).made()
            base, k = made.name, 2
            while made.name in self.functions:
                made.name, k = f"{base}_{k}", k + 1
            self._made[key] = self.functions[made.name] = made
        return self._made[key]


class _Reader:
    """Reads one function for one set of whole-number arguments."""

    def __init__(self, program: Program, source: Callable[..., Any], bound: Mapping[str, Value]) -> None:
        self.program, self.source = program, source
        tree = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        self.tree = tree
        self.space = {**source.__globals__, **program.replaced}
        self.whole: dict[str, Value] = dict(bound)
        self.known: dict[str, Value] = {}
        self.kinds = {a.arg: kind_of(ast.unparse(a.annotation or ast.Name("float"))) for a in tree.args.args}
        self.arguments = dict(self.kinds)
        stored = [x.id for x in ast.walk(tree) if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)]
        self.stored = Counter(stored)

    def made(self) -> Function:
        """The function, without what it does not need."""
        doc = (ast.get_docstring(self.tree) or "").partition("\n")[0]
        body = without_unread(self.block(self.tree.body), self.pure)
        read = {x.id for statement in body for x in ast.walk(statement) if isinstance(x, ast.Name)}
        parameters = [(name, kind) for name, kind in self.arguments.items() if name not in self.whole and name in read]
        returns = kind_of(ast.unparse(self.tree.returns)) if self.tree.returns else "float"
        return Function(self.tree.name.lstrip("_"), body, parameters, returns, doc)

    def refuse(self, node: ast.AST) -> NotExportableError:
        """The form of a node is not known."""
        return NotExportableError(f"{self.tree.name}: cannot be exported: {ast.unparse(node)}")

    # statements

    def block(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        """The statements that are left."""
        found: list[ast.stmt] = []
        for statement in statements:
            found.extend(self.statement(statement))
            if found and isinstance(found[-1], ast.Return | ast.Break | ast.Continue):
                break
        return found

    def statement(self, node: ast.stmt) -> Sequence[ast.stmt]:
        """The part of a statement that is left."""
        match node:
            case ast.Pass():
                return []
            case ast.Expr(value=ast.Constant()):
                return []
            case ast.Expr(value=ast.Call(func=ast.Attribute(attr="static"))):
                return []  # a checksum of the sources
            case ast.If(test=test, body=body, orelse=orelse):
                decided = self.value(test)
                if decided is not None:
                    return self.block(body if decided else orelse)
                kept = ast.If(self.expression(test), self.block(body), self.block(orelse))
                if kept.body or not kept.orelse:
                    return [kept] if kept.body else []
                return [ast.If(ast.UnaryOp(ast.Not(), kept.test), kept.orelse, [])]
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=[count])):
                return self.loop(name, count, node.body)
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                return self.several(targets, values)
            case ast.Assign(targets=[target], value=value):
                return self.assign(target, value)
            case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                return [ast.AugAssign(target, op, self.expression(value))]
            case ast.Return(value=ast.expr() as value):
                return [ast.Return(self.expression(value))]
            case ast.Break() | ast.Continue():
                return [node]
        raise self.refuse(node)

    def loop(self, name: str, count: ast.expr, body: list[ast.stmt]) -> list[ast.stmt]:
        """A loop as it is, or written out where its count is static."""
        if isinstance(count, ast.Call) and ast.unparse(count.func) == "wp.static":
            found: list[ast.stmt] = []
            for k in range(int(self.value(count) or 0)):
                self.whole[name] = k
                found += self.block(body)
            return found
        self.kinds[name] = "int"
        return [ast.For(ast.Name(name), self.expression(count), self.block(body), [])]

    def several(self, targets: list[ast.expr], values: list[ast.expr]) -> list[ast.stmt]:
        """``a, b = x, y``, one after the other; y does not need the earlier a."""
        for k, target in enumerate(targets):
            later = {x.id for value in values[k + 1 :] for x in ast.walk(value) if isinstance(x, ast.Name)}
            if isinstance(target, ast.Name) and target.id in later:
                raise self.refuse(target)
        pairs = zip(targets, values, strict=True)
        return [statement for target, value in pairs for statement in self.assign(target, value)]

    def assign(self, target: ast.expr, value: ast.expr) -> list[ast.stmt]:
        """An assignment, unless it only says what is known."""
        if isinstance(target, ast.Attribute) and target.attr in self.program.fixed:
            return []
        known = self.value(value)
        if isinstance(target, ast.Name) and self.stored[target.id] == 1 and known is not None:
            if isinstance(known, int):
                self.whole[target.id] = known
                return []
        if isinstance(target, ast.Name) and self.stored[target.id] == 1:
            self.known[target.id] = known
        made = self.expression(value)
        if isinstance(target, ast.Name):
            self.kinds.setdefault(target.id, self.kind(made))
        return [ast.Assign([self.expression(target)], made, lineno=0)]

    def pure(self, name: str) -> bool:
        """Whether a function of the export only computes."""
        made = self.program.functions.get(name)
        return made is None or {kind for _, kind in made.parameters} <= {"float", "int"}

    # expressions

    def value(self, node: ast.expr) -> Value:
        """The value of an expression that the device decides; None for any other."""
        match node:
            case ast.Constant(value=int() | float() as value):
                return value
            case ast.Name(id=name):
                found = self.whole.get(name, self.known.get(name))
                if found is None and name not in self.kinds and not self.stored[name]:
                    found = self.program.numbers[name][0] if name in self.program.numbers else self.space.get(name)
                return found if isinstance(found, int | float) else None
            case ast.Attribute() | ast.Subscript():
                return self.number(node)[1]
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                value = self.value(inner)
                return None if value is None else -value
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self.value(left), self.value(right)
                return None if a is None or b is None else _BINARY[type(op)](a, b)
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                a, b = self.value(left), self.value(right)
                return None if a is None or b is None else _COMPARED[type(op)](a, b)
            case ast.BoolOp(op=op, values=parts):
                found = [self.value(part) for part in parts]
                decides = isinstance(op, ast.Or)
                if any(part is not None and bool(part) is decides for part in found):
                    return decides
                return None if None in found else not decides
            case ast.Call():
                return self.called(node)
        return None

    def called(self, node: ast.Call) -> Value:
        """The value of a call."""
        name = ast.unparse(node.func)
        if name == "wp.static":
            found = self.static(node.args[0])
            return found if isinstance(found, int | float) else None
        if name in self.program.known:
            return self.program.known[name]
        short = name.removeprefix("wp.")
        arguments = [self.value(argument) for argument in node.args]
        if short in _OF_INTS and None not in arguments:
            return _OF_INTS[short](*arguments)
        return None

    def static(self, node: ast.expr) -> Any:
        """Meaning of an expression in the function's module."""
        return eval(compile(ast.Expression(node), "static", "eval"), {**self.space, **self.whole})  # our own source

    def number(self, node: ast.expr) -> tuple[str, Value]:
        """Name and value of a number of the device; an empty name if it is none."""
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if self.kinds.get(name) == "JointParams":
                return attribute.upper() if attribute != "K" else "K_HOLD", self.program.numbers[_of(attribute)][0]
            case ast.Attribute(attr=attribute) if attribute in self.program.fixed:
                return "", self.program.fixed[attribute]
            case ast.Attribute(value=ast.Name(id="wp"), attr="inf"):
                return "", None
            case ast.Subscript(value=ast.Attribute(attr="shape")):
                return "COMMANDS", self.program.numbers["COMMANDS"][0]
            case ast.Subscript(value=ast.Name(id="values"), slice=ast.Tuple(elts=[_, column])):
                at = self.value(column)
                if not isinstance(at, int):
                    raise self.refuse(node)
                name = self.program.effects[at]
                return name, self.program.numbers[name][0]
        return "", None

    def expression(self, node: ast.expr) -> ast.expr:
        """The expression that is left."""
        name, known = self.number(node)
        if name:
            self.program.used.add(name)
            return ast.Name(name)
        if known is not None:
            return ast.Constant(known)
        match node:
            case ast.Constant():
                return node
            case ast.Name(id=name):
                if name in self.program.numbers and name not in self.kinds:
                    self.program.used.add(name)
                    return node
                known = self.whole.get(name)
                if known is None and name not in self.kinds and not self.stored[name]:
                    known = self.value(node)
                    if known is None:
                        raise self.refuse(node)
                return node if known is None else ast.Constant(known)
            case ast.Attribute(value=ast.Name(id="wp")):
                return node
            case ast.Attribute(value=inner, attr=attribute):
                if isinstance(inner, ast.Name) and self.kinds.get(inner.id) == "Path":
                    self.program.fields.add(attribute)
                return ast.Attribute(self.expression(inner), attribute)
            case ast.Subscript(value=inner, slice=place):
                return self.element(inner, place)
            case ast.UnaryOp(op=op, operand=inner):
                return ast.UnaryOp(op, self.expression(inner))
            case ast.BinOp(left=left, op=op, right=right):
                return ast.BinOp(self.expression(left), op, self.expression(right))
            case ast.Compare(left=left, ops=ops, comparators=[right]):
                return ast.Compare(self.expression(left), ops, [self.expression(right)])
            case ast.BoolOp(op=op, values=parts):
                left = [self.expression(part) for part in parts if self.value(part) is None]
                return left[0] if len(left) == 1 else ast.BoolOp(op, left)
            case ast.Call():
                return self.call(node)
        raise self.refuse(node)

    def element(self, array: ast.expr, place: ast.expr) -> ast.expr:
        """An element of the states, or of the past commands."""
        if isinstance(place, ast.Tuple):
            place = place.elts[1]
        known = self.value(place)
        if isinstance(array, ast.Name) and array.id == "memory":
            if not isinstance(known, int):
                raise self.refuse(array)
            known = self.program.slots.setdefault(known, len(self.program.slots))
        inside = self.expression(place) if known is None else ast.Constant(known)
        return ast.Subscript(self.expression(array), inside)

    def call(self, node: ast.Call) -> ast.expr:
        """A call of another function of the export, or of a function that every language has."""
        known = self.called(node)
        if known is not None:
            return ast.Constant(known)
        name = ast.unparse(node.func)
        if name == "wp.where":
            decided = self.value(node.args[0])
            if decided is not None:
                return self.expression(node.args[1 if decided else 2])
        if name == "Path" or name in ("float", "int") or name.startswith("wp.") and "static" not in name:
            return ast.Call(ast.Name(name.removeprefix("wp.")), [self.expression(x) for x in node.args], [])
        target = self.static(node.func.args[0]) if isinstance(node.func, ast.Call) else self.space.get(name)
        if not isinstance(target, wp.Function):
            raise self.refuse(node)
        source: Any = target.func
        names = list(inspect.signature(source).parameters.values())
        bound: dict[str, Value] = {}
        passed: dict[str, ast.expr] = {}
        for parameter, argument in zip(names, node.args, strict=True):
            value = self.value(argument)
            if str(parameter.annotation) == "int" or parameter.annotation is int:
                if value is not None:
                    bound[parameter.name] = value
                    continue
            if parameter.name not in DROPPED:
                passed[parameter.name] = argument
        made = self.program.function(source, bound)
        kept = [self.expression(passed[name]) for name, _ in made.parameters]
        return ast.Call(ast.Name(made.name), kept, [])

    def kind(self, node: ast.expr) -> str:
        """Type of an expression that was made: ``float``, ``int`` or ``Path``."""
        return kind_of_expression(node, self.kinds, self.program)


def _of(attribute: str) -> str:
    return attribute.upper() if attribute != "K" else "K_HOLD"


def kind_of(annotation: str) -> str:
    """Type of an argument by its annotation in the kernels."""
    short = annotation.removeprefix("wp.")
    return "floats" if short.startswith("array") else short


def kind_of_expression(node: ast.expr, kinds: Mapping[str, str], program: Program) -> str:
    """Type of an expression of the export."""
    match node:
        case ast.Constant(value=value):
            return "int" if isinstance(value, int) else "float"
        case ast.Name(id=name):
            return kinds.get(name) or ("int" if isinstance(program.numbers.get(name, (0.0,))[0], int) else "float")
        case ast.Attribute(attr=attribute):
            return "int" if attribute in ("newest", "steps") else "float"
        case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
            return "int"
        case ast.UnaryOp(operand=inner):
            return kind_of_expression(inner, kinds, program)
        case ast.BinOp(left=left, right=right):
            parts = {kind_of_expression(part, kinds, program) for part in (left, right)}
            return "int" if parts == {"int"} else "float"
        case ast.Call(func=ast.Name(id=name), args=arguments):
            if name in ("int", "Path"):
                return name
            if name in program.functions:
                return program.functions[name].returns
            if name in ("where", "abs", "min", "max"):
                return kind_of_expression(arguments[-1], kinds, program)
    return "float"
