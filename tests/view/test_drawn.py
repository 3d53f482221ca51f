"""What the page shows stays: inputs with their limits, texts, and everything that is drawn, with colours and sizes.

Each is a list in tests/data/page; what is new needs no line there. `KINREACH_KEEP=1 pytest tests/view/test_drawn.py`
keeps what there is now; its change in git is to be read before it is committed.
"""

import hashlib
import os
import re
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser")

from benchmarks.studies.tab import Tab
from kinreach.robots import PUBLISHED_CALIBRATIONS
from kinreach.view._cli import setup_of
from kinreach.view._server import Server

KEPT = Path(__file__).parents[1] / "data" / "page"
#: For what is drawn to arrive [s].
PATIENCE = 20.0
#: What viser adds to everything.
USUAL = {
    "scale": 1.0, "cast_shadow": True, "receive_shadow": True, "wireframe": False, "opacity": None, "visible": True,
    "flat_shading": False, "material": "standard", "disabled": False, "hint": None, "show_axes": False,
    "axes_length": 0.5, "axes_radius": 0.025, "origin_radius": 0.05, "origin_color": [236, 236, 0], "_marks": None,
    "_icon_html": None, "_hold_callback_freqs": [], "color": None,
}  # fmt: skip


def said(value):
    if isinstance(value, np.ndarray | list | tuple):
        numbers = np.asarray(value).ravel() if len(value) and not isinstance(value[0], str) else None
        if numbers is not None and numbers.dtype.kind in "iuf" and len(numbers) > 8:
            rest = np.array([numbers.mean(), np.abs(numbers).max(), numbers.std()], dtype=float)
            return f"{len(numbers)} numbers {said(rest.tolist())}"
        return f"[{', '.join(map(said, value))}]"
    if isinstance(value, float | np.floating):
        return f"{round(float(value), 2) + 0.0:g}"
    return hashlib.sha256(value).hexdigest()[:8] if isinstance(value, bytes) else repr(value)


def listed(tab):
    """Return elements and nodes, a line each; numbers that are measured, or that move, are left out."""
    elements, lines = tab.elements, []
    for element in sorted(elements.values(), key=lambda one: one.get("order", 0)):
        own = {key: each for key, each in element.items() if key not in ("uuid", "order", "container")}
        inside = elements.get(element["container"], {})
        parts = [f"{key}={said(each)}" for key, each in own.items() if USUAL.get(key, ...) != each]
        lines.append(f"{inside.get('label') or 'page'}: {' '.join(parts)}")
    for name, node in sorted(tab.nodes.items()):
        moves = ("owner", *(("position", "wxyz") if name.startswith("/episodes") else ()))
        parts = [f"{key}={said(each)}" for key, each in node.items() if key not in moves]
        lines.append(f"{name}: {' '.join(part for part in parts if part not in ALWAYS)}")
    lines.append(f"theme: {said([*map(str, tab.theme.items())])}")
    return [re.sub(r"\d+(\.\d+)?(e-\d+ mm| ms| µs| s\b)", "#\\2", line) for line in lines]


ALWAYS = {f"{key}={said(each)}" for key, each in USUAL.items()}


def solve(tab):
    tab.set("Solve", True)


def go_too_far(tab):
    tab.set("x y z [m]", [1.5, 0.0, 0.2])


def ask_for_a_direction(tab):
    tab.set("asks for", "position and direction")
    tab.set("ghosts", "all")


@pytest.mark.parametrize(
    ("arm", "calibration", "done"),
    [
        ("ur5", "ur5_a", [solve, go_too_far]),
        ("arm3", None, [go_too_far]),
        ("panda", None, []),
        ("ur10e", None, [ask_for_a_direction]),
    ],
)
def test_the_page_is_as_it_was(arm, calibration, done):
    file = calibration and str(PUBLISHED_CALIBRATIONS[calibration])
    server = Server(setup_of(arm, simple=True, calibration=file), port=8600)
    with Tab(server) as tab:
        for part in reversed(tab.page.names):
            tab.page.show(part)
        before = check(tab, KEPT / f"{arm}.txt", [])
        for act in done:
            act(tab)
            check(tab, KEPT / f"{arm}_{act.__name__}.txt", before)
    server.stop()


def check(tab, path, before):
    """Compare with what is kept, without the lines there were before; keep it where that is asked for."""
    if os.environ.get("KINREACH_KEEP"):
        path.parent.mkdir(exist_ok=True)
        time.sleep(8.0)
        path.write_text("\n".join(line for line in listed(tab) if line not in before) + "\n", encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    deadline = time.monotonic() + PATIENCE
    while gone := set(kept).difference(lines := listed(tab)):
        assert time.monotonic() < deadline, f"if it is meant, KINREACH_KEEP=1 pytest tests/view/test_drawn.py: {gone}"
        time.sleep(0.05)
    return lines
