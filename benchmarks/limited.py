"""Answers of a method on one log after another, in a process of its own that may be ended."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from multiprocessing.connection import Connection
from typing import Any

#: Nothing takes longer, s of the processor: what has not answered by then did not finish.
LONGEST = 20.0
#: Shorter calls are repeated for so long, s.
_SHORT = 0.02
#: On a busy machine the clock may run so many times longer.
_BUSY = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What came back."""

    values: tuple[Any, ...]  # one an argument, of those that were reached
    seconds: tuple[float, ...]  # of each
    trouble: str  # how the method ended, where it did not answer
    megabytes: float  # by which the most memory used grew


def answers(
    method: Callable[[Any], Any],
    arguments: list[Any],
    *,
    budget: float,
    least: int = 1,
    longest: float = LONGEST,
) -> Answers:
    """Call a method on each argument in turn until the budget is spent.

    The process is a copy of this one: arguments are not sent, libraries are warm. The first
    argument is answered twice where there is time, and its second time is kept: imports,
    compilation and caches are no property of a method. Times are of the processor. After the budget
    no argument is begun once there are ``least`` answers; after the longest, s, the process ends.
    """
    context: Any = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(
        target=_work, args=(there, method, arguments, budget, least, longest), daemon=True
    )
    start = time.perf_counter()
    process.start()
    there.close()
    found = list(_received(here, start + _BUSY * longest))
    if process.is_alive():
        process.kill()
    process.join()
    worked = [each for each in found if each[0] == "value"]
    failed = [each[1] for each in found if each[0] == "trouble"]
    done = any(each[0] == "end" for each in found)
    trouble = failed[0] if failed else "" if done or worked else f"did not finish in {longest:g} s"
    return Answers(
        values=tuple(each[1] for each in worked),
        seconds=tuple(each[2] for each in worked),
        trouble=trouble,
        megabytes=max((each[3] for each in worked), default=0.0),
    )


def _received(here: Connection, end: float) -> Iterator[tuple[Any, ...]]:
    while here.poll(max(0.0, end - time.perf_counter())):
        try:
            message = here.recv()
        except EOFError:
            return
        yield message
        if message[0] != "value":
            return


def _again(method: Callable[[Any], Any], argument: Any) -> float:
    """Time of one call more, or the mean of many short ones, s."""
    calls, start = 0, time.thread_time()
    while calls == 0 or time.thread_time() - start < _SHORT:
        method(argument)
        calls += 1
    return (time.thread_time() - start) / calls


def _work(
    there: Connection,
    method: Callable[[Any], Any],
    arguments: list[Any],
    budget: float,
    least: int,
    longest: float,
) -> None:
    # The clock of a process whose time is limited counts in ticks; that of its thread does not.
    from resource import RLIMIT_CPU, RUSAGE_SELF, getrlimit, getrusage, setrlimit

    begun = time.thread_time()
    setrlimit(RLIMIT_CPU, (max(1, round(begun + longest)), getrlimit(RLIMIT_CPU)[1]))
    before = getrusage(RUSAGE_SELF).ru_maxrss
    with redirect_stdout(StringIO()):
        for index, argument in enumerate(arguments):
            if time.thread_time() - begun > budget and index >= least:
                break
            try:
                start = time.thread_time()
                value = method(argument)
                took = time.thread_time() - start
                if index == 0 and took < budget / 4:
                    took = _again(method, argument)
            except Exception as trouble:  # noqa: BLE001 - whatever a library raises is its answer
                there.send(("trouble", f"{type(trouble).__name__}: {str(trouble)[:80]}"))
                return
            grown = (getrusage(RUSAGE_SELF).ru_maxrss - before) / 1024
            there.send(("value", value, took, grown))
    there.send(("end",))
