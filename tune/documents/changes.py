"""What differs between two devices: quantities with their intervals, of several axes by entry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from math import inf, isclose

from identification import Device, Quantity, SlopeRange

#: Quantities of a device in the order of its file.
_QUANTITIES = ("sample_time", "mass", "damping", "coulomb_friction", "force_offset", "delay",
               "encoder_resolution", "current_lag", "position_stiffness", "damping_slope",
               "presliding_stiffness")  # fmt: skip
#: Those that a file of several axes holds as a range over axes, which says nothing of each.
_RANGES = frozenset({"mass", "damping", "coulomb_friction", "force_offset"})
#: Those that a wrong scale of the force multiplies, all by the same.
_OF_THE_FORCE = _RANGES | {"position_stiffness", "damping_slope", "presliding_stiffness"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A quantity of a file with its 95 %, SI units; no value where only ends are stated."""

    value: float | None
    low: float
    high: float

    @classmethod
    def around(cls, poses: Sequence[Interval]) -> Interval | None:
        """The one that holds those of all poses, with the mean of their values; None for none."""
        if not poses:
            return None
        values = [each.value for each in poses if each.value is not None]
        mean = sum(values) / len(values) if values else None
        low, high = min(each.low for each in poses), max(each.high for each in poses)
        return cls(value=mean, low=low, high=high)

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return (self.high - self.low) / 2


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


def changes_of(old: Device, new: Device) -> tuple[Change, ...]:
    """Every quantity that at least one of the devices states."""
    sides: dict[str, list[Interval | None]] = {
        name: [(item := getattr(each, name)) and _range(item) for each in (old, new)]
        for name in _QUANTITIES
    }
    limits = [each.force_limit for each in (old, new)]
    for name in ("continuous", "peak"):
        sides[f"force_limit.{name}"] = [each and exact(getattr(each, name)) for each in limits]
    if old.axes is not None and new.axes is not None:
        sides = _entries(old, new) | {
            name: each for name, each in sides.items() if name not in _RANGES
        }
    return stated(sides)


def one_factor(changes: Sequence[Change]) -> Interval | None:
    """The factor by which all that a force scales may have changed; None unless two changed so.

    Of one axis only: of several each has its own drive.
    """
    low, high, beyond = 0.0, inf, 0
    for each in changes:
        if each.name not in _OF_THE_FORCE:
            continue
        if each.old is None or each.new is None:
            return None
        beyond += each.beyond
        for a, b in ((each.old.low, each.new.high), (-each.old.high, -each.new.low)):
            if a:  # factor·a <= b
                low, high = (low, min(high, b / a)) if a > 0 else (max(low, b / a), high)
            elif b < 0:
                return None
    if beyond > 1 and low > 0 and (low < high or isclose(low, high)):
        return Interval(value=(low + high) / 2, low=low, high=high)
    return None


def renamed(old: Device, new: Device) -> tuple[str, ...]:
    """Name, axis and serial number that both state and that are not the same, as "axis x → y"."""
    sides = ((key, getattr(old, key), getattr(new, key)) for key in ("name", "axis", "serial"))
    return tuple(f"{key} {a} → {b}" for key, a, b in sides if a and b and a != b)


def _entries(old: Device, new: Device) -> dict[str, list[Interval | None]]:
    """What axes have each, pose by pose; over all poses where there are not as many."""
    tables = [device.by_axis() for device in (old, new)]
    counts = {len(device.poses or ()) for device in (old, new)}
    found: dict[str, list[Interval | None]] = {}
    for name in dict.fromkeys((*tables[0], *tables[1])):
        poses = [[_range(item) for item in table.get(name, ())] for table in tables]
        if len(counts) > 1:
            found[name] = [Interval.around(each) for each in poses]
        elif counts == {1}:
            found[name] = [next(iter(each), None) for each in poses]
        else:
            pairs = zip_longest(*poses)
            found |= {f"pose_{k}.{name}": list(pair) for k, pair in enumerate(pairs, 1)}
    return found


def stated(sides: dict[str, list[Interval | None]]) -> tuple[Change, ...]:
    """Old and new by name, of all that one of them states."""
    changes = (Change(name=name, old=old, new=new) for name, (old, new) in sides.items())
    return tuple(each for each in changes if each.old or each.new)


def _range(item: Quantity | SlopeRange) -> Interval:
    value = item.value if isinstance(item, Quantity) else None
    return Interval(value=value, low=item.low, high=item.high)


def exact(value: float) -> Interval:
    """A value without doubt."""
    return Interval(value=value, low=value, high=value)
