"""Gate of faults: one-line faults, each of which some default test has to notice.

    python -m tests.faults              # all of them, two at a time: some minutes
    python -m tests.faults ripple apart # those whose names hold a word

Each is put into a copy of the tree, in which the tests named beside it are run until one fails.
Ends with 1 unless every fault is caught. What notices a fault goes through a public verb, a command
or `certify`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
_AT_ONCE = 2
_PYTEST = (sys.executable, "-m", "pytest", "-n0", "-x", "-q", "-p", "no:cacheprovider")
_LONGEST = 600  # s, of the tests of one fault


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One line changed.

    Attributes:
        name: what is no longer so.
        file: in which.
        old: text that stands there once.
        new: in its place.
        tests: files or ids of which one has to fail.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str


def _of(file: str, tests: str, *faults: tuple[str, str, str]) -> tuple[Fault, ...]:
    return tuple(
        Fault(name=name, file=file, old=old, new=new, tests=tests) for name, old, new in faults
    )


FAULTS: tuple[Fault, ...] = (
    *_of(
        "tune/certificate/absolute.py",
        "tests/test_clamps.py",
        ("coupling of clamps and switches", " * 0.25\n", " * 0.0\n"),
        (
            "the gain in a clamp's own term",
            "real * (1 / (gain * size)))\n            beyond",
            "real * (1 / size))\n            beyond",
        ),
        ("levels of what fades", "zip(levels, sum_.steady, strict=True)", "zip((), ())"),
        (
            "taps alone where nothing holds",
            "(channel.constant or not channel.taps)",
            "(not channel.taps)",
        ),
        ("channels of the moment", "if seen != names:", "if len(seen) > 9:"),
    ),
    *_of(
        "tune/certificate/switched.py",
        "tests/test_clamps.py",
        ("gain of a multiplier against the margin", "if not witness.gain >= least or", "if"),
        ("extra delay of a multiplier", " or witness.extra_delay_samples != extra:", ":"),
        (
            "a held multiplier without a hand",
            "if stated is not None and not there:",
            "if not there and 0:",
        ),
        ("what is damping only", "elif element.fades:", "elif element.damping:"),
    ),
    *_of(
        "tune/certificate/certify.py",
        "tests/test_conditions.py",
        ("ripple", "if not meets_wall(design, moment):", "if not moment:"),
        ("forces", "found.failures += force_failures(design, moment)", "pass"),
        (
            "passivity",
            "found.failures += passivity_failures(design, moment, setting, bare)",
            "pass",
        ),
        (
            "what is felt",
            "if len(moment) == 1:\n                found",
            "if not moment:\n                found",
        ),
        ("clamps that may be reached", "if is_clamped(design, moment):", "if not moment:"),
    ),
    *_of(
        "tune/certificate/bounds.py",
        "tests/test_conditions.py",
        (
            "force levels that sum to the peak",
            '("cut", levels, limit.peak),',
            '("cut", 0.0, limit.peak),',
        ),
        (
            "sustained force",
            '("sustained", sustained, limit.continuous),',
            '("sustained", 0.0, 1.0),',
        ),
    ),
    *_of(
        "tune/certificate/moments.py",
        "tests/test_conditions.py",
        (
            "a proof that was not found",
            "outcome.cells, outcome.proved = proof.cells, proof.proved",
            "outcome.cells, outcome.proved = proof.cells, True",
        ),
        ("a claimed gain", "    if gain > margin.gain:\n", "    if gain > 1e9:\n"),
        (
            "a claimed delay",
            "    if extra > margin.extra_delay_samples:\n",
            "    if extra > 1e9:\n",
        ),
    ),
    *_of(
        "tune/certificate/fade_levels.py",
        "tests/test_conditions.py",
        ("levels of elements that fade beside others", "if not proof.proved:", "if proof is None:"),
    ),
    *_of(
        "tune/certificate/contact.py",
        "tests/test_clamps.py tests/test_conditions.py",
        ("damping that is less than the lag takes", "if least < -_AGREE * B:", "if least < -9e9:"),
        ("what is met before a face", "if lead > most * (1 + _AGREE):", "if lead > 9e9:"),
    ),
    *_of(
        "tune/certificate/check.py",
        "tests/test_conditions.py",
        ("an absolute gain that is not proved", "if said != seen:", "if said == -1.0:"),
        (
            "numbers of the certificate",
            'if not np.allclose(seen, said, rtol=_AGREE, atol=0):\n            yield f"certificate.{name} says',
            'if name is None:\n            yield f"certificate.{name} says',
        ),
    ),
    *_of(
        "tune/certificate/elements.py",
        "tests/test_conditions.py",
        (
            "a limit that does not bind",
            'if word not in {"wanted", "range", "saturation"} and',
            "if not word and",
        ),
        (
            "a gain above the absolute one",
            "if said.absolute_gain is not None and said.gain > said.absolute_gain:",
            "if said.gain < 0:",
        ),
        ("as commanded", 'if not element.as_commanded and words == {"wanted"}:', "if not words:"),
    ),
    *_of(
        "tune/documents/profile.py",
        "tests/test_conditions.py",
        ("a profile of another law", "    if law != LAW and str", "    if not content and str"),
        ("the digest", 'if content.get("digest") != expected:', 'if content.get("digest") == "":'),
    ),
    *_of(
        "tune/optimisation/limits.py",
        "tests/test_optimise.py tests/test_clamps.py",
        (
            "ripple in the tuner",
            "good &= np.all(noise <= problem.limits.ripple * (1 + CLOSE), axis=1)",
            "good &= np.all(noise >= 0, axis=1)",
        ),
        (
            "force and lead in the tuner",
            "return np.all(problem.linear.used(sizes) <= 1 + CLOSE, axis=0)",
            "return np.all(problem.linear.used(sizes) <= 1e9, axis=0)",
        ),
    ),
    *_of(
        "tune/templates/guard.c",
        "tests/test_guard_law.py tests/test_guard_faults.py tests/test_guard_play.py tests/test_guard.py",
        (
            "a wall that pulls",
            "effect->one_sided && contact->side < 0 ? 0.0 :",
            "effect->one_sided && contact->side < 0 ? -9e9 :",
        ),
        ("the level of a clamp", "return u < low ? low : u > high ? high : u;", "return u;"),
        ("a gain that rises under force", "|| contact->quiet >= HAPTUNE_TAPS) {", "|| 1) {"),
        ("a spring entered away from its rest", "if (enters && spring) {", "if (0 && spring) {"),
        (
            "pairs that are apart",
            "return elements == 0 || (low < MOMENTS && moments[low] == elements);",
            "return 1;",
        ),
        ("a corridor that is too narrow", "return !(room >= lead);", "return 0;"),
    ),
)


def copy_tree(folder: Path) -> None:
    """All files that git knows of or would, without its own."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def is_caught(fault: Fault) -> str:
    """How its tests ended: "caught", "NOT CAUGHT", or why they could not be asked."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copy_tree(folder)
        file = folder / fault.file
        text = file.read_text(encoding="utf-8")
        if text.count(fault.old) != 1:
            return f"{text.count(fault.old)} places in {fault.file}"
        file.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
        done = subprocess.run(
            [*_PYTEST, *fault.tests.split()],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder)},
            capture_output=True,
            text=True,
            timeout=_LONGEST,
            check=False,
        )
    if done.returncode == 0:
        return "NOT CAUGHT"
    if done.returncode == 1:
        return "caught"
    return f"tests could not run: {done.stdout[-300:]}"


def main() -> int:
    words = sys.argv[1:]
    chosen = [f for f in FAULTS if not words or any(word in f.name for word in words)]
    left = 0
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        for fault, outcome in zip(chosen, pool.map(is_caught, chosen), strict=True):
            left += outcome != "caught"
            print(f"{outcome:12} {fault.name} ({fault.file})", flush=True)
    print(f"{len(chosen) - left} of {len(chosen)} faults caught")
    return int(left > 0)


if __name__ == "__main__":
    raise SystemExit(main())
