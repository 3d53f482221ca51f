"""What the fuzz tests share: values that nobody should pass, good values in odd clothes, and the count of both."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from kinreach.errors import KinreachError

#: A case that takes longer than this counts as a hang [ms].
DEADLINE = 60_000
_COMMON: dict[str, Any] = {
    "derandomize": True,
    "deadline": DEADLINE,
    "database": None,
    "phases": (Phase.explicit, Phase.generate),  # cases are small, and to shrink one that is slow takes minutes
    "suppress_health_check": list(HealthCheck),
}
settings.register_profile("quick", max_examples=8, **_COMMON)
settings.register_profile("full", max_examples=260, **_COMMON)
PROFILE = os.environ.get("KINREACH_FUZZ", "quick")


class Refuses:
    """An object whose every conversion raises."""

    def __array__(self, *_args: object, **_options: object) -> Any:
        raise RuntimeError("no array")

    def __float__(self) -> float:
        raise ZeroDivisionError("no number")

    def __index__(self) -> int:
        raise ZeroDivisionError("no integer")


def _endless() -> list[Any]:
    loop: list[Any] = []
    loop.append(loop)
    return loop


#: No array of numbers, and no number.
THINGS: tuple[Any, ...] = (
    None, "", "home", "1", b"\xff", "a\0b", "\ud800", "x" * 5000, object(), object, len, {}, {"q": 1}, {1, 2},
    Refuses(), 1j, [1j] * 3, 10**400, [10**400] * 3, range(0), iter([1.0]), Exception("x"), NotImplemented, ...,
    _endless(), [[1, 2], [3]], [None, 1.0], ["1", "2", "3"], np.array(["a", "b"]), np.array([object()] * 6),
    np.zeros(3, dtype="M8[s]"), np.zeros(6, dtype="M8[s]"), np.zeros((4, 4), dtype=complex), np.array([None] * 3),
    np.zeros(6, dtype=[("a", float)]),
)  # fmt: skip
NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.sampled_from(
    [0.0, -0.0, 5e-324, 1e-12, 1e6, 1.0000001e6, 1e17, 1e150, 1e154, 1e200, 1e308, -1e308, np.inf, -np.inf, np.nan]
)
_KINDS = st.sampled_from(["f2", "f4", "f8", ">f8", "i1", "i8", "u1", "u8", "?", "g", "O"])


def things() -> st.SearchStrategy[Any]:
    """Objects that are no numbers."""
    return st.sampled_from(THINGS)


@st.composite
def bad_arrays(draw: st.DrawFn, shape: tuple[int, ...]) -> Any:
    """Arrays of a wrong shape or of wild numbers, of any type; or no arrays at all. A few are good by chance."""
    kind = draw(st.sampled_from(["thing", "shape", "wild", "one", "type"]))
    if kind == "thing":
        return draw(things())
    if kind == "shape":
        dimensions = draw(array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=7))
        return draw(arrays(np.float64, dimensions, elements=st.floats(-3, 3)))
    if kind == "wild":
        return draw(arrays(np.float64, shape, elements=NUMBERS))
    if kind == "type":
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return draw(arrays(np.float64, shape, elements=st.floats(-300, 300))).astype(draw(_KINDS))
    values = draw(arrays(np.float64, shape, elements=st.floats(-3, 3)))
    if values.size:
        values.flat[draw(st.integers(0, values.size - 1))] = draw(NUMBERS)
    return values


@st.composite
def dressed(draw: st.DrawFn, values: st.SearchStrategy[np.ndarray]) -> tuple[np.ndarray, Any]:
    """Good numbers, and the same in a form in which they may come: lists, other strides, other bytes, read-only."""
    plain = draw(values)
    how = draw(
        st.sampled_from(["list", "tuple", "fortran", "reversed", "strided", "readonly", "swapped", "object", "sub"])
    )
    if how == "list":
        return plain, plain.tolist()
    if how == "tuple":
        return plain, tuple(plain.tolist() if plain.ndim == 1 else map(tuple, plain.tolist()))
    if how == "fortran":
        return plain, np.asfortranarray(plain)
    if how == "reversed":
        return plain, np.ascontiguousarray(plain[..., ::-1])[..., ::-1]
    if how == "strided":
        wide = np.full((*plain.shape[:-1], 3 * plain.shape[-1]), np.nan)
        wide[..., ::3] = plain
        return plain, wide[..., ::3]
    if how == "readonly":
        frozen = plain.copy()
        frozen.flags.writeable = False
        return plain, frozen
    if how == "swapped":
        return plain, plain.astype(">f8")
    return plain, plain.astype(object) if how == "object" else plain.view(type("Sub", (np.ndarray,), {}))


class Tally(NamedTuple):
    """How many cases of one test were run, and how many of them were refused."""

    cases: int
    refused: int


def fuzz(
    cases: st.SearchStrategy[Any],
    run: Callable[[Any], None],
    *,
    share: float = 1.0,
    least: float = 0.8,
    both: bool = True,
) -> Tally:
    """Run many cases; each has to end well or in a `KinreachError` with a text.

    Args:
        cases: What to draw.
        run: Runs one case; asserts what has to hold if nothing is raised.
        share: Of the profile's number of cases; below 1 where a case is slow.
        least: Share of the cases that must have been run, where there are not so many different ones.
        both: Whether, of many cases, some must be refused and some must not.
    """
    profile = settings.get_profile(PROFILE)
    wanted = max(3, round(share * profile.max_examples))
    counts = [0, 0]

    @settings(profile, max_examples=wanted)
    @given(cases)
    def one(case: Any) -> None:
        counts[0] += 1
        try:
            run(case)
        except KinreachError as error:
            counts[1] += 1
            text = str(error)
            assert text
            assert len(text) < 2000

    one()
    assert counts[0] >= least * wanted, f"{counts[0]} of {wanted} cases"
    assert not both or wanted < 50 or 0 < counts[1] < counts[0], f"{counts[1]} of {counts[0]} cases refused"
    return Tally(*counts)
