"""A small feed-forward network in numpy: what a trained policy is without the library that trained it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def _silu(x: Array) -> Array:
    with np.errstate(over="ignore"):
        return x / (1.0 + np.exp(-x))


#: What stands behind every hidden layer, and behind the last.
ACTIVATIONS: Mapping[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "silu": _silu,
    "relu": lambda x: np.maximum(x, 0.0),
}
OUTPUTS: Mapping[str, Callable[[Array], Array]] = {"linear": lambda x: x, "tanh": np.tanh}


@dataclass(frozen=True, eq=False)
class Network:
    """y = shift + gain out(W_k ... act(W_1 f + b_1) ... + b_k) of features f of an observation x.

    With z = (x - mean) / scale over the first observations, the features are z, then sin(w z) and cos(w z), in both the
    waves of one observation side by side.

    Attributes:
        mean, scale: Constants of the normalisation, shape (n,); only the first n observations are used.
        waves: Angular frequencies w, shape (k,).
        layers: Weights, shape (out, in), and biases, shape (out,), of one layer after the other.
        activation: Of the hidden layers, a key of `ACTIVATIONS`.
        output: Behind the last layer, a key of `OUTPUTS`.
        gain, shift: Shape (m,).
    """

    mean: Array
    scale: Array
    waves: Array
    layers: Sequence[tuple[Array, Array]]
    activation: str
    output: str
    gain: Array
    shift: Array

    def __call__(self, x: Array) -> Array:
        """Outputs, shape (..., m), for observations of shape (..., at least n)."""
        h = (x[..., : len(self.mean)] - self.mean) / self.scale
        if len(self.waves):
            angles = (h[..., :, None] * self.waves).reshape(*h.shape[:-1], -1)
            h = np.concatenate([h, np.sin(angles), np.cos(angles)], axis=-1)
        activation = ACTIVATIONS[self.activation]
        for weight, bias in self.layers[:-1]:
            h = activation(h @ weight.T + bias)
        weight, bias = self.layers[-1]
        return self.shift + self.gain * OUTPUTS[self.output](h @ weight.T + bias)
