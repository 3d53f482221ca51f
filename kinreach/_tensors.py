"""Functions that let the same formulas run on numpy's arrays and torch's tensors, and conversions between them.

Torch is imported only when a tensor is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import is_tensor, shown, torch_module
from kinreach._engines import load_extra
from kinreach.errors import InputError

#: Rows of numbers that stay in a processor's cache.
BLOCK = 4096


def namespace(values: Any) -> Any:
    return torch_module() if is_tensor(values) else np


def like(values: Any, constant: ArrayLike) -> Any:
    """Return a constant of the kind of values, in their precision and on their device."""
    if is_tensor(values):
        return torch_module().as_tensor(constant, dtype=values.dtype, device=values.device)
    return np.asarray(constant)


def flags_like(values: Any, flags: Any) -> Any:
    """Return truth values of the kind of values, on their device."""
    return torch_module().as_tensor(flags, device=values.device) if is_tensor(values) else flags


def empty(values: Any, *shape: int, flags: bool = False) -> Any:
    """Allocate an array of the kind of values for numbers, or for flags."""
    if is_tensor(values):
        return values.new_empty(shape, dtype=torch_module().bool if flags else None)
    return np.empty(shape, dtype=np.bool_ if flags else np.float64)


def copied(values: Any) -> Any:
    return values.clone() if is_tensor(values) else values.copy()


def on_host(values: Any) -> Any:
    return values.detach().cpu().numpy() if is_tensor(values) else values


def as_device(device: object) -> Any:
    """Return a device of torch (`torch.device`) that this machine has."""
    torch = load_extra("torch", "train")
    try:
        found = torch.device(device)
        torch.empty(1, device=found).cpu()
    except Exception as error:  # of half a dozen kinds, by what torch was compiled for
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"torch has no device {shown(device)} here: {reason}") from None
    return found


def on_device(values: Any, device: Any) -> Any:
    """Return arrays as tensors on a device of torch, by DLPack: on the processor they share their memory."""
    if isinstance(values, Mapping):
        return {name: on_device(value, device) for name, value in values.items()}
    if is_tensor(values) or values.dtype.kind not in "biuf":
        return values
    return torch_module().from_dlpack(values).to(device)


def parts(values: Any) -> Iterator[slice]:
    """Return slices of rows that stay in a processor's cache; all rows at once on another device."""
    if is_tensor(values) and values.device.type != "cpu":
        return iter((slice(None),))
    return blocks(len(values))


def blocks(count: int) -> Iterator[slice]:
    """Yield slices of at most BLOCK rows that make up `count` rows: few enough that their numbers stay in the cache."""
    return (slice(start, start + BLOCK) for start in range(0, count, BLOCK))
