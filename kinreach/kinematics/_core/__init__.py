"""The compiled core, called without Python's headers and without its lock.

`core.h` has the functions and their arguments. Arrays go in and come out as pointers to doubles in the order of C.
Nothing is checked there: the callers in this room give arrays of the sizes that `core.h` says.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI

from kinreach.errors import KinreachError

_FOLDER = Path(__file__).parent
_LIBRARY = _FOLDER / ("core.dylib" if sys.platform == "darwin" else "core.so")

ffi: Any = FFI()
ffi.cdef("\n".join(line for line in (_FOLDER / "core.h").read_text().splitlines() if not line.startswith("#")))
try:
    lib: Any = ffi.dlopen(str(_LIBRARY))
except OSError as error:
    raise KinreachError(
        f"the compiled core does not load ({error}); `pip install` builds it, and in a checkout `python hatch_build.py`"
    ) from error
_DOUBLES, _FLAGS, _INTS, _LONGS = (ffi.typeof(f"{kind}[]") for kind in ("double", "unsigned char", "int", "long long"))
NULL = ffi.NULL
#: Numbers in a row of a six-joint arm's posture: branch, flags, angles.
ROW = 8
_ROWS = {most: ffi.typeof(f"double[{ROW * most}]") for most in (8, 16)}
_new = ffi.new_allocator(should_clear_after_alloc=False)


def new_rows(most: int) -> Any:
    """Return memory for rows of postures of a six-joint arm, faster than an array's."""
    return _new(_ROWS[most])


def as_rows(memory: Any) -> Any:
    """Return what `new_rows` made as an array (most, 8)."""
    return np.frombuffer(ffi.buffer(memory)).reshape(-1, ROW)


class Struct:
    """A struct of `core.h` that can be copied and pickled.

    Args:
        kind: Its name.
        fields: Its fields: numbers, or for an array a sequence of as many as it has, or fewer.
    """

    def __init__(self, kind: str, **fields: Any) -> None:
        self.kind, self.pointer = kind, ffi.new(f"{kind} *", fields)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.kind, bytes(ffi.buffer(self.pointer)))


def _restored(kind: str, content: bytes) -> Struct:
    struct = Struct(kind)
    ffi.memmove(struct.pointer, content, len(content))
    return struct


def doubles(array: Any) -> Any:
    """Return the pointer to an array of doubles in the order of C; the array has to live as long as it is used."""
    return ffi.from_buffer(_DOUBLES, array)


def flags(array: Any) -> Any:
    """Return the pointer to truth values; as `doubles`."""
    return ffi.from_buffer(_FLAGS, array)


def ints(array: Any) -> Any:
    """Return the pointer to integers of 32 bits; as `doubles`."""
    return ffi.from_buffer(_INTS, array)


def longs(array: Any) -> Any:
    """Return the pointer to integers of 64 bits; as `doubles`."""
    return ffi.from_buffer(_LONGS, array)
