"""The pages of the environments list the arguments, spaces, limits and entries of `info` that the environments have.

`KINREACH_KEEP=1 pytest tests/envs/test_pages.py` writes the tables of arguments and of `info`.
"""

import inspect
import re

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401  (registers the environments)
from tests.kept import KEEP

PAGES = {
    "button": ["kinreach/ButtonPress-v0"],
    "moving": ["kinreach/Moving-v0"],
    "obstacles": ["kinreach/Obstacles-v0"],
    "reach": ["kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0", "kinreach/Reach-v0"],
    "real_arm": ["kinreach/RealArm-v0"],
    "lift": ["kinreach/Lift-v0"],
}


TABLE = re.compile(r"(?:^ *\|.*\n)+", re.MULTILINE)


def section(text, heading):
    """Where a section of a page or a docstring is: the text before it, its own, and the text after it."""
    before, found, rest = re.split(rf"(?<=\n)( *## {heading}\n)", text, maxsplit=1)
    end = re.search(r"^ *## ", rest, re.MULTILINE).start()
    return before + found, rest[:end], rest[end:]


def is_kept(root, page, text):
    """Whether a page has this text; with `KINREACH_KEEP=1` it is written."""
    path = root / f"docs/environments/{page}.md"
    if KEEP:
        path.write_text(text, encoding="utf-8")
    return path.read_text(encoding="utf-8") == text


def test_arguments_have_their_defaults(root):
    """A new option is described in the dataclass of options; the page may describe it in other words."""
    stale = []
    for page, names in PAGES.items():
        text = (root / f"docs/environments/{page}.md").read_text(encoding="utf-8")
        before, arguments, after = section(text, "Arguments")
        lines = arguments.splitlines(keepends=True)
        rows = {found[1]: line for line in lines if (found := re.match(r"\| `(\w+)` \| ", line))}
        fields = type(gym.make(names[-1]).unwrapped).Options.__dataclass_fields__
        assert len(fields) >= 3
        at = lines.index("|---|---|---|\n") + 1
        for name, field in fields.items():
            row = rows.pop(name, None)
            at = at if row is None else lines.index(row)
            said = field.metadata["description"] if row is None else row.split(" | ", 2)[2].removesuffix(" |\n")
            lines[at : at + (row is not None)] = [f"| `{name}` | `{quoted(field.default)}` | {said} |\n"]
            at += 1
        text = before + "".join(line for line in lines if line not in rows.values()) + after
        stale += [] if is_kept(root, page, text) else [page]
    assert stale == [], f"KINREACH_KEEP=1 pytest {__file__} writes the options of docs/environments"


def quoted(value):
    return repr(value).replace("'", '"')


def keys_of(tables):
    """Patterns of the keys in the first column; in `reward_TERM` any word may stand for TERM."""
    keys = [key for table in tables for row in table[2:] for key in re.findall(r"`(\w+)`", row.split(" | ")[0])]
    return [re.compile(re.sub("[A-Z]+", r"\\w+", key)) for key in keys]


@pytest.mark.parametrize("page", PAGES)
def test_info_is_as_documented(root, page):
    """In the tables of the class's docstring, that of the first class of a page is of all."""
    classes = {name: type(gym.make(name).unwrapped) for name in PAGES[page]}
    tables = {
        name: [table.split("\n")[:-1] for table in TABLE.findall(section(inspect.getdoc(kind), "Info")[1])]
        for name, kind in classes.items()
    }
    (shared,) = tables[PAGES[page][0]]
    for name, kind in classes.items():
        where = f"the table ## Info of {kind.__name__} in {inspect.getsourcefile(kind)}"
        env, own = gym.make(name), tables[name] if name != PAGES[page][0] else []
        documented = keys_of([shared, *own])
        for info in (env.reset(seed=0)[1], env.step(env.action_space.sample())[4]):
            unknown = [key for key in info if not any(known.fullmatch(key) for known in documented)]
            assert unknown == [], f"write a row for each into {where}"
            gone = [known.pattern for known in documented if not any(map(known.fullmatch, info))]
            assert gone == [], f"info has none of these; take them out of {where}"
    text = (root / f"docs/environments/{page}.md").read_text(encoding="utf-8")
    before, info, after = section(text, "Info")
    wanted = iter("\n".join([table[0], "|---|---|", *table[2:], ""]) for rows in tables.values() for table in rows)
    text = before + TABLE.sub(lambda found: next(wanted), info) + after
    assert list(wanted) == []
    assert is_kept(root, page, text), f"KINREACH_KEEP=1 pytest {__file__} copies the tables into docs/environments"


@pytest.mark.parametrize("name", [name for names in PAGES.values() for name in names])
def test_docstrings_have_gymnasiums_sections(name):
    """All of them, in Gymnasium's order."""
    env = gym.make(name)
    said = env.unwrapped.__class__.__doc__
    sections = "Description, Action Space, Observation Space, Rewards, Starting State, Episode End, Info, Arguments"
    found = [head for head in re.findall(r"^ *## (.*)$", said, re.MULTILINE) if head not in ("Other Arms", "Goals")]
    assert found == [*sections.split(", "), "Version History"]
    assert "<table of" not in said


@pytest.mark.parametrize("page", PAGES)
def test_spaces_are_as_shown(root, page):
    text = (root / f"docs/environments/{page}.md").read_text(encoding="utf-8")
    (actions,) = re.findall(r"^\| Action space \| `(.*?)`", text, re.MULTILINE)
    observations = re.findall(r"`Box\(([\d, ]+)\), float32`", text.partition("\n## ")[0])
    assert len(observations) >= 1
    shapes = set()
    for name in PAGES[page]:
        env = gym.make(name)
        space = env.action_space
        found = (
            f"Discrete({space.n})"
            if isinstance(space, gym.spaces.Discrete)
            else f"Box(-1, 1, {space.shape}, {space.dtype})"
        )
        assert found == actions
        shapes.add(", ".join(map(str, env.observation_space.shape)) + "," * (len(env.observation_space.shape) == 1))
    assert shapes == set(observations)


@pytest.mark.parametrize("page", PAGES)
def test_observations_have_their_bounds(root, page):
    """Rows "| 0–2 | name | min | max | unit |" of the section on observations."""
    text = (root / f"docs/environments/{page}.md").read_text(encoding="utf-8")
    section = text.partition("\n## Observation Space\n")[2].partition("\n## ")[0]
    space = gym.make(PAGES[page][0]).observation_space
    low, high = (np.atleast_2d(bound)[0] for bound in (space.low, space.high))
    checked = 0
    for first, last, least, most in re.findall(
        r"^\| (\d+)(?:–(\d+))? \| [^|]+ \| ([−\d.π]+) \| ([^|]+) \|", section, re.MULTILINE
    ):
        rows = slice(int(first), int(last or first) + 1)
        words = {"π": np.pi, "−π": -np.pi, "`again` + 1": 3, "the largest budget": 50}
        for shown, bound in ((least, low), (most, high)):
            value = words.get(shown)
            np.testing.assert_allclose(
                bound[rows], float(shown.replace("−", "-")) if value is None else value, atol=1e-6
            )
        checked += len(low[rows])
    assert checked == len(low)


def test_the_table_of_all_environments_is_whole(root):
    """Ids, and sizes of observations and actions."""
    text = (root / "docs/environments/index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[`(kinreach/[^`]+)`\]\([^)]+\) \| ([\d ×]+) \| ([\d ×]+)", text, re.MULTILINE)
    ids = {name for name in gym.registry if name.startswith("kinreach/") and "Kinematic" not in name}
    assert {name for name, *_ in rows} == ids
    for name, observed, acted in rows:
        env = gym.make(name)
        action = env.action_space
        size = (action.n,) if isinstance(action, gym.spaces.Discrete) else action.shape
        assert observed.strip() == " × ".join(map(str, env.observation_space.shape)), name
        assert acted.strip() == " × ".join(map(str, size)), name
