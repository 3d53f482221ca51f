"""What `kinreach.baselines` exports."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from kinreach import baselines

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/*.py"), *ROOT.glob("notebooks/*.ipynb"),
    *ROOT.glob("tools/clients/*.py"),
]  # fmt: skip


def test_every_name_is_there_and_a_page_or_an_example_has_it():
    text = "\n".join(path.read_text(encoding="utf-8") for path in PAGES)
    for name in baselines.__all__:
        assert getattr(baselines, name) is not None
        assert re.search(rf"\b{name}\b", text), name
    assert len(baselines.__all__) > 10


def test_pages_and_examples_import_from_here_alone():
    imports = 0
    for path in PAGES:
        if path.is_relative_to(ROOT / "docs/reference/api"):
            continue  # describes what a face's functions return, too
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r"kinreach\.baselines\.(\w+)", text)) <= set(baselines.__all__), path
        imports += text.count("from kinreach.baselines import")
    assert imports > 10


@pytest.mark.slow
def test_a_policy_acts_without_torch(run_python):
    code = (
        "import sys, kinreach.baselines as b\n"
        "before = len([name for name in sys.modules if name.startswith('kinreach.baselines.')])\n"
        "b.load_policy('ranked-single'), b.rollout, b.evaluate, b.get_recipe('ranked-single')\n"
        "print(before, sorted({'torch', 'stable_baselines3'} & set(sys.modules)))"
    )
    done = run_python("-c", code)
    assert done.stdout.strip() == "0 []", done.stderr


def test_a_missing_extra_is_named_in_one_line(run_python):
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "try:\n    from kinreach.baselines import train\n"
        "except ImportError as error:\n    print(type(error).__name__, error)"
    )
    done = run_python("-c", code)
    assert done.stdout.strip() == "InstallationError train needs torch: pip install 'kinreach[train]'", done.stderr
