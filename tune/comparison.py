"""Compare: what changed between two devices or two profiles, and does the old profile still hold.

A quantity counts as changed where the two intervals have no value in common: two 95 % intervals of
the same truth miss one another in fewer than one comparison of a hundred. An old profile holds
where its effects, filters and margin are proved anew over the box of the new device.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from identification import Device, Quantity, SlopeRange, UsageError, as_stored
from tune.certificate.certify import certify
from tune.documents.certified import AbsoluteStability
from tune.documents.effects import EFFECT_NAMES
from tune.documents.errors import CheckFailedError
from tune.documents.profile import Design, Margins, SafeProfile
from tune.documents.scene import LARGEST

#: Quantities of a device in the order of its file.
_QUANTITIES = (
    "sample_time",
    "mass",
    "damping",
    "coulomb_friction",
    "force_offset",
    "delay",
    "encoder_resolution",
    "current_lag",
    "position_stiffness",
)
_RANGES = ("damping_slope", "presliding_stiffness")
#: How closely the gain that is kept is found, as part of the margin.
_STEP = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A quantity of a file with its 95 %, SI units; no value where only ends are stated."""

    value: float | None
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One quantity in the old file and in the new one; None where a file does not state it.

    Attributes:
        name: the key, for an effect "element.effect".
        old: in the old file.
        new: in the new file.
    """

    name: str
    old: Interval | None
    new: Interval | None

    @property
    def beyond(self) -> bool:
        """True where the intervals have no value in common, or only one file states it."""
        if self.old is None or self.new is None:
            return self.old is not self.new
        return self.new.low > self.old.high or self.new.high < self.old.low

    @property
    def part(self) -> float | None:
        """The difference of the values as part of the old one; None where that says nothing."""
        if self.old is None or self.new is None or not self.old.value or self.new.value is None:
            return None
        return self.new.value / self.old.value - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """What changed.

    Attributes:
        kind: "devices", "profiles", or "profile and device".
        changes: of the devices, in the order of their files.
        effects: of the profiles, none where one of the two is a device.
        failures: why the old profile does not hold on the new device; empty where it does.
        gain: margin that the old profile keeps there, as proved, with the extra delay of its
            margin; None without an old profile, or where forces or ripple are what fails.
        judged: whether there was an old profile to judge.
    """

    kind: str
    changes: tuple[Change, ...]
    effects: tuple[Change, ...] = ()
    failures: tuple[str, ...] = ()
    gain: float | None = None
    judged: bool = False

    @property
    def holds(self) -> bool | None:
        """Whether the old profile holds on the new device; None without an old profile."""
        return not self.failures if self.judged else None


def compare(old: Device | SafeProfile, new: Device | SafeProfile) -> Comparison:
    """Compare two devices, two profiles, or an old profile with a new device.

    An old profile is proved anew over the box of the new device, with its own margin.

    Raises:
        UsageError: an old device with a new profile, or axes of different motion.
        UnstatedError: facts of the new device that a person has to state before it is judged.
    """
    before, after = (each if isinstance(each, Device) else each.device for each in (old, new))
    if before.motion != after.motion:
        raise UsageError(
            "OLD NEW",
            f"the old axis is {before.motion}, the new one {after.motion}",
            "Compare files of one motion",
        )
    changes = tuple(_changes(before, after))
    if isinstance(old, Device):
        if isinstance(new, SafeProfile):
            raise UsageError(
                "OLD NEW", "the old file is a device, the new one a profile", "Swap them"
            )
        return Comparison(kind="devices", changes=changes)
    failures: tuple[str, ...] = ()
    gain = old.margin.gain
    after.require_stated()
    try:
        certify(_moved(old, after), witnesses=_witnesses(old, gain))
    except CheckFailedError as error:
        failures = error.failures
        kept = _kept_gain(old, after)
        gain = kept if kept < old.margin.gain else None
    both = isinstance(new, SafeProfile)
    return Comparison(
        kind="profiles" if both else "profile and device",
        changes=changes,
        effects=tuple(_effects(old, new)) if both else (),
        failures=failures,
        gain=gain,
        judged=True,
    )


def _kept_gain(design: SafeProfile, device: Device) -> float:
    """The gain margin, at most the one asked for, that is proved on another device; 0 for none.

    With the extra delay of the margin, and within a hundredth of it below the largest. Force and
    ripple are not looked at.
    """
    moved = _moved(design, device.model_copy(update={"force_limit": None})).model_copy(
        update={"ripple_limit": LARGEST}
    )
    kept, lost = 0.0, design.margin.gain

    def is_proved(gain: float) -> bool:
        margin = moved.margin.model_copy(update={"gain": gain})
        try:
            certify(moved.model_copy(update={"margin": margin}), witnesses=_witnesses(design, gain))
        except CheckFailedError:
            return False
        return True

    if is_proved(lost):
        return lost
    while lost - kept > _STEP * design.margin.gain:
        middle = (kept + lost) / 2
        kept, lost = (middle, lost) if is_proved(middle) else (kept, middle)
    return kept


def _witnesses(design: SafeProfile, gain: float) -> dict[str, AbsoluteStability]:
    """The multipliers of a profile, asked for no more than a gain."""
    stated = design.certificate.absolute_stability or {}
    return {name: each.model_copy(update={"gain": gain}) for name, each in stated.items()}


def _moved(design: SafeProfile, device: Device) -> Design:
    """The design on another device, its claims those of its margin and no more.

    What the design states of the device it was made for, such as margins beyond the one asked for
    and what is felt, is not asked of the other one.
    """
    kept = Margins(
        gain=0.0,
        extra_delay_samples=float(design.margin.extra_delay_samples),
        passive=False,
    )
    unclaimed = {
        name: element.model_copy(
            update={"margins": kept, "ripple": LARGEST, "rendered": None, "perceived_steps": {}}
        )
        for name, element in design.elements.items()
    }
    return design.model_copy(update={"device": as_stored(device), "elements": unclaimed})


def _changes(old: Device, new: Device) -> Iterator[Change]:
    """Every quantity that at least one of the devices states."""
    for name in (*_QUANTITIES, *_RANGES):
        pair = [_interval(getattr(device, name)) for device in (old, new)]
        if any(pair):
            yield Change(name=name, old=pair[0], new=pair[1])
    for name in ("continuous", "peak"):
        limits = [device.force_limit for device in (old, new)]
        pair = [None if each is None else _exact(getattr(each, name)) for each in limits]
        if any(pair):
            yield Change(name=f"force_limit.{name}", old=pair[0], new=pair[1])


def _effects(old: Design, new: Design) -> Iterator[Change]:
    """Every effect that acts in at least one of the designs."""
    for element in dict.fromkeys((*old.elements, *new.elements)):
        for effect in EFFECT_NAMES:
            sizes = [
                getattr(design.elements[element], effect) if element in design.elements else 0.0
                for design in (old, new)
            ]
            if any(sizes):
                first, second = (_exact(size) if size else None for size in sizes)
                yield Change(name=f"{element}.{effect}", old=first, new=second)


def _interval(item: Quantity | SlopeRange | None) -> Interval | None:
    if item is None:
        return None
    value = item.value if isinstance(item, Quantity) else None
    return Interval(value=value, low=item.low, high=item.high)


def _exact(value: float) -> Interval:
    return Interval(value=value, low=value, high=value)
