"""Damage to what stands in an ONNX file, which stays readable as protobuf: the checks behind the parser get work."""

from __future__ import annotations

import random
from typing import Any

from benchmarks.fuzz.mutations import NUMBERS, mutate

_SIZES = (0, 1, -1, 2, 12, 47, 48, 2**31, -(2**63), 2**63 - 1)
_FLOATS = (0.0, -1.0, float("nan"), float("inf"), 1e38, 1e-45)
_OPERATORS = (
    "Add",
    "Gemm",
    "Elu",
    "Constant",
    "Conv",
    "Loop",
    "If",
    "",
    "Tanh",
    "Reshape",
    "ConstantOfShape",
    "é" * 99,
)


def mutate_onnx(data: bytes, rng: random.Random) -> bytes:
    """Half of the time bytes change, half of the time one to three fields of the graph."""
    if rng.random() < 0.5:
        return mutate(data, rng)
    import onnx

    try:
        proto = onnx.ModelProto.FromString(data)
    except Exception:  # a corpus entry that the parser refuses
        return mutate(data, rng)
    for _ in range(rng.choice((1, 1, 2, 3))):
        change = rng.choice((_node, _node, _weight, _weight, _interface, _metadata, _model))
        change(proto, rng)
    return proto.SerializeToString()


def _any(found: Any, rng: random.Random) -> Any:
    return rng.choice(list(found)) if len(found) else None


def _node(proto: Any, rng: random.Random) -> None:
    """An operator, its connections, its attributes, its place."""
    node = _any(proto.graph.node, rng)
    if node is None:
        return
    what = rng.randrange(6)
    if what == 0:
        node.op_type = rng.choice(_OPERATORS)
    elif what == 1 and node.input:
        node.input[rng.randrange(len(node.input))] = rng.choice(("", "obs", "actions", "none", node.output[0]))
    elif what == 2 and node.output:
        node.output[0] = rng.choice(("", "obs", "actions", "x" * 1000))
    elif what == 3:
        del node.input[rng.randrange(len(node.input) + 1) :]
    elif what == 4 and node.attribute:
        value = _any(node.attribute, rng)
        value.type = rng.choice((1, 2, 3, 4, 6, value.type))
        value.f, value.i = rng.choice(_FLOATS), rng.choice(_SIZES)
        if rng.random() < 0.3:
            value.name = rng.choice(("alpha", "beta", "transA", "value", ""))
    elif rng.random() < 0.5:
        proto.graph.node.remove(node)
    else:
        proto.graph.node.add().CopyFrom(node)


def _weight(proto: Any, rng: random.Random) -> None:
    """Shape, type, values, name and place of a weight."""
    weight = _any(proto.graph.initializer, rng)
    if weight is None:
        return
    what = rng.randrange(7)
    if what == 0 and weight.dims:
        weight.dims[rng.randrange(len(weight.dims))] = rng.choice(_SIZES)
    elif what == 1:
        weight.dims.append(rng.choice(_SIZES))
    elif what == 2:
        del weight.dims[:]
    elif what == 3:
        weight.data_type = rng.randrange(26)
    elif what == 4:
        weight.raw_data = rng.choice((b"", weight.raw_data[:-1], mutate(weight.raw_data, rng)))
    elif what == 5:
        weight.data_location = 1
        entry = weight.external_data.add()
        entry.key, entry.value = "location", rng.choice(("/etc/passwd", "../x", ""))
    elif rng.random() < 0.5:
        weight.name = rng.choice(("", "obs", "actions"))
    else:
        proto.graph.initializer.remove(weight)


def _interface(proto: Any, rng: random.Random) -> None:
    """Inputs and outputs."""
    side = rng.choice((proto.graph.input, proto.graph.output))
    value = _any(side, rng)
    if value is None:
        return
    what = rng.randrange(4)
    if what == 0:
        value.name = rng.choice(("", "obs", "actions", "x"))
    elif what == 1:
        side.remove(value)
    elif what == 2:
        side.add().CopyFrom(value)
    else:
        value.type.tensor_type.elem_type = rng.randrange(26)
        for size in value.type.tensor_type.shape.dim:
            size.dim_value = rng.choice(_SIZES)


def _metadata(proto: Any, rng: random.Random) -> None:
    """The description that is stored next to the graph."""
    entry = _any(proto.metadata_props, rng)
    if entry is None:
        return
    if rng.random() < 0.1:
        entry.key = rng.choice(("", "mrwarp ", "task"))
    else:
        value = entry.value  # protobuf gives bytes where an earlier change left no UTF-8
        value = value if isinstance(value, bytes) else value.encode()
        entry.value = mutate(value, rng).decode(errors="ignore")
        if rng.random() < 0.3:
            entry.value = rng.choice((*NUMBERS, '{"task": 3}', '{"task": {"robot": []}}')).replace("\x00", "")


def _model(proto: Any, rng: random.Random) -> None:
    """Versions."""
    if rng.random() < 0.5 and proto.opset_import:
        proto.opset_import[0].version = rng.choice(_SIZES)
    else:
        proto.ir_version = rng.choice(_SIZES)
