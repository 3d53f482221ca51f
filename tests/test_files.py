"""A result file is the old one or the new one, never half of one."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from kinreach import _files as files
from kinreach._files import UNFINISHED, locked, make_writable, open_input, read_bytes, replacing, write_text
from kinreach.errors import InputError, OutputError


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text("old")

    def fail_half_way() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half of the ne")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_half_way()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["results.json"]


def test_the_old_file_is_there_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text("old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["results.json"]


def test_a_full_disk_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "a.txt").write_text("old")
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match=r"cannot write .*a\.txt: No space left on device"):
        write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "a.txt").read_text() == "old"


@pytest.fixture(params=[0o000, 0o002, 0o022, 0o027, 0o077, 0o177, 0o777], ids=oct)
def mask(request: pytest.FixtureRequest) -> Iterator[int]:
    """A file mode creation mask of this process."""
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_written_files_have_the_usual_permissions(tmp_path: Path, mask: int, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "plain").write_text("x")
    usual = (tmp_path / "plain").stat().st_mode
    assert usual & 0o777 == 0o666 & ~mask

    def add(path: Path) -> None:
        with path.open("a") as file:
            file.write("x")

    def narrow(path: Path) -> None:
        path.write_text("x")
        path.chmod(0o600)

    def replace(path: Path) -> None:
        path.with_name("other").write_text("x")
        path.with_name("other").chmod(0o755)
        path.with_name("other").replace(path)

    def create_again(path: Path) -> None:
        path.unlink()
        with path.open("x") as file:  # which its own mask may keep from opening it again
            file.write("x")

    def close(path: Path) -> None:
        path.chmod(0o000)

    synced = []

    def to_disk(path: Path) -> None:  # an ordinary user can open only what its owner may read and write
        synced.append(path.stat().st_mode & 0o600)

    monkeypatch.setattr(files, "_to_disk", to_disk)
    for write in (add, narrow, replace, create_again, close):
        with replacing(tmp_path / "ours") as temporary:
            assert temporary.stat().st_mode & 0o600 == 0o600
            write(temporary)
        assert (tmp_path / "ours").stat().st_mode == usual, write.__name__
    assert synced == [0o600] * 5
    assert sorted(os.listdir(tmp_path)) == ["ours", "plain"]


@pytest.mark.parametrize("path", [".", "/", ""])
def test_a_directory_is_no_file(path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match="cannot write"):
        write_text(Path(path), "x")
    assert os.listdir(tmp_path) == []


def test_threads_that_write_leave_the_mask_of_the_process_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is one for all threads: whoever asks for it changes it for a moment, and files of others come out wrong."""

    def forbidden(mask: int) -> int:
        raise AssertionError("the mask of all threads is changed")

    monkeypatch.setattr(os, "umask", forbidden)
    (tmp_path / "plain").write_text("x")

    def write(index: int) -> int:
        for turn in range(20):
            write_text(tmp_path / f"{index}.txt", str(turn))
        return (tmp_path / f"{index}.txt").stat().st_mode

    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(write, range(8))) == {(tmp_path / "plain").stat().st_mode}
    assert {(tmp_path / f"{index}.txt").read_text() for index in range(8)} == {"19"}


def test_two_that_write_one_file_do_not_share_a_temporary(tmp_path: Path) -> None:
    with replacing(tmp_path / "a.txt") as first, replacing(tmp_path / "a.txt") as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert (tmp_path / "a.txt").read_text() == "first"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        make_writable(tmp_path / "file" / "out")


def test_a_directory_is_made_with_its_parents(tmp_path: Path) -> None:
    make_writable(tmp_path / "a" / "b")
    assert os.listdir(tmp_path / "a" / "b") == []


def test_a_directory_is_locked_for_one_writer(tmp_path: Path) -> None:
    with locked(tmp_path, "a training"):
        with pytest.raises(OutputError, match="a training is writing into"), locked(tmp_path, "a training"):
            pass
        (tmp_path / "a").mkdir()
        with locked(tmp_path / "a", "a training"):
            write_text(tmp_path / "x", "free to write")
    with locked(tmp_path, "a training"):
        assert sorted(os.listdir(tmp_path)) == ["a", "x"]


@pytest.mark.parametrize("name", ["x" * 240 + ".txt", "\N{SNOWMAN}" * 80 + ".txt"])
def test_a_name_as_long_as_the_system_takes_can_be_written(name: str, tmp_path: Path) -> None:
    for text in ("first", "second"):
        write_text(tmp_path / name, text)
    assert (tmp_path / name).read_text() == "second"
    assert os.listdir(tmp_path) == [name]


def test_an_ending_that_leaves_no_room_for_the_inode_leaves_nothing_behind(tmp_path: Path) -> None:
    refused = 0
    before = len(os.listdir("/proc/self/fd"))
    for length in range(180, 230):
        path = tmp_path / f"a.{'x' * length}"
        try:
            write_text(path, "new")
        except OutputError:
            refused += 1
        else:
            path.unlink()
        assert os.listdir(tmp_path) == []
    assert 0 < refused < 50
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("sweep", ["the same file", "its folder"])
def test_what_a_killed_writer_left_is_removed_and_nothing_else(sweep: str, tmp_path: Path) -> None:
    def unfinished(stem: str, inode: int = 0) -> Path:
        (tmp_path / "made").write_text("half")
        own = (tmp_path / "made").stat().st_ino
        return (tmp_path / "made").rename(tmp_path / f".{stem}{UNFINISHED}{inode or own:x}-{'0' * 15}{inode % 10}.json")

    left, copy, other = unfinished("a"), unfinished("a", inode=3), unfinished("b")
    (tmp_path / f".a{UNFINISHED}").write_text("a user's")
    with replacing(tmp_path / "a.json") as running:
        running.write_text("new")
        before = set(tmp_path.iterdir())
        assert left not in before
        other_left = unfinished("a")
        if sweep == "its folder":
            make_writable(tmp_path)
        else:
            write_text(tmp_path / "a.json", "another")
        assert not other_left.exists()
        assert other.exists() == (sweep == "the same file")
        assert copy.exists()
        assert running.exists()
    assert (tmp_path / "a.json").read_text() == "new"
    assert (tmp_path / f".a{UNFINISHED}").exists()


def test_files_of_users_have_a_bounded_size(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, "the file", most=5) == b"12345"
    with pytest.raises(InputError, match=r"cannot read the file .*: it has 5 bytes, larger than 4 bytes"):
        read_bytes(path, "the file", most=4)
    with path.open("r+b") as file:
        file.truncate(3 << 20)
    for most, said in ((1 << 20, "1 MiB"), (2**20 + 1, "1 MiB"), (2**20 - 1, "1048575 bytes"), (2 << 20, "2 MiB")):
        with pytest.raises(InputError, match=f"it has 3145728 bytes, larger than {said}$"):
            open_input(path, "the file", most=most)
