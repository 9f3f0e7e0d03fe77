"""The C guard: wrong calls, missed periods, readings that cannot be, whatever its flags."""

import itertools
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from identification import InvalidInputError
from tests.exported import changed, tuned
from tests.guard import Enter, Guard, InPython, Push, Reply, built, enter, push
from tests.guard_program import HIDDEN, REFUSAL, build, compilers, play_wrong_numbers, sources
from tune import export
from tune.certificate.check import inconsistent
from tune.exporters.law import largest_change

WALL, CUP, RUBBER = 1, 2, 4
#: Rubber that rests at 0 and is stretched to this place by the third period, m, and its force, N.
PLACE, FORCE = 2e-4, -0.14


@pytest.fixture(scope="module")
def guard(tmp_path_factory: pytest.TempPathFactory) -> Guard:
    return built(export(tuned(), "c"), tmp_path_factory.mktemp("guard"))


def stretched() -> list[Enter | Push]:
    """Rubber that pulls: it is entered, and the next reading is elsewhere."""
    return [enter(WALL | CUP | RUBBER), push(RUBBER, 0, 0.0), push(RUBBER, 1, PLACE)]


@pytest.mark.parametrize(
    ("elements", "gain", "status"),
    [
        (WALL | RUBBER, 1.0, "NOT_TOGETHER"),
        (8, 1.0, "NOT_TOGETHER"),
        (RUBBER | 1 << 63, 1.0, "NOT_TOGETHER"),
        (WALL, 1.0, "NOT_ENTERED"),
        (RUBBER, 1.0000001, "BAD_GAIN"),
        (RUBBER, -0.1, "BAD_GAIN"),
    ],
)
def test_whatever_is_not_certified_gives_no_force_and_a_reason(
    guard: Guard, elements: int, gain: float, status: str
) -> None:
    """What is entered stays so; its spring rests where the device is when it is played again."""
    calls = stretched()
    if status == "NOT_ENTERED":
        calls[0] = enter(RUBBER)
    calls += [push(elements, 2, PLACE, gain), push(RUBBER, 3, PLACE), push(RUBBER, 4, 2 * PLACE)]
    replies = guard.run(calls)[2:]
    assert [reply.status for reply in replies] == ["OK", status, "OK", "OK"]
    assert [reply.force for reply in replies] == pytest.approx([FORCE, 0, 0, FORCE])


@pytest.mark.parametrize(
    ("period", "position", "status"),
    [
        (2, float("nan"), "NOT_FINITE"),
        (2, -(2.0**64), "NOT_FINITE"),
        (2, 1e19, "GLITCH"),
        (1, PLACE, "STALE"),
    ],
)
def test_a_reading_that_is_missed_holds_the_force_and_two_end_the_contact(
    guard: Guard, period: int, position: float, status: str
) -> None:
    assert tuned().certificate.extra_delay_samples == 1
    replies = guard.run([*stretched(), push(RUBBER, period, position), push(RUBBER, 3, PLACE)])[2:]
    assert [reply.status for reply in replies] == ["OK", status, "OK"]
    assert [reply.force for reply in replies] == pytest.approx([FORCE] * 3)
    assert replies[-1].missed == 1
    assert replies[-1].glitches == (status == "GLITCH")

    bad = [push(RUBBER, period, position), push(RUBBER, period + (period > 1), position)]
    replies = guard.run([*stretched(), *bad, push(RUBBER, 4, PLACE), push(RUBBER, 5, PLACE)])[3:]
    assert [reply.status for reply in replies[:2]] == [status, "LATE"]
    assert replies[2].status in {"LATE", "NOT_ENTERED"}
    assert replies[3].status == "NOT_ENTERED"
    assert [reply.force for reply in replies] == pytest.approx([FORCE, 0, 0, 0])


@pytest.mark.parametrize("period", [2**32 - 1, 4, 2**31])
def test_more_missed_periods_than_are_certified_end_every_contact(
    guard: Guard, period: int
) -> None:
    after = (
        push(RUBBER, period, PLACE),
        push(RUBBER, (period + 1) % 2**32, PLACE),
        enter(RUBBER),
        push(RUBBER, (period + 2) % 2**32, PLACE),
        push(RUBBER, (period + 3) % 2**32, 2 * PLACE),
    )
    replies = guard.run([*stretched(), *after])[3:]
    assert [reply.status for reply in replies] == ["LATE", "NOT_ENTERED", "OK", "OK", "OK"]
    assert [reply.force for reply in replies] == pytest.approx([0, 0, 0, 0, FORCE])


def test_after_a_gap_velocity_goes_on_from_the_line_over_it(guard: Guard) -> None:
    """A contact that begins right after it is played as if nothing had been missed."""
    line = [0.0001 * k for k in range(60)]
    found: list[list[Reply]] = []
    for seen in ([*range(20), *range(40, 60)], range(60)):
        guard.start()
        replies: list[Reply] = []
        for k in seen:
            if k == 41:
                guard.call(enter(WALL))
            replies.append(guard.call(push(WALL if k >= 41 else 0, k, line[k])))
        found.append(replies)
    gap, whole = found
    assert [reply.status for reply in gap] == ["OK"] * 20 + ["LATE"] + ["OK"] * 19
    # What the filter had not yet caught up with when the gap began is all that differs.
    lag = np.exp(-2 * np.pi * 50 * 1e-3 * 20)
    forces = np.array([[reply.force for reply in each[-18:]] for each in (gap, whole)])
    np.testing.assert_allclose(forces[0], forces[1], atol=lag)
    assert forces[0, -1] < -0.5


def test_faster_than_the_device_can_move_is_a_glitch_and_fast_motion_is_none(guard: Guard) -> None:
    """A jump, from rest or on the way, is bridged; steady motion at any speed is none."""
    allowed = largest_change(tuned())
    assert allowed == pytest.approx((0.2 + 28 / 3 * 1e-3) * 1e-3 + 12e-6, rel=0.02)
    for speed in (0.0, 0.2, 2.0):
        steady = [speed * 1e-3 * k for k in range(20)]
        for jump, glitches in ((0.9 * allowed, 0), (1.1 * allowed, 1), (-6e-4, 1)):
            places = [*steady[:10], steady[10] + jump, *steady[11:]]
            guard.start()
            replies = [guard.call(push(0, k, place)) for k, place in enumerate(places)]
            begun = replies[9].glitches  # a start at full speed looks like one
            assert [reply.status for reply in replies[5:10]] == ["OK"] * 5
            assert replies[-1].glitches - begun == glitches
            assert (replies[10].status == "GLITCH") == bool(glitches)
            assert {reply.status for reply in replies[11:]} == {"OK"}


def test_what_cannot_be_is_what_the_documents_say(guard: Guard) -> None:
    """Far from two lines: through the last two readings, and through the two one period earlier."""
    T, draws = 1e-3, np.random.default_rng(0)
    most, place, seen = largest_change(tuned()), 0.0, Counter[str]()
    used = [(-2.0, 0.0), (-1.0, 0.0), (0.0, 0.0)]  # (period, reading), bridged by straight lines
    guard.run([push(0, 0, 0.0)])
    for k in range(1, 600):
        place += 0.1 * T * float(np.sin(0.05 * k))
        reading = place + float(draws.choice([0.0, 0.0, 0.8, 1.5]) * draws.normal() * most)
        far, steps = [], k - used[-1][0]
        for (before, low), (after, high) in itertools.pairwise(used[-3:]):
            line = high + (high - low) / (after - before) * (k - after)
            far.append(abs(reading - line) > most * steps)
        reply = guard.call(push(0, k, reading))
        seen[reply.status] += 1
        assert (reply.status in {"GLITCH", "LATE"}) == (all(far) or steps > 2)
        if reply.status == "OK" or steps > 2:
            last, rows = used[-1], int(steps)
            used += [
                (last[0] + n, last[1] + (reading - last[1]) * n / rows) for n in range(1, rows + 1)
            ]
    assert min(seen["OK"], seen["GLITCH"]) > 30


@pytest.mark.parametrize("kind", ["c", "python"])
def test_a_start_in_motion_faster_than_any_stated_speed_ends_contacts_and_says_so(
    guard: Guard, kind: str
) -> None:
    """As the header tells; at rest, and up to the stated speed, every reading is used."""
    played = guard if kind == "c" else InPython(tuned())
    for speed, statuses in (
        (0.0, ["OK"] * 5),
        (0.19, ["OK"] * 5),
        (0.3, ["OK", "GLITCH", "LATE", "LATE", "NOT_ENTERED"]),
    ):
        played.run([enter(WALL, -1.0, 1)])
        moving = [played.call(push(WALL, k, 1e-3 * speed * k)) for k in range(5)]
        assert [reply.status for reply in moving] == statuses
        assert not any(reply.force for reply in moving if reply.status != "OK")
        played.call(enter(WALL, -1.0, 1))
        assert played.call(push(WALL, 5, 5e-3 * speed)).status == "OK"


def test_an_encoder_that_jumps_for_good_ends_the_contact_and_is_followed_again(
    guard: Guard,
) -> None:
    guard.run(stretched())
    before = [guard.call(push(RUBBER, k, PLACE)) for k in range(2, 10)]
    after = [guard.call(push(RUBBER, k, 0.004)) for k in range(10, 20)]
    assert [reply.force for reply in before] == pytest.approx([FORCE] * 8)
    assert [reply.status for reply in after[:2]] == ["GLITCH", "LATE"]
    assert [reply.force for reply in after] == pytest.approx([FORCE] + [0.0] * 9)
    guard.call(enter(RUBBER))
    assert guard.call(push(RUBBER, 20, 0.004)).status == "OK"


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("cup", {"fade_time": 0.0}, "fade_time says 0 s, an element with mass"),
        ("cup", {"fade_time": 0.001}, "fades over 0.1 to 10 s"),
        ("cup", {"one_sided": True}, "one_sided pushes only"),
        ("wall", {"fade_time": 0.1}, "nothing in it fades"),
    ],
)
def test_what_cannot_be_played_so_is_refused_by_check(
    name: str, change: dict[str, float], words: str
) -> None:
    assert list(inconsistent(tuned(), name)) == []
    element = tuned().elements[name].model_copy(update=change)
    elements = {**tuned().elements, name: element}
    said = inconsistent(tuned().model_copy(update={"elements": elements}), name)
    assert words in "; ".join(said)


def test_a_fade_that_the_profile_does_not_state_is_not_exported() -> None:
    cup = tuned().elements["cup"].model_copy(update={"fade_time": 0.0})
    profile = changed()
    profile = profile.model_copy(update={"elements": {**profile.elements, "cup": cup}}).signed()
    for target in ("c", "chai3d", "json", "ros2"):
        with pytest.raises(InvalidInputError, match="no fade_time"):
            export(profile, target)


OPTIMISATIONS = ("-O0", "-O1", "-Og", "-O2", "-O3", "-Os", "-Ofast")
MATH = (
    (),
    ("-ffast-math",),
    ("-ffinite-math-only",),
    ("-ffast-math", "-fno-finite-math-only"),
    ("-funsafe-math-optimizations",),
    ("-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math"),
    ("-freciprocal-math",),
    ("-ffp-contract=fast",),
    ("-frounding-math",),
    ("-fno-honor-nans",),
    ("-fno-honor-infinities",),
    ("-fno-honor-nans", "-fno-honor-infinities"),
    ("-mfpmath=387",),
    ("-fsingle-precision-constant",),
)
STANDARDS = ("c99", "c++11", "c11", "c++14", "c17", "c++17", "gnu17", "c++20")
#: Sentences with which it may refuse.
REFUSALS = (REFUSAL, "haptune_constants_have_to_be_of_type_double")


@pytest.fixture
def here(tmp_path: Path) -> Path:
    if not compilers():
        pytest.skip("no compiler here")
    sources(tmp_path)
    return tmp_path


def outcome(folder: Path, pair: tuple[str, str], standard: str, flags: tuple[str, ...]) -> str:
    """What came of it; a refusal is tried again without the macros that tell."""
    told = build(folder, pair, standard, flags)
    if not told:
        play_wrong_numbers(folder / "program")
        return "played"
    if not any(sentence in told for sentence in REFUSALS):
        assert build(folder, pair, standard, flags, "empty.c"), told
        return "no such flag"
    if REFUSAL in told:
        told = build(folder, pair, standard, (*flags, *HIDDEN))
        assert not told or REFUSALS[1] in told, told
        if not told:
            play_wrong_numbers(folder / "program")
    return "refused"


@pytest.mark.parametrize("pair", compilers(), ids=lambda pair: pair[0])
@pytest.mark.parametrize(
    ("standard", "flags", "came"),
    [
        ("c++11", ("-O2",), "played"),
        ("c99", ("-O2", "-ffinite-math-only"), "refused"),
        ("c17", ("-O3", "-flto", "-ffast-math"), "refused"),
        ("c11", ("-Ofast", "-fno-finite-math-only"), "played"),
    ],
)
def test_no_force_after_a_fault(
    here: Path, pair: tuple[str, str], standard: str, flags: tuple[str, ...], came: str
) -> None:
    assert outcome(here, pair, standard, flags) in {came, "no such flag"}


@pytest.mark.long
@pytest.mark.parametrize("pair", compilers(), ids=lambda pair: pair[0])
def test_no_force_after_a_fault_with_any_flags(here: Path, pair: tuple[str, str]) -> None:
    """Every optimisation with every other flag, with and without LTO; standards take turns."""
    seen: Counter[str] = Counter()
    standards = itertools.cycle(STANDARDS)
    for optimisation, math, lto, _ in itertools.product(
        OPTIMISATIONS, MATH, ((), ("-flto",)), range(3)
    ):
        flags = (optimisation, *math, *lto)
        seen[outcome(here, pair, next(standards), flags)] += 1
    print(pair[0], dict(seen))
    assert seen["played"] > 100
    assert seen["refused"] > 50
