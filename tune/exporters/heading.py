"""What stands at the head of every file: which profile, what is certified and what is not."""

from __future__ import annotations

from identification import ForceLimit
from tune.documents.profile import SafeProfile
from tune.exporters.names import quote_yaml

#: What an integrator has to read before anything else; in ASCII.
NOT_A_SAFETY_FUNCTION = (
    "Not a safety function. A certified profile says that the control loop is stable under the "
    "assumptions written here. It limits no force, speed or travel in the sense of machine safety, "
    "notices no fault of the device, and replaces no emergency stop, no risk assessment and no "
    "protective measure that a standard asks for (such as ISO 12100, ISO 13849, ISO 14971 or "
    "IEC 60601)."
)
#: Letters of a name in a comment.
_SHORT = 60


def digest(profile: SafeProfile) -> str:
    """The digest of the profile as it was read, or as it would be written."""
    return profile.digest or profile.signed().digest


def short(name: str) -> str:
    """A name in quotes, cut where it is very long."""
    return quote_yaml(name if len(name) <= _SHORT else name[: _SHORT - 3] + "...")


def unit_of_force(profile: SafeProfile) -> str:
    """N or N*m, in ASCII."""
    return "N*m" if profile.device.motion == "rotary" else "N"


def force_limit(profile: SafeProfile) -> ForceLimit:
    """What the actuator gives, without which no profile is exported.

    Raises:
        UnstatedError: nobody stated it.
    """
    profile.device.require_stated(("force_limit",))
    limit = profile.device.force_limit
    assert limit is not None
    return limit


def heading(profile: SafeProfile) -> tuple[str, ...]:
    """Lines of text without comment marks."""
    device, seal, margin = profile.device, profile.certificate, profile.margin
    limit, force = force_limit(profile), unit_of_force(profile)
    rotary = device.motion == "rotary"
    return (
        "Written by haptune from a certified profile. Do not edit: tune and export again.",
        NOT_A_SAFETY_FUNCTION,
        "",
        f"profile digest: {digest(profile)}",
        f"device: {short(device.name)}, axis {short(device.axis)}, {device.motion}; "
        f"scene {short(profile.scene)}",
        f"margin: {margin.name}: stable for every gain in (0, {seal.gain:g}] with up to "
        f"{seal.extra_delay_samples:g} extra samples of delay",
        f"certified for: mass {_range(seal.mass)} {'kg*m^2' if rotary else 'kg'}, damping "
        f"{_range(seal.damping)} {'N*m*s/rad' if rotary else 'N*s/m'}, sample time "
        f"{_range(seal.sample_time)} s, delay {_range(seal.delay_samples)} samples "
        f"(together {100 * seal.confidence:g} %)",
        f"force limit: {limit.continuous:g} {force} continuous, {limit.peak:g} {force} peak",
        *(
            f"findings about the log {short(source)}: {', '.join(codes) or 'none'}"
            for source, codes in findings_of(profile).items()
        ),
        "method: " + seal.method,
        "assumes:",
        *(f"- {each}" for each in seal.assumes),
        "not assessed:",
        *(f"- {each}" for each in seal.not_assessed),
    )


def findings_of(profile: SafeProfile) -> dict[str, list[str]]:
    """Codes of what was found about each log of the device, by its name.

    Those that would have refused the log and were allowed are marked.
    """
    return {
        record.source: [
            f"{code} (allowed)" if code in record.allowed else code for code in record.findings
        ]
        for record in profile.device.logs
    }


def _range(bounds: tuple[float, float]) -> str:
    low, high = bounds
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
