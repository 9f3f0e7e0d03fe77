"""Signals that ask a command to end: they unwind it, but never in the middle of a file.

What was begun is cleaned up on the way out. Signals that the command was started to ignore, as
under ``nohup``, stay ignored.
"""

from __future__ import annotations

import signal
import sys
from _thread import interrupt_main, start_new_thread
from time import monotonic, sleep
from types import FrameType

#: Keyboard, a request to end, a terminal that was closed, a console's break; where they exist.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")

#: Seconds in which another signal says no more than the first: shell and system both send one.
_SAME_WISH = 1.0

#: Seconds until an interruption is raised again that came where Python cannot raise.
_AGAIN = 0.1


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
        """Raise Interruption if a signal came, and not while a file is written."""
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


class FilesWhole:
    """A block in which signals wait, so that all its files are written or none is begun.

    Raises:
        Interruption: before the block if a signal came already, else after it.
    """

    def __enter__(self) -> None:
        _requests.raise_unless_writing()
        self._outer, _requests.writing = _requests.writing, True

    def __exit__(self, *_: object) -> None:
        _requests.writing = self._outer
        _requests.raise_unless_writing()
