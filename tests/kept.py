"""Outputs that are kept in tests/data: things with properties, after each of several steps.

`KINREACH_KEEP=1 pytest FILE` keeps what there is now; read the difference in git before you commit it.
"""

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

#: Thing -> property -> its value as text.
State = dict[str, dict[str, str]]

DATA = Path(__file__).with_name("data")
KEEP = bool(os.environ.get("KINREACH_KEEP"))
#: Numbers whose last digit depends on the processor: those with decimals, and those that a unit says are rounded.
MEASURED = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?|-?\d+(?=°| mm| µm)")
#: How far a number that is written to its last bit may be off on another processor.
COMPUTED = 1e-9
PNG = b"\x89PNG"
#: Longer arrays are summarised.
MAX_SHOWN = 8


def written(value: object) -> str:
    """Write a value; numbers with four decimals, of long arrays sums that depend on the order."""
    if isinstance(value, bytes):  # a picture; that of a JPEG depends on the library
        picture = cv2.imdecode(np.frombuffer(value, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
        return written(picture) if value.startswith(PNG) else f"JPEG {picture.shape}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name}: {written(each)}" for name, each in value.items()) + "}"
    if isinstance(value, np.ndarray | list | tuple):
        numbers = np.zeros(0)
        with suppress(ValueError):  # rows of different lengths
            numbers = np.ravel(value)
        if len(numbers) > MAX_SHOWN and numbers.dtype.kind in "biuf":
            finite = np.nan_to_num(numbers.astype(float), nan=-1.0)
            sums = [finite @ np.cos(rate * np.arange(len(finite))) / len(finite) for rate in (0.0, 0.7, 2.1)]
            return f"{len(finite)} numbers {written([*sums, finite.min(), finite.max()])}"
        entries = value.tolist() if isinstance(value, np.ndarray) else value
        return f"[{', '.join(map(written, entries))}]"
    return f"{round(float(value), 4) + 0.0:.4f}" if isinstance(value, float | np.floating) else repr(value)


def differences(kept: State, now: State) -> list[str]:
    """What is gone, new or other."""
    found = []
    for thing in {**kept, **now}:
        if thing not in kept or thing not in now:
            found.append(f"{'new' if thing in now else 'gone'}: {thing}")
            continue
        before, after = kept[thing], now[thing]
        others = [name for name in {**before, **after} if not alike(before.get(name, ""), after.get(name, ""))]
        found += [f"{thing} {name}: {before.get(name)} -> {after.get(name)}" for name in others]
    return found


def alike(kept: str, now: str) -> bool:
    """Whether two texts are the same, except for the last digit of what is measured."""
    if kept == now:
        return True
    if MEASURED.sub("#", kept) != MEASURED.sub("#", now):
        return False
    pairs = zip(MEASURED.findall(kept), MEASURED.findall(now), strict=True)
    return all(abs(float(one) - float(other)) <= 1.01 * max(_unit(one), _unit(other), COMPUTED) for one, other in pairs)


def _unit(number: str) -> float:
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def read(name: str) -> dict[str, State]:
    """Return the states of a file by the steps that led to them."""
    states: dict[str, State] = {}
    state: State = {}
    for line in (DATA / name).read_text(encoding="utf-8").splitlines():
        thing, *properties = line.split("\t")
        if line.startswith("== "):
            state = states[line[3:]] = dict(state)
        elif line.startswith("- "):
            del state[line[2:]]
        else:
            state[thing] = {**state.get(thing, {}), **dict(each.split("=", 1) for each in properties)}
            state[thing] = {name: value for name, value in state[thing].items() if value}
    return states


def keep(name: str, states: Mapping[str, State]) -> None:
    """Write states, each as what changes in it; a property without a value is gone."""
    lines: list[str] = []
    before: State = {}
    for step, state in states.items():
        lines += [f"== {step}", *(f"- {thing}" for thing in before if thing not in state)]
        for thing, properties in state.items():
            old = before.get(thing, {})
            gone = [f"{each}=" for each in old if each not in properties]
            new = [f"{each}={value}" for each, value in properties.items() if old.get(each) != value]
            if thing not in before or gone or new:
                lines.append("\t".join([thing, *gone, *new]))
        before = state
    (DATA / name).parent.mkdir(exist_ok=True)
    (DATA / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


def check(name: str, states: Mapping[str, State]) -> None:
    """Compare states with those of a file.

    Raises:
        AssertionError: They differ.
    """
    if KEEP:
        keep(name, states)
    kept = read(name)
    assert list(kept) == list(states)
    for step, state in states.items():
        assert differences(kept[step], state) == [], f"{step}: if it is meant, keep it with KINREACH_KEEP=1"
