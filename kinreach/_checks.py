"""Input checks at the public boundary: all raise an `InputError` that names the value and its bound."""

from __future__ import annotations

import operator
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from math import inf
from numbers import Real
from pathlib import Path
from reprlib import Repr
from sys import float_info
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.errors import InputError, raise_unknown

Floats = NDArray[np.float64]

#: Upper bound of a number of threads.
MAX_THREADS = 1024
#: Gymnasium's option of every environment: the steps after which an episode is truncated.
STEP_LIMIT = "max_episode_steps"

#: Other characters than ASCII's printable ones and ends of lines.
_UNUSUAL = re.compile(r"[^\n\t -~]")
_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


def shown(value: object) -> str:
    """Return the text of a value for an error message, shortened."""
    try:
        return _SHORT.repr(value)
    except Exception:  # a number of too many digits, or an object whose own code fails
        return f"an object of type {type(value).__name__}"


def printable(text: str) -> str:
    """Escape the control characters of a text; ends of lines stay."""
    return _UNUSUAL.sub(lambda found: found[0] if found[0].isprintable() else ascii(found[0])[1:-1], text)


def listed(words: Sequence[str]) -> str:
    """Return words with commas between them, and "and" before the last; of none nothing."""
    return " and ".join(part for part in (", ".join(words[:-1]), *words[-1:]) if part)


def check_count(name: str, value: object, *, least: int = 1, most: int | None = None) -> int:
    """Check for an integer within bounds.

    Raises:
        InputError: Not an integer (floats and truth values are refused), or outside the bounds.
    """
    try:
        count = operator.index(value)  # type: ignore[arg-type]
    except Exception:  # no integer, or an object whose own code fails
        raise InputError(f"{name} must be an integer, got {shown(value)}") from None
    if isinstance(value, bool):
        raise InputError(f"{name} must be an integer, got {value}")
    if count < least:
        raise InputError(f"{name} must be at least {least}, got {shown(count)}")
    if most is not None and count > most:
        raise InputError(f"{name} must be at most {most}, got {shown(count)}")
    return count


def check_flag(name: str, value: object) -> None:
    """Check for True or False; numbers are refused.

    Raises:
        InputError: The value is another one.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} must be true or false, got {shown(value)}")


def check_step_limit(options: Mapping[str, Any]) -> None:
    """Check Gymnasium's limit of steps among the options of an environment, where its episodes have to end."""
    if STEP_LIMIT in options:
        check_count(STEP_LIMIT, options[STEP_LIMIT])


def check_number(name: str, value: object, *, least: float = -inf, most: float = inf, above: float = -inf) -> float:
    """Check for a finite number within bounds, of which `above` is excluded.

    Raises:
        InputError: Not a number (truth values are refused), not finite, or outside the bounds.
    """
    try:
        number = None if isinstance(value, bool) or not isinstance(value, Real) else float(value)
    except OverflowError:
        number = inf
    if number is None:
        raise InputError(f"{name} must be a number, got {shown(value)}")
    if not (least <= number <= most and above < number and -inf < number < inf):
        parts = (
            (f"at least {least:g}", least > above),
            (f"above {above:g}", above > -inf),
            (f"at most {most:g}", most < inf),
        )
        bounds = " and ".join(["finite", *(text for text, bound in parts if bound)])
        raise InputError(f"{name} must be {bounds}, got {shown(value)}")
    return number


def check_known(kind: str, value: object, available: Collection[str]) -> None:
    """Refuse a value that is not one of the available names.

    Raises:
        UnknownNameError: The message lists the available names.
    """
    if not isinstance(value, str) or value not in available:
        raise_unknown(kind, value if isinstance(value, str) else shown(value), available)


def check_path(name: str, value: Any) -> Path:
    """Check for a path whose file system can be asked about it.

    Raises:
        InputError: Not a path, too long, not encodable as text, or through a folder that may not be entered.
    """
    try:
        path = Path(value)
        str(path).encode()  # what cannot be printed cannot be reported either
        if "\0" in str(path):
            raise ValueError("a path has no null character")
        path.exists()  # raises where a name is too long
    except (TypeError, ValueError, OSError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{name} cannot be a path, got {shown(value)}: {reason}") from None
    return path


def check_out_file(name: str, value: Any) -> Path:
    """Check for the path of a file that can be written: its folder exists, and it is no folder itself.

    Raises:
        InputError: It is not; or not a path.
    """
    path = check_path(name, value)
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"{name} must be a file in a folder that exists, got {path}")
    return path


#: How far a matrix may be from a rotation before it is refused (float32 poses pass).
ROTATION_TOLERANCE = 1e-5
#: Bounds of a joint angle [rad] and of a coordinate [m]: far beyond any arm, and small enough for exact sines (1e-10).
MAX_ANGLE, MAX_DISTANCE = 1e6, 1e6

#: Bounds of a closed form's tolerance [m, rad].
MIN_TOLERANCE, MAX_TOLERANCE = 1e-9, 1.0
#: Arrays of up to so many entries are checked one by one.
_FEW = 64


def as_vector(name: str, value: ArrayLike, size: int, *, most: float = float_info.max) -> Floats:
    """Return a finite float vector of the given size with entries up to `most`, or raise an `InputError`."""
    vector = as_floats(name, value)
    if vector.shape != (size,):
        raise InputError(f"{name} must have shape ({size},), got {vector.shape}")
    for entry in vector.tolist():  # faster than an array's operations
        if not -most <= entry <= most:
            _refuse_entries(name, vector, most)
    return vector


def check_entries(name: str, values: Floats, most: float) -> None:
    """Refuse an array with an entry that is not finite, or larger than `most`."""
    if values.size <= _FEW:  # faster than an array's operations
        for entry in values.ravel().tolist():
            if not -most <= entry <= most:
                _refuse_entries(name, values, most)
    elif not (values.max(initial=0.0) <= most and values.min(initial=0.0) >= -most):
        _refuse_entries(name, values, most)


def _refuse_entries(name: str, values: Floats, most: float) -> None:
    values = np.atleast_1d(values)
    finite = np.isfinite(values)
    if not finite.all():
        rows = finite.reshape(-1, values.shape[-1])
        raise InputError(f"{name} must be finite, got {values.reshape(rows.shape)[~rows.all(axis=1)][0]}")
    raise InputError(f"{name} must be within ±{most:g}, got {values.flat[np.abs(values).argmax()]:g}")


def as_pose(name: str, value: ArrayLike) -> Floats:
    """Return a homogeneous transform, shape (4, 4), or raise an `InputError`."""
    T = as_floats(name, value)
    if T.shape != (4, 4):
        raise InputError(f"{name} must be a 4x4 homogeneous transform, got shape {T.shape}")
    check_poses(name, T[None])
    return T


def check_poses(name: str, T: Floats) -> None:
    """Refuse a stack of transforms, shape (n, 4, 4), if one is not a rigid motion or goes beyond `MAX_DISTANCE`."""
    if not np.isfinite(T).all():
        raise InputError(f"{name} must be finite; {_where(~np.isfinite(T).all(axis=(1, 2)))} is not")
    check_entries(f"every entry of {name}", T, MAX_DISTANCE)
    bad_row = (np.abs(T[:, 3] - (0.0, 0.0, 0.0, 1.0)) > ROTATION_TOLERANCE).any(axis=1)
    if bad_row.any():
        raise InputError(f"{name} must have the last row 0 0 0 1; {_where(bad_row)} has {T[bad_row.argmax(), 3]}")
    R = T[:, :3, :3]
    gram = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2))
    skewed = (gram > ROTATION_TOLERANCE) | (np.linalg.det(R) < 0)
    if skewed.any():
        worst = int(skewed.argmax())
        raise InputError(
            f"the upper left 3x3 block of {name} must be a rotation; {_where(skewed)} is not "
            f"(largest entry of |R^T R - I| is {gram[worst]:.2g}, determinant {np.linalg.det(R[worst]):.3g})"
        )


def as_floats(name: str, value: ArrayLike) -> Floats:
    """Return an array of doubles, or raise an `InputError`: text, complex numbers, dates and None are refused."""
    array = as_array(name, value)
    if array.dtype == np.float64:
        return array
    try:
        if array.dtype.kind in "biuf" or (array.dtype.kind == "O" and all(isinstance(x, Real) for x in array.flat)):
            with np.errstate(over="ignore"):  # what is too large becomes infinite, and that is refused by who asks
                return array.astype(np.float64)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{name} must be an array of numbers: {error}") from None
    raise InputError(f"{name} must be an array of numbers, got {shown(value)}")


def torch_module() -> Any:
    """Return torch if it has been imported, else None: kinematics accepts its tensors and never imports it."""
    return sys.modules.get("torch")


def is_tensor(value: object) -> bool:
    """Return whether a value is a tensor of torch."""
    torch = torch_module()
    return torch is not None and isinstance(value, torch.Tensor)


def check_tensor(name: str, value: Any, shape: tuple[int, ...]) -> None:
    """Refuse a tensor that is not of floating-point numbers in the shape (..., *shape).

    Numbers are not checked, which would wait for the device: NaN gives NaN.
    """
    if not value.is_floating_point():
        raise InputError(f"{name} must be a tensor of floating-point numbers, got {value.dtype}")
    if tuple(value.shape[max(value.ndim - len(shape), 0) :]) != shape:
        raise InputError(f"{name} must have shape (..., {', '.join(map(str, shape))}), got {tuple(value.shape)}")


def as_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return an array of any type, or raise an `InputError`."""
    try:
        return np.asarray(value)
    except Exception as error:  # of the object's own code
        raise InputError(f"{name} must be an array of numbers: {error}") from None


def as_flags(name: str, value: ArrayLike) -> NDArray[np.bool_]:
    """Return an array of truth values, or raise an `InputError`; 0 and 1 count as such, other numbers do not."""
    if isinstance(value, np.ndarray | bool) and np.asarray(value).dtype == np.bool_:
        return np.asarray(value)
    values = as_floats(name, value)
    if not ((values == 0.0) | (values == 1.0)).all():
        raise InputError(f"{name} must be true or false, got {values[(values != 0.0) & (values != 1.0)][0]:g}")
    return values.astype(np.bool_)


def check_tolerance(tol: float) -> float:
    """Check for a tolerance within bounds: below them rounding decides, and above them lies the size of any arm."""
    inside = type(tol) is float and MIN_TOLERANCE <= tol <= MAX_TOLERANCE
    return tol if inside else check_number("tol", tol, least=MIN_TOLERANCE, most=MAX_TOLERANCE)


def _where(bad: ArrayLike) -> str:
    bad = np.asarray(bad)
    return "it" if len(bad) == 1 else f"entry {int(bad.argmax())}"
