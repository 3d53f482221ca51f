"""The package as a whole: imports point one way, nothing heavy loads by itself, and its files agree with each other."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from importlib.util import find_spec, resolve_name
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import kinreach
from kinreach import _engines as engines

#: The rooms, and those that each may import from.
ROOMS: dict[str, set[str]] = {"robots": set()}
ROOMS["kinematics"] = {"robots"}
ROOMS["thesis"] = {"kinematics", *ROOMS["kinematics"]}
ROOMS["sim"] = {"kinematics", *ROOMS["kinematics"]}
ROOMS["vision"] = {"sim", *ROOMS["sim"]}
ROOMS["envs"] = {"thesis", "vision", *ROOMS["vision"]}
ROOMS["plots"] = {"thesis", *ROOMS["thesis"]}
ROOMS["baselines"] = {"envs", "plots", *ROOMS["envs"]}
ROOMS["compare"] = {"baselines", *ROOMS["baselines"]}
ROOMS["demo"] = {"compare", *ROOMS["compare"]}
ROOMS["deploy"] = {"sim", "plots", *ROOMS["sim"]}
ROOMS["view"] = {"demo", "deploy", *ROOMS["demo"]}
#: Modules that every room may import, and that import none: but for the command line, which loads jobs by their names.
FOUNDATION = {
    "checks", "cli", "engines", "errors", "files", "flags", "jobs", "objects", "provenance", "registration",
    "rotations", "statistics", "tensors",
}  # fmt: skip
ENGINES = ("pinocchio", "coal", "placo", "mujoco", "torch", "stable_baselines3", "cv2", "matplotlib")
LEARNING = {"torch", "stable_baselines3", "tensorboard"}
#: Packages that a room must not know.
UNKNOWN_TO = {
    "robots": {"gymnasium", *ENGINES},
    "kinematics": {"mujoco", "gymnasium"} | LEARNING,
    "thesis": {"mujoco", "gymnasium"} | LEARNING,
    "sim": {"gymnasium"} | LEARNING,
    "vision": {"gymnasium"} | LEARNING,
    "plots": {"mujoco", "gymnasium"} | LEARNING,
    "envs": LEARNING - {"stable_baselines3"},
    "baselines": {"mujoco"},
    "demo": LEARNING,
    "view": {"mujoco"} | LEARNING,
    "deploy": {"gymnasium"} | LEARNING,
    "compare": LEARNING,
}

PACKAGE = Path(kinreach.__file__).resolve().parent
MODULES = sorted(PACKAGE.rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def part_of(module: str) -> str:
    """The room, or the module beside the rooms, that a module is in; empty for the package itself."""
    return module.split(".")[1].lstrip("_") if module.startswith("kinreach.") else ""


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Every module or name that a file imports, also within functions, by its full name."""
    return tuple(imports_in(tree(path), path))


def imports_in(part: ast.AST, path: Path) -> Iterator[str]:
    package = module_name(path) if path.name == "__init__.py" else module_name(path).rpartition(".")[0]
    for node in ast.walk(part):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            source = resolve_name("." * node.level + (node.module or ""), package) if node.level else node.module
            yield from (f"{source}.{alias.name}" for alias in node.names)


@pytest.mark.slow
def test_imports_point_downwards_only():
    wrong, edges, seen = [], 0, set()
    for path in MODULES:
        part = part_of(module_name(path))
        seen.add(part)
        allowed = {part, *FOUNDATION, *ROOMS.get(part, set())}
        for imported in imports(path):
            target = part_of(imported)
            if target in {*ROOMS, *FOUNDATION}:  # other names are those of the package itself
                edges += 1
                if target not in allowed:
                    wrong.append(f"{module_name(path)} -> {imported}")
    assert wrong == []
    assert seen >= {*ROOMS, *FOUNDATION}
    assert edges > 200


def exported(module: str) -> set[str]:
    return set(getattr(import_module(module), "__all__", ())) if find_spec(module) else set()


def test_rooms_use_each_other_through_their_doors():
    """A room imports of another what it or its `inside` exports, and an `inside` has nothing that nobody asks for."""
    wrong, asked = [], set()
    for path in MODULES:
        for imported in imports(path):
            source, _, name = imported.rpartition(".")
            room = part_of(imported)
            if room not in ROOMS or room == part_of(module_name(path)) or imported == f"kinreach.{room}":
                continue
            asked.add(imported)
            if source not in (f"kinreach.{room}", f"kinreach.{room}.inside") or name not in exported(source):
                wrong.append(f"{module_name(path)} -> {imported}")
    assert wrong == []
    for room in ROOMS:
        offered = exported(f"kinreach.{room}.inside")
        assert {name for name in offered if f"kinreach.{room}.inside.{name}" not in asked} == set(), room
        assert offered & exported(f"kinreach.{room}") == set(), room
    assert len(asked) > 200


#: A private module or name of a room, as code imports it or `monkeypatch` names it.
INSIDE = re.compile(rf"\bkinreach\.({'|'.join(ROOMS)})(\.\w+)*?(\.| import )_(?!_)\w")


@pytest.mark.slow
def test_tests_of_rooms_go_through_their_doors():
    """At least half of the lines of the tests are in files that name nothing private of a room."""
    lines = {True: 0, False: 0}
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        looks_inside = INSIDE.search(text) is not None or any(map(INSIDE.match, imports(path)))
        lines[looks_inside] += text.count("\n")
    assert lines[False] >= lines[True] > 0
    assert sum(lines.values()) > 40_000


def is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def test_no_circle_of_imports():
    """Within functions, too; what is imported for its types alone does not count."""
    modules = {module_name(path) for path in MODULES}
    graph: dict[str, set[str]] = {}
    for path in MODULES:
        importer = module_name(path)
        typed = {name for node in ast.walk(tree(path)) if is_for_types(node) for name in imports_in(node, path)}
        found = set(imports(path)) - typed
        graph[importer] = {name if name in modules else name.rpartition(".")[0] for name in found} & modules
        graph[importer].discard(importer)
    TopologicalSorter(graph).prepare()  # CycleError names the circle
    assert sum(map(len, graph.values())) > 500


def test_every_folder_is_a_room():
    folders = {path.parent.name.lstrip("_") for path in PACKAGE.glob("*/__init__.py")}
    assert folders == set(ROOMS) == set(UNKNOWN_TO)


def test_rooms_know_only_their_own_packages():
    wrong, looked_at = [], 0
    for path in MODULES:
        if unknown := UNKNOWN_TO.get(part_of(module_name(path))):
            looked_at += 1
            wrong += [f"{module_name(path)} -> {name}" for name in imports(path) if name.split(".")[0] in unknown]
    assert wrong == []
    assert looked_at > 50


def test_every_module_says_what_it_is():
    assert [module_name(p) for p in MODULES if not ast.get_docstring(tree(p))] == []


def test_import_loads_no_engine(run_python):
    code = (
        "import sys, kinreach, kinreach.robots, kinreach.errors, kinreach._engines, kinreach.cli\n"
        "[kinreach.robots.get_arm(name).urdf for name in ('ur5', 'arm3')]\n"
        f"print(sorted({set(ENGINES)} & set(sys.modules)), 'numpy' in sys.modules)"
    )
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[] True"


@pytest.mark.slow
def test_an_episode_loads_few_modules(run_python):
    """What a reader has to open to follow one goal from `gym.make` to its reward."""
    code = (
        "import sys, gymnasium as gym, kinreach\n"
        "env = gym.make('kinreach/UR5SingleStep-v0', observation='geometric')\n"
        "env.reset(seed=0)\n"
        "assert 'reward_terms' in env.step(env.action_space.sample())[4]\n"
        "print(sum(name.split('.')[0] == 'kinreach' and name.split('.')[-1] != 'inside' for name in sys.modules))"
    )
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert 40 <= int(done.stdout) <= 72


@pytest.mark.slow
def test_kinematics_loads_no_simulator_and_no_learner(run_python):
    heavy = {"gymnasium", "mujoco", "torch", "stable_baselines3", "cv2", "matplotlib", "placo", "trimesh"}
    heavy |= {"scipy"}
    code = (
        "import sys; from kinreach.kinematics import UR5Kinematics, pose, pose_vector\n"
        "kin = UR5Kinematics(); T = pose([0.4, 0.1, 0.3, 3.1, 0, 0])\n"
        "assert abs(pose_vector(kin.fk(kin.nearest(T, kin.arm.home).q)) - pose_vector(T)).max() < 1e-9\n"
        f"print(sorted({heavy} & set(sys.modules)))"
    )
    done = run_python("-c", code)
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr


@pytest.mark.parametrize(
    "imports",
    [
        "import kinreach, gymnasium",
        "import gymnasium, kinreach",
        "import kinreach; from importlib.util import find_spec; find_spec('gymnasium'); import gymnasium",
        "import kinreach.kinematics; from gymnasium.envs.registration import register; import gymnasium",
    ],
)
def test_environments_are_registered_whichever_comes_first(imports, run_python):
    code = f"{imports}; print(sum(name.startswith('kinreach/') for name in gymnasium.registry))"
    done = run_python("-c", code)
    assert (done.returncode, done.stdout.strip()) == (0, "13"), done.stderr


class TestIncompatibleInstallation:
    """`pip install pin placo` without versions: what the user then sees."""

    TRACE = "libboost_python311.so.1.87.0: cannot open shared object file: No such file or directory"

    @pytest.fixture
    def broken(self, tmp_path: Path) -> Path:
        """An environment whose pinocchio lacks its shared library and whose placo is a different one."""
        folder = tmp_path / "broken"
        folder.mkdir()
        (folder / "pinocchio.py").write_text(f"raise ImportError({self.TRACE!r})\n", encoding="utf-8")
        metadata = folder / "placo-0.9.0.dist-info" / "METADATA"
        metadata.parent.mkdir()
        metadata.write_text("Metadata-Version: 2.1\nName: placo\nVersion: 0.9.0\n", encoding="utf-8")
        return folder

    def check(self, message: str) -> None:
        assert "cannot import pinocchio" in message
        assert self.TRACE in message
        assert "placo 0.9.0 (needs 0.10.2)" in message
        assert "pin 3.8.0 (needs" not in message
        for name, version in engines.PLACO_VERSIONS.items():
            assert f"{name}=={version}" in message
        assert message.count("cannot import") == 1

    def test_error_names_the_versions(self, run_python, broken):
        code = (
            "from kinreach import _engines as engines, errors\n"
            "try:\n    engines.load('pinocchio')\n"
            "except errors.InstallationError as error:\n    print(error)\n"
        )
        done = run_python("-c", code, before=broken)
        assert done.returncode == 0, done.stderr
        assert len(done.stdout.splitlines()) == 1
        self.check(done.stdout)

    @pytest.mark.slow
    def test_command_ends_in_one_line(self, run_python, broken):
        done = run_python("-m", "kinreach", "compare", "--goals", "1", before=broken)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(done.stderr.splitlines()) == 1
        self.check(done.stderr)

    def test_without_placo_any_pinocchio_will_do(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "pinocchio", None)
        versions = {"pin": "4.0.0"}
        monkeypatch.setattr(engines, "installed_version", versions.get)
        with pytest.raises(
            engines.InstallationError, match=r"^cannot import pinocchio: .*Found: pin 4\.0\.0\. .*'pin>=3\.8,<5'$"
        ):
            engines.load("pinocchio")

    def test_missing_engine(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "placo", None)
        with pytest.raises(
            engines.InstallationError, match=r"cannot import placo: .*pip install placo==0\.10\.2 pin=="
        ):
            engines.load("placo")

    @pytest.mark.parametrize(
        ("error", "said"),
        [
            (ImportError(), "ImportError. Found"),
            (ImportError(""), "ImportError. Found"),
            (ImportError("\n"), "ImportError. Found"),
            (AttributeError(), "AttributeError. Found"),
            (ImportError("\nno such file\nand more"), "no such file. Found"),
        ],
        ids=repr,
    )
    def test_errors_that_say_nothing(self, error, said, monkeypatch):
        def fail(module):
            raise error

        monkeypatch.setattr("importlib.import_module", fail)
        with pytest.raises(engines.InstallationError, match=f"^cannot import coal: {said}"):
            engines.load("coal")


@pytest.fixture(scope="module")
def project(root: Path) -> dict:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def constraints(root: Path) -> dict[str, str]:
    lines = (root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line.split("==") for line in lines if not line.startswith("#")]
    assert all(len(pin) == 2 and re.fullmatch(r"[\w.]+", pin[1]) for pin in pins)
    return {canonicalize_name(name): version for name, version in pins}


class TestFilesAgree:
    """Versions are written down in more than one file."""

    def test_only_placo_needs_exact_versions(self, project, constraints):
        assert [name for name in project["dependencies"] if "==" in name] == []
        exact = dict(name.split("==") for name in project["optional-dependencies"]["placo"])
        assert exact == engines.PLACO_VERSIONS
        assert {name: constraints[name] for name in exact} == exact

    def test_constraints_cover_every_requirement(self, project, constraints):
        lists = [project["dependencies"], *project["optional-dependencies"].values()]
        wanted = [Requirement(text) for listed in lists for text in listed]
        wanted = [requirement for requirement in wanted if requirement.name != "kinreach"]
        assert len(wanted) >= 25
        for requirement in wanted:
            assert constraints[canonicalize_name(requirement.name)] in requirement.specifier, requirement

    def test_core_needs_no_learning(self, project):
        names = {canonicalize_name(Requirement(text).name) for text in project["dependencies"]}
        assert names.isdisjoint({"torch", "stable-baselines3", "tensorboard", "eaik", "ssik", "ur-analytic-ik"})

    def test_version(self, root):
        """The changelog opens with it, or with what comes after it; it was released when the citation says."""
        headings = re.findall(r"^## \[(.+)\](?: - (.+))?$", (root / "CHANGELOG.md").read_text(), re.M)
        released = [pair for pair in headings if pair[0] != "Unreleased"]
        assert released[0][0] == kinreach.__version__
        assert ("Unreleased", "") not in headings[1:]
        citation = (root / "CITATION.cff").read_text()
        assert re.search(
            rf'^version: {re.escape(kinreach.__version__)}\ndate-released: "{released[0][1]}"$', citation, re.M
        )


def test_dataclasses_are_frozen_and_options_are_named():
    """But for an episode of the page, which grows; arguments of an environment have no order."""
    found = [
        (node.name, line)
        for path in MODULES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.ClassDef)
        for line in map(ast.unparse, node.decorator_list)
        if line.partition("(")[0] == "dataclass"
    ]
    assert len(found) > 120
    assert [name for name, line in found if "frozen=True" not in line] == ["Episode"]
    named = [name for name, line in found if "kw_only=True" in line]
    assert named == [name for name, _ in found if name.endswith("Options")]
    assert {"ReachOptions", "LiftOptions"} < set(named)
