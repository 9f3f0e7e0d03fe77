"""What is known of a device now, by each log and method, and what was known before."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from identification.device.device import Device
from identification.device.quantities import Quantity
from identification.estimators.estimate import NORMAL_95, Estimate
from identification.fitting.one_log import LogFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: What is drawn, with the symbol of each.
SYMBOLS = {
    "mass": "mass m",
    "damping": "damping b",
    "coulomb_friction": "friction Fc",
    "force_offset": "offset f0",
    "delay": "delay",
}
#: Letters of a log's name.
_SHORT = 22


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """One state of knowledge: a line of the picture.

    Attributes:
        words: whose it is.
        color: of its line.
        ends: (low, value, high) of each quantity it tells.
    """

    words: str
    color: str
    ends: dict[str, tuple[float, float, float]]


def knowledge(device: Device, fits: Sequence[LogFit], before: Device | None) -> list[Known]:
    """What is drawn, from top to bottom.

    Args:
        device: as it is known now.
        fits: of its logs; none where they are not at hand.
        before: the device as an earlier file states it; None where there is none.
    """
    lines = [_of_device(device, "now", "tab:green")]
    if before is not None:
        dated = "" if before.date is None else f", {before.date}"
        lines.append(_of_device(before, f"before{dated}", "k"))
    for fit in fits:
        name = _short(fit.trajectory.source) + ", " if len(fits) > 1 else ""
        lines += [
            _of_estimate(each, f"{name}{each.method}", "tab:blue" if believed else "0.55")
            for each, believed in ((fit.estimate, True), *((o, False) for o in fit.others))
        ]
    return lines


def draw_intervals(axes: Sequence[Axes], lines: Sequence[Known], units: dict[str, str]) -> None:
    """One axes a quantity, one line a state of knowledge; 95 % intervals."""
    for place, (quantity, each) in enumerate(zip(SYMBOLS, axes, strict=True)):
        for row, known in enumerate(lines):
            if quantity not in known.ends:
                continue
            low, value, high = known.ends[quantity]
            each.plot([low, high], [-row, -row], color=known.color, lw=4, alpha=0.4)
            each.plot([value], [-row], "o", color=known.color, ms=4)
        each.set_ylim(-len(lines) + 0.5, 0.5)
        words = [known.words for known in lines] if place == 0 else [""] * len(lines)
        each.set_yticks([-row for row in range(len(lines))], words, fontsize=7)
        each.grid(visible=True, axis="y", lw=0.3)
        each.tick_params(axis="x", labelsize=7)
        each.locator_params(axis="x", nbins=3)
        each.ticklabel_format(axis="x", useOffset=False, style="plain")
        each.set_xlabel(f"{SYMBOLS[quantity]}, {units[quantity]}", fontsize=8)


def _of_device(device: Device, words: str, color: str) -> Known:
    ends: dict[str, tuple[float, float, float]] = {}
    for name in SYMBOLS:
        quantity: Quantity = getattr(device, name)
        if name != "delay" or "delay" not in device.missing:
            factor = 1e3 if name == "delay" else 1.0
            ends[name] = _times(factor, quantity.low, quantity.value, quantity.high)
    return Known(words=words, color=color, ends=ends)


def _of_estimate(estimate: Estimate, words: str, color: str) -> Known:
    ends: dict[str, tuple[float, float, float]] = {}
    for name in estimate.parameters:
        if name in SYMBOLS:
            value, half = estimate.value(name), NORMAL_95 * estimate.deviation(name)
            ends[name] = (value - half, value, value + half)
    if estimate.delay_deviation is not None:
        half = NORMAL_95 * estimate.delay_deviation
        ends["delay"] = _times(1e3, estimate.delay - half, estimate.delay, estimate.delay + half)
    return Known(words=words, color=color, ends=ends)


def _times(factor: float, low: float, value: float, high: float) -> tuple[float, float, float]:
    return factor * low, factor * value, factor * high


def _short(name: str) -> str:
    return name if len(name) <= _SHORT else f"{name[: _SHORT - 1]}…"
