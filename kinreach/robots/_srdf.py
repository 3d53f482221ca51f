"""MoveIt's SRDF: which links of an arm may touch each other."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

from kinreach._checks import check_path, shown
from kinreach._files import decoded, read_bytes
from kinreach.errors import InputError
from kinreach.robots._urdf import MAX_CHARACTERS, ROBOT, parse_xml
from kinreach.robots._urdf_repair import listed_names

#: Elements with two links that may touch, and that may not; and with a link that may touch every other.
_PAIR, _CHECKED, _EVERY = "disable_collisions", "enable_collisions", "disable_default_collisions"
_XACRO = ("${", "$(")


class Srdf(NamedTuple):
    """What an SRDF says of an arm.

    Attributes:
        may_touch: Pairs of links.
        notes: A line if it names links that the arm does not have.
    """

    may_touch: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def read_srdf(file: str | Path, links: Collection[str]) -> Srdf:
    """Read the pairs of links that an SRDF lets touch.

    Args:
        file: Its path.
        links: Names of the arm's links.

    Raises:
        InputError: It cannot be read, is no SRDF, or names no two links of the arm.
    """
    path = check_path("srdf", file)
    text = decoded(read_bytes(path, "the SRDF", most=MAX_CHARACTERS), otherwise="latin-1").lstrip("\ufeff \t\r\n")
    root = parse_xml(text, tags=(ROBOT,), prefixed=True)
    where = shown(str(path))
    pairs = [(each.get("link1", ""), each.get("link2", "")) for each in root.iter(_PAIR)]
    every = [each.get("link", "") for each in root.iter(_EVERY)]
    checked = {frozenset((each.get("link1", ""), each.get("link2", ""))) for each in root.iter(_CHECKED)}
    named = [link for pair in (*pairs, *((link,) for link in every), *map(sorted, checked)) for link in pair]
    if any(mark in link for link in named for mark in _XACRO) or any(each.tag.startswith("xacro:") for each in root):
        raise InputError(f"{where} is xacro, which SRDFs are made from; expand it with xacro, and give the result")
    if not pairs and not every:
        about = "a URDF" if root.find("link") is not None else "a file without them"
        raise InputError(f"an SRDF names with <{_PAIR}> the links that may touch; {where} is {about}")
    pairs += [pair for pair in combinations(links, 2) if set(pair) & set(every)]
    allowed = {frozenset(pair): pair for pair in pairs if set(pair) <= set(links)}
    kept = tuple((min(pair), max(pair)) for key, pair in allowed.items() if key not in checked)
    if not kept:
        raise InputError(f"{where} names no two links of this arm, which has {listed_names(links)}: is it another's?")
    unknown = [*dict.fromkeys(link for link in named if link not in links)]
    other = "links that the arm does not have" if len(unknown) > 1 else "a link that the arm does not have"
    return Srdf(kept, (f"{where} names {other}: {listed_names(unknown)}",) if unknown else ())
