"""What every command prints with ``--json``: one object, the same for all but for its details."""

from __future__ import annotations

from typing import Literal, NotRequired

# pydantic reads this one on every Python; it is part of what pydantic itself needs.
from typing_extensions import TypedDict

from tune.documents.result_details import (
    AuditDetails,
    CalibrateDetails,
    CheckDetails,
    CompareDetails,
    Details,
    DoctorDetails,
    ExciteDetails,
    IdentifyDetails,
    SimulateDetails,
    TuneDetails,
    VerifyDetails,
)


class FindingResult(TypedDict):
    """What is wrong, or doubtful, with the log ``source``."""

    code: str
    severity: Literal["warning", "refusal"]
    source: str
    seen: str
    needed: str
    remedy: str


class Result(TypedDict):
    """How a command ended.

    ``outputs`` are the files written, ``message`` is what stands on standard error where it failed.
    """

    schema: Literal["haptune/result/1"]
    command: str
    status: Literal[
        "done",
        "internal-error",
        "usage",
        "invalid-input",
        "log-refused",
        "no-feasible-effect",
        "check-failed",
        "not-written",
        "interrupted",
    ]
    exit_code: Literal[0, 1, 2, 3, 4, 5, 6, 7, 130]
    findings: list[FindingResult]
    outputs: list[str]
    message: NotRequired[str]


#: The details of each command; "haptune" alone is where no command was found.
DETAILS: dict[str, type] = {
    "haptune": Details,
    "demo": CalibrateDetails,
    "new": Details,
    "doctor": DoctorDetails,
    "identify": IdentifyDetails,
    "tune": TuneDetails,
    "calibrate": CalibrateDetails,
    "audit": AuditDetails,
    "check": CheckDetails,
    "verify": VerifyDetails,
    "compare": CompareDetails,
    "export": Details,
    "report": CalibrateDetails,
    "excite": ExciteDetails,
    "simulate": SimulateDetails,
}
