"""Standard output and error that stop nothing: what cannot be delivered is remembered instead.

A reader that has gone away, or was never there, wants nothing: that is no failure. A full disk is.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import sys
import textwrap
from time import sleep
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

#: Seconds between two attempts where a reader is slow and the stream does not wait for it.
_PAUSE = 0.01
#: Columns of the narrowest terminal that lines are broken for.
_NARROWEST = 40


class Outlet(io.RawIOBase):
    """A stream of bytes that takes everything and passes on what it can.

    Attributes:
        failure: the system's words why something was not delivered, "" if all was.
    """

    def __init__(self, inner: io.RawIOBase) -> None:
        self.failure = ""
        self._inner = inner
        self._open = True

    def write(self, data: ReadableBuffer, /) -> int:
        """Pass bytes on, or drop them and all that follow where that fails."""
        whole = memoryview(data).nbytes
        if not self._open:
            return whole
        try:
            while (written := self._inner.write(data)) is None:
                sleep(_PAUSE)
        except OSError as error:
            self._open = False
            if not _reader_gone(error):
                self.failure = error.strerror or str(error)
            return whole
        return written

    def writable(self) -> bool:
        """Always."""
        return True

    def fileno(self) -> int:
        """The descriptor beneath."""
        return self._inner.fileno()

    def isatty(self) -> bool:
        """Whether a terminal is beneath."""
        return self._inner.isatty()


def prepare_streams() -> None:
    """Make standard output and error such that no failure of theirs changes what a command does.

    Letters that a terminal cannot show become question marks. Closed descriptors lead nowhere, so
    that no file opened later takes their place.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest that is free, which is this one
    sys.stdout = _outlet_stream(sys.stdout)
    sys.stderr = _outlet_stream(sys.stderr)


def delivery_failure() -> str:
    """Why standard output did not take what was printed, "" if it did or nobody reads it."""
    sys.stdout.flush()
    outlet = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return outlet.failure if isinstance(outlet, Outlet) else ""


def wrap_text(text: str, stream: TextIO) -> str:
    """A text broken between words where a terminal is too narrow for it; untouched elsewhere."""
    if not stream.isatty():
        return text
    width = max(_NARROWEST, shutil.get_terminal_size().columns)
    lines: list[str] = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        lines += textwrap.wrap(
            line,
            width,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
            drop_whitespace=True,
        ) or [""]
    return "\n".join(lines)


def _outlet_stream(stream: TextIO | None) -> TextIO:
    if stream is None:  # what Python makes of a closed descriptor
        return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123 - open to the end
    beneath: Any = getattr(stream, "buffer", None)  # absent where a program runs us inside itself
    raw = getattr(beneath, "raw", beneath)  # unbuffered streams have but one layer
    if not isinstance(stream, io.TextIOWrapper) or isinstance(raw, Outlet):
        return stream  # pyright: ignore[reportUnknownVariableType]
    return io.TextIOWrapper(
        io.BufferedWriter(Outlet(raw)),
        encoding=stream.encoding,
        errors="replace",
        line_buffering=stream.line_buffering or stream.write_through,
    )


def _reader_gone(error: OSError) -> bool:
    """Whether a pipe is broken, which Windows calls an invalid argument."""
    gone = {errno.EPIPE, errno.EINVAL} if sys.platform == "win32" else {errno.EPIPE}
    return error.errno in gone
