"""A fleet at a glance: how its devices are spread, and which of them is not like the others.

The others are told by their median and by the median of the distances from it, scaled to the
standard deviation of a normal distribution (P. J. Rousseeuw and C. Croux, "Alternatives to the
median absolute deviation", 1993), which up to half of them cannot move however far they lie. A
device is unlike them where all of its 95 % interval lies further away than any device does in any
quantity, but in five at most of a hundred normal fleets that are alike in truth: by Student's t,
because the spread of few is not well known, and by Bonferroni over all that is compared. What is
the same in more than half of the devices has no such spread, and is not judged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification import counted
from tune.documents.scene import EFFECT_NAMES, UNITS
from tune.optimisation.study import QUANTITIES
from tune.presentation.tables import headed_table, plain_number

if TYPE_CHECKING:
    import polars
    from matplotlib.figure import Figure
    from rich.table import Table

FloatArray = NDArray[np.float64]

#: Devices from which it is said that one is not like the others.
FEWEST = 5
#: The part of fleets alike in truth that may have a device far above the others; as many below.
#: Student's t is short of the tail of this distance by up to a quarter.
_BY_CHANCE = 0.02
#: Part of a value that its spread has to exceed: of less, rounding is a part.
_ROUNDING = 1e-9
#: The median distance from the median in normal standard deviations.
_MEDIAN_DISTANCE = NormalDist().inv_cdf(0.75)
#: Rows of a table on the page; the Parquet file has all.
_MOST_ROWS = 200
#: Devices named in one part of the picture, and their colour.
_MOST_NAMED, _UNLIKE = 5, "#D55E00"
_WIDTH, _HEIGHT, _COLUMNS = 11.0, 2.1, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlike:
    """A device one quantity of which is not like that of the others, beyond its interval."""

    device: str  # its name
    quantity: str  # its column
    value: float  # with the 95 % interval, SI units
    low: float
    high: float
    median: float  # of the fleet
    spread: float  # of the fleet, as a standard deviation
    distance: float  # of the nearer end of the interval from the median, in spreads


def unlike_others(frame: polars.DataFrame) -> tuple[Unlike, ...]:
    """Devices that are not like the others of their axis, the furthest first; of few, none."""
    axes = frame.drop_nulls("motion").partition_by("axis", "motion")
    judged = [(axis, name) for axis in axes for name in QUANTITIES if _varies(axis, name)]
    compared = sum(len(axis) for axis, _ in judged)
    found = [each for axis, name in judged for each in _unlike(axis, name, compared)]
    return tuple(sorted(found, key=lambda each: -each.distance))


def _varies(frame: polars.DataFrame, name: str) -> bool:
    """Whether enough devices have a spread by which one can be told from the others."""
    value = frame[name].to_numpy()
    return len(value) >= FEWEST and _middle(value)[1] > _ROUNDING * np.median(np.abs(value))


def _unlike(frame: polars.DataFrame, name: str, compared: int) -> Iterator[Unlike]:
    from scipy.special import stdtrit

    value, low, high = (frame[each].to_numpy() for each in (name, f"{name}_low", f"{name}_high"))
    median, spread = _middle(value)
    distance = np.maximum(np.maximum(low - median, median - high), 0.0) / spread
    # This distance is known as well as a standard deviation of half as many is.
    most = stdtrit((len(value) - 1) / 2, 1 - _BY_CHANCE / compared)
    for place in np.flatnonzero(distance > most):
        yield Unlike(
            device=frame["name"][int(place)],
            quantity=name,
            value=float(value[place]),
            low=float(low[place]),
            high=float(high[place]),
            median=median,
            spread=spread,
            distance=float(distance[place]),
        )


def _middle(value: FloatArray) -> tuple[float, float]:
    """(median, spread) of the middle half."""
    median = float(np.median(value))
    return median, float(np.median(np.abs(value - median))) / _MEDIAN_DISTANCE


def fleet_verdicts(frame: polars.DataFrame, unlike: tuple[Unlike, ...]) -> tuple[str, ...]:
    """How many devices have a profile, and how many are not like the others."""
    refused = frame.filter(frame["exit_code"] != 0)
    all_ = counted(len(frame), "device")
    first = f"{len(frame) - len(refused)} of {all_} tuned and proved safe"
    first += f"; {len(refused)} refused, and without a profile" if len(refused) else ""
    named = sorted({each.device for each in unlike})
    if not named:
        return (first,)
    words = ", ".join(named[:8]) + (f" and {len(named) - 8} more" if len(named) > 8 else "")
    return first, f"{len(named)} not like the others: {words}"


def unlike_table(unlike: tuple[Unlike, ...]) -> Table:
    """What is not like the others of a fleet."""
    numbers = ("value", "95 % interval", "median", "distance")
    table = headed_table(
        "not like the others",
        ("device", "quantity", *numbers),
        right=numbers,
        caption="distance: of the nearer end of the 95 % interval from the median, in standard "
        "deviations of the fleet",
    )
    for each in unlike[:_MOST_ROWS]:
        value, low, high, median = map(plain_number, (each.value, each.low, each.high, each.median))
        interval, distance = f"{low} .. {high}", f"{each.distance:.1f}"
        table.add_row(each.device, _words(each.quantity), value, interval, median, distance)
    return table


def refused_table(frame: polars.DataFrame) -> Table:
    """Devices that have no profile, and why."""
    table = headed_table("refused", ("device", "exit code", "why"), right=("exit code",))
    refused = frame.filter(frame["exit_code"] != 0).head(_MOST_ROWS)
    for name, code, why in refused.select("name", "exit_code", "sentence").iter_rows():
        table.add_row(name, str(code), why)
    return table


def _spread_table(frame: polars.DataFrame) -> Table:
    """Every quantity over the fleet."""
    numbers = ("devices", "least", "median", "most", "spread")
    table = headed_table(
        "over the fleet",
        ("quantity", *numbers),
        right=numbers,
        caption="spread: of the middle half, as a standard deviation; SI units",
    )
    for name in _shown(frame):
        value = frame[name].drop_nulls().to_numpy()
        median, spread = _middle(value)
        told = (plain_number(each) for each in (value.min(), median, value.max(), spread))
        table.add_row(_words(name), str(len(value)), *told)
    return table


def _shown(frame: polars.DataFrame) -> list[str]:
    """Columns that are told by their distribution: the device's quantities and every effect."""
    parted = {name: name.rpartition(".") for name in frame.columns}
    effects = (name for name, (of, _, last) in parted.items() if of and last in EFFECT_NAMES)
    return [
        name
        for name in (*QUANTITIES, *effects)
        if name in frame.columns and frame[name].null_count() < len(frame)
    ]


def _words(name: str) -> str:
    return name.replace("_", " ").replace(".", " ")


def _unit(frame: polars.DataFrame, name: str) -> str:
    """The unit of a quantity, where all devices move in one way."""
    motions = frame["motion"].drop_nulls().unique()
    if len(motions) != 1:
        return ""
    units = UNITS[motions[0]] | {"delay": "s"}
    kind = {"coulomb_friction": "force", "force_offset": "force"}.get(name, name.rpartition(".")[2])
    return f", {units[kind]}"


def fleet_picture(frame: polars.DataFrame, unlike: tuple[Unlike, ...]) -> Figure:
    """A histogram of each quantity and effect; devices not like the others are marked by name."""
    from identification import NotebookFigure

    names = [name for name in _shown(frame) if frame[name].drop_nulls().n_unique() > 1]
    rows = max(1, -(-len(names) // _COLUMNS))
    figure = NotebookFigure(figsize=(_WIDTH, _HEIGHT * rows), layout="constrained")
    axes: Any = figure.subplots(rows, _COLUMNS, squeeze=False)
    for axis, name in zip(axes.flat, names, strict=False):
        value = frame[name].drop_nulls().to_numpy()
        axis.hist(value, bins=min(40, max(5, int(np.sqrt(len(value))))), color="#0072B2")
        top = axis.get_xaxis_transform()
        for each in [each for each in unlike if each.quantity == name][:_MOST_NAMED]:
            axis.axvspan(each.low, each.high, color=_UNLIKE)
            place = {"transform": top, "rotation": 90, "va": "top", "ha": "right"}
            axis.text(each.low, 0.97, each.device, color=_UNLIKE, fontsize=7, **place)
        axis.set_xlabel(_words(name) + _unit(frame, name), fontsize=8)
        axis.tick_params(labelsize=7)
        axis.xaxis.get_offset_text().set_fontsize(7)
        axis.yaxis.get_major_locator().set_params(integer=True)
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    return figure


def fleet_html(title: str, frame: polars.DataFrame, unlike: tuple[Unlike, ...]) -> str:
    """The page of a fleet, complete in itself."""
    from tune.presentation.page import summary_html

    tables = [_spread_table(frame)]
    tables[:0] = [unlike_table(unlike)] if unlike else []
    tables += [refused_table(frame)] if frame["exit_code"].max() else []
    return summary_html(
        title,
        fleet_verdicts(frame, unlike),
        tables,
        fleet_picture(frame, unlike),
        "How many devices have each value; what is not like the others with its 95 % interval.",
    )
