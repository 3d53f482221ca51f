"""Read files of users, and write results.

Inputs must be regular files of a bounded size: opening a FIFO would block, opening a device may have effects.
Outputs are written whole or not at all.

The name of an unfinished file contains the number of its inode, so that no copy and no file of a user matches it.
Unfinished files that no process has locked are removed.
"""

from __future__ import annotations

import codecs
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path

from filelock import lock_descriptor

from kinreach.errors import InputError, OutputError

#: In the name of every unfinished file, between the beginning of the stem and the inode's number.
UNFINISHED = ".kinreach-unfinished-"
_NAME = re.compile(r"\..*" + re.escape(UNFINISHED) + r"(?P<inode>[0-9a-f]+)-[0-9a-f]{16}(\..*)?", re.DOTALL)
#: Free space that a disk must have [bytes].
_ROOM = 16_384
#: Mode bits of an owner who reads and writes.
_OWN = 0o600


#: What a path can be beside a regular file.
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_input(path: Path, what: str, *, most: int) -> BufferedReader:
    """Open a file that a user named.

    Args:
        path: Of the file.
        what: What it is, for messages, such as "the policy".
        most: Largest size [bytes].

    Raises:
        InputError: The file does not exist, is not a regular file, or is too large.
    """
    try:
        _check_regular(os.stat(path))  # before it is opened, which may do something to a device
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
        try:
            status = os.fstat(handle)
            _check_regular(status)
            if status.st_size > most:
                raise OSError(f"it has {status.st_size} bytes, larger than {_size(most)}")
            return os.fdopen(handle, "rb")
        except BaseException:
            os.close(handle)
            raise
    except OSError as error:
        raise InputError(f"cannot read {what} {path}: {error.strerror or error}") from None


def read_bytes(path: Path, what: str, *, most: int) -> bytes:
    """Return the contents of a file; arguments and errors as in `open_input`."""
    with open_input(path, what, most=most) as file:
        return file.read(os.fstat(file.fileno()).st_size)  # not `most`, for which memory would be set aside


def read_text(path: Path, what: str, *, most: int) -> str:
    """Return the contents of a text file in UTF-8; arguments and errors as in `open_input`."""
    try:
        return read_bytes(path, what, most=most).decode()
    except UnicodeDecodeError as error:
        raise InputError(f"cannot read {what} {path}: it is not UTF-8 text ({error})") from None


def decoded(content: bytes, *, otherwise: str) -> str:
    """Return the text of a file without its byte order mark: UTF-16 by that, else UTF-8, else in another encoding.

    Bytes that the encoding does not have are replaced.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode(otherwise, errors="replace")


def _check_regular(status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = _KINDS.get(stat.S_IFMT(status.st_mode), "something else")
        raise OSError(f"it is {kind}, not a regular file")


def _size(count: int) -> str:
    return f"{count >> 20} MiB" if count >= 2**20 else f"{count} bytes"


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, which replaces `path` when the block ends without an error.

    If the block raises, the old file stays as it was. If the process is killed in the block, the temporary file stays
    behind until the same file is written again, or `make_writable` is called for its directory.

    Raises:
        OutputError: The file system refused.
    """
    try:
        _sweep(path.parent, _prefix(path))
        handle, temporary, mode = _locked_temporary(path)
    except OSError as error:
        raise _refused(path, error) from error
    try:
        temporary.chmod(mode | _OWN)  # a mask may keep the owner out, who has yet to write
        yield temporary
        temporary.chmod(mode | _OWN)  # the block may have put another file in its place
        _to_disk(temporary)
        temporary.chmod(mode)
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
        _sweep(directory, ".")
        with tempfile.TemporaryFile(dir=directory) as file:
            file.write(bytes(_ROOM))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise _refused(directory, error) from error


@contextmanager
def locked(directory: Path, writer: str) -> Iterator[None]:
    """Lock a directory for one writer, if its file system has locks; the lock ends with the process.

    Args:
        directory: An existing one.
        writer: Who writes, for the message.

    Raises:
        OutputError: Another process has locked it.
    """
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        free = True
        with suppress(OSError):  # no locks there
            free = lock_descriptor(handle, blocking=False)
        if not free:
            raise OutputError(f"{writer} is writing into {directory} already; wait for it, or use another")
        yield
    finally:
        os.close(handle)


def _sweep(directory: Path, beginning: str) -> None:
    """Remove temporary files whose writers were killed; those of running writers are locked."""
    for left in directory.iterdir():
        name = _NAME.fullmatch(left.name)
        if name is None or not left.name.startswith(beginning):
            continue
        with suppress(OSError):  # gone, somebody else's, or being written
            handle = os.open(left, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                status = os.fstat(handle)
                ours = stat.S_ISREG(status.st_mode) and status.st_ino == int(name["inode"], 16)
                if ours and lock_descriptor(handle, blocking=False):
                    left.unlink()
            finally:
                os.close(handle)


def _prefix(path: Path) -> str:
    """Return what the names of a file's temporaries begin with, of a long name its beginning."""
    return f".{path.stem[:40]}{UNFINISHED}"


def _locked_temporary(path: Path) -> tuple[int, Path, int]:
    """Make a temporary file; return its lock's handle, its path, and the mode that the system gives a new file here.

    It is locked before it gets the name under which `_sweep` may remove it. The mode is read from the file: to read
    the process's mask is to change it for a moment, for all threads.
    """
    token = secrets.token_hex(8)
    prefix = _prefix(path)
    new = path.parent / f"{prefix}{token}{path.suffix}"
    handle = os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    with suppress(OSError):  # a file system without locks: it cannot be swept either
        lock_descriptor(handle)
    status = os.fstat(handle)
    temporary = path.parent / f"{prefix}{status.st_ino:x}-{token}{path.suffix}"
    try:
        os.rename(new, temporary)
    except OSError:
        new.unlink(missing_ok=True)
        os.close(handle)
        raise
    return handle, temporary, stat.S_IMODE(status.st_mode)


def _to_disk(path: Path) -> None:
    """Flush a file to the disk; a full disk raises here."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _refused(path: Path, error: OSError) -> OutputError:
    return error if isinstance(error, OutputError) else OutputError(f"cannot write {path}: {error.strerror or error}")
