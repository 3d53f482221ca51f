"""Writing results: a file is either the old one or the new one, never half of one."""

from __future__ import annotations

import fcntl
import glob
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kinreach.errors import OutputError

#: In the name of every file that is being written, between a dot with the stem and what makes it unique.
UNFINISHED = "-unfinished-"
#: A disk without room for that many bytes is full from the start.
_ROOM = 16_384
#: Mode bits of an owner who reads and writes.
_OWN = 0o600


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it takes `path`'s place when the block ends well.

    If the block raises, the old file stays as it was. If the process is killed in the block, the temporary file stays
    behind until the same file is written again, or `make_writable` is called for its directory.

    Raises:
        OutputError: The file system refused.
    """
    try:
        _sweep(path.parent, f".{glob.escape(path.stem)}{UNFINISHED}*")
        handle, temporary, mode = _locked_temporary(path)
    except OSError as error:
        raise _refused(path, error) from error
    try:
        temporary.chmod(mode | _OWN)  # a mask may keep the owner out, who has yet to write
        yield temporary
        _to_disk(temporary)
        temporary.chmod(mode)  # of a file that `open` makes; the block may have put another in its place
        os.replace(temporary, path)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)
        os.close(handle)


def write_text(path: Path, text: str) -> None:
    """Write a text file in one step.

    Raises:
        OutputError: The file system refused.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def make_writable(directory: Path) -> None:
    """Create a directory, with its parents, and make sure that files can be written in it.

    Raises:
        OutputError: It cannot be created, cannot be written to, or its disk is full.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        _sweep(directory, f".*{UNFINISHED}*")
        with tempfile.TemporaryFile(dir=directory) as file:
            file.write(bytes(_ROOM))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise _refused(directory, error) from error


def _sweep(directory: Path, pattern: str) -> None:
    """Remove temporary files whose writers were killed; those that somebody is writing are locked, and stay."""
    for left in directory.glob(pattern):
        with suppress(OSError):  # gone, somebody else's, or being written
            handle = os.open(left, os.O_RDWR)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                left.unlink()
            finally:
                os.close(handle)


def _locked_temporary(path: Path) -> tuple[int, Path, int]:
    """A new temporary file, the handle that holds its lock, and the mode that the system gives a new file here.

    The lock ends with the process whatever ends that. The mode is that of the file itself: to ask for the process's
    mask is to change it for a moment, for all threads.
    """
    while True:
        temporary = path.parent / f".{path.stem}{UNFINISHED}{secrets.token_hex(4)}{path.suffix}"
        try:
            handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError:
            continue
        mode = stat.S_IMODE(os.fstat(handle).st_mode)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            if os.fstat(handle).st_nlink:  # else somebody swept it up before it was locked
                return handle, temporary, mode
        except OSError:
            return handle, temporary, mode  # a file system without locks: it cannot be swept either
        os.close(handle)


def _to_disk(path: Path) -> None:
    """Have the data on the disk before the name points at them; a disk that turns out to be full says so here."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _refused(path: Path, error: OSError) -> OutputError:
    return error if isinstance(error, OutputError) else OutputError(f"cannot write {path}: {error.strerror or error}")
