"""Results as plain types for programs: what the tables show, in numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from identification import Examination, Quantity
    from tune.documents.results import LogExamined, ToldQuantity


def finite(content: object) -> object:
    """Content of JSON with null for every number that is not finite, which JSON cannot hold."""
    if isinstance(content, float) and not math.isfinite(content):
        return None
    if isinstance(content, Mapping):
        return {key: finite(item) for key, item in cast("Mapping[str, object]", content).items()}
    if isinstance(content, list | tuple):
        return [finite(item) for item in cast("list[object]", content)]
    return content


def half_width(quantity: Quantity) -> float:
    """Half of the interval, in the unit of the quantity."""
    return (quantity.high - quantity.low) / 2


def relative_half_width(quantity: Quantity) -> float | None:
    """Half of the interval as part of the value; None where it is exact or the value is zero."""
    if quantity.exact or quantity.value == 0:
        return None
    return half_width(quantity) / abs(quantity.value)


def quantity_result(quantity: Quantity | None) -> ToldQuantity | None:
    """A quantity with its interval."""
    if quantity is None:
        return None
    return {
        "value": quantity.value,
        "low": quantity.low,
        "high": quantity.high,
        "half_width": half_width(quantity),
        "relative": relative_half_width(quantity),
    }


def examination_result(seen: Examination) -> LogExamined:
    """What doctor's table shows of one log."""
    return {
        "source": seen.source,
        "motion": seen.motion,
        "usable": not seen.refused,
        "samples": seen.samples,
        "fitted": seen.fitted,
        "duration": seen.duration,
        "sample_time": seen.sample_time,
        "rate_hz": 1 / seen.sample_time,
        "travel": seen.travel,
        "peak_speed": seen.peak_speed,
        "peak_force": seen.peak_force,
        "encoder_count": seen.count,
        "noise": seen.noise,
        "band_hz": seen.band,
        "mass": quantity_result(seen.mass),
        "damping": quantity_result(seen.damping),
    }
