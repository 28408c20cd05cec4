"""Films: frames that are written one by one, as MP4 (H.264) or as an animated WebP."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext, suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from mindstage.errors import InvalidArgumentError, RendererUnavailableError
from mindstage.files import atomic_file

__all__ = ["FILM_SUFFIXES", "FilmWriter"]


FILM_SUFFIXES = (".mp4", ".webp")
"""The formats of films."""

_CODECS = ("libx264", "libopenh264", "mpeg4")
_QUALITY = "18"
"""Constant rate factor of H.264: visually without loss."""


class FilmWriter:
    """Writes a film; a context manager. The file appears when the film is complete, and not at all after an error."""

    def __init__(self, path: Path, *, size: tuple[int, int], frame_rate_hz: float) -> None:
        """Begins the film.

        Args:
            path: the file; its suffix is one of `FILM_SUFFIXES`.
            size: width and height [px]; both even for MP4.
            frame_rate_hz: frames per second.

        Raises:
            InvalidArgumentError: the suffix or the size is not possible.
            RendererUnavailableError: PyAV is not installed, or has no encoder.
        """
        suffix = path.suffix.lower()
        if suffix not in FILM_SUFFIXES:
            remedy = f"there is {', '.join(FILM_SUFFIXES)}"
            raise InvalidArgumentError(str(path), cause="films cannot be written in this format", remedy=remedy)
        if suffix == ".mp4" and (size[0] % 2 or size[1] % 2):
            raise InvalidArgumentError(
                "size", cause=f"MP4 needs even numbers, not {size[0]}x{size[1]}", remedy="give 1280x800"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as files:
            file = files.enter_context(files.enter_context(atomic_file(path)).open("w+b"))
            made: _Encoder = _Mp4(file, size, frame_rate_hz) if suffix == ".mp4" else _WebP(file, frame_rate_hz)
            self._files = files.pop_all()
        self._encoder = made

    def add(self, pixels: NDArray[np.uint8]) -> None:
        """Adds a frame, h x w x 3, sRGB."""
        self._encoder.add(pixels)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            with self._files:
                self._encoder.close()
            return
        with suppress(Exception):  # the first error is the relevant one
            self._encoder.close()
        with nullcontext() if isinstance(error, OSError) else suppress(OSError):
            self._files.__exit__(kind, error, trace)


class _Encoder(Protocol):
    def add(self, pixels: NDArray[np.uint8]) -> None: ...
    def close(self) -> None: ...


class _Mp4:
    def __init__(self, file: BinaryIO, size: tuple[int, int], frame_rate_hz: float) -> None:
        try:
            import av
        except ImportError as error:
            remedy = "install it with: pip install 'mindstage[render]', or write .webp"
            raise RendererUnavailableError("av", cause=str(error), remedy=remedy) from error
        codec = next((name for name in _CODECS if name in av.codecs_available), None)
        if codec is None:
            cause = f"it has none of the encoders {', '.join(_CODECS)}"
            raise RendererUnavailableError("av", cause=cause, remedy="write .webp")
        self._av: Any = av
        self._container: Any = self._av.open(file, "w", format="mp4")
        options = {"crf": _QUALITY} if codec == "libx264" else {}
        rate = Fraction(frame_rate_hz).limit_denominator(1001)
        self._stream: Any = self._container.add_stream(codec, rate=rate, options=options)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"

    def add(self, pixels: NDArray[np.uint8]) -> None:
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        self._container.mux(self._stream.encode())
        self._container.close()


class _WebP:
    def __init__(self, file: BinaryIO, frame_rate_hz: float) -> None:
        self._file, self._duration_ms = file, round(1000 / frame_rate_hz)
        self._frames: list[Any] = []

    def add(self, pixels: NDArray[np.uint8]) -> None:
        from PIL import Image

        self._frames.append(Image.fromarray(pixels))

    def close(self) -> None:
        if self._frames:
            first, *others = self._frames
            first.save(
                self._file,
                "WEBP",
                save_all=True,
                append_images=others,
                duration=self._duration_ms,
                loop=0,
                quality=88,
                minimize_size=False,
            )
