"""The options that `reset` is given, for one environment and for a batch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kinreach.errors import InputError
from kinreach.inputs import check_count, shown
from kinreach.kinematics.goals import MOST_DISTANCE, Floats, as_floats, check_entries


def option_rows(
    options: Mapping[str, Any] | None, sizes: Mapping[str, int], count: int | None
) -> tuple[Floats | None, ...]:
    """The options of `reset(options=...)` as arrays with a row for each environment.

    Args:
        options: As given by the user.
        sizes: The options there are, each with the length of its rows.
        count: Number of environments of a batch; None for a single one, whose options are plain rows.

    Returns:
        In the order of `sizes`, arrays of shape (count, size), or (1, size) for a single environment; None for what is
        not given.

    Raises:
        InputError: An unknown option, a wrong shape, or a value that is not finite.
    """
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"reset options must be a mapping of {', '.join(sizes)}, got {shown(options)}")
    given = {name: value for name, value in (options or {}).items() if value is not None}
    if unknown := [name for name in given if name not in sizes]:
        raise InputError(f"unknown reset options {shown(unknown)}; available: {', '.join(sizes)}")
    rows: list[Floats | None] = []
    for name, size in sizes.items():
        if name not in given:
            rows.append(None)
            continue
        values = as_floats(name, given[name])
        shape = (size,) if count is None else (count, size)
        if values.shape != shape or not np.isfinite(values).all():
            raise InputError(f"{name} must be finite and have shape {shape}, got {values.shape}")
        check_entries(name, values, MOST_DISTANCE)
        rows.append(values.reshape(-1, size))
    return tuple(rows)


def check_seed(seed: object) -> int | None:
    """The seed of an environment, as Gymnasium takes it; NumPy's integers are taken too.

    Raises:
        InputError: It is no integer, or negative.
    """
    return None if seed is None else check_count("seed", seed, least=0)
