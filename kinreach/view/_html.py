"""Texts of the page as HTML: tabs, verdict, list of postures, gauge, tables. Everything is escaped.

The classes and the handlers of clicks are in `head.html`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import cycle
from math import degrees

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics import IKResult
from kinreach.view._draw import BRANCH_COLOURS, Colour
from kinreach.view._episodes import Episode, EpisodeFrame
from kinreach.view._names import angle, length, place, plain
from kinreach.view._real_arm import TipMiss
from kinreach.view._results import Results
from kinreach.view._target import Answer, Finish, Posture, State

_GREEN, _RED, _ORANGE = "#37a34b", "#e03131", "#e8910c"
_CROSS = '<span class="kr-bad">✗</span>'
#: Groups of buttons that texts press. Of `POINT_AT` the first is for nothing, of `POSTURE` and `POINT_AT` there are
#: `MAX_POSTURES` others: a calibrated UR has up to sixteen postures.
SHOW, DO, COLOURS, POSTURE, POINT_AT, METHOD = "show", "do", "colours", "posture", "point at", "method"
#: The group that a press on a chart presses, of `MOMENTS` + 1 buttons.
MOMENT, MOMENTS = "moment", 100
MAX_POSTURES = 16
#: Hides the groups of buttons that follow it in a folder.
UNSEEN = '<i class="kr-unseen"></i>'
#: `slowest_motion` of a gauge that is full, and below which it is orange and red [m/rad].
FULL, LOW, VERY_LOW = 0.12, 0.04, 0.015

#: Upper ends of a chart's scale, and the largest bend of a straight line in it.
TOPS, STRAIGHT = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0), 1e-9

#: Actions on any part of the page -> their icons.
SCREENSHOT, PYTHON = "Screenshot: save the scene as a PNG", "Copy as Python: the program for what is on the screen"
_SVG = '<svg viewBox="0 0 24 24">{}</svg>'
_ICONS = {
    SCREENSHOT: _SVG.format(
        '<path d="M8 7l2-3h4l2 3h3a2 2 0 0 1 2 2v9a2 2 0 0 1-2 2H5a2 2 0 0 1-2-2V9a2 2 0 0 1 2-2z"/>'
        '<circle cx="12" cy="13" r="3"/>'
    ),
    PYTHON: _SVG.format('<path d="M7 8l-4 4 4 4M17 8l4 4-4 4M14 4l-4 16"/>'),
}


def css(colour: Colour) -> str:
    return "rgb({},{},{})".format(*colour)


def block(content: str) -> str:
    """Wrap content in the margins of the page, without unprintable characters."""
    content = "".join(sign for sign in content if sign.isprintable() or sign == "\n")
    return f'<div class="kr">{content}</div>'


def message(text: str, *, bad: bool = False, caution: bool = False) -> str:
    """Write a sentence in a box, red, orange or green."""
    colour = " kr-wrong" if bad else " kr-caution" if caution else ""
    return block(f'<div class="kinreach-verdict{colour}">{escape(text)}</div>')


def bar(names: Sequence[str], active: str) -> str:
    """Draw the parts of the page as tabs, and the actions on them as icons."""
    tabs = "".join(
        f'<button role="tab" aria-selected="{"true" if name == active else "false"}" {_press(SHOW, index)}>'
        f"{escape(name)}</button>"
        for index, name in enumerate(names)
    )
    icons = "".join(
        f'<button class="kr-icon" {_press(DO, index)} title="{what}" aria-label="{what}">{drawn}</button>'
        for index, (what, drawn) in enumerate(_ICONS.items())
    )
    return block(f'<div class="kr-bar"><div role="tablist">{tabs}</div><div>{icons}</div></div>')


def legend(
    answer: Answer, *, shown: int, joints: Sequence[str], sliding: Sequence[str] = (), chosen: bool = False
) -> str:
    """List all postures, usable ones first and the nearest before others, with the reasons against the rest.

    The posture of index `shown` is solid, -1 for none; `chosen` tells whether the user chose it.
    """
    rows: list[str] = []

    def rank(index: int) -> tuple[bool, bool, float]:
        posture = answer.postures[index]
        return posture.state is not State.USABLE, index != answer.shown, posture.distance

    order = sorted(range(len(answer.postures)), key=rank)
    unreached: dict[str, list[Posture]] = {}
    for index in order:
        posture = answer.postures[index]
        if posture.q is None:
            unreached.setdefault(posture.reason, []).append(posture)
        else:
            word = "" if index != shown else "kept" if chosen else "solid" if not posture.reason else "shown"
            rows.append(_row(index, posture, posture.q, word=word, joints=joints, sliding=sliding))
    for reason, postures in unreached.items():
        names = "<br>".join(escape(posture.name) for posture in postures)
        rows.append(_entry(_CROSS, names, _reason(reason)))
    return block(f'<div class="kinreach-postures">{"".join(rows)}</div>')


def branch_colour(branch: int) -> Colour:
    return BRANCH_COLOURS[branch % len(BRANCH_COLOURS)]


def _row(index: int, posture: Posture, q: Floats, *, word: str, joints: Sequence[str], sliding: Sequence[str]) -> str:
    """A posture; a click draws it solid, the mouse over it shows its ghost."""
    usable = posture.state is State.USABLE
    at = list(zip(joints, q.tolist(), strict=True))
    values = " ".join(place(value, slides=name in sliding) for name, value in at)
    titles = ", ".join(f"{plain(name)} {place(value, 1, slides=name in sliding)}" for name, value in at)
    name = f"<b>{escape(posture.name)}</b>" if word else escape(posture.name)
    detail = "" if usable else _reason(posture.reason)
    detail += f'<span class="kr-small" style="font-family:monospace" title="{escape(titles)}">{values}</span>'
    detail += f' <span class="kr-word">{word}</span>' if word else ""
    icon = _SVG.format(
        '<rect x="9" y="9" width="11" height="11" rx="2"/><path d="M5 15a1 1 0 0 1-1-1V5a1 1 0 0 1 1-1h9"/>'
    )
    copy = (
        '<button class="kr-icon" title="Copy the joint angles in radians" aria-label="Copy the joint angles" '
        f'data-copy="{q.tolist()}">{icon}</button>'
    )
    does = f'{_press(POSTURE, index)} data-point="{POINT_AT} {index + 1}" role="button" tabindex="0"'
    does += f' title="{"Follow the nearest again" if word == "kept" else "Draw this one solid"}"'
    mark = _dot(css(branch_colour(posture.branch))) if usable else _CROSS
    return _entry(mark, name, detail, does=does, after=copy)


def _press(name: str, index: int) -> str:
    return f'data-press="{name} {index}"'


def _reason(text: str) -> str:
    return f'<div class="kr-bad" style="font-size:12px">{escape(text)}</div>'


def _dot(colour: str) -> str:
    return f'<span style="color:{colour}">●</span>'


def _entry(mark: str, title: str, detail: str, *, does: str = "", after: str = "") -> str:
    return f'<div class="kr-entry" {does}>{mark}<div><div>{title}</div>{detail}</div>{after}</div>'


def gauge(stiffness: float, what: str) -> str:
    """Draw a posture's distance from singularity, by `TargetModel.slowest_motion` [m/rad], and name the nearest one."""
    share = min(1.0, stiffness / FULL)
    colour = _RED if stiffness < VERY_LOW else _ORANGE if stiffness < LOW else _GREEN
    near = f" Nearest singularity: {escape(what)}." if what else ""
    speed = f"{0.1 / stiffness:.1f} rad/s" if stiffness > 1e-6 else "no finite speed"
    return block(
        '<div class="kr-line">Singular<div class="kr-track"><div class="kinreach-gauge" '
        f'style="width:{100 * share:.0f}%;background:{colour}"></div></div>free to move</div>'
        f'<div class="kr-small">In its slowest direction the tool moves {escape(length(stiffness))} for a radian of '
        f"the joints: 100 mm/s need {speed}.{near}</div>"
    )


def solvers(finishes: Sequence[Finish]) -> str:
    rows = []
    for finish in finishes:
        result = finish.result
        end = "reached" if result.success else result.reason or result.status.value
        rows.append(
            f"<tr><td>{escape(finish.solver)}</td><td>{escape(length(result.position_error))}</td>"
            f'<td>{angle(result.orientation_error, 2)}</td><td title="median of {finish.calls} calls after a first">'
            f"{1000 * finish.seconds:.2g} ms</td></tr>"
            f'<tr><td colspan="4" class="{"kr-good" if result.success else "kr-bad"}" style="font-size:11px">'
            f"{escape(end)}</td></tr>"
        )
    return block(
        '<table class="kinreach-solvers"><tr><th>solver</th><th>off by</th><th>turned</th><th>time</th></tr>'
        f"{''.join(rows)}</table>"
    )


def ends(results: Results, index: int, chosen: str) -> str:
    """List the distance of each method from a goal."""
    x, y, z = results.goals[index]
    names = list(results.colours)
    rows = [
        _entry(
            _dot(css(results.colours[name])),
            f"<b>{escape(name)}</b>" if name == chosen else escape(name),
            "" if end.reached else _reason(end.reason or "not reached"),
            does=f'{_press(METHOD, names.index(name))} role="button" tabindex="0" title="Draw this one"',
            after=f"<span>{escape(length(end.distance)) if np.isfinite(end.distance) else '?'}</span>",
        )
        for name, end in results.ends[index].items()
    ]
    return block(
        f'<div class="kr-small">Goal {index} at {x:.3f}, {y:.3f}, {z:.3f} m: tip to goal</div>'
        f'<div class="kinreach-ends">{"".join(rows)}</div>'
    )


def moment(episode: Episode, frame: EpisodeFrame) -> str:
    """Describe a frame: time, steps, reward, contacts."""
    parts = [f"{frame.time:.2f} s, {frame.step} of {len(episode.steps)} steps"]
    if frame.step:
        step = episode.steps[frame.step - 1]
        parts.append(f"reward {step.reward:.3g}")
        parts += [] if step.distance is None else [f"{length(step.distance)} from the goal"]
        parts += [step.impossible_reason] if step.impossible_reason else []
    parts += [", ".join(f"{plain(name)} {value}" for name, value in episode.facts.items())] if episode.facts else []
    parts += [] if frame.believed is None else ["blue: the arm as its user believes it to be"]
    pairs = dict.fromkeys(f"{plain(a)} touches {plain(b)}" for a, b in (contact.bodies for contact in frame.contacts))
    lines = "<br>".join([*map(escape, parts), *(f'<span class="kr-bad">{escape(pair)}</span>' for pair in pairs)])
    return block(f'<div class="kinreach-moment" style="font-size:12px">{lines}</div>')


def bars(terms: Mapping[str, float]) -> str:
    """Draw the terms of a step's reward as bars from 0, in the colours of the plot."""
    least, most = min(0.0, *terms.values()), max(0.0, *terms.values())
    width = most - least or 1.0
    rows = "".join(
        f"<span>{escape(plain(name))}</span><div>"
        f'<i style="left:{100 * (min(value, 0.0) - least) / width:.1f}%;width:{100 * abs(value) / width:.1f}%;'
        f'background:{css(colour)}"></i></div><span>{round(value, 2) + 0.0:g}</span>'
        for (name, value), colour in zip(terms.items(), cycle(BRANCH_COLOURS), strict=False)
    )
    return block(f'<div class="kr-bars">{rows}</div>')


def chart(times: Floats, shares: Floats) -> str:
    """Draw speeds by their limits, 0 to 1, shape (k, joints), over times [s], shape (k,), in the colours of `speeds`.

    A line stands at the moment that `speeds` is called with.
    """
    most = float(shares.max(initial=0.0))
    top = next((top for top in TOPS if most <= top), float(np.ceil(10 * most) / 10))
    lines = "".join(
        f'<polyline points="{_points(times, share, top)}" style="stroke:{css(colour)}"/>'
        for share, colour in zip(shares.T, cycle(BRANCH_COLOURS), strict=False)
    )
    limit = f'<line class="kr-limit" x1="0" x2="1000" y1="{100 / top:.1f}" y2="{100 / top:.1f}"/>' if top >= 1 else ""
    levels = "".join(f'<line class="kr-level" x1="0" x2="1000" y1="{y}" y2="{y}"/>' for y in (0, 50, 100))
    percents = "".join(f"<span>{100 * share:g} %</span>" for share in (top, top / 2, 0.0))
    return block(
        f'<div class="kr-chart"><div>{percents}</div><div data-scrub="{MOMENT}">'
        f'<svg viewBox="0 0 1000 100" preserveAspectRatio="none"><g transform="matrix(1 0 0 -1 0 100)">{levels}{limit}'
        f"{lines}</g></svg><b></b></div><div></div><div><span>0 s</span><span>{times[-1]:.2f} s</span></div></div>"
    )


def _points(times: Floats, shares: Floats, top: float) -> str:
    """Corners of a line in a chart 1000 wide and 100 high."""
    corners = np.ones(len(times), dtype=bool)
    corners[1:-1] = np.abs(np.diff(shares, 2)) > STRAIGHT
    x, y = 1000 * times[corners] / times[-1], 100 * shares[corners] / top
    return " ".join(f"{a:.1f},{b:.2f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def speeds(joints: Sequence[str], now: Floats, most: Floats, limits: Floats, *, moment: float) -> str:
    """Draw the joints' speeds by their limits as bars, with a mark at the largest of the motion [rad/s].

    `moment` is that of the line in `chart`: 0 at the start of the motion, 1 at its end.
    """
    rows = "".join(
        f"<span>{_dot(css(colour))} {escape(plain(name))}</span>"
        f'<div class="kr-track"><div style="width:{100 * share:.1f}%;background:{css(colour)}"></div>'
        f'<b style="left:{100 * peak:.1f}%"></b></div>'
        f'<span title="largest of the motion, of {limit:.2f} rad/s">{100 * peak:.0f} %</span>'
        for name, share, peak, limit, colour in zip(
            joints, now.tolist(), most.tolist(), limits.tolist(), cycle(BRANCH_COLOURS), strict=False
        )
    )
    said = '<div class="kr-small">Joint speeds by their limits, over the time and now; numbers are the largest.</div>'
    now_at = f"<style>:root {{ --kr-moment: {moment:.4f} }}</style>"
    return block(f'{now_at}<div class="kr-bars kr-speeds">{rows}</div>{said}')


def remarks(lines: Sequence[str]) -> str:
    """Write lines of a report."""
    rows = "".join(f"<div>{escape(line)}</div>" for line in lines)
    return block(f'<div class="kr-small kinreach-remarks">{rows}</div>')


def miss(found: TipMiss, exact: IKResult) -> str:
    """Write a tip error along x, y and z, and that of the calibrated arm's own posture."""
    parts = "".join(f"<td>{1000 * value:+.1f} mm</td>" for value in found.vector)
    own = f"no posture: {escape(exact.reason)}"
    if exact.success:
        turned = degrees(np.abs(exact.q - found.q).max())
        own = f"{escape(length(exact.position_error))} off; it turns a joint by up to {turned:.1f}°"
    return block(
        f'<table class="kinreach-miss"><tr><th>x</th><th>y</th><th>z</th></tr><tr>{parts}</tr></table>'
        f'<div class="kr-small">The calibrated arm\'s own posture: {own}.</div>'
    )


def scale(colours: NDArray[np.uint8], least: str, most: str, title: str) -> str:
    """Draw the colours of a map, RGBA of shape (k, 4), with their meaning."""
    stops = ",".join(css(colour) for colour in colours[:, :3].tolist())
    return block(
        f'<div class="kr-small">{escape(title)}</div><div class="kr-line" style="font-size:12px">{escape(least)}'
        f'<div class="kr-track" style="background:linear-gradient(to right,{stops})"></div>{escape(most)}</div>'
    )


def small(text: str) -> str:
    return block(f'<span class="kr-small">{escape(text)}</span>')


def code(text: str) -> str:
    return block(
        f'<button class="kr-copy" data-copy="{escape(text)}">Copy</button>'
        f'<pre class="kinreach-code">{escape(text)}</pre>'
    )
