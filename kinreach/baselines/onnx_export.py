"""A policy as an ONNX model: observation in, action out, for programs that know neither kinreach nor NumPy.

The graph is `LearnedPolicy.act` in double precision, operator by operator, and needs no torch. The model's metadata has
the policy's card in the entry `kinreach`, as JSON. Only operators that ONNX Runtime has in double precision are used;
cosine and ELU are not among them.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import kinreach
from kinreach.baselines.policies import SLACK, LearnedPolicy
from kinreach.checks import check_count
from kinreach.engines import load_extra
from kinreach.envs.reach.task import SINGLE_STEP, STEP_SIZE
from kinreach.errors import InputError
from kinreach.files import replacing

#: Versions of ONNX's operators and of its file format, as ONNX Runtime has had them since 1.14.
OPSET, IR_VERSION = 18, 8
#: Names of the model's input, (batch, observations), and output, (batch, actions), or (batch,) where they are numbered.
INPUT, OUTPUT = "observation", "action"


def export_onnx(policy: LearnedPolicy, path: str | Path, *, observations: int | None = None) -> None:
    """Write a policy as an ONNX model, whole or not at all.

    Args:
        policy: As `load_policy` returns it.
        path: Of the file.
        observations: Numbers in an observation of its environment; as many as the policy must have, if None.

    Raises:
        InputError: Observations that the policy does not take.
        InstallationError: The package `onnx` is missing.
        OutputError: The file system refused.
    """
    if policy.network.eyes:
        raise InputError(f"{policy.name} sees pictures; only policies that take vectors are exported")
    count = policy.inputs if observations is None else check_count("observations", observations)
    if not policy.takes(count):
        raise InputError(f"{policy.name} does not take observations of {count} numbers")
    model = _model(policy, count)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(model.SerializeToString())


class _Graph:
    """The nodes and constants of a model, put together from the input to the output."""

    def __init__(self) -> None:
        self.onnx: Any = load_extra("onnx", "onnx")
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: ArrayLike) -> str:
        """The name of a constant."""
        name = f"constant{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.asarray(value), name))
        return name

    def __call__(self, operator: str, *inputs: str | ArrayLike, **attributes: Any) -> str:
        """The name of what an operator makes of names and constants."""
        names = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        output = f"{operator.lower()}{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, names, [output], **attributes))
        return output


def _model(policy: LearnedPolicy, observations: int) -> Any:
    graph = _Graph()
    helper, kinds = graph.onnx.helper, graph.onnx.TensorProto
    output = _network(graph, policy)
    outputs = len(policy.network.gain)
    shape: list[str | int] = ["batch"]
    if policy.card.meaning == "preferences":
        graph("ArgMax", output, axis=-1, keepdims=0)
        kind = kinds.INT64
    else:
        low, high = policy.bounds
        action = graph("Min", graph("Max", output, low), high)
        if policy.stepwise:
            joints = graph("Slice", INPUT, [observations - 1 - outputs], [observations - 1], [1])
            _paced(graph, graph("Sub", graph("Mul", action, SINGLE_STEP.scale), joints))
        kind = kinds.DOUBLE
        shape.append(outputs)
    graph.nodes[-1].output[0] = OUTPUT
    made = helper.make_graph(
        graph.nodes,
        policy.name.replace(" ", "-"),
        [helper.make_tensor_value_info(INPUT, kinds.DOUBLE, ["batch", observations])],
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


def _network(graph: _Graph, policy: LearnedPolicy) -> str:
    """`Network.__call__`."""
    network = policy.network
    first = graph("Slice", INPUT, [0], [len(network.mean)], [1])
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
    """One of `policies.ACTIVATIONS` or `policies.OUTPUTS`."""
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
    """`policies.paced`."""
    longest = graph("ReduceMax", graph("Abs", way), [1], keepdims=1)
    steps = graph("Ceil", graph("Sub", graph("Div", longest, STEP_SIZE), SLACK))
    return graph("Div", graph("Div", way, STEP_SIZE), graph("Max", steps, 1.0))
