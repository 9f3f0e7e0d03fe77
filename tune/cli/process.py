"""What surrounds a command: signals that ask it to end, and standard streams that stop nothing.

A signal unwinds it, but never in the middle of a file; what was begun is cleaned up on the way out.
Signals that the command was started to ignore, as under ``nohup``, stay ignored. Of the streams it
is remembered what cannot be delivered. A reader that has gone away, or was never there, wants
nothing: that is no failure. A full disk is. Little is imported before signals are caught.
"""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from _thread import interrupt_main, start_new_thread
from time import monotonic, sleep

TYPE_CHECKING = False
if TYPE_CHECKING:  # what checkers of types take for true
    from types import FrameType
    from typing import Any, TextIO

    from _typeshed import ReadableBuffer

#: Keyboard, a request to end, a terminal that was closed, a console's break; where they exist.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
#: Seconds in which another signal says no more than the first: shell and system both send one.
_SAME_WISH = 1.0
#: Seconds until an interruption is raised again that came where Python cannot raise.
_AGAIN = 0.1
#: Seconds between two attempts where a reader is slow and the stream does not wait for it.
_PAUSE = 0.01
#: Columns of the narrowest terminal that lines are broken for.
_NARROWEST = 40


class Interruption(BaseException):
    """A signal asked the command to end. No `Exception`, so that nothing handles it on the way."""


class _Requests:
    """What signals have asked of this process so far; there is one, as there is of signals."""

    def __init__(self) -> None:
        self.handled: list[signal.Signals] = []
        self.came = False
        self.deaf_until = 0.0
        self.writing = False

    def receive(self, number: int, frame: FrameType | None) -> None:
        """Unwind at once, or when the file that is being written is whole."""
        del number, frame
        if monotonic() < self.deaf_until:
            return
        self.came, self.deaf_until = True, monotonic() + _SAME_WISH
        self.raise_unless_writing()

    def raise_unless_writing(self) -> None:
        if self.came and not self.writing:
            raise Interruption

    def raise_again(self) -> None:
        """Raise Interruption in the main thread in a moment."""

        def later() -> None:
            sleep(_AGAIN)
            self.deaf_until = 0.0
            interrupt_main(self.handled[0])

        start_new_thread(later, ())


_requests = _Requests()


def unwind_on_signals() -> None:
    """Let signals that end a process raise Interruption instead, in the main thread."""
    others = sys.unraisablehook

    def unraisable(ignored: sys.UnraisableHookArgs) -> None:
        """What Python drops on the floor, as in a weak reference's callback."""
        if issubclass(ignored.exc_type, Interruption):
            _requests.raise_again()
        else:
            others(ignored)

    sys.unraisablehook = unraisable
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            _requests.handled.append(number)
            signal.signal(number, _requests.receive)


def ignore_signals() -> None:
    """Let nothing interrupt the last words of a command that ends anyway."""
    for number in _requests.handled:
        signal.signal(number, signal.SIG_IGN)


def was_interrupted() -> bool:
    """Whether a signal came, though a library may have turned it into another error."""
    return _requests.came


class UninterruptedWrites:
    """A block in which signals wait, so that all its files are written or none is begun."""

    def __enter__(self) -> None:
        _requests.raise_unless_writing()
        self._outer, _requests.writing = _requests.writing, True

    def __exit__(self, *_: object) -> None:
        _requests.writing = self._outer
        _requests.raise_unless_writing()


class _Outlet(io.RawIOBase):
    """A stream of bytes that takes everything and passes on what it can."""

    def __init__(self, inner: io.RawIOBase) -> None:
        #: The system's words why something was not delivered, "" if all was.
        self.failure = ""
        self._inner = inner
        self._open = True

    def write(self, data: ReadableBuffer, /) -> int:
        """Pass bytes on, or drop them and all that follow where that fails."""
        count = memoryview(data).nbytes
        if not self._open:
            return count
        try:
            while (written := self._inner.write(data)) is None:
                sleep(_PAUSE)
        except OSError as error:
            self._open = False
            # A broken pipe, which Windows calls an invalid argument: its reader has gone.
            gone = {errno.EPIPE, errno.EINVAL} if sys.platform == "win32" else {errno.EPIPE}
            if error.errno not in gone:
                self.failure = error.strerror or str(error)
            return count
        return written

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._inner.fileno()

    def isatty(self) -> bool:
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
    return outlet.failure if isinstance(outlet, _Outlet) else ""


def wrap_text(text: str, stream: TextIO) -> str:
    """A text broken between words where a terminal is too narrow for it; untouched elsewhere."""
    if not stream.isatty():
        return text
    import shutil
    import textwrap

    width = max(_NARROWEST, shutil.get_terminal_size().columns)
    lines: list[str] = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        lines += textwrap.wrap(
            line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
        ) or [""]
    return "\n".join(lines)


def _outlet_stream(stream: TextIO | None) -> TextIO:
    if stream is None:  # what Python makes of a closed descriptor
        return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123 - open to the end
    beneath: Any = getattr(stream, "buffer", None)  # absent where a program runs us inside itself
    raw = getattr(beneath, "raw", beneath)  # unbuffered streams have but one layer
    if not isinstance(stream, io.TextIOWrapper) or isinstance(raw, _Outlet):
        return stream  # pyright: ignore[reportUnknownVariableType]
    return io.TextIOWrapper(
        io.BufferedWriter(_Outlet(raw)),
        encoding=stream.encoding,
        errors="replace",
        line_buffering=stream.line_buffering or stream.write_through,
    )
