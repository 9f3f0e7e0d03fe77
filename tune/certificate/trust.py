"""Facts and opinions: keys of a profile that no calculation from the profile can confirm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Trusted:
    """A key of profiles, with all below it, that a check believes at least in part.

    Attributes:
        key: with the keys above it, joined by points; * stands for any name.
        reason: what is believed, and what of it is not.
    """

    key: str
    reason: str

    def covers(self, path: Sequence[str]) -> bool:
        """Whether a key, with the keys above it, is this one or below it."""
        own = self.key.split(".")
        return len(path) >= len(own) and all(
            part in {"*", name} for part, name in zip(own, path, strict=False)
        )


#: Facts and wishes for which somebody answers.
TAKEN_ON_TRUST = (
    Trusted(key="device", reason="facts of the device and its logs; --device compares them"),
    Trusted(key="scene", reason="a name"),
    Trusted(key="hand", reason="the grips asked for, each of which is proved"),
    Trusted(key="ripple_limit", reason="as asked for; that no moment exceeds it is recomputed"),
    Trusted(key="perception", reason="how finely hands tell; the steps it gives are recomputed"),
    Trusted(key="elements.*.motion", reason="how deep, fast and hard the hand moves"),
    Trusted(key="together", reason="sets as asked for, each of which is proved"),
    Trusted(key="apart", reason="pairs that the scene keeps apart; every other is proved"),
    Trusted(key="elements.*.lead", reason="as asked for; that it is kept is recomputed"),
    Trusted(key="elements.*.one_sided", reason="as asked for; that nothing in it pulls is checked"),
    Trusted(
        key="elements.*.fade_time",
        reason="as asked for or found; that all that must not be switched fades is checked, not "
        "once more whether a hand could pump it",
    ),
)

#: What a check leaves as it is said: a wish that nobody else knows, or what is no claim.
OPINIONS = (
    Trusted(
        key="elements.*.as_commanded",
        reason="that values were wanted; that no effect has a limit of another wish is checked, "
        "and what is felt of all others",
    ),
    Trusted(
        key="elements.*.limited_by",
        reason="that a value or range was wanted; that every other limit said to bind allows no "
        "tenth more is recomputed",
    ),
    Trusted(key="elements.*.margins.gain", reason="that no more could be proved"),
    Trusted(key="elements.*.margins.extra_delay_samples", reason="that no more could be proved"),
    Trusted(key="notes", reason="why effects were dropped; which ones is recomputed"),
    Trusted(key="method", reason="which solver proposed; nothing rests on it"),
    *(
        Trusted(
            key=f"certificate.absolute_stability.*.{kind}",
            reason="which multipliers; that these prove what they are stated for is done again",
        )
        for kind in ("free", "held")
    ),
    Trusted(key="certificate.points", reason="the work it took; it is done again"),
    Trusted(key="certificate.cells", reason="the work it took; it is done again"),
    Trusted(key="certificate.versions", reason="what it was computed with"),
)
