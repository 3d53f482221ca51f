"""requirements.lock: every package of the core with hashes, in the versions of constraints.txt, and no address."""

import re
import tomllib

import pytest

CANONICAL = re.compile(r"[-_.]+")


def canonical(name):
    return CANONICAL.sub("-", name).lower()


@pytest.fixture(scope="module")
def locked(root):
    """Version and hashes of each package."""
    text = (root / "requirements.lock").read_text(encoding="utf-8")
    found = {}
    for entry in re.split(r"\n(?=\S)", re.sub(r"^#.*\n", "", text, flags=re.MULTILINE)):
        name, version = re.match(r"(\S+?)==(\S+)", entry).groups()
        found[canonical(name)] = version, re.findall(r"--hash=sha256:([0-9a-f]{64})(?=\s|$)", entry)
    return found


def test_every_package_has_hashes_and_no_address_is_written_down(locked, root):
    assert len(locked) > 90
    assert all(hashes for _, hashes in locked.values())
    text = (root / "requirements.lock").read_text(encoding="utf-8")
    assert not re.search(r"://|--index|--find-links|file:|@ ", text)


def test_versions_are_those_of_the_constraints(locked, root):
    lines = (root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {canonical(line.split("==")[0]): line.split("==")[1] for line in lines if line and line[0] != "#"}
    shared = sorted(set(locked) & set(pinned))
    assert len(shared) > 90
    assert {name: locked[name][0] for name in shared} == {name: pinned[name] for name in shared}


def test_all_of_the_core_and_none_of_what_is_left_out(locked, root):
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    def names(requirements):
        return {canonical(re.match(r"[\w.-]+", requirement).group()) for requirement in requirements}

    extras = project["optional-dependencies"]
    tools = (root / "tools" / "lock.in").read_text(encoding="utf-8").splitlines()
    wanted = names(
        [*project["dependencies"], *extras["docs"], *extras["notebooks"], *(t for t in tools if t[0] != "#")]
    )
    assert len(wanted) > 25
    assert wanted <= set(locked)
    assert not names([*extras["train"], *extras["oracles"]]) & set(locked)
