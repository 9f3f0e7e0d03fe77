"""What is going on, for how long already, and about how much longer, on a terminal."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from time import monotonic

#: Counted parts of the work end a sentence so, which is what an estimate is made of.
_COUNT = re.compile(r"\((\d+) of (\d+)\)$")
#: Less than this needs no clock, s.
_SHORT = 1.0


class Stage:
    """The sentence of the work in hand with its clock; read anew whenever it is drawn.

    Args:
        clock: seconds since any moment.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._sentence = "working"
        self._began = self._said = self._counting = clock()
        self._first = self._part = self._parts = 0

    def __call__(self, sentence: str) -> None:
        """Go on to another stage; "... (3 of 7)" begins the third of seven parts alike."""
        now = self._clock()
        counted = _COUNT.search(sentence)
        part, parts = (int(each) for each in counted.groups()) if counted else (0, 0)
        if parts != self._parts or part <= self._part:
            self._first, self._counting = part, now
        self._part, self._parts = part, parts
        self._sentence, self._said = sentence, now

    def __rich__(self) -> str:
        """What a terminal shows now."""
        return str(self)

    def __str__(self) -> str:
        """The sentence, seconds since the work began, and seconds that are left of the parts."""
        now = self._clock()
        text = self._sentence
        if now - self._began >= _SHORT:
            text += f", {now - self._began:.0f} s"
        done = self._part - self._first
        if done > 0:
            mean = (self._said - self._counting) / done
            left = (self._parts - self._part + 1) * mean - (now - self._said)
            text += f", about {max(left, 1.0):.0f} s more" if mean else ""
        return text


@contextmanager
def show_stages() -> Generator[Callable[[str], None]]:
    """A function that is told each stage, which is shown on standard error until the work ends."""
    from rich.console import Console

    stage = Stage()
    with Console(stderr=True, markup=False, highlight=False).status(stage):
        yield stage
