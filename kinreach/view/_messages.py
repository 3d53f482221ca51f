"""Check the messages of a tab, and report errors in its page."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from math import inf
from typing import Any

from kinreach._checks import as_vector, check_count, check_flag, check_known, check_number, shown
from kinreach.cli import complain
from kinreach.errors import InputError, KinreachError
from kinreach.view import _html as html

#: viser's names of the messages that are answered; uploads, forms and commands are not.
INPUT, DRAG = "GuiUpdateMessage", "TransformControlsUpdateMessage"
#: Largest length of a text, and largest coordinate of a dragged frame [m].
MAX_TEXT, MAX_DISTANCE = 4096, 1e6

#: Called with an error, or with None when an input is accepted.
Report = Callable[[Exception | None], None]


def watch(client: Any, report: Report) -> None:
    """Check every message of a tab, and report the exceptions of its handlers."""
    gui, connection = client.gui, client.gui._websock_interface
    gui._thread_executor = client.scene._thread_executor = _Reporting(gui._thread_executor, report)
    for kind, handlers in list(connection._incoming_handlers.items()):
        connection.unregister_handler(kind)
        if kind.__name__ in (INPUT, DRAG, "SceneNodeClickMessage", "ViewerCameraMessage"):
            connection.register_handler(kind, _checking(gui, handlers, report))


def error_message(error: Exception) -> str:
    """Return an error as a red sentence of the page, and print it as a line on the terminal."""
    text = str(error) if isinstance(error, KinreachError) else f"{type(error).__name__}: {error}"
    complain(f"kinreach view: {text}")
    return html.message(text, bad=True)


def checked(handle: Any, value: Any) -> Any:
    """Check a value of an input and return it; a number may be text, because it is while it is typed."""
    name, old = handle.label, handle.value
    least, most = getattr(handle, "min", None), getattr(handle, "max", None)
    if isinstance(old, tuple):
        if not isinstance(value, list | tuple) or len(value) != len(old):
            raise InputError(f"{name} must be {len(old)} numbers, got {shown(value)}")
        bounds = zip(least or (None,) * len(old), most or (None,) * len(old), strict=True)
        return tuple(_number(name, entry, *bound) for entry, bound in zip(value, bounds, strict=True))
    if isinstance(old, bool):
        check_flag(name, value)
    elif isinstance(old, int):
        number = _number(name, value, least, most)
        return check_count(name, int(number) if number.is_integer() else value, least=-(10**9))
    elif isinstance(old, float):
        return _number(name, value, least, most)
    elif hasattr(handle, "options"):
        check_known(name, value, handle.options)
    elif not isinstance(value, str) or not value.isprintable() or len(value) > MAX_TEXT:
        raise InputError(f"{name} must be at most {MAX_TEXT} signs that can be printed, got {shown(value)}")
    return value


def _number(name: str, value: Any, least: float | None, most: float | None) -> float:
    if isinstance(value, str):
        with suppress(ValueError):
            value = float(value)
    return check_number(name, value, least=-inf if least is None else least, most=inf if most is None else most)


def _checking(gui: Any, handlers: list[Any], report: Report) -> Callable[[int, Any], Any]:
    """Return one handler that checks a message and calls the others."""

    async def handle(client_id: int, message: Any) -> None:
        try:
            kind = type(message).__name__
            if kind == INPUT:
                target = gui._gui_input_handle_from_uuid.get(message.uuid)
                if target is None or target.disabled or not target.visible:
                    return
                if not isinstance(message.updates, dict) or set(message.updates) != {"value"}:
                    raise InputError(f"a tab may change the value of {target.label}, not {shown(message.updates)}")
                message.updates = {"value": checked(target, message.updates["value"])}
            elif kind == DRAG:
                as_vector("the position of what is dragged", message.position, 3, most=MAX_DISTANCE)
                as_vector("the rotation of what is dragged", message.wxyz, 4, most=1.1)
            if kind != "ViewerCameraMessage":
                report(None)
            for handler in handlers:
                await handler(client_id, message)
        except Exception as error:
            report(error)

    return handle


class _Reporting(Executor):
    """An executor that reports exceptions, which viser would print."""

    def __init__(self, executor: Executor, report: Report) -> None:
        self._executor, self._report = executor, report

    def submit(self, work: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:

        def run() -> None:
            try:
                work(*args, **options)
            except Exception as error:
                self._report(error)

        return self._executor.submit(run)
