"""One name and one colour for each method, in every figure, report and film."""

from __future__ import annotations

from collections.abc import Iterable
from zlib import crc32

#: Colours of lines that stand for anything but a method, in their order.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
#: Method -> its colour. Only methods that no figure shows together share one.
METHOD_COLOURS = {
    # models of the arm
    **dict.fromkeys(("closed-form", "analytic", "interception", "look-again"), "#003F66"),
    **dict.fromkeys(("placo", "last-sight", "registered"), "#0072B2"),
    **dict.fromkeys(("lm", "identified"), "#56B4E9"),
    **dict.fromkeys(("qp", "identified-joints"), "#8CCBEB"),
    **dict.fromkeys(("hybrid", "residual"), "#CC79A7"),
    # paths around obstacles
    "from-above": "#A65E2E",
    "free-way": "#5B7F1F",
    "path-to-one": "#CC79A7",
    "path": "#6A3D9A",
    # neither a model nor learning
    **dict.fromkeys(("random", "first-sight", "data-sheet"), "#7A7A7A"),
    # PPO
    **dict.fromkeys(("ppo-single", "ppo", "button", "ppo-moving", "policy-informed"), "#D55E00"),
    **dict.fromkeys(("ppo-multi", "ppo-moving-clear", "ppo-lift-multi", "correction-joints"), "#F2A35E"),
    **dict.fromkeys(("ppo-multi-ending", "correction"), "#6A3D9A"),
    # ranked PPO, and down a gradient
    **dict.fromkeys(
        ("ranked-single", "panda-single", "ranked-lift", "space-single", "gradient-moving", "policy"), "#00674C"
    ),
    **dict.fromkeys(("ranked-multi", "ranked-lift-range", "space-multi", "policy-tuned"), "#2FBF94"),
    "policy-again": "#E69F00",
    # what the documents and other packages do
    **dict.fromkeys(("thesis-ppo-single", "thesis-ppo-multi"), "#000000"),
    **dict.fromkeys(("sb3-single", "sb3-multi", "sb3-multi-long", "button-report-demonstrated-frames"), "#E69F00"),
    **dict.fromkeys(("sac-single", "sac-multi", "button-report", "button-report-actuation"), "#0072B2"),
    **dict.fromkeys(("td3-single", "td3-multi", "button-report-both"), "#CC79A7"),
    **dict.fromkeys(("ddpg-single", "ddpg-multi", "button-dqn", "button-dqn-report-actuation"), "#009E73"),
    "button-report-demonstrated-press": "#56B4E9",
}
#: Of methods that are not in the table: no method of the table has one of these.
OTHERS = ("#8C6D31", "#B0123C", "#9A86E8", "#A59A00", "#00838F")


def method_colours(names: Iterable[str], *, taken: Iterable[str] = ()) -> dict[str, str]:
    """Choose a colour for each method: its own, and for others one of `OTHERS` that depends on the name.

    Methods have different colours as long as there are enough; what follows a comma in a name, such as the seed, is
    ignored.

    Args:
        names: Of the methods.
        taken: Colours that others do not get.
    """
    methods = {name: name.partition(",")[0] for name in names}
    present, used = set(methods.values()), set(taken)
    found: dict[str, str] = {}
    for method, colour in METHOD_COLOURS.items():
        if method in present and colour not in used:
            found[method] = colour
            used.add(colour)
    for method in methods.values():
        if method not in found:
            first = crc32(method.encode())
            turned = [OTHERS[(first + step) % len(OTHERS)] for step in range(len(OTHERS))]
            found[method] = next((colour for colour in (*turned, *PALETTE) if colour not in used), turned[0])
            used.add(found[method])
    return {name: found[method] for name, method in methods.items()}


def colours_of(names: Iterable[str]) -> dict[str, str]:
    """Choose a colour for each line of a figure: those of methods, if one is known, else the palette's in its order."""
    given = list(dict.fromkeys(names))
    if any(name.partition(",")[0] in METHOD_COLOURS for name in given):
        return method_colours(given)
    return {name: PALETTE[index % len(PALETTE)] for index, name in enumerate(given)}
