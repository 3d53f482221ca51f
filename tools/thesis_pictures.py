"""The thesis's figures as pictures for docs/studies/thesis.md: `python -m tools.thesis_pictures`, a minute of one core.

Each is the figure in which a notebook's cell ends. The cells before it are run as they stand.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

from kinreach.cli import Parser, finish

PROG = "python -m tools.thesis_pictures"
ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs/images/thesis"
#: Pixels.
WIDTH = 1400
#: Width of the figures whose words a phone shows at a readable size [inches].
NARROW, PHONE = ("3.8", "5.1", "5.2", "5.3", "5.4", "5.5", "5.6"), 6.4
#: Width and height of those whose panels stand below each other, for the same reason [inches].
STACKED = {"2.4-2.5": (5.2, 6.6), "3.4": (5.0, 9.2), "3.5-3.7": (3.8, 10.2), "6.1": (5.6, 7.6)}
#: Notebook, then the figure's number in the thesis and what only the code of its cell has.
PICTURES = {
    "01_reward_geometry": {
        "2.2": "draw_named_places(",
        "3.2-3.3": "draw_pictures(",
        "3.4": "draw_pentagons(",
        "3.5-3.7": 'title="Branch A"',
        "3.8": "draw_distance_reward(",
        "2.4-2.5": "draw_clipped_objective(",
    },
    "02_seeing": {"3.1": "(figure 3.1)"},
    "03_single_step": {"5.1": "(figure 5.1)", "5.2": "(figure 5.2)"},
    "04_multi_step": {
        "5.3": "(figure 5.3)",
        "5.4": "(figure 5.4)",
        "5.5": "(figure 5.5)",
        "5.6": "(figure 5.6)",
        "6.1": "(figure 6.1)",
        "6.2": '(figure 6.2)"',
    },
}


def figures_of(notebook: Path, wanted: dict[str, str]) -> dict[str, Figure]:
    """Run a notebook until it has drawn these figures."""
    names: dict[str, Any] = {"__name__": notebook.stem, "display": lambda *_: None}
    found: dict[str, Figure] = {}
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code" or len(found) == len(wanted):
            continue
        code = "".join(line for line in cell["source"] if not line.startswith("%"))
        tree = ast.parse(code)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        with contextlib.redirect_stdout(io.StringIO()):
            exec(compile(tree, notebook.name, "exec"), names)
            value = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names) if last else None
        found |= {number: value for number, text in wanted.items() if text in code and number not in found}
    return found


def stack(figure: Figure, size: tuple[float, float]) -> None:
    """Put the panels below each other."""
    places = figure.add_gridspec(len(figure.axes), 1)
    for panel, place in zip(figure.axes, places, strict=True):
        panel.set_subplotspec(place)
    figure.set_size_inches(*size)


def save(figure: Figure, file: Path) -> None:
    """With a palette, which a picture of few colours does not show."""
    whole = io.BytesIO()
    figure.savefig(whole, format="png", dpi=WIDTH / figure.get_figwidth())
    Image.open(whole).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)


def main(argv: list[str] | None = None) -> int:
    """Save the figures of the thesis that notebooks draw."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=IMAGES, help="folder of the pictures")
    folder = parser.parse_args(argv).out.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    sys.path.insert(0, str(ROOT / "notebooks"))
    os.chdir(ROOT / "notebooks")
    for name, wanted in PICTURES.items():
        for number, figure in figures_of(ROOT / "notebooks" / f"{name}.ipynb", wanted).items():
            if number in NARROW:
                figure.set_figwidth(PHONE)
            if number in STACKED:
                stack(figure, STACKED[number])
            save(figure, folder / f"{number}.png")
            print(folder / f"{number}.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
