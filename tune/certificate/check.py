"""Re-compute a written profile by the independent path: digest, certificate, margins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tune.certificate.certify import certify
from tune.errors import CheckFailedError
from tune.profile import Certificate, SafeProfile, load_profile

#: Bounds of the box are stored with twelve digits.
_AGREE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """A profile that passed, beside the certificate computed anew."""

    profile: SafeProfile
    certificate: Certificate


def check(path: Path) -> CheckReport:
    """Check a profile file.

    Raises:
        InvalidInputError: not a readable profile.
        CheckFailedError: the digest is wrong, a point is unstable or undecided, or the file claims
            what was not found.
    """
    profile = load_profile(path)
    fresh = certify(profile)
    stated = profile.certificate
    failures: list[str] = []
    for name in ("mass", "damping", "sample_time", "delay_samples"):
        for seen, said in zip(getattr(fresh, name), getattr(stated, name), strict=True):
            if abs(seen - said) > _AGREE * max(abs(seen), abs(said)):
                failures.append(
                    f"certificate.{name} says {said:.12g}, the device gives {seen:.12g}"
                )
    if (stated.gain, stated.extra_delay_samples) != (fresh.gain, fresh.extra_delay_samples):
        failures.append(
            f"the certificate is for a gain of {stated.gain:g} and {stated.extra_delay_samples} "
            f"extra samples, the profile's margin is {fresh.gain:g} and {fresh.extra_delay_samples}"
        )
    if failures:
        raise CheckFailedError(tuple(failures))
    return CheckReport(profile=profile, certificate=fresh)
