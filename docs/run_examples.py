"""Put the code of examples, and what they print, into `docs/guides/examples.md`.

    python docs/run_examples.py              # runs all of them
    python docs/run_examples.py 09_seeing    # runs some; the code of all is put there
    python docs/run_examples.py none         # runs none

They run in a folder of their own; pictures that they write to `results` go to `docs/images`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "guides/examples.md"


def run(name: str) -> str:
    """What an example prints; its pictures are kept."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", str(ROOT / "examples" / f"{name}.py")],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        for picture in Path(folder, "results").glob("*.[jp][pn]g"):
            shutil.copy(picture, ROOT / "docs" / "images" / picture.name)
    return done.stdout


def main(names: list[str]) -> None:
    """Replace the code of every example that the page shows, and the output of those that are named."""
    page = PAGE.read_text(encoding="utf-8")
    shown = re.findall(r"`python examples/(\w+)\.py`", page)
    for name in shown:
        place = re.compile(
            rf"(`python examples/{name}\.py`\n\n```python\n)(.*?)(^```\n\n```text\n)(.*?)(^```)",
            re.DOTALL | re.MULTILINE,
        )
        code = (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8")
        output = None
        if name in (names or shown):
            print(name, flush=True)
            output = run(name)
        page, found = place.subn(
            lambda match, code=code, output=output: (
                f"{match[1]}{code}{match[3]}{match[4] if output is None else output}{match[5]}"
            ),
            page,
        )
        if not found:
            raise SystemExit(f"{PAGE.name} has no blocks for the code and the output of {name} after its command")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
