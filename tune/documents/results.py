"""What every command prints with ``--json``: one object, and the details of each command.

Every number that its tables show is there, in SI units. A command that fails keeps what was
computed until then, so that no key is sure to be there. A number that is not finite, or was not
computed, is null.
"""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

Pair = tuple[float, float]


class MissingFact(TypedDict):
    """A fact of the hardware that nobody stated: what to write, and what a log suggests of it."""

    key: str
    write: str
    hint: str


class ToldQuantity(TypedDict):
    """A quantity with its 95 % interval; ``relative`` is the half-width as part of the value."""

    value: float
    low: float
    high: float
    half_width: float
    relative: float | None


class LogExamined(TypedDict):
    """What one log shows; s, Hz, m, m/s, N or the rotary units."""

    source: str
    motion: Literal["linear", "rotary"] | None
    usable: bool
    samples: int
    fitted: int | None
    duration: float
    sample_time: float
    rate_hz: float
    travel: float
    peak_speed: float
    peak_force: float
    encoder_count: float | None
    noise: float
    band_hz: Pair
    mass: ToldQuantity | None
    damping: ToldQuantity | None


class OtherEstimate(TypedDict):
    """What another method makes of a log."""

    method: str
    mass: float
    damping: float


class LogIdentified(TypedDict):
    """How one log was identified."""

    source: str
    method: str
    reason: str
    fitted: int
    others: list[OtherEstimate]
    structure: list[str]


class AlternativeResult(TypedDict):
    """A scene tuned with one fact of the hardware changed; ``won`` against the device as it is."""

    change: str
    total: float
    won: float
    steps: dict[str, float]
    won_by_effect: dict[str, float]
    reason: str | None


class Details(TypedDict, total=False):
    """What commands share.

    ``device`` is the content of device.yaml (haptune/device/1), ``profile`` that of profile.yaml
    (haptune/profile/1); ``read_as`` tells by log how one that is no plain table was understood.
    """

    read_as: dict[str, str]
    missing: list[MissingFact]
    device: dict[str, Any]
    profile: dict[str, Any]
    taken_on_trust: list[str]
    rehearsed: Literal["settles"]


class DoctorDetails(Details, total=False):
    """Details of ``doctor``."""

    logs: list[LogExamined]


class IdentifyDetails(Details, total=False):
    """Details of ``identify``; ``half_widths`` are parts of the values, by quantity."""

    half_widths: dict[str, float | None]
    method: str
    logs: list[LogIdentified]


class TuneDetails(Details, total=False):
    """Details of ``tune``."""

    candidates: list[dict[str, Any]]
    what_if: list[AlternativeResult]


class CalibrateDetails(IdentifyDetails, TuneDetails, total=False):
    """Details of ``calibrate``, ``demo`` and ``report``, which show a device and a profile.

    The ``half_widths`` of ``report`` are of the device in the profile; its ``device``, where logs
    were given, is as identified from them again.
    """


class FleetDetails(Details, total=False):
    """Details of ``fleet``; ``rows`` are those of results.parquet, without what is null in all.

    ``distance`` is null where more than half of the fleet are the same.
    """

    devices: int
    done_before: int
    unlike: list[dict[str, Any]]
    rows: list[dict[str, Any]]


class CheckDetails(TypedDict, total=False):
    """Details of ``check``: profile, certificate found anew, what is trusted or not checked."""

    profile: dict[str, Any]
    certificate: dict[str, Any]
    taken_on_trust: dict[str, str]
    not_checked: dict[str, str]
    rehearsed: Literal["settles"]


class FaultResult(TypedDict):
    """Why gains are not safe."""

    limit: str
    seen: str
    needed: str
    remedy: str


class AuditDetails(Details, total=False):
    """Details of ``audit``; null where something was not computed."""

    safe: bool
    box: dict[str, Any]
    loop: dict[str, Any]
    needed: dict[str, float | None]
    gain_margin: float | None
    extra_delay_samples: float | None
    jitter: float
    sustained_force: float | None
    peak_force: float | None
    ripple: float | None
    one_count: dict[str, float]
    wall: dict[str, Any]
    speed: float
    slowest_decay: float | None
    damping_ratio: float | None
    phase_margin_degrees: float | None
    disk_margin: float | None
    critical_frequency_hz: float | None
    passive: bool | None
    passive_above_damping: float | None
    faults: list[FaultResult]
    nearest: dict[str, float] | None


class Check(TypedDict):
    """One comparison of a log with its profile; ``numbers`` are those of the words."""

    check: str
    verdict: Literal["agrees", "disagrees", "cannot tell", "not assessed"]
    seen: str
    predicted: str
    tolerance: str
    remedy: str
    numbers: dict[str, float | None]


class VerifyDetails(Details, total=False):
    """Details of ``verify``."""

    log: str
    elements: list[str]
    direction: list[float] | None
    gain: float | None
    checks: list[Check]
    filters: list[dict[str, Any]]
    delay: Pair | None
    longer_delays_not_looked_at: bool
    margins: list[dict[str, Any]]
    play: list[dict[str, Any]]


class CompareDetails(Details, total=False):
    """Details of ``compare``; ``gain`` is the margin that is still proved."""

    kind: Literal["devices", "profiles", "profile and device"]
    changes: list[dict[str, Any]]
    effects: list[dict[str, Any]]
    felt: list[dict[str, Any]]
    one_factor: dict[str, float] | None
    renamed: list[str]
    holds: bool | None
    at_margin: bool
    gain: float | None


class ExciteDetails(Details, total=False):
    """Details of ``excite``; shares are parts of the limits."""

    duration: float
    limits: dict[str, float | None]
    guesses: dict[str, float]
    candidates: list[dict[str, Any]]
    predicted: dict[str, float]
    stated: dict[str, float]
    worst: list[dict[str, Any]]
    rows: int


class ExportDetails(Details, total=False):
    """Details of ``export``: exported files of another profile that stand beside what it wrote."""

    of_other_profiles: list[str]


class SimulateDetails(Details, total=False):
    """Details of ``simulate``."""

    scenario: str
    description: str
    samples: int
    sample_time: float


class FindingResult(TypedDict):
    """What is wrong, or doubtful, with the log, or the ``element.effect``, ``source``.

    ``at`` are the stretches of a log, s, in which it occurs; none where it is of the whole.
    """

    code: str
    severity: Literal["warning", "refusal"]
    source: str
    seen: str
    needed: str
    remedy: str
    at: list[tuple[float, float]]


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
    "fleet": FleetDetails,
    "audit": AuditDetails,
    "check": CheckDetails,
    "verify": VerifyDetails,
    "compare": CompareDetails,
    "export": ExportDetails,
    "report": CalibrateDetails,
    "open": Details,
    "excite": ExciteDetails,
    "simulate": SimulateDetails,
}
