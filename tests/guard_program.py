"""A whole program around the exported C guard, built with any compiler, standard and flags."""

import itertools
import math
import shutil
import struct
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tests.exported import tuned
from tests.guard import STATUS, Enter, Push, Reply, enter, push, write
from tune import SafeProfile, export

WALL, CUP = 1, 2
#: What no reading, gain or face is: NaN of every kind, infinity, and nearly so.
WRONG = (
    0x7FF8000000000000,
    0xFFF8000000000000,
    0x7FF0000000000001,
    0x7FFFFFFFFFFFFFFF,
    0x7FF0000000000000,
    0xFFF0000000000000,
    0x7FEFFFFFFFFFFFFF,
    0xFFEFFFFFFFFFFFFF,
)
PLACES = ("first reading", "reading", "two readings", "gain", "face")
SETS = (WALL, CUP, WALL | CUP)
#: Periods of a play, and that of the fault.
_PERIODS, _AT = 60, 30

_MAIN = """\
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include "haptune_guard.h"

static double number(uint64_t bits)
{
    double found;
    memcpy(&found, &bits, sizeof found);
    return found;
}

int main(void)
{
    haptune_guard guard;
    char what;
    uint64_t elements, period, place, more;
    haptune_init(&guard);
    while (scanf(" %c %" SCNx64 " %" SCNx64 " %" SCNx64 " %" SCNx64,
               &what, &elements, &period, &place, &more) == 5) {
        double force = 0.0;
        uint64_t bits;
        if (what == 'i') {
            haptune_init(&guard);
        } else if (what == 'r') {
            haptune_reset(&guard, elements, number(place), more ? 1 : 0);
        } else {
            force = haptune_force(
                &guard, elements, (uint32_t)period, number(place), number(more));
        }
        memcpy(&bits, &force, sizeof bits);
        printf("%d %" PRIx64 "\\n", (int)guard.status, bits);
    }
    return 0;
}
"""
#: Takes the macros away by which compilers tell of such flags.
HIDDEN = ("-U__FAST_MATH__", "-U__FINITE_MATH_ONLY__", "-D__FINITE_MATH_ONLY__=0")
REFUSAL = "they take out tests for NaN"


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """Calls with one fault in them; without it, what they may be held against."""

    name: str
    calls: tuple[Enter | Push, ...]
    at: int
    plain: tuple[Enter | Push, ...]
    status: str
    held: bool
    ended: bool


def profile() -> SafeProfile:
    """The tuned profile, its wall one that pushes only."""
    made = tuned()
    wall = made.elements["wall"].model_copy(update={"one_sided": True})
    return made.model_copy(update={"elements": {**made.elements, "wall": wall}}).signed()


def plays() -> list[Play]:
    """Each wrong number at each place, with each set of elements: 120."""
    return [_play(*each) for each in itertools.product(PLACES, SETS, WRONG)]


def _play(place: str, elements: int, bits: int) -> Play:
    wrong = _number(bits)
    calls: list[Enter | Push] = [enter(elements, 0.0, 1)]
    calls += [push(elements, k, -2e-3 * math.sin(k / 10)) for k in range(_PERIODS)]
    at = 1 if place == "first reading" else 1 + _AT
    good = calls[at]
    assert isinstance(good, Push)
    plain = [*calls[:at], *calls[at + 1 :]]  # a reading that is no number is one that is missed
    if place == "gain":
        calls[at] = replace(good, gain=wrong)
        plain = [*calls[:at], replace(good, gain=-1.0), *calls[at + 1 :]]
    elif place == "face":
        calls.insert(at, enter(elements, wrong, 1))
        plain = [*calls[:at], enter(elements | 8, 0.0, 1), *calls[at + 1 :]]
    else:
        calls[at] = replace(good, position=wrong)
    if place == "two readings":
        last = calls[at + 1]
        assert isinstance(last, Push)
        calls[at + 1] = replace(last, position=wrong)
        at += 1
        plain = [*plain[: at - 1], *calls[at + 1 :]]
    late = place == "two readings"
    return Play(
        name=f"{place} {bits:016x} of {elements}",
        calls=tuple(calls),
        at=at,
        plain=tuple(plain),
        status="LATE" if late else "BAD_GAIN" if place == "gain" else "NOT_FINITE",
        held=place == "reading",
        ended=late or place == "face",
    )


def play_wrong_numbers(program: Path) -> None:
    """After every fault the force is what it has to be."""
    made = plays()
    replies = _run(program, [each.calls for each in made])
    plain = _run(program, [each.plain for each in made])
    limit = profile().device.force_limit
    assert limit is not None
    for play, told, without in zip(made, replies, plain, strict=True):
        forces = [reply.force for reply in told]
        at = play.at
        assert all(math.isfinite(force) and abs(force) <= limit.peak for force in forces), play.name
        assert max(map(abs, forces[:at])) >= 0.1 or at <= 1, play.name
        assert told[at].status == play.status, play.name
        assert forces[at] == (forces[at - 1] if play.held else 0.0), play.name
        assert any(forces[at:]) != play.ended, play.name
        after = len(play.calls) - at - 1
        assert forces[-after:] == [reply.force for reply in without[-after:]], play.name


def _number(bits: int) -> float:
    return struct.unpack("<d", struct.pack("<Q", bits))[0]


def _bits(number: float) -> int:
    return struct.unpack("<Q", struct.pack("<d", number))[0]


def _run(program: Path, runs: Sequence[Sequence[Enter | Push]]) -> list[list[Reply]]:
    """Replies to the calls of each run, each after haptune_init."""
    lines: list[str] = []
    for run in runs:
        lines.append("i 0 0 0 0")
        for call in run:
            if isinstance(call, Enter):
                lines.append(f"r {call.elements:x} 0 {_bits(call.rest):x} {call.side:x}")
            else:
                numbers = f"{_bits(call.position):x} {_bits(call.gain):x}"
                lines.append(f"f {call.elements:x} {call.period:x} {numbers}")
    done = subprocess.run(
        [program], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    told = (line.split() for line in done.stdout.splitlines())
    replies = [Reply(status=STATUS[int(a)], force=_number(int(b, 16))) for a, b in told]
    found: list[list[Reply]] = []
    for run in runs:
        found.append(replies[1 : 1 + len(run)])
        replies = replies[1 + len(run) :]
    assert not replies
    return found


def compilers() -> list[tuple[str, str]]:
    """Those for C and C++ that are here."""
    pairs = (("gcc", "g++"), ("clang", "clang++"), ("icx", "icpx"))
    return [(c, cxx) for c, cxx in pairs if shutil.which(c) and shutil.which(cxx)]


def sources(folder: Path) -> None:
    """The exported guard and a program around it."""
    empty = "int main(void) { return 0; }\n"
    write({**export(profile(), "c"), "main.c": _MAIN, "empty.c": empty}, folder)


def build(
    folder: Path, pair: tuple[str, str], standard: str, flags: Sequence[str], *files: str
) -> str:
    """Make ``folder/program``, of the guard or of files; what the compiler says where it cannot."""
    plus = "++" in standard
    language = ["-x", "c++"] if plus else ["-x", "c"]
    named = files or ("main.c", "haptune_guard.c")
    done = subprocess.run(
        [pair[plus], f"-std={standard}", *flags, *language, *named, "-o", "program"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 or done.stderr
    return done.stderr if done.returncode else ""
