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
from kinreach.baselines._policy_file import CLIP, Network
from kinreach.baselines._steering import AHEAD, FIRST_FRAMES, FORECASTING, PLACES, TINY, WINDOWS, Steering, table_middle
from kinreach.baselines.random_arms import ur5
from kinreach.envs.inside import moving
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
            _paced(graph, graph("Div", graph("Sub", posture, joints), policy.step_sizes))
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
    steering = network.steering
    if steering is None:
        return _outputs(graph, network, observation)
    return _steered(graph, steering, observation, _outputs(graph, network, _steering(graph, steering, observation)))


def _outputs(graph: _Graph, network: Network, observation: str) -> str:
    first = graph("Slice", observation, [0], [len(network.mean)], [1])
    h = graph("Div", graph("Sub", first, network.mean), network.scale)
    if len(network.waves):
        each = graph("Mul", graph("Unsqueeze", h, [2]), network.waves)
        angles = graph("Reshape", each, [0, network.mean.size * network.waves.size])
        cosines = graph("Sin", graph("Add", angles, np.pi / 2.0))
        h = graph("Concat", h, graph("Sin", angles), cosines, axis=1)
    if network.differences is not None:
        differences = graph("MatMul", first, network.differences.T)
        h = graph("Concat", h, graph("Min", graph("Max", differences, -CLIP), CLIP), axis=1)
    for index, (weight, bias) in enumerate(network.layers):
        h = graph("Add", graph("MatMul", h, weight.T), bias)
        h = _activated(graph, h, network.activation if index < len(network.layers) - 1 else network.output)
    return graph("Add", graph("Mul", h, network.gain), network.shift)


def _columns(graph: _Graph, x: str, first: int, end: int, axis: int = 1) -> str:
    return graph("Slice", x, [first], [end], [axis])


def _steering(graph: _Graph, steering: Steering, x: str) -> str:
    """Add `Steering.features`."""
    double, count = graph.onnx.TensorProto.DOUBLE, len(WINDOWS)
    earlier = graph("Reshape", _columns(graph, x, moving.RATES.stop, steering.inputs), [0, len(steering.fits) - 1, 3])
    earlier = _columns(graph, earlier, 0, 2, 2)
    first = _columns(graph, earlier, len(steering.fits) - 2, len(steering.fits) - 1)

    def differing(places: str, others: str | ArrayLike) -> str:
        each = graph("Cast", graph("Not", graph("Equal", places, others)), to=double)
        return graph("ReduceSum", graph("ReduceMax", each, [2], keepdims=0), [1], keepdims=0)

    frames = graph("Add", differing(earlier, first), differing(first, 0.0))
    fits = graph("Gather", steering.fits, graph("Cast", frames, to=graph.onnx.TensorProto.INT64), axis=0)
    fitted = graph("MatMul", fits, earlier)
    speed = graph("Squeeze", _columns(graph, fitted, FORECASTING, FORECASTING + 1), [1])
    clocks = graph("Div", graph("Unsqueeze", frames, [1]), [FIRST_FRAMES, len(steering.fits) - 1.0])
    q, T = _columns(graph, x, moving.ANGLES.start, moving.ANGLES.stop), _pose(graph, x)
    tip = graph("Squeeze", _columns(graph, _columns(graph, T, 0, 3), 3, 4, 2), [2])
    axis = graph("Squeeze", _columns(graph, _columns(graph, T, 0, 3), 2, 3, 2), [2])
    seen = _columns(graph, x, 0, 2)
    away = graph("Sub", seen, _columns(graph, tip, 0, 2))
    squares = graph("ReduceSum", graph("Mul", speed, speed), [1], keepdims=1)
    groups = (
        graph("Mul", graph("Flatten", _columns(graph, fitted, 0, count)), 2.0),
        graph(
            "Mul", graph("Tanh", graph("Div", graph("Flatten", _columns(graph, fitted, count, 2 * count)), 10.0)), 2.0
        ),
        graph("Tanh", graph("Mul", graph("Flatten", _columns(graph, earlier, 0, PLACES - 1)), 10.0)),
        graph("Mul", graph("Sub", seen, table_middle()), 5.0),
        graph("Min", clocks, 1.0),
        graph("Sub", q, ur5().arm.home),
        graph("Mul", _columns(graph, x, moving.RATES.start, moving.RATES.stop), 0.5),
        graph("Mul", tip, 3.0),
        axis,
        *(graph("Mul", graph("Add", away, graph("Mul", speed, time)), 5.0) for time in AHEAD),
        graph("Mul", graph("Sqrt", graph("Add", squares, TINY)), 2.0),
    )
    return graph("Concat", *groups, axis=1)


def _pose(graph: _Graph, x: str) -> str:
    """Add the pose of the thesis's arm's tip in the world, (batch, 4, 4)."""
    still, turning, turned = np.diag([0.0, 0.0, 1.0, 1.0]), np.diag([1.0, 1.0, 0.0, 0.0]), np.zeros((4, 4))
    turned[1, 0], turned[0, 1] = 1.0, -1.0
    first, *others = ur5().chain.placements
    T: str | ArrayLike = first
    for joint, placement in enumerate(others):
        angle = graph(
            "Unsqueeze", _columns(graph, x, moving.ANGLES.start + joint, moving.ANGLES.start + joint + 1), [2]
        )
        cosine, sine = graph("Sin", graph("Add", angle, np.pi / 2.0)), graph("Sin", angle)
        turn = graph("Add", graph("Add", graph("Mul", cosine, turning), graph("Mul", sine, turned)), still)
        T = graph("MatMul", graph("MatMul", T, turn), placement)
    return str(T)


def _steered(graph: _Graph, steering: Steering, x: str, share: str) -> str:
    """Add `Steering.actions`."""
    arm: Any = ur5().arm
    speed, acceleration, frame = arm.speed_limit, arm.acceleration_limit, 1.0 / moving.FRAMES
    q = _columns(graph, x, moving.ANGLES.start, moving.ANGLES.stop)
    v = _columns(graph, x, moving.RATES.start, moving.RATES.stop)
    ends = []
    for side in (-1.0, 1.0):
        end = graph("Min", graph("Max", graph("Add", v, side * acceleration * frame), -speed), speed)
        ramp = graph("Div", graph("Abs", graph("Sub", end, v)), acceleration)
        during = graph("Mul", graph("Div", graph("Add", v, end), 2.0), ramp)
        after = graph("Mul", end, graph("Sub", frame, ramp))
        braked = graph("Mul", end, graph("Add", graph("Abs", end), acceleration * frame / moving.PARTS))
        beyond = graph("Add", graph("Mul", braked, moving.BEYOND_STOP / (2.0 * acceleration)), moving.LEAST_WAY * side)
        ends.append(graph("Add", graph("Add", q, graph("Add", during, after)), beyond))
    part = graph("Div", graph("Add", share, 1.0), 2.0)
    target = graph("Add", ends[0], graph("Mul", graph("Sub", ends[1], ends[0]), part))
    return graph("Div", graph("Min", graph("Max", target, steering.low), steering.high), np.pi)


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


def _paced(graph: _Graph, steps: str) -> str:
    longest = graph("ReduceMax", graph("Abs", steps), [1], keepdims=1)
    return graph("Div", steps, graph("Max", graph("Ceil", graph("Sub", longest, SLACK)), 1.0))
