"""Every finding of a log, and those of them that refuse it."""

from identification import Finding, Hardware, Identification, LogRefusedError, Trajectory, identify
from identification.findings import CODES


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
    return tuple(each for each in all_of_them if each.code != "not-stated"), found


def refusals(trajectory: Trajectory, hardware: Hardware | None = None) -> set[str]:
    findings, found = findings_of(trajectory, hardware)
    codes = {each.code for each in findings if each.severity == "refusal"}
    assert not codes or findings[0].severity == "refusal"
    assert bool(codes) == (found is None)
    return codes


def warnings(trajectory: Trajectory, hardware: Hardware | None = None) -> set[str]:
    findings, found = findings_of(trajectory, hardware)
    assert found is not None
    return {each.code for each in findings}
