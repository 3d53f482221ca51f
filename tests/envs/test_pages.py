"""The pages of the environments list the arguments, spaces and limits that the environments have."""

import re

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401  (registers the environments)

PAGES = {
    "button": ["kinreach/ButtonPress-v0"],
    "moving": ["kinreach/Moving-v0"],
    "obstacles": ["kinreach/Obstacles-v0"],
    "reach": ["kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0", "kinreach/Reach-v0"],
    "real_arm": ["kinreach/RealArm-v0"],
    "lift": ["kinreach/Lift-v0"],
}


@pytest.mark.parametrize("page", PAGES)
def test_arguments_have_their_defaults(root, page):
    text = (root / f"docs/environments/{page}.md").read_text(encoding="utf-8").partition("\n## Arguments\n")[2]
    shown = dict(re.findall(r"^\| `(\w+)` \| `(.*?)` \|", text, re.MULTILINE))
    env = gym.make(PAGES[page][-1])
    fields = type(env.unwrapped).Options.__dataclass_fields__
    assert shown.keys() == fields.keys()
    for name, field in fields.items():
        assert shown[name].replace('"', "'") == repr(field.default), name
    assert len(shown) >= 4


@pytest.mark.parametrize("name", [name for names in PAGES.values() for name in names])
def test_docstrings_have_gymnasiums_sections(name):
    """All of them, in Gymnasium's order."""
    env = gym.make(name)
    said = env.unwrapped.__class__.__doc__
    sections = "Description, Action Space, Observation Space, Rewards, Starting State, Episode End, Info, Arguments"
    found = [head for head in re.findall(r"^ *## (.*)$", said, re.MULTILINE) if head != "Other Arms"]
    assert found == [*sections.split(", "), "Version History"]
    assert "<table of" not in said


@pytest.mark.parametrize("page", PAGES)
def test_spaces_are_as_shown(root, page):
    text = (root / f"docs/environments/{page}.md").read_text(encoding="utf-8")
    (actions,) = re.findall(r"^\| Action space \| `(.*?)`", text, re.MULTILINE)
    observations = re.findall(r"`Box\(([\d, ]+)\), float64`", text.partition("\n## ")[0])
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
