"""What the same formulas need to run on numpy's arrays and on torch's tensors, which are taken and never asked for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.checks import is_tensor, torch_module
from kinreach.kinematics.chain import blocks


def namespace(values: Any) -> Any:
    """The module that computes with values: numpy or torch."""
    return torch_module() if is_tensor(values) else np


def like(values: Any, constant: ArrayLike) -> Any:
    """A constant of the kind of values, in their precision and on their device."""
    if is_tensor(values):
        return torch_module().as_tensor(constant, dtype=values.dtype, device=values.device)
    return np.asarray(constant)


def empty(values: Any, *shape: int, flags: bool = False) -> Any:
    """An array of the kind of values for numbers, or for flags, not filled in."""
    if is_tensor(values):
        return values.new_empty(shape, dtype=torch_module().bool if flags else None)
    return np.empty(shape, dtype=np.bool_ if flags else np.float64)


def on_host(values: Any) -> Any:
    """The values as an array of numpy."""
    return values.detach().cpu().numpy() if is_tensor(values) else values


def parts(values: Any) -> Iterator[slice]:
    """Slices of rows to compute at a time: blocks that stay in a processor's cache, all rows on another device."""
    if is_tensor(values) and values.device.type != "cpu":
        return iter((slice(None),))
    return blocks(len(values))
