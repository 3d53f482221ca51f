"""What the README shows works as it stands there."""

import json
import re
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.compare import get_task
from kinreach.kinematics import URKinematics
from tools.readme_film import COMMAND

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
TRAINING = "docs/studies/appendix/trainings.md"
DATA = "docs/studies/appendix/data"
LATE = "docs/studies/appendix/learning_pays_tables.md"
#: Every sentence of README that has a number, with the files and the numbers in them that it rests on. The tables are
#: measured again by tests of their own. Whoever changes one of the two has to look at the other.
CLAIMS = {
    "Python 3.11 to 3.14, Linux, MIT licence.": [
        ("pyproject.toml", 'requires-python = ">=3.11"'),
        ("pyproject.toml", '"Programming Language :: Python :: 3.14"'),
        ("LICENSE", "MIT License"),
    ],
    "It knows 14 UR models, calibrations, tools and pendant frames": [
        ("tests/kinematics/test_ur_family.py", "len(rows) == len(UR_LENGTHS) >= 14"),
    ],
    "`python -m benchmarks.speed`; medians, one thread": [
        ("docs/reference/benchmarks.json", '"command": "python -m benchmarks.speed"'),
        ("docs/reference/benchmarks.md", "on one thread unless a row says otherwise"),
    ],
    "`make compare` puts ten methods on 200 goals on a table, in MuJoCo;": [
        ("tests/test_readme.py", "assert best == "),
    ],
    "Four of the ten (`python -m kinreach.compare --task ur5 --goals 200 --seed 0`):": [
        ("tests/test_studies.py", "def test_the_table_is_what_its_command_measures"),
    ],
    "learned methods the best of five trainings.": [
        (
            TRAINING,
            "Of the five seeds these had the smallest median distance on the validation goals: `ranked-single` 4, "
            "`ranked-multi` 0, `ppo-single` 3, `ppo-multi` 2, `thesis-ppo-single` 3",
        ),
    ],
    "less than 10 mm off, gripper straight down": [("kinreach/thesis/_reward.py", "REACHED_DISTANCE = 0.01")],
    "the closed form takes any goal, exact to 5e-9 mm;": [
        ("tests/test_readme.py", "def test_how_exact_the_closed_form_is"),
    ],
    "`ranked-single` learns one table in a minute": [
        (
            f"{DATA}/trained.csv",
            '`ranked-single`,5,"100.00 [99.96, 100.00]",100.00,"0.192 [0.159, 0.225]",0.398,99.99,100.00',
        ),
        (f"{DATA}/trained.csv", "100.00,0.215,1,43–45"),
        (TRAINING, "| `ranked-single` | 100 % [99, 100] | 6 % [4, 8] | 0 % [0, 1] |"),
    ],
    "With a wrong model and five looks, least squares leaves 0.21 mm, a learned correction 0.22.": [
        (f"{DATA}/real-arm.csv", '`identified`,"5.90 [4.55, 7.31]","0.21 [0.20, 0.23]"'),
        (f"{DATA}/real-arm.csv", '`correction-joints`,"5.90 [4.55, 7.31]","0.22 [0.21, 0.24]"'),
        (f"{DATA}/real-arm.csv", '`policy-tuned`,"6.57 [5.57, 7.16]","0.73 [0.66, 0.80]"'),
        (f"{DATA}/real-arm.csv", '`policy-informed`,"5.88 [4.23, 7.06]","1.05 [0.92, 1.15]"'),
    ],
    "networks touch nearly as many as planners while the arm may wait, in 0.2 ms.": [
        (
            "docs/studies/learning_pays.md",
            "| `interception` | 100.0 [98.7, 100.0] | 100.0 [98.7, 100.0] | 99.3 [97.6, 99.8] | 90.7 ",
        ),
        (
            "docs/studies/learning_pays.md",
            "mean of five trainings | 99.9 [98.1, 100.0] | 99.3 [96.8, 100.0] | 95.3 [83.3, 100.0] | 81.1 ",
        ),
        (f"{DATA}/late-map.csv", '0.30,200,0.4,1,count,"91.7 [84.4, 95.7]","92.7 [85.7, 96.4]","92.5 [83.3, 98.4]"'),
        (LATE, "| a network | 0.16 | 92.5 "),
    ],
    "Where it cannot (200 ms late, 0.8 m/s, collisions ignored), one forecast touches 44 % in 4 ms, "
    "a network before it 66 in 0.7, 64 futures 73 in 16.": [
        (LATE, "| `interception` | 4.1 | 99.0 [94.3, 99.8] | 43.8 "),
        (LATE, "| it, then `interception` | 0.73 | 98.3 [92.3, 100.0] | 66.0 "),
        (LATE, "| `scenarios` | 16 | **100.0** [96.2, 100.0] | **72.9** "),
    ],
    "Beyond training they fail.": [
        (f"{DATA}/moving-map.csv", 'noise 3 mm,`gradient-moving-clear`,"5.2 [0.2, 12.8]","2.1 [0.1, 7.4]"'),
        (f"{DATA}/moving-faults.csv", '30 % of the sights missing,`gradient-moving-clear`,"4.0 [0.0, 14.4]","3.3 '),
    ],
}


def test_the_python_code_prints_what_is_shown(capsys):
    text = README.read_text()
    shown = re.findall(r"```python\n(.*?)```\n\n```text\n(.*?)```", text, re.DOTALL)
    names: dict[str, object] = {}
    for code, printed in shown:
        exec(code, names)  # one session, as a reader would type it
        assert capsys.readouterr().out == printed
    assert len(shown) == text.count("```python") == 2


def test_the_command_prints_what_is_shown(capsys):
    (shown,) = re.findall(
        r"```bash\nkinreach (ik .*) \| head -(\d+)\n```\n\n```text\n(.*?)```", README.read_text(), re.DOTALL
    )
    command, lines, printed = shown
    assert main(shlex.split(command)) == 0
    assert capsys.readouterr().out.splitlines()[: int(lines)] == printed.splitlines()


@pytest.mark.slow
def test_the_film_is_of_the_command_that_is_shown(tmp_path, capsys, monkeypatch):
    """It runs as it stands there, and says what the film says."""
    commands = README.read_text().replace("\\\n    ", "").splitlines()
    assert COMMAND in commands
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(COMMAND)[1:]) == 0
    assert "4 of 8 postures free; 2 x movej" in capsys.readouterr().out
    assert Path("motion.script").read_text().startswith("def kinreach_program():")


def test_it_is_short():
    assert 300 < len(README.read_text().split()) <= 600


def test_the_speeds_are_those_of_the_benchmarks():
    """Medians of one pose [us], of the suites that the page of benchmarks shows."""
    suites = json.loads((ROOT / "docs/reference/benchmarks.json").read_text())["suites"]
    measured = {}
    for section in (*suites["ik-single"], *suites["ik-calibrated"]):
        median = next(i for i, name in enumerate(section["columns"]) if name == "median [us]" or name == "median")
        measured |= {(section["title"], row[0]): row[median] for row in section["rows"]}
    sources = {
        "UR5, all branches": ("One pose of the UR5, all branches", "kinreach, public call and array"),
        "UR5, one posture near a seed": ("One pose of the UR5, one posture near a seed", "kinreach, nearest"),
        "calibrated UR10e, all branches": (
            "One pose of a calibrated UR10e, all branches",
            "kinreach, calibrated",
        ),
    }
    table = README.read_text().partition("| | kinreach | EAIK |")[2].partition("\n\n")[0].splitlines()
    checked = 0
    for line in table[2:]:
        name, *cells = [cell.strip(" *").replace(" ", "") for cell in line.strip("|").split("|")]
        title, own = next(value for key, value in sources.items() if key.replace(" ", "") == name)
        eaik = "EAIK, nearest branch" if "seed" in title else "EAIK"
        ssik = "ssik, general_6r" if "calibrated" in title else "ssik"
        peers = (own, eaik, "IK-Geo", ssik, "placo", "OptIK", "mink")
        for peer, cell in zip(peers, cells, strict=True):
            if cell != "–":
                assert float(cell) == pytest.approx(float(measured[title, peer]), rel=0.006), (name, peer)
                checked += 1
    assert checked == 11


def prose(text):
    """Sentences in one line: no code, tables, pictures, headings, nor targets of links."""
    text = re.sub(r"^```.*?^```|^(    |\||!|#).*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    return " ".join(re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text).split())


def test_every_number_rests_on_a_file():
    """A sentence with a number is in the list, and the number is where the list says."""
    text = prose(README.read_text())
    assert len(text) > 1200
    gone = [sentence for sentence in CLAIMS if sentence not in text]
    assert gone == []
    for sentence in CLAIMS:
        text = text.replace(sentence, "")
    numbers = r"(?<![\w-])(?:\d[\d.]*|two|three|four|five|ten|thirteen|half|third)\b"
    assert [text[max(at.start() - 40, 0) : at.end() + 40] for at in re.finditer(numbers, text, re.IGNORECASE)] == []
    missing = [
        (file, found)
        for evidence in CLAIMS.values()
        for file, found in evidence
        if found not in " ".join((ROOT / file).read_text().split())
    ]
    assert missing == []
    assert all(CLAIMS.values())


def test_how_exact_the_closed_form_is():
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    balls = kin.arm.workcell.draw_goals(np.random.default_rng(0), 200)
    tips = [kin.fk(kin.axis_goal(ball, (0, 0, -1), seed=kin.arm.home).q)[:3, 3] for ball in balls]
    assert np.median(1e3 * np.linalg.norm(tips - balls, axis=1)) == pytest.approx(5e-9, abs=5e-10)


def test_the_files_and_pictures_are_there():
    targets = re.findall(r"\]\(([^)#h][^)]*)\)", README.read_text())
    assert len(targets) >= 6
    files = [target.partition("#")[0] for target in targets]
    assert [file for file in files if not (README.parent / file).exists()] == []


def test_github_draws_the_pages_behind_links():
    """Nothing of Sphinx's is on them, and their tables are as their files are."""
    pages = {target.partition("#")[0] for target in re.findall(r"\]\(([^)#h][^)]*\.md[^)]*)\)", README.read_text())}
    assert len(pages) >= 12
    texts = {page: (ROOT / page).read_text() for page in pages}
    assert [page for page, text in texts.items() if re.search(r"^(```|:::+)\{", text, re.MULTILINE)] == []
    tables = runpy.run_path(str(ROOT / "docs/tables.py"))
    assert sum(len(tables["PLACE"].findall(text)) for text in texts.values()) >= 2
    everywhere = {page: page.read_text() for page in sorted((ROOT / "docs").rglob("*.md"))}
    assert [page for page, text in everywhere.items() if tables["with_tables"](page) != text] == []
    assert [page for page, text in everywhere.items() if "{csv-table}" in text] == []
    assert sum(len(tables["PLACE"].findall(text)) for text in everywhere.values()) >= 50


@pytest.mark.slow
def test_the_comparison_commands_run(tmp_path, capsys):
    commands = re.findall(r"python -m kinreach\.compare ([^`\n]+)", README.read_text())
    assert len(commands) >= 1
    for command in commands:
        arguments = re.sub(r"--goals \d+", "--goals 1", command).split()
        assert main(["compare", *arguments, "--methods", "closed-form", "--out", str(tmp_path)]) == 0
    assert "closed-form" in capsys.readouterr().out


def test_the_methods_of_the_table_exist():
    rows = re.findall(r"^\|([a-z-]+)\|[\d.]+ \[", README.read_text(), re.MULTILINE)
    assert rows == ["closed-form", "placo", "ranked-single", "thesis-ppo-single"]
    assert set(rows) <= set(get_task("ur5").methods)
    assert len(get_task("ur5").methods) == 10


def test_the_table_is_four_rows_of_one_that_is_measured_again():
    """By the same command, in `tests/test_studies.py`, with all ten methods."""
    readme = README.read_text()
    study = (ROOT / "docs/studies/reach_without_learning.md").read_text().partition("\n## Goals in")[0]
    (command,) = re.findall(r"of the ten\n\(`(python -m kinreach\.compare [^`]+)`", readme)
    assert f"\n    {command} # the same\n" in (ROOT / "docs/studies/reach_without_learning.md").read_text()
    rows = [
        line.strip("|").replace("*", "").split("|")
        for line in readme.splitlines()
        if re.match(r"\|[a-z-]+\|[\d.]+ \[", line)
    ]
    whole = [
        re.split(r" \| ", line.strip("| "))
        for line in study.splitlines()
        if re.match(r"\| `[a-z-]+` \| [\d.]+ \[", line)
    ]
    measured = {name.strip("`"): rest for name, *rest in whole if rest[-1] != "–"}
    assert len(measured) == 10
    for name, reached, distance, solve in rows:
        whole_distance, whole_solve = measured[name][1].replace("*", ""), measured[name][3]
        assert [reached, distance, solve] == [measured[name][0], whole_distance.split(" / ")[0], whole_solve]
    assert len(rows) == 4
    learned = {name: float(row[1].split(" / ")[0]) for name, row in measured.items() if re.search("ppo|ranked", name)}
    best = min(learned, key=learned.__getitem__)
    assert best == "ranked-single"
    assert len(learned) == 5
