"""Signals that ask a command to end: they unwind it, but never in the middle of a file.

What was begun is cleaned up on the way out. Signals that the command was started to ignore, as
under ``nohup``, stay ignored.
"""

from __future__ import annotations

import signal
import sys
from time import monotonic
from types import FrameType

#: Keyboard, a request to end, a terminal that was closed, a console's break; where they exist.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")

#: Seconds in which another signal says no more than the first: shell and system both send one.
_SAME_WISH = 1.0


class Interruption(BaseException):
    """A signal asked the command to end. No `Exception`, so that nothing handles it on the way."""


class _Asked:
    """What signals have asked of this process so far; there is one, as there is of signals."""

    def __init__(self) -> None:
        self.handled: list[int] = []
        self.since: float | None = None
        self.writing = False

    def receive(self, number: int, frame: FrameType | None) -> None:
        """Unwind at once, or when the file that is being written is whole."""
        del number, frame
        now = monotonic()
        again = self.since is not None and now - self.since < _SAME_WISH
        if not again:
            self.since = now
            self.raise_unless_writing()

    def raise_unless_writing(self) -> None:
        """Raise Interruption if a signal came, and not while a file is written."""
        if self.since is not None and not self.writing:
            raise Interruption


_asked = _Asked()


def unwind_on_signals() -> None:
    """Let signals that end a process raise Interruption instead, in the main thread."""
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            _asked.handled.append(number)
            signal.signal(number, _asked.receive)
    others = sys.unraisablehook

    def unraisable(ignored: sys.UnraisableHookArgs) -> None:
        """Say nothing of an interruption that cannot be raised; it is before the next file."""
        if not issubclass(ignored.exc_type, Interruption):
            others(ignored)

    sys.unraisablehook = unraisable


def ignore_signals() -> None:
    """Let nothing interrupt the last words of a command that ends anyway."""
    for number in _asked.handled:
        signal.signal(number, signal.SIG_IGN)


def was_interrupted() -> bool:
    """Whether a signal came, though a library may have turned it into another error."""
    return _asked.since is not None


class FilesWhole:
    """A block in which signals wait, so that all its files are written or none is begun.

    Raises:
        Interruption: before the block if a signal came already, else after it.
    """

    def __enter__(self) -> None:
        _asked.raise_unless_writing()
        self._outer, _asked.writing = _asked.writing, True

    def __exit__(self, *_: object) -> None:
        _asked.writing = self._outer
        _asked.raise_unless_writing()
