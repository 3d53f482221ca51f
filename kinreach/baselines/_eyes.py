"""Convolutions of a camera's picture with a spatial softmax, in numpy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[Any]

#: Colours are shifted and scaled to -1 … 1 by this [levels of 255].
MIDDLE = 127.5
#: Pictures whose windows are unfolded at a time: some 10 MB each.
_PICTURES_AT_ONCE = 16


@dataclass(frozen=True, eq=False)
class Eye:
    """Convolutions with rectifiers between them, then a spatial softmax.

    A channel's place is the mean column and row, both from -1 to 1, weighted by the softmax of its last layer (Levine,
    Finn, Darrell, Abbeel, JMLR 17 (2016), section 5.1).

    Attributes:
        layers: Weights, shape (out, in, k, k) with an odd k, and biases, shape (out,), of one convolution after the
            other; its input is padded with k // 2 zeros on every side.
        strides: Of the convolutions.
        sharpness: Factor of the last layer before the softmax.
    """

    layers: Sequence[tuple[Array, Array]]
    strides: Sequence[int]
    sharpness: float

    @property
    def places(self) -> int:
        """Outputs: a column and a row for each channel of the last layer."""
        return 2 * len(self.layers[-1][1])

    def __call__(self, pictures: Array) -> Array:
        """Return column and row of each channel, (..., 2 channels), in pictures, uint8, (..., height, width, 3)."""
        flat = pictures.reshape(-1, *pictures.shape[-3:])
        found = [self._places(flat[row : row + _PICTURES_AT_ONCE]) for row in range(0, len(flat), _PICTURES_AT_ONCE)]
        return np.concatenate(found).reshape(*pictures.shape[:-3], -1)

    def _places(self, pictures: Array) -> Array:
        h = np.moveaxis(pictures, -1, 1) / MIDDLE - 1.0
        for index, ((weight, bias), stride) in enumerate(zip(self.layers, self.strides, strict=True)):
            h = _convolved(np.maximum(h, 0.0) if index else h, weight, stride) + bias[:, None, None]
        rows, columns = h.shape[2:]
        h = np.exp(self.sharpness * (h - h.max(axis=(2, 3), keepdims=True)))
        h /= h.sum(axis=(2, 3), keepdims=True)
        across, down = h.sum(axis=2) @ np.linspace(-1, 1, columns), h.sum(axis=3) @ np.linspace(-1, 1, rows)
        return np.stack([across, down], axis=2).reshape(len(pictures), -1)


def _convolved(x: Array, weight: Array, stride: int) -> Array:
    """Return the convolution of x, shape (n, in, height, width), without its bias."""
    size = weight.shape[2]
    edge = (size // 2, size // 2)
    padded: Any = np.pad(x, ((0, 0), (0, 0), edge, edge))
    windows: Array = sliding_window_view(padded, (size, size), axis=(2, 3))  # type: ignore[call-overload]
    windows = windows[:, :, ::stride, ::stride].transpose(0, 2, 3, 1, 4, 5)
    return np.moveaxis(windows.reshape(*windows.shape[:3], -1) @ weight.reshape(len(weight), -1).T, -1, 1)


def picture_names(observation: Mapping[str, Any]) -> list[str]:
    """Return names of the colour pictures in an observation, in the order of a policy's eyes."""
    return sorted(name for name in observation if name.endswith("_rgb"))
