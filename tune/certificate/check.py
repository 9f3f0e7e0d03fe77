"""Re-compute a written profile by the independent path: digest, certificate, all that it says."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from identification import Device, to_mapping
from tune.certificate.certify import certify
from tune.certificate.poles import judge
from tune.certificate.region import ModePoint, Point, setting_of
from tune.certificate.statements import (
    differences,
    element_failures,
    form_failures,
    stated_failures,
)
from tune.documents import CheckFailedError
from tune.documents.certified import Certificate, HandBox, ModeBox, WorstPoint
from tune.documents.profile import SafeProfile, profile_of, read_signed
from tune.documents.scene import EFFECT_NAMES


@dataclass(frozen=True, slots=True, kw_only=True)
class Trusted:
    """A key of profiles, with all below it, that a check believes at least in part."""

    key: str  # with the keys above it, joined by points; * stands for any name
    reason: str  # what is believed, and what of it is not

    def covers(self, path: Sequence[str]) -> bool:
        """Whether a key, with the keys above it, is this one or below it."""
        own = self.key.split(".")
        return len(path) >= len(own) and all(
            part in {"*", name} for part, name in zip(own, path, strict=False)
        )


def _trusted(*pairs: tuple[str, str]) -> tuple[Trusted, ...]:
    return tuple(Trusted(key=key, reason=reason) for key, reason in pairs)


#: Facts and wishes for which somebody answers.
TAKEN_ON_TRUST = _trusted(
    ("device", "facts of the device and its logs; --device compares them"),
    ("scene", "a name"),
    ("hand", "the grips asked for, each of which is proved"),
    ("ripple_limit", "as asked for; that no moment exceeds it is recomputed"),
    ("perception", "how finely hands tell; the steps it gives are recomputed"),
    ("elements.*.motion", "how deep, fast and hard the hand moves"),
    ("together", "sets as asked for, each of which is proved"),
    ("apart", "pairs that the scene keeps apart; every other is proved"),
    ("elements.*.lead", "as asked for; that it is kept is recomputed"),
    ("elements.*.one_sided", "as asked for; that nothing in it pulls is checked"),
    (
        "elements.*.fade_time",
        "as asked for or found; that all that must not be switched fades is checked, not once more "
        "whether a hand could pump it",
    ),
)
_MULTIPLIERS = "which multipliers; that these prove what they are stated for is done again"
#: What a check leaves as it is said: a wish that nobody else knows, or what is no claim.
OPINIONS = _trusted(
    (
        "elements.*.as_commanded",
        "that values were wanted; that no effect has a limit of another wish is checked, and what "
        "is felt of all others",
    ),
    (
        "elements.*.limited_by",
        "that a value or range was wanted; that every other limit said to bind allows no tenth "
        "more is recomputed",
    ),
    ("elements.*.margins.gain", "that no more could be proved"),
    ("elements.*.margins.extra_delay_samples", "that no more could be proved"),
    ("notes", "why effects were dropped; which ones is recomputed"),
    ("method", "which solver proposed; nothing rests on it"),
    ("certificate.absolute_stability.*.free", _MULTIPLIERS),
    ("certificate.absolute_stability.*.held", _MULTIPLIERS),
    ("certificate.points", "the work it took; it is done again"),
    ("certificate.cells", "the work it took; it is done again"),
    ("certificate.versions", "what it was computed with"),
)

#: Bounds of the box are stored with twelve digits.
_AGREE = 1e-9
_CLAIMED = ("confidence", "mass", "damping", "sample_time", "delay", "delay_samples", "gain")
#: A fresh search may find a pole closer to the circle by this part of its distance from it: another
#: linear algebra library may climb to another point.
_SEARCH = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """A profile that passed, beside the certificate computed anew."""

    profile: SafeProfile
    certificate: Certificate


def check(path: str | PathLike[str], device: Device | None = None) -> CheckReport:
    """Check a profile file.

    Args:
        path: of the file.
        device: that the profile has to be for; None takes the device of the file on trust.

    Raises:
        InvalidInputError: not a readable profile.
        CheckFailedError: the digest is wrong, a point is unstable or undecided, the file says what
            was not found, or the device is another.
    """
    return check_content(read_signed(path), path, device)


def check_content(
    content: Mapping[str, Any], source: str | PathLike[str], device: Device | None = None
) -> CheckReport:
    """Check the content of a profile file whose digest belongs to it; raises as `check`."""
    profile = profile_of(content, source)
    failures = [*form_failures(profile, content), *stated_failures(profile)]
    if device is not None:
        names = "the device given", "the profile"
        failures += differences(to_mapping(device), to_mapping(profile.device), names, "device")
    try:
        fresh = certify(profile, witnesses=profile.certificate.absolute_stability)
    except CheckFailedError as error:
        raise CheckFailedError((*error.failures, *failures), error.points) from None
    for name in profile.elements:
        failures += element_failures(profile, name)
    failures += _claims_differ(profile, fresh)
    if failures:
        raise CheckFailedError(tuple(failures))
    return CheckReport(profile=profile, certificate=fresh)


def _claims_differ(profile: SafeProfile, fresh: Certificate) -> Iterator[str]:
    """Numbers of the certificate that the device and the elements of the file do not give."""
    stated = profile.certificate
    for moment in stated.interior:
        if moment not in fresh.interior:
            yield f"certificate.interior says {moment} is proved, the profile has no such moment"
    for moment in fresh.interior:
        if moment not in stated.interior:
            yield f"certificate.interior does not say that {moment} is proved. Tune again"
    for name in ("method", "assumes", "not_assessed", "absolute_stability"):
        if getattr(stated, name) != getattr(fresh, name):
            yield f"certificate.{name} is not what haptune says of such a profile. Tune again"
    for name in (*_CLAIMED, "extra_delay_samples"):
        seen, said = getattr(fresh, name), getattr(stated, name)
        if not np.allclose(seen, said, rtol=_AGREE, atol=0):
            yield f"certificate.{name} says {_number(said)}, computed anew it is {_number(seen)}"
    for name in ("modes", "current_lag", "position_stiffness", "presliding_stiffness", "hand"):
        seen, said = _flat(getattr(fresh, name)), _flat(getattr(stated, name))
        if len(seen) != len(said) or not np.allclose(seen, said, rtol=_AGREE, atol=0):
            yield f"certificate.{name} is not what device and hand of the file give"
    for name, element in profile.elements.items():
        gains = [
            proved.gain
            for moment, proved in (fresh.absolute_stability or {}).items()
            if name in moment.split(" + ")
        ]
        seen, said = min(gains, default=None), element.margins.absolute_gain
        if said != seen:
            yield f"{name}: margins.absolute_gain says {said}, the certificate proves {seen}"
    yield from _worst_differs(profile, fresh)


def _worst_differs(profile: SafeProfile, fresh: Certificate) -> Iterator[str]:
    """The worst point is in the box, has the radius it says, and the search finds no worse."""
    stated = profile.certificate.worst
    setting = setting_of(profile, stated.elements) if stated.elements in profile.moments() else None
    if setting is None:
        yield f"certificate.worst names {', '.join(stated.elements)[:80]}, which is not felt"
        return
    device = profile.device
    if len(stated.modes) != len(device.modes) or not _inside(stated, fresh):
        yield "certificate.worst is not a point of the box"
        return
    point = Point(
        mass=stated.mass,
        damping=stated.damping,
        sample_time=stated.sample_time,
        delay_samples=stated.delay_samples,
        modes=tuple(
            ModePoint(**dict(place), at_encoder=mode.at_encoder, at_handle=mode.at_handle)
            for place, mode in zip(stated.modes, device.modes, strict=True)
        ),
        hand=stated.hand,
        current_lag=stated.current_lag or 0.0,
        position_stiffness=stated.position_stiffness or 0.0,
    )
    seen = judge(point, setting, stated.gain).radius
    if not np.isclose(seen, stated.pole_radius, rtol=_AGREE, atol=0):
        yield (
            f"certificate.worst.pole_radius says {stated.pole_radius:.12g}, computed anew it is "
            f"{seen:.12g}"
        )
    # A radius as stored has twelve digits, too few where a pole moves in millionths of a millionth.
    elif 1 - seen > (1 + _SEARCH) * (1 - fresh.worst.pole_radius):
        yield (
            f"certificate.worst.pole_radius says {stated.pole_radius:.12g}, a worse one was found: "
            f"{fresh.worst.pole_radius:.12g}"
        )


def _inside(stated: WorstPoint, box: Certificate) -> bool:
    """Whether a stated point lies in the box, to the digits stored."""
    pairs = [
        (stated.mass, box.mass),
        (stated.damping, box.damping),
        (stated.sample_time, box.sample_time),
        (stated.gain, (box.gain, box.gain)),
        (
            stated.delay_samples,
            (box.delay_samples[0], box.delay_samples[1] + box.extra_delay_samples),
        ),
    ]
    for place, around in zip(stated.modes, box.modes, strict=True):
        pairs.append((place.frequency_hz, around.frequency_hz))
        pairs.append((place.damping_ratio, around.damping_ratio))
    # Before it slides a device has a spring that it has not after.
    held = stated.position_stiffness is not None and box.presliding_stiffness is not None
    slope = box.position_stiffness
    if held and (slope is None or (stated.position_stiffness or 0.0) > slope[1]):
        slope = box.presliding_stiffness
    for value, around in (
        (stated.current_lag, box.current_lag),
        (stated.position_stiffness, slope),
    ):
        if (value is None) != (around is None):
            return False
        if value is not None and around is not None:
            pairs.append((value, around))
    if stated.hand is not None:
        if box.hand is None:
            return False
        pairs += [(getattr(stated.hand, each), getattr(box.hand, each)) for each in EFFECT_NAMES]
    return all(
        low - _AGREE * abs(low) <= value <= high + _AGREE * abs(high)
        for value, (low, high) in pairs
    )


def _flat(part: HandBox | tuple[ModeBox, ...] | tuple[float, float] | None) -> list[float]:
    if isinstance(part, HandBox):
        return [*part.mass, *part.damping, *part.stiffness]
    numbers: list[float] = []
    for item in part or ():
        if isinstance(item, ModeBox):
            numbers += [*item.frequency_hz, *item.damping_ratio]
        else:
            numbers.append(item)
    return numbers


def _number(value: float | tuple[float, ...]) -> str:
    return " to ".join(f"{item:.12g}" for item in np.atleast_1d(value))
