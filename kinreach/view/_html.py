"""The parts of the page that are text: verdict, list of postures, gauge, table of solvers. Everything is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import degrees

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics import IKResult
from kinreach.view._draw import BRANCH_COLOURS, Colour
from kinreach.view._episodes import Episode, Frame
from kinreach.view._names import angle, length, plain
from kinreach.view._real_arm import Miss
from kinreach.view._results import End, Results
from kinreach.view._target import Answer, Finish, Posture, State

_GREEN, _RED, _ORANGE = "#2b8a3e", "#c92a2a", "#d9820a"
_SMALL = "font-size:11px;color:#666;line-height:1.35"
#: `slowest_motion` of a gauge that is full, and below which it is orange and red [m/rad].
FULL, LOW, VERY_LOW = 0.12, 0.04, 0.015


def css(colour: Colour) -> str:
    """Write a colour for a style sheet."""
    return "rgb({},{},{})".format(*colour)


def block(content: str) -> str:
    """Wrap content in the margins of the page's elements, without signs that cannot be printed."""
    content = "".join(sign for sign in content if sign.isprintable() or sign == "\n")
    return f'<div style="padding:2px 10px 4px 10px;font-size:13px;line-height:1.4">{content}</div>'


def message(text: str, *, bad: bool = False) -> str:
    """Write a sentence in a box, red or green."""
    colour, back = (_RED, "#fff0f0") if bad else (_GREEN, "#eefbf0")
    return block(
        f'<div class="kinreach-verdict" style="border-left:4px solid {colour};background:{back};padding:6px 8px;'
        f'color:#222">{escape(text)}</div>'
    )


def verdict(answer: Answer) -> str:
    """Return the verdict on a target."""
    return message(answer.verdict, bad=not answer.usable)


def legend(answer: Answer, *, shown: int, joints: Sequence[str]) -> str:
    """List all postures, the nearest that can be used first, and why others are refused.

    Args:
        answer: Of the target.
        shown: Index of the posture that is drawn solid; -1 if none is.
        joints: Names of the joints.
    """
    rows: list[str] = []

    def rank(index: int) -> tuple[bool, bool, float]:
        posture = answer.postures[index]
        return posture.state is not State.USABLE, index != shown, posture.distance

    order = sorted(range(len(answer.postures)), key=rank)
    unreached: dict[str, list[Posture]] = {}
    for index in order:
        posture = answer.postures[index]
        if posture.q is None:
            unreached.setdefault(posture.reason, []).append(posture)
        else:
            rows.append(_row(posture, posture.q, solid=index == shown, joints=joints))
    for reason, postures in unreached.items():
        names = "<br>".join(escape(posture.name) for posture in postures)
        rows.append(_entry("✗", _RED, names, _reason(reason)))
    return block(f'<div class="kinreach-postures">{"".join(rows)}</div>')


def branch_colour(branch: int) -> Colour:
    """Return the colour of a branch's ghost."""
    return BRANCH_COLOURS[branch % len(BRANCH_COLOURS)]


def _row(posture: Posture, q: Floats, *, solid: bool, joints: Sequence[str]) -> str:
    usable = posture.state is State.USABLE
    values = " ".join(f"{round(degrees(value))}°" for value in q)
    titles = ", ".join(f"{plain(name)} {degrees(value):.1f}°" for name, value in zip(joints, q, strict=True))
    reason = "" if usable else _reason(posture.reason)
    name = f"<b>{escape(posture.name)}</b>" if solid else escape(posture.name)
    word, back = ("solid", "#343a40") if usable else ("shown", _RED)
    mark = f' <span style="background:{back};color:#fff;border-radius:3px;padding:0 4px;font-size:10px">{word}</span>'
    detail = f'{reason}<span style="{_SMALL};font-family:monospace" title="{escape(titles)}">{values}</span>'
    colour = css(branch_colour(posture.branch)) if usable else _RED
    return _entry("●" if usable else "✗", colour, name + (mark if solid else ""), detail)


def _reason(text: str) -> str:
    return f'<div style="color:{_RED};font-size:12px">{escape(text)}</div>'


def _entry(sign: str, colour: str, title: str, detail: str) -> str:
    return (
        '<div style="display:flex;gap:6px;padding:2px 0;border-bottom:1px solid #f0f0f0">'
        f'<span style="color:{colour};width:12px">{sign}</span><div><div>{title}</div>{detail}</div></div>'
    )


def gauge(stiffness: float, what: str) -> str:
    """Draw how far a posture is from a singular one.

    Args:
        stiffness: `TargetModel.slowest_motion` [m/rad].
        what: The singularity that it is nearest to; empty if that is not known.
    """
    share = min(1.0, stiffness / FULL)
    colour = _RED if stiffness < VERY_LOW else _ORANGE if stiffness < LOW else _GREEN
    near = f" Nearest singularity: {escape(what)}." if what else ""
    speed = f"{0.1 / stiffness:.1f} rad/s" if stiffness > 1e-6 else "no finite speed"
    return block(
        '<div style="display:flex;align-items:center;gap:8px"><span style="white-space:nowrap">Singular</span>'
        '<div style="flex:1;height:10px;border-radius:5px;background:#e9ecef;overflow:hidden">'
        f'<div class="kinreach-gauge" style="width:{100 * share:.0f}%;height:100%;background:{colour}"></div></div>'
        '<span style="white-space:nowrap">free to move</span></div>'
        f'<div style="{_SMALL}">In its slowest direction the tool moves {length(stiffness)} for a radian of the '
        f"joints: 100 mm/s need {speed}.{near}</div>"
    )


def solvers(finishes: Sequence[Finish]) -> str:
    """List where each solver ended, and how long it took."""
    rows = []
    for finish in finishes:
        result = finish.result
        end = "reached" if result.success else result.reason or result.status.value
        colour = _GREEN if result.success else _RED
        rows.append(
            f"<tr><td>{escape(finish.solver)}</td><td>{_off(result.position_error)}</td>"
            f"<td>{angle(result.orientation_error, 2)}</td><td>{1000 * finish.seconds:.2f} ms</td></tr>"
            f'<tr><td colspan="4" style="color:{colour};font-size:11px;padding-bottom:4px">{escape(end)}</td></tr>'
        )
    return block(
        '<table class="kinreach-solvers" style="width:100%;font-size:12px;border-collapse:collapse">'
        '<tr style="text-align:left;color:#666"><th>solver</th><th>off by</th><th>turned</th><th>time</th></tr>'
        f"{''.join(rows)}</table>"
    )


def _off(value: float) -> str:
    """A length [m] that is often too short for millimetres."""
    if value < 1e-6:
        return "&lt; 1 µm"
    return f"{1e6 * value:.0f} µm" if value < 1e-5 else length(value)


def ends(results: Results, index: int) -> str:
    """List where each method ended on a goal.

    Args:
        results: Of a comparison.
        index: Of the goal.
    """
    x, y, z = results.goals[index]
    rows = [
        _entry("●", css(results.colours[name]), f"{escape(name)}: {_distance(end.distance)}", _ended(end))
        for name, end in results.ends[index].items()
    ]
    return block(
        f'<div style="{_SMALL}">Goal {index} at {x:.3f}, {y:.3f}, {z:.3f} m</div>'
        f'<div class="kinreach-ends">{"".join(rows)}</div>'
    )


def _distance(value: float) -> str:
    return f"{length(value)} from the goal" if np.isfinite(value) else "distance unknown"


def _ended(end: End) -> str:
    if end.reached:
        return f'<div style="color:{_GREEN};font-size:12px">reached</div>'
    return _reason(end.reason or "not reached")


def moment(episode: Episode, frame: Frame) -> str:
    """Describe a frame: time, steps, reward and its terms, what touches."""
    parts = [f"{frame.time:.2f} s, {frame.step} of {len(episode.steps)} steps"]
    if frame.step:
        step = episode.steps[frame.step - 1]
        terms = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in step.terms.items())
        parts.append(f"reward {step.reward:.3g}{f' ({terms})' if terms else ''}")
        parts += [] if step.distance is None else [f"{length(step.distance)} from the goal"]
        parts += [step.impossible_reason] if step.impossible_reason else []
    parts += [", ".join(f"{plain(name)} {value}" for name, value in episode.facts.items())] if episode.facts else []
    parts += [] if frame.believed is None else ["blue: the arm as its user believes it to be"]
    pairs = dict.fromkeys(f"{plain(a)} touches {plain(b)}" for a, b in (contact.bodies for contact in frame.contacts))
    lines = "<br>".join([*map(escape, parts), *(f'<span style="color:{_RED}">{escape(pair)}</span>' for pair in pairs)])
    return block(f'<div class="kinreach-moment" style="font-size:12px">{lines}</div>')


def miss(found: Miss, exact: IKResult) -> str:
    """Write a tip error by its parts, and that of the calibrated arm's own posture.

    Args:
        found: Of the data sheet's posture.
        exact: The calibrated arm's posture.
    """
    parts = "".join(f"<td>{1000 * value:+.2f} mm</td>" for value in found.vector)
    own = f"no posture: {escape(exact.reason)}"
    if exact.success:
        turned = degrees(np.abs(exact.q - found.q).max())
        own = f"{_off(exact.position_error)} off; a joint is turned by up to {turned:.2f}° against the data sheet's"
    return block(
        f'<table class="kinreach-miss" style="font-size:12px;width:100%"><tr style="text-align:left;color:#666">'
        f"<th>x</th><th>y</th><th>z</th></tr><tr>{parts}</tr></table>"
        f'<div style="{_SMALL}">The calibrated arm\'s own posture: {own}.</div>'
    )


def scale(colours: NDArray[np.uint8], least: str, most: str, title: str) -> str:
    """Draw the colours of a map, RGBA of shape (k, 4), with their meaning."""
    stops = ",".join(css(colour) for colour in colours[:, :3].tolist())
    return block(
        f'<div style="{_SMALL}">{escape(title)}</div>'
        '<div style="display:flex;align-items:center;gap:8px;font-size:12px">'
        f'{escape(least)}<div style="flex:1;height:10px;background:linear-gradient(to right,{stops})"></div>'
        f"{escape(most)}</div>"
    )


def small(text: str) -> str:
    """Write a remark."""
    return block(f'<span style="{_SMALL}">{escape(text)}</span>')


def code(text: str) -> str:
    """Write a program with a button that copies it."""
    return block(
        '<button style="padding:4px 10px;cursor:pointer" onclick="navigator.clipboard.writeText('
        "this.nextElementSibling.innerText);this.innerText='Copied'\">Copy</button>"
        '<pre class="kinreach-code" style="background:#f6f8fa;padding:10px;overflow:auto;font-size:12px">'
        f"{escape(text)}</pre>"
    )
