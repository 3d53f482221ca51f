"""Write frames into a file: a GIF with Pillow, or VP9 in an MP4 with OpenCV, which every browser plays."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kinreach._checks import check_path
from kinreach._files import make_writable, replacing
from kinreach.errors import InputError, OutputError

#: Frames per second of a film, in the time of the simulation.
FILM_FPS = 25
Pixels = NDArray[np.uint8]
FORMATS = (".gif", ".mp4")
#: Frames of a GIF, which is put together in memory; a longer film has to be a video.
MAX_GIF_FRAMES = 1000
#: A GIF has every second frame only, and few colours: those of its first frame, chosen by an octree, which keeps those
#: of things as small as the ball, and the ones that are written with. Another frame may be so far off in the mean.
GIF_EVERY, GIF_COLOURS, MAX_COLOUR_ERROR = 2, 63, 6.0
#: Height of the samples of a film's own colours [pixels].
SWATCH = 24


class Film(AbstractContextManager["Film"]):
    """Collect frames; the file appears, complete, when the block ends without an error or with Ctrl-C."""

    def __init__(self, path: str | Path, *, fps: int, colours: Sequence[str] = ()) -> None:
        self.path = check_path("a film", path)
        if self.path.suffix not in FORMATS:
            raise InputError(f"a film's name ends in {' or '.join(FORMATS)}, got {self.path.name!r}")
        make_writable(self.path.parent)
        self._fps = fps
        self._stack = ExitStack()
        self._colours = colours
        self._images: list[Image.Image] = []
        self._palette: Image.Image | None = None
        self._writer: Any = None
        self.frames = 0

    def __enter__(self) -> Film:
        self._temporary = self._stack.enter_context(replacing(self.path))
        return self

    @property
    def full(self) -> bool:
        """Whether it is a GIF that has as many frames as it may."""
        return self.path.suffix == ".gif" and self.frames >= MAX_GIF_FRAMES

    def add(self, frame: Pixels) -> None:
        """Append a frame, uint8 RGB, shape (height, width, 3), unless the film is full."""
        if self.full:
            return
        self.frames += 1
        if self.path.suffix == ".gif":
            if self.frames % GIF_EVERY == 1:
                self._images.append(self._with_few_colours(Image.fromarray(frame)))
            return
        if self._writer is None:
            self._writer = self._open(frame.shape[1], frame.shape[0])
        self._writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and not (isinstance(error, KeyboardInterrupt) and self.frames):
            self._stack.__exit__(kind, error, trace)  # leaves the old file as it was
            return
        with self._stack:
            if not self.frames:
                raise InputError("there are no frames to write")
            self._finish()

    def _with_few_colours(self, image: Image.Image) -> Image.Image:
        """Reduce an image to the film's palette, without dither: what does not move has the same pixels.

        The palette is made anew from an image that it does not fit.
        """
        if self._palette is not None:
            reduced = image.quantize(palette=self._palette, dither=Image.Dither.NONE)
            now, then = (np.asarray(one)[::4, ::4] for one in (reduced.convert("RGB"), image))
            if cv2.absdiff(now, then).mean() <= MAX_COLOUR_ERROR:
                return reduced
        whole = Image.new("RGB", (image.width, image.height + SWATCH))
        whole.paste(image)
        width = -(-image.width // max(len(self._colours), 1))
        for index, colour in enumerate(self._colours):
            whole.paste(colour, (index * width, image.height, (index + 1) * width, whole.height))
        self._palette = whole.quantize(GIF_COLOURS, Image.Quantize.FASTOCTREE)
        return image.quantize(palette=self._palette, dither=Image.Dither.NONE)

    def _open(self, width: int, height: int) -> Any:
        # the wheels of OpenCV have no encoder for H.264, and browsers do not play their mp4v
        writer = cv2.VideoWriter(str(self._temporary), cv2.VideoWriter.fourcc(*"vp09"), self._fps, (width, height))
        if not writer.isOpened():
            raise OutputError(f"cannot write {self.path}: this OpenCV has no VP9 encoder; a .gif needs none")
        self._stack.callback(writer.release)  # where the film fails; a second time does nothing
        return writer

    def _finish(self) -> None:
        if self._writer is not None:
            self._writer.release()
            whole = cv2.VideoCapture(str(self._temporary)).get(cv2.CAP_PROP_FRAME_COUNT) == self.frames
            if not whole:  # OpenCV does not report what it could not write
                raise OutputError(f"cannot write {self.path}: the video is not whole; the disk may be full")
            return
        first, *rest = self._images
        duration = round(GIF_EVERY * 1000 / self._fps)
        first.save(self._temporary, "GIF", save_all=True, append_images=rest, duration=duration, loop=0, optimize=True)
