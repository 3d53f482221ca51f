"""The documentation agrees with the code: paths, names, links and commands in it exist, and its Python code runs.

That the pages build without a warning is `make docs`.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from kinreach.cli import main
from kinreach.robots import get_arm
from notebooks import figures

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TOP = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
SOURCE = "\n".join(
    path.read_text(encoding="utf-8")
    for room in ("kinreach", "notebooks", "benchmarks/learners", "benchmarks/logs")
    for path in (ROOT / room).rglob("*.py")
)
#: `kinreach compare ...` or `python -m kinreach.compare ...`, up to the end of the line or of the code in it.
COMMANDS = "compare|check|demonstrate|demo|evaluate|ik|kinematics|move|simulate-ur|train|view"
COMMAND = rf"(?:python -m kinreach\.|(?<![\w/-])kinreach )({COMMANDS})\b([^`\n]*)"
NARROW = ("guides", "environments")
ENVIRONMENT = re.compile(r"kinreach/\w+-v\d")


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def blocks(path: Path) -> str:
    """The Python code of a page as one session, as a reader would type it."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", read(path), re.DOTALL | re.MULTILINE))


@pytest.fixture(scope="module")
def text() -> str:
    return "\n".join(map(read, (*PAGES, *TOP)))


def test_nothing_is_fetched_to_show_a_page(text):
    """Neither by a page nor by what Sphinx adds to it; `make docs` refuses a page that no table of contents has."""
    assert not re.findall(r"<script|!\[[^\]]*\]\(http|src=\"http", text)
    settings = read(DOCS / "conf.py")
    assert 'html_math_renderer = "mathml"' in settings
    assert "nb_ipywidgets_js = {}" in settings
    assert 'nb_execution_mode = "off"' in settings
    assert re.findall(r'"_inventories/', settings)


def test_the_built_pages_fetch_nothing(root):
    """Scripts, styles, fonts and pictures are files beside the pages."""
    pages = [path for path in (root / "build/docs").rglob("*") if path.suffix in (".html", ".css")]
    if not pages:
        pytest.skip("`make docs` has not been run")
    fetched = re.compile(
        r"""<(?:script|img|iframe)[^>]*\ssrc="(?:https?:)?//|<link[^>]*rel="(?!canonical|next|prev)[^>]*href="(?:https?:)?//|url\(["']?(?:https?:)?//|@import"""
    )
    assert [path.name for path in pages if fetched.search(read(path))] == []
    assert len(pages) >= 50


def test_docstrings_and_tables_in_the_reference(root, monkeypatch):
    """What `docs/_site.py` makes of Markdown in docstrings, and which cells it takes for numbers."""
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(DOCS)
    site = importlib.import_module("_site")
    lines = [
        "Pay |d|.",
        "",
        "## Terms",
        "| a | b |",
        "|---|---|",
        "| 1 | 2 |",
        "",
        "As in:",
        "",
        "    r = |d|",
        "",
        "Args:",
    ]
    site._from_markdown(None, "function", "", None, None, lines)
    text = "\n".join(lines)
    assert "Pay \\|d\\|." in text
    assert (
        ".. rubric:: Terms\n\n.. list-table::\n   :header-rows: 1\n\n   * - a\n     - b\n   * - 1\n     - 2\n" in text
    )
    assert "As in:\n\n::\n\n    r = |d|\n\nArgs:" in text
    numbers = ("0.04", "1.2 / 3.4", "97.5 % [91.8, 100.0]", "−3", "< 1e-9 mm", "15 000", "26 µs", "−π")
    assert [text for text in numbers if not site.NUMBER.match(text)] == []
    assert [text for text in ("1 of 5 seeds reach", "2026 or later, if ever", "x") if site.NUMBER.match(text)] == []
    commands = (
        '<div class="highlight-bash"><pre>kinreach<span class="w"> </span>ik<span class="w"> </span>--arm ur5e</pre>'
    )
    context = {"body": commands + "<p>--arm</p>"}
    site._whole_words(None, "", "", context, None)
    whole = commands.replace("--arm", '<span class="whole">--arm</span>')
    assert context["body"] == whole + "<p>--arm</p>"
    nodes = importlib.import_module("docutils.nodes")
    headings, row = (
        [nodes.entry("", nodes.paragraph("", "", part)) for part in parts]
        for parts in ([nodes.Text("a"), nodes.math("", r"\alpha"), nodes.Text("b")], [nodes.Text("w" * 30)] * 3)
    )
    site._stack(nodes.table(), [headings, row])
    assert [type(cell[0][0]).__name__ for cell in row[1:]] == ["math", "Text"]


def sentences(text: str) -> Iterator[str]:
    """What a page says, without code, tables, headings and targets of links; code in a line counts as a word."""
    text = re.sub(r"^```.*?^```|^:::.*?$|^---$|^(?:    |\||#|!\[).*?$", "\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"`[^`]*`", "code", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text))
    for paragraph in re.split(r"\n\s*\n|^\s*(?:[-*]|\d+\.) ", text, flags=re.MULTILINE):
        yield from re.split(r"(?<=[.!?:])\*{0,2}\s+", " ".join(paragraph.split()))


def test_sentences_are_short():
    """Of what users read: at most 30 words."""
    pages = [TOP[0], *(DOCS / f"{name}.md" for name in ("index", "start"))]
    pages += [path for room in ("guides", "environments", "studies") for path in (DOCS / room).rglob("*.md")]
    said = [(page.name, sentence) for page in pages for sentence in sentences(read(page))]
    assert len(said) >= 800
    assert [(page, text) for page, text in said if len(re.findall(r"[^\s]*\w[^\s]*", text)) > 30] == []


def test_pages_are_short():
    """What they say, without code and tables: all, and those that are no measurements."""
    measured = re.findall(r"^(?:reference|studies)/[\w/]+$", read(DOCS / "measurements.md"), re.MULTILINE)
    measured = {DOCS / "measurements.md", *(DOCS / f"{name}.md" for name in measured)}
    assert len(measured) >= 20
    said = {page: sum(len(sentence.split()) for sentence in sentences(read(page))) for page in PAGES}
    assert 25_000 < sum(said.values()) <= 36_000
    users = [page for page in PAGES if page not in measured]
    assert 8_000 < sum(said[page] for page in users) <= 13_500


#: Files of earlier commits, with the commit.
EARLIER = re.compile(r"`([\w/.-]+)`(?: and `([\w/.-]+)`)? of\s+commit\s+([0-9a-f]{8})")


def test_commits_have_the_files_that_pages_name():
    """Where git has the history, which an archive and a shallow clone have not."""
    named = [(*found[:2], found[2]) for page in PAGES for found in EARLIER.findall(read(page))]
    assert len(named) >= 4
    for *paths, commit in named:
        if subprocess.run(["git", "cat-file", "-e", commit], cwd=ROOT, capture_output=True, check=False).returncode:
            pytest.skip(f"git does not know the commit {commit}")
        for path in filter(None, paths):
            subprocess.run(["git", "cat-file", "-e", f"{commit}:{path}"], cwd=ROOT, check=True)


def test_paths_exist(text):
    text = EARLIER.sub("", text)
    paths = set(re.findall(r"`((?:kinreach|tests|notebooks|docs|benchmarks|examples)/[\w/.-]*)`", text))
    paths |= set(re.findall(r"(?:python|pytest) ((?:[\w./-]+\.py ?)+)", text.replace("`", " ")))
    names = {name for path in paths for name in path.split() if not ENVIRONMENT.fullmatch(name)}
    missing = [name for name in sorted(names) if not (ROOT / name).exists() and not (ROOT / f"{name}.py").exists()]
    assert missing == []
    assert len(names) >= 60


def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings, as the site makes them."""
    heads = re.findall(
        r"^#+ (.+)$", re.sub(r"^```.*?^```", "", read(path), flags=re.DOTALL | re.MULTILINE), re.MULTILINE
    )
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head) for head in heads)
    return {re.sub(r"[^\w -]", "", head).strip().lower().replace(" ", "-") for head in plain}


def test_the_clients_are_those_that_are_run(root):
    """Versions as installed, and every script."""
    page = (root / "docs/guides/training.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \| ([\d., ]+) \| [^|]+ \| [^|]+ \| `(\w+\.py)` \|$", page, re.MULTILINE)
    installed = (root / "tools/clients/requirements.txt").read_text(encoding="utf-8") + (root / "Makefile").read_text()
    pins = {name.lower().replace("_", "-"): version for name, version in re.findall(r"(\w+)==([\d.]+)", installed)}
    said = [pair for names, versions, _ in rows for pair in zip(names.split(", "), versions.split(", "), strict=True)]
    assert len(said) == 9
    assert {name: pins[name.lower()] for name, _ in said} == dict(said)
    scripts = {path.name for path in (root / "tools/clients").glob("*.py")}
    assert {script for *_, script in rows} == scripts


def test_links_lead_somewhere():
    checked, dead = 0, []
    for page in (*PAGES, *TOP, ROOT / "CHANGELOG.md"):
        for target in re.findall(r"\]\(([^)\s]+)\)|^\[[^]^]+\]: (\S+)$", read(page), re.MULTILINE):
            target = target[0] or target[1]
            if target.startswith("https://"):
                continue
            name, _, anchor = target.partition("#")
            file = (page.parent / name).resolve() if name else page
            if not file.exists() or (anchor and anchor not in anchors(file)):
                dead.append(f"{page.name}: {target}")
            checked += 1
    assert dead == []
    assert checked >= 80


def test_commands_exist(text):
    modules = set(re.findall(r"python -m ([\w.]+)", text))
    assert [name for name in sorted(modules) if importlib.util.find_spec(name) is None] == []
    assert modules >= {"kinreach.compare", "kinreach.train", "kinreach.evaluate", "kinreach.demo", "benchmarks.speed"}
    targets = set(re.findall(r"^ *make ([a-z-]+)|`make ([a-z-]+)", text, re.MULTILINE))
    known = set(re.findall(r"^([a-z-]+):", read(ROOT / "Makefile"), re.MULTILINE))
    assert {name for pair in targets for name in pair if name} <= known
    assert len(targets) >= 5


def test_options_exist(text, capsys):
    """Every option that a page gives to one of the package's commands is in its help."""

    @cache
    def options(command: str, *task: str) -> set[str]:
        with pytest.raises(SystemExit):
            main([{"kinematics": "check"}.get(command, command), *task, "--help"])
        return set(re.findall(r"--[a-z-]+", capsys.readouterr().out))

    def task_of(rest: str) -> tuple[str, ...]:
        found = re.search(r"--task (?!my_|examples\.|TASK)([\w-]+)", rest)
        return ("--task", found[1]) if found else ()

    found = [
        (command, task_of(rest) if command == "compare" else (), option)
        for command, rest in re.findall(COMMAND, re.sub(r"\\\n *", " ", text), re.MULTILINE)
        for option in re.findall(r"(?<= )--[a-z-]+", rest.partition("  #")[0])
    ]
    assert [given for given in found if given[2] not in options(given[0], *given[1])] == []
    assert len(found) >= 20


def test_figures_of_the_thesis_have_functions():
    names = set(re.findall(r"`(?:figures\.)?(draw_\w+)`", read(DOCS / "studies/appendix/thesis_points.md")))
    assert [name for name in sorted(names) if not hasattr(figures, name)] == []
    assert len(names) >= 10


def test_every_point_of_the_thesis_has_a_verdict():
    """Claims, figures and the outlook: shown, differs because of something that is said, or open."""
    text = read(DOCS / "studies/appendix/thesis_points.md")
    tables = re.findall(r"^\| (.*) \|\n\|(?:---\|)+\n((?:\|.*\|\n)+)", text, re.MULTILINE)
    assert len(tables) == len(re.findall(r"^\|(---\|)+$", text, re.MULTILINE)) >= 10
    judged = [rows for heading, rows in tables if heading.endswith("| verdict")]
    assert judged == [rows for _, rows in tables]
    said = [row.strip("| ").rpartition(" | ")[2] for rows in judged for row in rows.splitlines()]
    assert [one for one in said if not re.match(r"(shown|open)\b|differs because ", one)] == []
    assert len(said) >= 90
    rows = re.findall(r"^\| (.*?) \|", text.partition("## Figures")[2], re.MULTILINE)
    figures = {(2, 5), (3, 8), (5, 6), (6, 2)}
    wanted = {f"{chapter}.{number}" for chapter, count in figures for number in range(1, count + 1)}
    assert set(re.findall(r"\b\d\.\d\b", " ".join(rows))) == wanted


@pytest.mark.slow
def test_names_in_the_points_exist():
    """The column "where" names what the package, figures or logs define, a file of the package, or a notebook."""
    files = {path.name for path in ((ROOT / "kinreach").rglob("*.py"))} | {
        p.stem for p in (ROOT / "notebooks").iterdir()
    }
    missing, checked = [], 0
    lines = cache(lambda name: [line for line in SOURCE.splitlines() if name in line])
    for page in ("studies/appendix/thesis_points.md", "studies/report.md"):
        for row in re.findall(r"^\| .*\|$", read(DOCS / page), re.MULTILINE):
            where = row.split(" | ")[1] if row.count(" | ") >= 2 else ""
            for name in re.findall(r"`(?!python )(?:figures\.|ARM\.)?([\w-]+(?:\.py)?)\b[^`/]*`", where):
                defined = rf"^[ \t]*(?:def|class) {name}\b|^[ \t]*{name}[ \t]*[:=]|[\"']?{name}[\"']?=|[\"']{name}[\"']"
                known = name in files or f"_{name}" in files or any(re.search(defined, line) for line in lines(name))
                missing += [] if known else [f"{page}: {name}"]
                checked += 1
    assert missing == []
    assert checked >= 40


def test_sizes_of_the_thesiss_gripper_are_those_of_the_value():
    """Wherever prose gives one of them."""
    gripper = get_arm("ur5-thesis").gripper
    stroke, half = f"{gripper.stroke:.2f} m", f"{gripper.stroke / 2:.2f} m"
    force, length = f"{gripper.force:.0f} N", f"{gripper.length:.2f} m"
    env, closing = read(ROOT / "kinreach/envs/_lift/env.py"), "opening to which the fingers close"
    for text, wanted in (
        (read(DOCS / "studies/appendix/thesis_points.md"), f"its {1000 * gripper.stroke:.0f} mm stroke"),
        (read(DOCS / "studies/appendix/thesis_points.md"), f"between the finger tips, {length} in front of the flange"),
        (read(DOCS / "environments/lift.md"), f"{closing}, from 0 to {stroke} | −1 | 1 | {half}"),
        (env, f"{closing} | -1 (0 m) | 1 ({stroke}) | {half} |"),
        (env, f"the fingers open by {gripper.opening:.2f} m;"),
        (env, f"that it is held off by, {force} at most"),
    ):
        assert wanted in " ".join(text.split()), wanted


def test_the_reference_lists_every_name():
    checked = 0
    for page in sorted((DOCS / "reference/api").glob("[!i]*.md")):
        package = importlib.import_module(f"kinreach.{page.stem}")
        listed = re.findall(r"^\.\. (?:auto)?(?:class|data|exception|function):: (\w+)$", read(page), re.MULTILINE)
        names = getattr(package, "__all__", [name for name in vars(package) if name.endswith("Error")])
        assert sorted(listed) == sorted(names), page.stem
        checked += len(listed)
    assert 70 <= checked <= 145  # errors included


FACES = (
    "kinreach", "kinreach.baselines", "kinreach.compare", "kinreach.deploy", "kinreach.envs", "kinreach.errors",
    "kinreach.kinematics", "kinreach.plots", "kinreach.robots", "kinreach.sim", "kinreach.thesis",
    "kinreach.view", "kinreach.vision",
)  # fmt: skip


def programs() -> Iterator[tuple[str, str]]:
    """All Python code that is written for users, with its file."""
    for page in (*PAGES, *TOP):
        for code in re.findall(r"^```python\n(.*?)^```", read(page), re.DOTALL | re.MULTILINE):
            yield page.name, code
    for file in (*(ROOT / "examples").glob("*.py"), *(ROOT / "notebooks/figures").glob("*.py")):
        yield file.name, read(file)
    for file in (ROOT / "notebooks").glob("*.ipynb"):
        for cell in json.loads(read(file))["cells"]:
            if cell["cell_type"] == "code":
                yield file.name, "".join(line for line in cell["source"] if not line.startswith(("%", "!")))


def test_users_import_from_faces():
    """And only what a face exports: pages, examples, notebooks with their figures, and CONTRIBUTING."""
    wrong, names = [], set()
    for file, code in programs():
        for node in ast.walk(ast.parse(code)):
            imported = set()
            if isinstance(node, ast.Import):
                imported = {(alias.name, "") for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported = {(node.module, alias.name) for alias in node.names}
            for module, name in {pair for pair in imported if pair[0].split(".")[0] == "kinreach"}:
                if module not in FACES or (name and name not in importlib.import_module(module).__all__):
                    wrong.append(f"{file}: {module} {name}")
                names.add((module, name))
    assert wrong == []
    assert {module for module, _ in names} >= set(FACES) - {"kinreach.errors", "kinreach.envs"}
    assert len(names) >= 65


def test_faces_export_what_a_page_or_an_example_uses():
    """The reference, which lists every name, does not count."""
    pages = [read(page) for page in (*PAGES, *TOP) if page.parent.name != "api" and page.stem != "changelog"]
    words = set(re.findall(r"\w+", "\n".join([*pages, *(code for _, code in programs())])))
    exported = {
        f"{face}.{name}": name for face in FACES[1:] for name in getattr(importlib.import_module(face), "__all__", ())
    }
    assert [path for path, name in exported.items() if name not in words] == []
    assert 70 <= len(exported) <= 127


def test_code_is_narrow():
    """At most 88 columns in what users read, examples included, and 98 in what notebooks print."""
    pages = [
        DOCS / "start.md",
        DOCS / "index.md",
        *(page for page in PAGES if page.parent.name in NARROW),
        ROOT / "README.md",
    ]
    wide, lines = [], 0
    for page in pages:
        for code in re.findall(r"^```(?:python|bash)\n(.*?)^```", read(page), re.DOTALL | re.MULTILINE):
            wide += [f"{page.name}: {line}" for line in code.splitlines() if len(line) > 88]
            lines += len(code.splitlines())
    for file in (ROOT / "notebooks").glob("*.ipynb"):
        for cell in json.loads(read(file))["cells"]:
            if cell["cell_type"] == "code":
                code = "".join(cell["source"]).splitlines()
                printed = "".join("".join(output.get("text", "")) for output in cell["outputs"]).splitlines()
                wide += [f"{file.name}: {line}" for line in code if len(line) > 88]
                wide += [f"{file.name}: {line}" for line in printed if len(line) > 98]
                lines += len(code)
    assert wide == []
    assert lines >= 1500


def test_every_example_is_on_the_page():
    """With a link for readers of the sources; the site puts the code there."""
    page = read(DOCS / "guides/examples.md")
    shown = re.findall(r"^\[`python (.*?)`\]\(\.\./\.\./(.*?)\)\n\n```text\n.+?^```", page, re.DOTALL | re.MULTILINE)
    assert [pair for pair in shown if pair[0] != pair[1]] == []
    assert {name for name, _ in shown} == {f"examples/{path.name}" for path in (ROOT / "examples").glob("*.py")}
    assert len(shown) >= 10


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        "environments/obstacles",
        "environments/real_arm",
        "environments/reach",
        "guides/any_arm",
        "guides/moving_a_robot",
        "guides/your_ur",
        "index",
        "start",
        "guides/own_method",
        "guides/own_task",
        "guides/viewer",
    ],
)
def test_the_code_of_a_page_runs(page, capsys):
    code = blocks(DOCS / f"{page}.md")
    assert len(code.splitlines()) >= 4
    exec(compile(code, page, "exec", dont_inherit=True), {"__name__": "__main__"})
    printed = capsys.readouterr().out
    assert printed
    shown = re.findall(
        r"^```python\n.*?^```\n\n```text\n(.*?)^```", read(DOCS / f"{page}.md"), re.DOTALL | re.MULTILINE
    )
    assert [text for text in shown if text not in printed] == []


@pytest.mark.usefixtures("needs_gl")
@pytest.mark.slow
def test_the_code_of_the_page_on_seeing_runs(capsys):
    exec(compile(blocks(DOCS / "guides/seeing.md"), "seeing", "exec"), {"__name__": "seeing"})
    assert "[ True  True]" in capsys.readouterr().out


@pytest.mark.slow
def test_the_code_of_the_page_on_training_runs(capsys, tmp_path, monkeypatch):
    pytest.importorskip("onnx"), pytest.importorskip("onnxruntime")
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", "ranked-single", "--export", "single.onnx"]) == 0  # as on the page
    exec(compile(blocks(DOCS / "guides/training.md"), "training", "exec"), {"__name__": "training"})
    assert "(1, 6) kinreach/UR5SingleStep-v0" in capsys.readouterr().out


@pytest.mark.slow
def test_policies_off_the_table_do_what_the_page_says(capsys):
    page = DOCS / "studies/appendix/trainings.md"
    exec(compile(blocks(page), "trainings", "exec"), {"__name__": "trainings"})
    measured = dict(re.findall(r"^([\w-]+ 0\.0\d?) ([\d.]+) \(", capsys.readouterr().out, re.MULTILINE))
    checked = 0
    for name, *said in re.findall(
        r"^\| `([\w-]+)` \| (\d+) % \[.*\] \| (\d+) % \[.*\] \| (\d+) % \[.*\] \|$", read(page), re.MULTILINE
    ):
        for height, share in zip(("0.0", "0.01", "0.02"), said, strict=True):
            assert 100 * float(measured[f"{name} {height}"]) == pytest.approx(float(share), abs=1)
            checked += 1
    assert checked == 9


@pytest.mark.slow
def test_what_contributing_promises_holds(run_python):
    """An arm, a solver, a reward and a task from outside the package."""
    code, _, _ = blocks(ROOT / "CONTRIBUTING.md").partition("from kinreach.baselines import")
    checks = """
by_name = {row["name"]: row for row in results["methods"]}
assert set(by_name) == {"lm", "PseudoInverse"}, by_name
assert all(row["reached"] == 1 for row in by_name.values()), by_name
assert line["methods"][0]["reached"] == 1, line
env.reset(seed=0)
_, paid, _, _, info = env.step(env.action_space.sample())
assert paid == sum(info["reward_terms"].values()) < 0, paid
"""
    done = run_python("-c", code + checks)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_an_algorithm_as_contributing_adds_it(run_python):
    _, begin, code = blocks(ROOT / "CONTRIBUTING.md").partition("from kinreach.baselines import")
    checks = """
from kinreach.baselines import evaluate, load_policy, train
train(recipe, "run", seed=0)
policy = load_policy("run/policy.safetensors")
assert [weight.shape[0] for weight, _ in policy.network.layers] == [32, 32, 6]
assert len(evaluate(policy, goals=10).trials) == 10
"""
    done = run_python("-c", begin + code + checks)
    assert done.returncode == 0, done.stderr
