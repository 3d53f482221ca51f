"""Which files of which makers work: `python -m benchmarks.robot_files FOLDER`.

FOLDER holds clones of repositories as OWNER/NAME. Every URDF and MJCF in them is tried as a user would give it: taken,
or refused and with what reason. Of what is taken, forward kinematics is compared with Pinocchio (MJCF: MuJoCo) on the
same file, and poses of random postures of six-axis arms are solved. Files that are equal byte by byte are tried once,
and arms are told apart by the lines of their axes. No mesh is needed.

    for name in $(cut -d' ' -f1 docs/reference/robot_files.txt | sort -u); do
        git clone --depth 1 https://github.com/$name FOLDER/$name
    done
    cd docs/reference && python -m benchmarks.robot_files FOLDER --only robot_files.txt --page robot_files.md \
        --guide ../guides/any_arm.md

Options: `--only FILE` tries only the files of a list; `--list FILE` writes the list of all that were tried; `--page
FILE` writes the tables, `--guide FILE` puts those by kind where it has them; `--rows FILE` adds a line of JSON for each
file as soon as it is tried, and files that have a line are not tried again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import xml.etree.ElementTree as ET
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from benchmarks.ik_arms.child import forked
from kinreach._checks import Floats
from kinreach._files import decoded, write_text
from kinreach._rotations import joints_apart
from kinreach.cli import Parser, finish
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, SevenAxisKinematics, SixAxisKinematics, URKinematics
from kinreach.kinematics.check import random_postures
from kinreach.robots import ArmDescription
from kinreach.robots._mjcf import MJCF, _with_includes, _without_files
from kinreach.robots._urdf import ROBOT, parse_xml

PROG = "python -m benchmarks.robot_files"
#: Largest file [bytes], processor time for one [s], postures that are compared, and that are solved.
MAX_BYTES, SECONDS, POSTURES, SOLVED = 2**23, 60, 20, 20
#: A posture is found again within this [rad, m], and forward kinematics agrees within this [m].
FOUND, AGREES = 1e-4, 1e-9
#: Lines of axes are equal within this [m, rad], and parallel within that.
ALIKE, PARALLEL = 2e-3, 1e-6
#: Parts of paths and names of robots, by maker.
MAKERS = {
    "Universal Robots": r"(?<![a-z])ur(?:3|5|10|16|20|30|_?description|robot)|universal",
    "Franka": "franka|panda|fr3",
    "KUKA": r"kuka|iiwa|lbr|(?<![a-z])kr\d",
    "ABB": r"(?<![a-z])abb|(?<![a-z])irb|yumi",
    "Fanuc": "fanuc|lr_?mate|m10ia",
    "Yaskawa": r"motoman|yaskawa|gp\d|sia\d",
    "Kinova": r"kinova|jaco|mico|j2[sn]\d|gen3|kortex",
    "UFACTORY": "xarm|ufactory|lite6",
    "Staubli": r"st[aä]ubli|(?<![a-z])tx\d",
    "Denso": "denso|cobotta|vs0",
    "Doosan": r"doosan|dsr|(?<![a-z])[amh]\d{4}",
    "Techman": r"techman|tmr|(?<![a-z])tm\d",
    "Dobot": r"dobot|magician|(?<![a-z])cr\d+|nova\d",
    "AUBO": "aubo",
    "RealMan": r"realman|(?<![a-z])rm_?\d|rm_|ecosystem",
    "Elephant": "elephant|mycobot|mypalletizer|mecharm|mybuddy|myarm",
    "Rethink": "sawyer|baxter|rethink",
    "Trossen": "interbotix|widow|viper|trossen|(?<![a-z])wx|(?<![a-z])vx|aloha",
    "ROBOTIS": "robotis|open_?manipulator",
    "SO-ARM and Koch": "so_?-?(?:arm)?10[01]|koch|low_cost",
    "Barrett": "barrett|wam",
    "Fetch": "fetch",
    "PAL": "tiago|talos|pal_|romeo",
    "Hello Robot": "stretch|hello",
    "Unitree": r"unitree|z1|(?<![a-z])(?:go|a|b|h|g)[12]",
    "AgileX": "agilex|piper",
    "Willow Garage": "pr2",
    "Niryo": "niryo|ned",
    "Flexiv": "flexiv|rizon",
    "Neuromeka": "indy|neuromeka",
    "Kawasaki": "kawasaki|khi",
    "Comau": "comau",
    "Hyundai": "hyundai",
    "HEBI": "hebi",
    "Rainbow": "rainbow|rb[0-9y]",
    "igus": "igus|rebel",
    "Mitsubishi": "mitsubishi|melfa",
    "Nachi": "nachi",
    "Epson": "epson",
    "Schunk": "schunk|lwa|powerball",
    "Shadow": "shadow",
    "Robotiq": "robotiq",
    "Source Robotics": "parol",
    "Annin": "(?<![a-z])ar[34]",
    "ARX": "(?<![a-z])arx|x5|l5",
}
OTHERS = "others"
#: Around the tables that the guide has, too.
BEGIN, END = "<!-- kinds -->", "<!-- end -->"
#: What refusals say, in the order in which they are looked for, and whether the file may be an arm's.
REASONS = {
    "a template of xacro: expand it first": ("is xacro", False),
    "nothing moves": ("no joint moves", False),
    "several equal branches (hands, legs, two arms): name one with `--tip`": (r"branches of|, which end in", False),
    "a closed loop": ("closed loop", True),
    "joints without limits or range": ("cannot move, its limits|no <limit>|without the numbers", True),
    "a joint that slides, mimics or is coupled": ("slides|mimics|follows", True),
    "a joint of another kind (floating, ball)": ("is floating|is planar|is spherical|must be one of revolute", True),
    "put together of other models (<attach>)": ("attaches other models", True),
    "a file that it includes is not in the repository": ("cannot read the included file", True),
    "MuJoCo does not read it": ("MuJoCo cannot read", False),
    "broken: no XML, links that hang nowhere, names twice": (
        "not XML|must begin with|connect two links|names .* times|two joints of one|several links|one root|"
        "must have 1 to|document type|nameless|carries itself|hangs? on|not a tree|cannot be printed|must be .*number|"
        "XML or text declaration|lower limit above",
        False,
    ),
}
Row = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    """Try all files and print the tables."""
    arguments = _parser().parse_args(argv)
    folder, kept = Path(arguments.folder), Path(arguments.rows) if arguments.rows else None
    chosen = _listed(Path(arguments.only)) if arguments.only else None
    rows = _kept(kept) if kept is not None else []
    for row in tried(folder, chosen, rows):
        rows.append(row)
        if kept is not None:
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    if arguments.list:
        write_text(Path(arguments.list), "".join(f"{row['repository']} {row['path']}\n" for row in rows))
    page = "\n".join(page_of(rows))
    if arguments.page:
        write_text(Path(arguments.page), page + "\n")
    if arguments.guide:
        guide, kinds = Path(arguments.guide), re.compile(f"{BEGIN}.*?{END}", re.DOTALL)
        write_text(guide, kinds.sub(kinds.findall(page)[0], guide.read_text(encoding="utf-8")))
    print(page)
    return 0


def _listed(file: Path) -> list[tuple[str, str]]:
    lines = file.read_text(encoding="utf-8").splitlines()
    return [tuple(line.split(" ", 1)) for line in lines if line]  # type: ignore[misc]


def _kept(file: Path) -> list[Row]:
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.is_file() else []


def tried(folder: Path, chosen: Sequence[tuple[str, str]] | None, before: Sequence[Row] = ()) -> Iterator[Row]:
    """Try each file of the folder, or those that are chosen, once for each content, and not those of before."""
    seen = {row["digest"] for row in before}
    for repository, path in chosen if chosen is not None else _files(folder):
        file = folder / repository / path
        if not file.is_file() or file.stat().st_size > MAX_BYTES:
            continue
        content = file.read_bytes()
        key = hashlib.sha256(content).hexdigest()
        if key in seen or not _is_robot(content):
            continue
        seen.add(key)
        row: Row = {
            "repository": repository,
            "path": path,
            "digest": key,
            "format": "MJCF" if _is_mjcf(content) else "URDF",
        }
        row["maker"] = _maker(f"{repository}/{path}")
        try:
            row |= forked(judged, file, limit=SECONDS)
        except InputError as error:
            row |= {"refused": str(error).replace(str(folder), "")[:400]}
        yield row


def _files(folder: Path) -> Iterator[tuple[str, str]]:
    for repository in sorted(folder.glob("*/*")):
        for file in sorted(path for path in repository.rglob("*") if path.suffix in (".urdf", ".xml", ".mjcf")):
            yield f"{repository.parent.name}/{repository.name}", file.relative_to(repository).as_posix()


def _is_mjcf(content: bytes) -> bool:
    return re.search(rb"<mujoco[\s>]", content[:4096]) is not None and b"<worldbody" in content


def _is_robot(content: bytes) -> bool:
    return _is_mjcf(content) or (re.search(rb"<robot[\s>]", content) is not None and b"<joint" in content)


def _maker(name: str) -> str:
    own = name.split("/", 2)[-1].lower()  # the path says more than whose repository it is
    for text in (own, name.lower()):
        for maker, pattern in MAKERS.items():
            if re.search(pattern, text):
                return maker
    return OTHERS


def judged(file: Path) -> Row:
    """Describe the arm of a file, compare its forward kinematics, and solve poses if it has six axes."""
    arm = ArmDescription.from_file(file)
    kin = ArmKinematics.of(arm, base="world")
    Q = random_postures(kin, POSTURES, 0)
    row: Row = {"axes": kin.n, "kind": _kind(kin), "lines": _lines(kin), "notes": len(arm.notes)}
    try:
        reference = _mujoco(file, kin) if _is_mjcf(file.read_bytes()) else _pinocchio(file, kin)
        row["off"] = max(float(np.abs(kin.fk(q) - reference(q)).max()) for q in Q)
    except (ValueError, RuntimeError, KeyError, IndexError) as error:
        row["not compared"] = " ".join(str(error).split())[:200] or type(error).__name__
    if kin.n == 6 and kin.knows_all_postures:
        row["found"] = sum(_is_found(kin, q) for q in random_postures(kin, SOLVED, 1))
    return row


def _is_found(kin: Any, q: Floats) -> bool:
    found = kin.all_solutions(kin.fk(q)).q
    return bool(len(found)) and float(joints_apart(found, q).min()) < FOUND


def _kind(kin: ArmKinematics) -> str:
    if isinstance(kin, URKinematics):
        return "six axes: a UR's"
    if isinstance(kin, SixAxisKinematics):
        return "six axes: spherical wrist or three parallel" if "closed form" in kin.solved else "six axes: others"
    if isinstance(kin, SevenAxisKinematics):
        return "seven axes"
    if kin.n == 6:
        return "six axes without every posture"
    names = {4: "four axes", 5: "five axes", 7: "seven axes without every posture"}
    return names.get(kin.n, "eight axes and more" if kin.n > 7 else "up to three axes")


def _lines(kin: ArmKinematics) -> list[list[float]]:
    """Angle and distance between each two axes at 0, by which arms are told apart."""
    zero = np.zeros(kin.n)
    J, tip = kin.jacobian(zero), kin.fk(zero)[:3, 3]
    turning = [(J[3:, i], tip + np.cross(J[3:, i], J[:3, i])) for i in range(kin.n)]
    axes = [(w, o) if w.any() else (J[:3, i], tip) for i, (w, o) in enumerate(turning)]
    pairs = []
    for (a, p), (b, o) in combinations(axes, 2):
        across, gap = np.cross(a, b), o - p
        length = float(np.linalg.norm(across))
        distance = abs(gap @ across) / length if length > PARALLEL else np.linalg.norm(np.cross(a, gap))
        pairs.append([length, float(distance)])
    return pairs


def _pinocchio(file: Path, kin: ArmKinematics) -> Callable[[Floats], Floats]:
    """Forward kinematics by Pinocchio on the file, with joints that are not the arm's where kinreach holds them."""
    model = pin.buildModelFromUrdf(str(file))
    data, tip = model.createData(), kin.arm.tips[kin.tip]
    if not model.existFrame(tip, pin.BODY):
        raise ValueError(f"no frame {tip}")
    frame = model.getFrameId(tip, pin.BODY)
    mimics = _mimics(file)

    def place(index: int, values: dict[str, float]) -> list[float]:
        joint = model.joints[index]
        if joint.nq > 2:
            return pin.neutral(model)[joint.idx_q : joint.idx_q + joint.nq].tolist()
        value = _value(model.names[index], values, mimics)
        if value is None:
            low, high = (ends[joint.idx_q] for ends in (model.lowerPositionLimit, model.upperPositionLimit))
            value = float(min(max(0.0, low), high)) if joint.nq == 1 and low <= high else 0.0
        return [np.cos(value), np.sin(value)] if joint.nq == 2 else [value] * joint.nq

    def fk(q: Floats) -> Floats:
        values = dict(zip(kin.arm.joints, q.tolist(), strict=True))
        x = np.concatenate([place(index, values) for index in range(1, model.njoints)])
        pin.framesForwardKinematics(model, data, x)
        return np.array(data.oMf[frame].homogeneous)

    return fk


def _text(file: Path) -> str:
    return decoded(file.read_bytes(), otherwise="latin-1").lstrip("\ufeff \t\r\n")


def _mimics(file: Path) -> dict[str, tuple[str, float, float]]:
    found = {}
    robot = parse_xml(_text(file), tags=(ROBOT,), prefixed=True)
    for joint in robot.iter("joint"):
        if (mimic := joint.find("mimic")) is not None:
            numbers = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            found[joint.get("name", "")] = (mimic.get("joint", ""), *numbers)
    return found


def _value(name: str, values: dict[str, float], mimics: dict[str, tuple[str, float, float]]) -> float | None:
    if name in values or name not in mimics:
        return values.get(name)
    leader, factor, offset = mimics[name]
    led = _value(leader, values, {key: mimic for key, mimic in mimics.items() if key != name})
    return None if led is None else factor * led + offset


def _mujoco(file: Path, kin: ArmKinematics) -> Callable[[Floats], Floats]:
    """Forward kinematics by MuJoCo on the file, without its meshes."""
    root = parse_xml(_text(file), tags=(MJCF,), prefixed=True)
    spec = mujoco.MjSpec.from_string(ET.tostring(_with_includes(root, file), encoding="unicode"))
    _without_files(mujoco, spec)
    model = spec.compile()
    data, tip = mujoco.MjData(model), kin.arm.tips[kin.tip]
    bodies = [model.body(i).name for i in range(model.nbody)]
    sites = [model.site(i).name for i in range(model.nsite)]
    if tip not in (*bodies, *sites):
        tip = tip.removesuffix("_site")  # of a site with a body's name
        bodies = []

    def fk(q: Floats) -> Floats:
        data.qpos[:] = model.qpos0
        for name, value in zip(kin.arm.joints, q, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        found = data.body(tip) if tip in bodies else data.site(tip)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = found.xmat.reshape(3, 3), found.xpos
        return T

    return fk


def reason_of(refused: str) -> tuple[str, bool]:
    """The group of a refusal, and whether the file may be an arm's."""
    for reason, (pattern, arm) in REASONS.items():
        if re.search(pattern, refused):
            return reason, arm
    return "other: " + refused[:80], True


def distinct(rows: Iterable[Row]) -> list[Row]:
    """One row for each arm, by the lines of its axes."""
    kept: dict[int, list[Row]] = defaultdict(list)
    for row in rows:
        lines = np.array(row["lines"])
        if not any(np.abs(np.array(other["lines"]) - lines).max(initial=0.0) < ALIKE for other in kept[row["axes"]]):
            kept[row["axes"]].append(row)
    return [row for same in kept.values() for row in same]


def page_of(rows: Sequence[Row]) -> Iterator[str]:
    """The page, line by line."""
    taken = [row for row in rows if "kind" in row]
    refused = [(row, *reason_of(row["refused"])) for row in rows if "refused" in row]
    repositories = Counter(row["repository"] for row in rows)
    yield "# Robot files that work\n"
    yield from _summary(rows, taken, sum(arm for _, _, arm in refused), len(repositories))
    yield "`docs/reference/robot_files.txt` lists what was tried, and `benchmarks/robot_files.py` repeats it.\n"
    yield f"{BEGIN}\n"
    yield from _table(["taken", "files", "arms", "FK agrees", "six-axis postures"], map(_of_kind, _by(taken, "kind")))
    yield ""
    reasons = Counter(reason for _, reason, _ in refused).most_common()
    yield from _table(["refused", "files"], [[reason, count] for reason, count in reasons])
    yield f"\n{END}\n\n## By maker\n"
    lines = []
    for maker in [*sorted({row["maker"] for row in rows} - {OTHERS}), OTHERS]:
        of = [row for row in taken if row["maker"] == maker]
        why = Counter(reason for row, reason, arm in refused if arm and row["maker"] == maker)
        if of or why:
            said = ", ".join(f"{reason} ({count})" for reason, count in why.items())
            lines.append([maker, len(of), len(distinct(of)), said])
    yield from _table(["maker", "files taken", "arms", "refused, though perhaps an arm"], lines)
    yield "\n## Repositories\n"
    yield ", ".join(f"`{name}` ({count})" for name, count in sorted(repositories.items())) + "."


def _summary(rows: Sequence[Row], taken: Sequence[Row], lost: int, repositories: int) -> Iterator[str]:
    arms = len(taken) + lost
    compared = [row["off"] for row in taken if "off" in row]
    agree = [off for off in compared if off < AGREES]
    six = [row["found"] for row in taken if "found" in row]
    yield (
        f"{len(rows)} distinct files of {repositories} public repositories were tried as they are. {len(taken)} are "
        f"taken, {100 * len(taken) / max(arms, 1):.0f} % of the {arms} that may be arms: {len(distinct(taken))} "
        "distinct arms."
    )
    yield (
        f"Forward kinematics is that of Pinocchio or MuJoCo on the same file in {len(agree)} of {len(compared)}, to "
        f"{max(agree, default=0.0):.0e} m and rad. Six axes: {sum(six)} of {SOLVED * len(six)} random postures are "
        "found again from their poses.\n"
    )


def _by(rows: Sequence[Row], key: str) -> list[list[Row]]:
    """Rows in groups, the largest first."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        groups[row[key]].append(row)
    return sorted(groups.values(), key=len, reverse=True)


def _of_kind(rows: list[Row]) -> list[object]:
    right = [row["off"] < AGREES for row in rows if "off" in row]
    six = [row["found"] for row in rows if "found" in row]
    found = f"{sum(six)} of {SOLVED * len(six)}" if six else ""
    return [rows[0]["kind"], len(rows), len(distinct(rows)), f"{sum(right)} of {len(right)}", found]


def _table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield "|---" * len(head) + "|"
    yield from (f"| {' | '.join(str(cell).replace('|', ' ') for cell in line)} |" for line in lines)


def _parser() -> Parser:
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="FOLDER", help="of clones, as OWNER/NAME")
    parser.add_argument("--only", metavar="FILE", help="list of the files to try")
    for name, what in (
        ("list", "the list of files that were tried"),
        ("page", "the tables"),
        ("guide", "the tables by kind, where it has them"),
        ("rows", "a line for each file"),
    ):
        parser.add_argument(f"--{name}", metavar="FILE", help=f"write {what}")
    return parser


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
