"""Every finding of a log, and those of them that refuse it."""

from __future__ import annotations

from identification import (
    Finding,
    Hardware,
    Identification,
    LogRefusedError,
    Trajectory,
    identify,
)
from identification.findings import CODES

#: Hardware files leave it open: a warning of the same code as what a log can be refused for.
UNSTATED = (
    "no motion is stated",
    "no delay is stated",
    "no force limit is stated",
    "no encoder resolution is stated",
)


def findings_of(
    trajectory: Trajectory, hardware: Hardware | None = None
) -> tuple[tuple[Finding, ...], Identification | None]:
    """Every finding but that hardware is not stated, and what was identified, if anything."""
    found = None
    try:
        found = identify(trajectory, hardware=hardware)
        all_of_them = found.findings
    except LogRefusedError as error:
        all_of_them = error.findings
    for each in all_of_them:
        assert each.code in CODES
        assert each.seen
        assert each.needed
        assert each.remedy.endswith(".")
    return tuple(each for each in all_of_them if not each.seen.startswith(UNSTATED)), found


def refusals(trajectory: Trajectory, hardware: Hardware | None = None) -> set[str]:
    findings, found = findings_of(trajectory, hardware)
    codes = {each.code for each in findings if each.severity == "refusal"}
    assert bool(codes) == (found is None)
    return codes


def warnings(trajectory: Trajectory, hardware: Hardware | None = None) -> set[str]:
    findings, found = findings_of(trajectory, hardware)
    assert found is not None
    return {each.code for each in findings}
