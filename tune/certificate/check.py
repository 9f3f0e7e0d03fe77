"""Re-compute a written profile by the independent path: digest, certificate, margins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tune.certificate.certify import certify
from tune.errors import CheckFailedError
from tune.profile import Certificate, SafeProfile, load_profile

#: Bounds of the box are stored with twelve digits.
_AGREE = 1e-9
_CLAIMED = (
    "confidence",
    "mass",
    "damping",
    "sample_time",
    "delay_samples",
    "gain",
    "extra_delay_samples",
)


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
    failures = tuple(_claims_differ(profile.certificate, fresh)) + tuple(_loop_differs(profile))
    if failures:
        raise CheckFailedError(failures)
    return CheckReport(profile=profile, certificate=fresh)


def _claims_differ(stated: Certificate, fresh: Certificate) -> Iterator[str]:
    """Numbers of the certificate that the device and the elements of the file do not give."""
    for moment, said in stated.interior.items():
        if said == "proved" and fresh.interior.get(moment) != "proved":
            yield f"certificate.interior says {moment} is proved, computed anew it is not"
    for name, seen, said in (
        *((name, getattr(fresh, name), getattr(stated, name)) for name in _CLAIMED),
        ("worst.pole_radius", fresh.worst.pole_radius, stated.worst.pole_radius),
    ):
        if not np.allclose(seen, said, rtol=_AGREE, atol=0):
            yield f"certificate.{name} says {_number(said)}, computed anew it is {_number(seen)}"


def _loop_differs(profile: SafeProfile) -> Iterator[str]:
    """What the controller is told to run but the device is not said to do."""
    loop, device = profile.loop, profile.device
    for name, said, known in (
        ("sample_time", loop.sample_time, device.sample_time),
        ("extra_delay_samples", loop.extra_delay_samples * loop.sample_time, device.delay),
    ):
        if not known.low * (1 - _AGREE) <= said <= known.high * (1 + _AGREE):
            yield (
                f"loop.{name} amounts to {said:.12g} s, the device has {known.low:.12g} to "
                f"{known.high:.12g} s"
            )


def _number(value: float | tuple[float, ...]) -> str:
    return " to ".join(f"{item:.12g}" for item in np.atleast_1d(value))
