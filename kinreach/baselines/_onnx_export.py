"""Policies as ONNX models, from observation to action.

The graph is `LearnedPolicy.act` in double precision. A policy that sees pictures has an input for each of them, of any
size. The entry `kinreach` of the metadata has the policy's card as JSON. ONNX Runtime has no cosine, ELU and
convolution in double precision, so that these are composed of others.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import kinreach
from kinreach._checks import check_count
from kinreach._engines import load_extra
from kinreach._files import replacing
from kinreach.baselines._eyes import MIDDLE, Eye
from kinreach.baselines._policies import SLACK, LearnedPolicy
from kinreach.envs.inside import reach_task
from kinreach.errors import InputError
from kinreach.robots import THESIS_ARM, get_arm

#: Versions of ONNX's operators and of its file format, as ONNX Runtime has had them since 1.14.
OPSET, IR_VERSION = 18, 8
#: Names of the model's input, (batch, observations), and output, (batch, actions), or (batch,) for discrete ones.
INPUT, OUTPUT = "observation", "action"
#: Policies that see have inputs such as `front_rgb`, uint8, (batch, height, width, 3), and, if they walk, the joints.
JOINTS = "joints"


def export_onnx(policy: LearnedPolicy, path: str | Path, *, observations: int | None = None) -> None:
    """Write a policy as an ONNX model, whole or not at all.

    `observations` are the numbers in an observation of its environment, by default as many as the policy reads; it is
    not used for pictures.
    """
    count = policy.inputs if observations is None else check_count("observations", observations)
    if not policy.accepts(count):
        raise InputError(f"{policy.name} does not take observations of {count} numbers")
    model = _model(policy, count)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(model.SerializeToString())


class _Graph:
    def __init__(self) -> None:
        self.onnx: Any = load_extra("onnx", "onnx")
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: ArrayLike) -> str:
        name, array = f"constant{len(self.constants)}", np.asarray(value)
        if array.dtype.kind == "f":  # what a training exports has single precision
            array = array.astype(np.float64)
        self.constants.append(self.onnx.numpy_helper.from_array(array, name))
        return name

    def __call__(self, operator: str, *inputs: str | ArrayLike, **attributes: Any) -> str:
        """Add a node with names and constants as inputs; return the name of its output."""
        names = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        output = f"{operator.lower()}{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, names, [output], **attributes))
        return output


def _model(policy: LearnedPolicy, observations: int) -> Any:
    graph = _Graph()
    helper, kinds = graph.onnx.helper, graph.onnx.TensorProto
    eyes, outputs = policy.network.eyes, len(policy.network.gain)
    cameras = get_arm(policy.arm or THESIS_ARM).goal_cameras
    pictures = sorted(f"{camera.name}_rgb" for camera in cameras)[: len(eyes)]
    seen = (_eye(graph, eye, name) for eye, name in zip(eyes, pictures, strict=True))
    output = _network(graph, policy, graph("Concat", *seen, axis=1) if eyes else INPUT)
    shape: list[str | int] = ["batch"]
    if policy.card.meaning == "preferences":
        graph("ArgMax", output, axis=-1, keepdims=0)
        kind = kinds.INT64
    else:
        low, high = policy.bounds
        action = graph("Min", graph("Max", output, low), high)
        if policy.stepwise:
            joints = JOINTS if eyes else graph("Slice", INPUT, [observations - 1 - outputs], [observations - 1], [1])
            half, middle = policy.action_range
            posture = graph("Add", graph("Mul", action, half), middle)
            _paced(graph, graph("Sub", posture, joints))
        kind = kinds.DOUBLE
        shape.append(outputs)
    graph.nodes[-1].output[0] = OUTPUT
    inputs: list[tuple[str, int, list[str | int]]] = [(INPUT, kinds.DOUBLE, [observations])]
    if eyes:
        inputs = [(name, kinds.UINT8, ["height", "width", 3]) for name in pictures]
        inputs += [(JOINTS, kinds.DOUBLE, [outputs])] if policy.stepwise else []
    made = helper.make_graph(
        graph.nodes,
        policy.name.replace(" ", "-"),
        [helper.make_tensor_value_info(name, kind, ["batch", *size]) for name, kind, size in inputs],
        [helper.make_tensor_value_info(OUTPUT, kind, shape)],
        graph.constants,
    )
    model = helper.make_model(
        made,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="kinreach",
        producer_version=kinreach.__version__,
    )
    helper.set_model_props(model, {"kinreach": json.dumps(asdict(policy.card), allow_nan=False, sort_keys=True)})
    graph.onnx.checker.check_model(model, full_check=True)
    return model


def _eye(graph: _Graph, eye: Eye, picture: str) -> str:
    h = graph("Sub", graph("Div", graph("Cast", picture, to=graph.onnx.TensorProto.DOUBLE), MIDDLE), 1.0)
    for index, ((weight, bias), stride) in enumerate(zip(eye.layers, eye.strides, strict=True)):
        if index:
            h = graph("Relu", h)
        size = weight.shape[2]
        h = graph("Pad", h, [0, size // 2, size // 2, 0] * 2)
        ends = [*range(1 - size, 0), np.iinfo(np.int64).max]
        places = [([y, x], [ends[y], ends[x]]) for y in range(size) for x in range(size)]
        windows = [graph("Slice", h, first, last, [1, 2], [stride, stride]) for first, last in places]
        flat = weight.transpose(2, 3, 1, 0).reshape(-1, len(bias))
        h = graph("Add", graph("MatMul", graph("Concat", *windows, axis=3), flat), bias)
    h = graph("Mul", graph("Sub", h, graph("ReduceMax", h, [1, 2])), eye.sharpness)
    weights = graph("Exp", h)
    weights = graph("Div", weights, graph("ReduceSum", weights, [1, 2]))
    across = graph("MatMul", _from_minus_one_to_one(graph, h, 2), graph("ReduceSum", weights, [1], keepdims=0))
    down = graph("MatMul", _from_minus_one_to_one(graph, h, 1), graph("ReduceSum", weights, [2], keepdims=0))
    pairs = graph("Concat", graph("Unsqueeze", across, [2]), graph("Unsqueeze", down, [2]), axis=2)
    return graph("Reshape", pairs, [0, eye.places])


def _from_minus_one_to_one(graph: _Graph, pictures: str, axis: int) -> str:
    """Return evenly spaced numbers, one for each row or column of pictures."""
    count = graph("Squeeze", graph("Shape", pictures, start=axis, end=axis + 1))
    numbers = graph("Range", 0.0, graph("Cast", count, to=graph.onnx.TensorProto.DOUBLE), 1.0)
    last = graph("Cast", graph("Max", graph("Sub", count, 1), 1), to=graph.onnx.TensorProto.DOUBLE)
    return graph("Sub", graph("Div", graph("Mul", numbers, 2.0), last), 1.0)


def _network(graph: _Graph, policy: LearnedPolicy, observation: str) -> str:
    network = policy.network
    first = graph("Slice", observation, [0], [len(network.mean)], [1])
    h = graph("Div", graph("Sub", first, network.mean), network.scale)
    if len(network.waves):
        each = graph("Mul", graph("Unsqueeze", h, [2]), network.waves)
        angles = graph("Reshape", each, [0, network.mean.size * network.waves.size])
        cosines = graph("Sin", graph("Add", angles, np.pi / 2.0))
        h = graph("Concat", h, graph("Sin", angles), cosines, axis=1)
    for index, (weight, bias) in enumerate(network.layers):
        h = graph("Add", graph("MatMul", h, weight.T), bias)
        h = _activated(graph, h, network.activation if index < len(network.layers) - 1 else network.output)
    return graph("Add", graph("Mul", h, network.gain), network.shift)


def _activated(graph: _Graph, x: str, activation: str) -> str:
    if activation == "linear":
        return x
    if activation == "silu":
        return graph("Mul", x, graph("Sigmoid", x))
    if activation == "elu":
        below = graph("Sub", graph("Exp", graph("Min", x, 0.0)), 1.0)
        return graph("Where", graph("Greater", x, 0.0), x, below)
    if activation == "leaky_relu":
        return graph("Max", x, graph("Mul", x, 0.01))
    return graph({"tanh": "Tanh", "relu": "Relu"}[activation], x)


def _paced(graph: _Graph, way: str) -> str:
    longest = graph("ReduceMax", graph("Abs", way), [1], keepdims=1)
    steps = graph("Ceil", graph("Sub", graph("Div", longest, reach_task.STEP_SIZE), SLACK))
    return graph("Div", graph("Div", way, reach_task.STEP_SIZE), graph("Max", steps, 1.0))
