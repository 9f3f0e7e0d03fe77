"""Whatever flags the guard is compiled with: no force after a fault, or it does not compile."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path

import pytest

from tests.guard_program import HIDDEN, REFUSAL, build, compilers, faults_of, plays, sources

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


def outcome(
    folder: Path, pair: tuple[str, str], standard: str, flags: tuple[str, ...]
) -> tuple[str, list[str]]:
    """(what came of it, what is wrong); a refusal is tried again without macros that tell."""
    told = build(folder, pair, standard, flags)
    if not told:
        return "played", faults_of(folder / "program")
    if not any(sentence in told for sentence in REFUSALS):
        known = not build(folder, pair, standard, flags, "empty.c")
        return ("refused", [told]) if known else ("no such flag", [])
    if REFUSAL in told:
        told = build(folder, pair, standard, (*flags, *HIDDEN))
        if not told:
            return "refused", faults_of(folder / "program")
        return "refused", [] if REFUSALS[1] in told else [told]
    return "refused", []


def test_there_are_120_faults() -> None:
    assert len({play.name for play in plays()}) == 120


@pytest.mark.parametrize("pair", compilers(), ids=lambda pair: pair[0])
@pytest.mark.parametrize(
    ("standard", "flags", "came"),
    [
        ("c99", ("-O0",), "played"),
        ("c++11", ("-O2",), "played"),
        ("c99", ("-O2", "-ffinite-math-only"), "refused"),
        ("c17", ("-O3", "-flto", "-ffast-math"), "refused"),
        ("c11", ("-Ofast", "-fno-finite-math-only"), "played"),
        ("c++17", ("-O3", "-flto", "-fno-honor-nans"), "played"),
    ],
)
def test_no_force_after_a_fault(
    here: Path, pair: tuple[str, str], standard: str, flags: tuple[str, ...], came: str
) -> None:
    found, wrong = outcome(here, pair, standard, flags)
    assert wrong == []
    assert found in {came, "no such flag"}


@pytest.mark.long
@pytest.mark.parametrize("pair", compilers(), ids=lambda pair: pair[0])
def test_no_force_after_a_fault_with_any_flags(here: Path, pair: tuple[str, str]) -> None:
    """Every optimisation with every other flag, with and without LTO; standards take turns."""
    seen: Counter[str] = Counter()
    wrong: dict[tuple[str, ...], list[str]] = {}
    standards = itertools.cycle(STANDARDS)
    for optimisation, math, lto, _ in itertools.product(
        OPTIMISATIONS, MATH, ((), ("-flto",)), range(3)
    ):
        standard, flags = next(standards), (optimisation, *math, *lto)
        came, faults = outcome(here, pair, standard, flags)
        seen[came] += 1
        if faults:
            wrong[standard, *flags] = faults[:3]
    print(pair[0], dict(seen))
    assert wrong == {}
    assert seen["played"] > 100
    assert seen["refused"] > 50
