"""One colour for each method, in every figure, report and film."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from zlib import crc32

#: Colours of lines that stand for anything but a method, in their order.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
#: Colour -> patterns of its methods, of which no figure shows two. The first that fits a name counts.
RULES = {
    # models of the arm
    "#003F66": ("closed-form", "analytic", "interception", "look-again", "script"),
    "#0072B2": ("placo", "last-sight", "registered", "sac-*", "button-report", "button-report-actuation"),
    "#56B4E9": ("lm", "identified", "button-report-demonstrated-press", "scenarios"),
    "#8CCBEB": ("qp", "identified-joints"),
    "#CC79A7": ("hybrid", "act-first", "residual", "path-to-one", "td3-*", "button-report-both"),
    # paths around obstacles
    "#A65E2E": ("from-above",),
    "#5B7F1F": ("free-way",),
    "#6A3D9A": ("path", "correction", "*-ending"),
    # neither a model nor learning
    "#7A7A7A": ("random", "first-sight", "data-sheet"),
    # learners; paler where they decide step by step, or know more
    "#000000": ("thesis-*",),
    "#F2A35E": ("ppo-*multi", "ppo-*-clear", "correction-joints"),
    "#D55E00": ("ppo", "ppo-*", "button", "policy-informed"),
    "#2FBF94": ("ranked-multi", "ranked-*-range", "space-multi", "gradient-*-clear", "policy-tuned"),
    "#00674C": ("ranked-*", "panda-*", "space-*", "gradient-*", "imitated-*", "policy"),
    "#009E73": ("ddpg-*", "button-dqn*"),
    "#E69F00": ("sb3-*", "policy-again", "button-report-demonstrated-frames"),
}
#: Of methods that no rule names: no rule has one of these.
OTHERS = ("#8C6D31", "#B0123C", "#9A86E8", "#A59A00", "#00838F")


def _place(name: str, patterns: Sequence[str]) -> int | None:
    """Return the index of the first pattern that fits a name; None if none does."""
    return next((index for index, pattern in enumerate(patterns) if fnmatchcase(name, pattern)), None)


def own_colour(name: str) -> str:
    """Return the colour of a method by its name; empty if no rule names it."""
    return next((colour for colour, patterns in RULES.items() if _place(name, patterns) is not None), "")


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
    for colour, patterns in RULES.items():
        fitting = {method: _place(method, patterns) or 0 for method in sorted(present) if own_colour(method) == colour}
        if fitting and colour not in used:
            found[min(fitting, key=fitting.__getitem__)] = colour
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
    if any(own_colour(name.partition(",")[0]) for name in given):
        return method_colours(given)
    return {name: PALETTE[index % len(PALETTE)] for index, name in enumerate(given)}
