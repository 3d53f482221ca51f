"""Files made to do harm, or damaged: refused, nothing of them is executed, nothing is written elsewhere."""

import json
import os
import pickle
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import strategies as st

from kinreach.baselines import load_policy
from kinreach.baselines._policy_file import read_policy, save_policy
from kinreach.baselines.inside import LearnedPolicy
from kinreach.cli import main
from kinreach.compare._runner import Records, prepare
from kinreach.errors import InputError, KinreachError
from kinreach.kinematics import URKinematics
from kinreach.robots import ArmDescription

DTYPES = ["F64", "F32", "F16", "BF16", "I64", "U8", "BOOL", "F8_E4M3", "F4", "C64", "", "X", None, 7]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A policy's header and bytes, taken apart."""
    path = tmp_path_factory.mktemp("policy") / "p.safetensors"
    policy = load_policy("ranked-single")
    save_policy(path, policy.card, policy.network)
    data = path.read_bytes()
    size = struct.unpack("<Q", data[:8])[0]
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def packed(header, body, *, length=None):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + body


@st.composite
def damage(draw, header, body):
    """A policy's file with one thing wrong."""
    made = json.loads(json.dumps(header))
    name = draw(st.sampled_from([name for name in made if name != "__metadata__"]))
    card = json.loads(made["__metadata__"]["kinreach"])
    ways = [
        "cut",
        "flip",
        "length",
        "overlap",
        "beyond",
        "dtype",
        "shape",
        "rename",
        "weights",
        "card",
        "meta",
        "bomb",
        "text",
    ]
    how = draw(st.sampled_from([*ways, "text"]))
    wild = st.none() | st.integers(-(2**70), 2**70) | st.text(max_size=9) | st.lists(st.integers(0, 9), max_size=3)
    if how in ("cut", "flip"):
        data = packed(header, body)
        at = draw(st.integers(0, min(len(data) - 1, draw(st.sampled_from([40, 3000, 10**9])))))
        return (
            data[:at]
            if how == "cut"
            else data[:at] + bytes([data[at] ^ (1 << draw(st.integers(0, 7)))]) + data[at + 1 :]
        )
    if how == "length":
        return packed(header, body, length=draw(st.sampled_from([0, 1, 2**31, 2**40, 2**63, 2**64 - 1, 99_999_999])))
    if how in ("overlap", "beyond"):
        ends = st.integers(0, 2 * len(body)) if how == "beyond" else st.integers(0, len(body))
        made[name]["data_offsets"] = [draw(ends), draw(ends)]
    elif how == "dtype":
        made[name]["dtype"] = draw(st.sampled_from(DTYPES))
    elif how == "shape":
        made[name]["shape"] = draw(st.lists(st.integers(-1, 2**64), max_size=4) | wild)
    elif how == "rename":
        made[draw(st.sampled_from(["../../evil", "/tmp/evil", "a\0b", "", "layer99.weight", "mean", "__proto__"]))] = (
            made.pop(name)
        )
    elif how == "weights":
        start, end = made[name]["data_offsets"]
        number = draw(st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200]))
        width = 8 if made[name]["dtype"] == "F64" else 4
        code = np.float64 if width == 8 else np.float32
        with np.errstate(over="ignore"):
            content = np.full((end - start) // width, number).astype(code).tobytes()
        return packed(made, body[:start] + content + body[end:])
    elif how == "card":
        card[draw(st.sampled_from(list(card)))] = draw(wild | st.dictionaries(st.text(max_size=3), wild, max_size=2))
        made["__metadata__"]["kinreach"] = json.dumps(card)
    elif how == "meta":
        made["__metadata__"] = draw(wild | st.dictionaries(st.text(max_size=3), st.text(max_size=3), max_size=2))
    elif how == "bomb":
        depth = draw(st.sampled_from([200, 5000, 200_000]))
        texts = [
            "[" * depth,
            '{"a":' * depth,
            "9" * depth,
            '"' + "x" * depth,
            "NaN",
            '{"format": 1e999}',
            "[" * depth + "]" * depth,
        ]
        made["__metadata__"]["kinreach"] = draw(st.sampled_from(texts))
    else:
        return packed(draw(st.binary(max_size=60)) if draw(st.booleans()) else b"[" * 100_000, body)
    return packed(made, body)


def test_policies(whole, fuzzed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "p.safetensors"

    def run(content):
        file.write_bytes(content)
        try:
            policy = LearnedPolicy(*read_policy(file))
            action = policy.act(np.full(13, 0.3))
            assert action.shape == (6,)
            assert (np.abs(action) <= 1).all()
            save_policy(tmp_path / "again.safetensors", policy.card, policy.network)
            (tmp_path / "again.safetensors").unlink()
        finally:
            assert [path.name for path in tmp_path.iterdir()] == ["p.safetensors"]

    fuzzed(damage(*whole), run, share=3)


class Bomb:
    """A pickle that writes a file when it is loaded."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return (os.mkdir, (self.path,))


def test_pickles_under_any_name_are_not_executed(tmp_path, capsys):
    mark = tmp_path / "executed"
    content = pickle.dumps(Bomb(mark))
    for name in ("p.safetensors", "checkpoint.pt", "curve.csv", "p.pkl"):
        (tmp_path / name).write_bytes(content)
    torch = pytest.importorskip("torch")
    torch.save({"identity": Bomb(mark), "segment": 0}, tmp_path / "zipped.pt")
    from kinreach.baselines import read_curve
    from kinreach.baselines._training import read_checkpoint

    with pytest.raises(InputError):
        load_policy(tmp_path / "p.safetensors")
    for name in ("checkpoint.pt", "zipped.pt"):
        assert read_checkpoint(tmp_path / name, {}) is None
    with pytest.raises(InputError):
        read_curve(tmp_path / "curve.csv")
    assert main(["evaluate", str(tmp_path / "p.pkl"), "--goals", "1"]) == 2
    assert main(["demo", "--policy", str(tmp_path / "p.pkl"), "--steps", "1"]) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert not mark.exists()


@pytest.mark.parametrize(
    "line",
    [b"", b"[" * 100_000, b'{"goal_index":' * 50_000, b"1" * 5000, b"\x00", b"null", b"x" * 2_000_000, b"[]", b"{}",
     b'{"goal_index": 9, "method": "lm", "reached": true}', b'{"goal_index": 1, "method": "chess", "reached": true}',
     b'{"goal_index": 0, "method": "lm", "reached": true}', b'{"goal_index": [0], "method": "lm", "reached": true}'],
)  # fmt: skip
def test_trials_of_an_interrupted_comparison_count_up_to_the_first_odd_line(line, tmp_path):
    path, identity = tmp_path / "records.jsonl", {"settings": {"goals": 3}}
    comparison = prepare(
        "ur5", ("lm",), goals=3, seed=0, arm=None, observation=None, options={"backend": "kinematic"}, command=""
    )
    known = json.dumps(identity).encode()
    trials = [b'{"goal_index": %d, "method": "lm", "reached": true}' % goal for goal in range(3)]
    path.write_bytes(b"\n".join([known, trials[0], line, trials[1]]))
    assert [trial["goal_index"] for trial in Records(path, identity, comparison, fresh=False).trials] == [0]
    assert len(path.read_text().splitlines()) == 2  # what is added now begins on a line of its own
    path.write_bytes(b"\n".join([line, *trials]))
    assert Records(path, identity, comparison, fresh=False).trials == []


@pytest.mark.parametrize("content", ["directory", "fifo", "endless"])
def test_what_is_no_file_is_not_waited_for(content, tmp_path):
    path = tmp_path / "p.safetensors"
    if content == "directory":
        path.mkdir()
    elif content == "fifo":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(KinreachError):
        load_policy(path)
    with pytest.raises(KinreachError):
        ArmDescription.from_urdf(path)


CALIBRATION_BOMB = "\n".join(
    [
        "a0: &a0 {x: 1}",
        *(f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}" for i in range(1, 12)),
        "kinematics: *a11",
    ]
)


@pytest.mark.parametrize(
    "content",
    [CALIBRATION_BOMB, *(f"kinematics: {text}" for text in (
        "!!bool foo", "!!int ''", "!!timestamp foo", "!!python/object/apply:os.system ['touch ran']", "&a [*a]",
        "[" * 5000, "{? [a] : b}", "1" * 5000)), "<" * 5000, "delta_theta = [" + "1," * 5000, "\0", None],
)  # fmt: skip
@pytest.mark.slow
def test_calibrations(content, tmp_path, monkeypatch):
    """Refused at once, whatever is in them."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "c.yaml"
    if content is None:
        os.mkfifo(path)
    else:
        path.write_text(content, encoding="utf-8")
    began = time.process_time()
    with pytest.raises(KinreachError):
        URKinematics.from_calibration(path)
    assert time.process_time() - began < 5.0
    assert [entry.name for entry in tmp_path.iterdir()] == ["c.yaml"]


@pytest.mark.slow
def test_files_that_promise_too_much_take_neither_memory_nor_time(tmp_path, whole, root):
    """With 1.5 GB for the whole process and half a minute, each ends in the error."""
    header, body = whole
    claims = {
        "mean": {"dtype": "F64", "shape": [2**40], "data_offsets": [0, 2**43]},
        "__metadata__": header["__metadata__"],
    }
    bombs = [
        packed(header, body, length=2**62),
        packed(claims, body),
        packed(b"[" * 1_000_000, b""),
        packed(
            dict(header, **{f"t{i}": {"dtype": "F64", "shape": [0] * 9, "data_offsets": [0, 0]} for i in range(9000)}),
            body,
        ),
    ]
    for index, content in enumerate(bombs):
        (tmp_path / f"{index}.safetensors").write_bytes(content)
    with (tmp_path / "huge.safetensors").open("wb") as file:
        file.truncate(2**40)
    code = (
        "import resource, sys\n"
        "from kinreach.baselines import load_policy\n"
        "from kinreach.errors import KinreachError\n"
        "used = int(open('/proc/self/statm').read().split()[0]) * 4096\n"
        "resource.setrlimit(resource.RLIMIT_AS, (used + 3 * 2**29, used + 3 * 2**29))\n"
        "for path in sys.argv[1:]:\n"
        "    try:\n"
        "        load_policy(path)\n"
        "    except KinreachError as error:\n"
        "        print('refused', len(str(error)))\n"
    )
    paths = sorted(map(str, tmp_path.iterdir()))
    done = subprocess.run(
        [sys.executable, "-c", code, *paths], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("refused") == len(paths) == 5
