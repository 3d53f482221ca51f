"""A call in a process of its own: what it imports, its crash and its search without end stay there."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from benchmarks.speed.peers.base import silent
from kinreach.errors import InputError

_FORK = multiprocessing.get_context("fork")


def forked(call: Callable[..., Any], *arguments: Any, limit: int = 60) -> Any:
    """Call a function in a fork of this process, on a silent terminal.

    Args:
        call: Its result is pickled.
        arguments: Of the call.
        limit: Processor time that it may take [s].

    Raises:
        InputError: It raised, took longer, or its process ended; the message is for a table.
    """
    ours, theirs = _FORK.Pipe(duplex=False)
    process = _FORK.Process(target=_child, args=(theirs, call, arguments, limit))
    process.start()
    theirs.close()
    try:
        result, why = ours.recv() if ours.poll(20 * limit) else (None, "no answer")
    except EOFError:
        process.join()
        late = process.exitcode == -signal.SIGPROF
        result, why = None, f"more than {limit} s of processor time" if late else "its process crashed"
    finally:
        process.kill()
        process.join()
    if why:
        raise InputError(why)
    return result


def _child(pipe: Connection, call: Callable[..., Any], arguments: tuple[Any, ...], limit: int) -> None:
    signal.setitimer(signal.ITIMER_PROF, limit)
    with silent():
        try:
            pipe.send((call(*arguments), ""))
        except ModuleNotFoundError as error:
            pipe.send((None, f"not installed (no module {error.name})"))
        except Exception as error:
            pipe.send((None, " ".join(str(error).split()) or type(error).__name__))
