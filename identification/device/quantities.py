"""A number with its interval, the region that several span, and results that are tables of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    WithJsonSchema,
    model_validator,
)

from identification.documents import Document
from identification.errors import InvalidInputError
from identification.trajectory import NORMAL_95

if TYPE_CHECKING:
    import polars

#: No quantity of a device comes near it in SI units; beyond, formulas overflow.
LARGEST = 1e9
#: Probability that the simultaneous box holds every identified quantity.
BOX_CONFIDENCE = 0.999
#: Part of a correlation that rounding to twelve digits may take away.
_ROUNDED = 1e-9
#: Degrees of freedom from which Hotelling's T² is χ² to six digits.
_MANY = 1e6
#: Precision of its distributions, more than twice that of a number.
_BITS = 128

Source = Literal["hardware", "log", "assumed"]


class Quantity(Document):
    """A number with its 95 % interval; in a file a bare number or {value, low, high, source}."""

    value: float
    low: float
    high: float
    source: Source | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Quantity:
        if max(abs(self.low), abs(self.high)) > LARGEST:
            raise ValueError(f"must lie within ±{LARGEST:g}, not {self.low:g} to {self.high:g}")
        if not self.low <= self.value <= self.high:
            raise ValueError(
                f"needs low <= value <= high, not {self.low:g}, {self.value:g}, {self.high:g}"
            )
        return self

    @property
    def exact(self) -> bool:
        """True when no interval was given."""
        return self.low == self.high


def _to_quantity(raw: object) -> object:
    if isinstance(raw, str | bool | None):
        raise ValueError("give a number or {value: …, low: …, high: …}")
    if isinstance(raw, int | float):
        return {"value": raw, "low": raw, "high": raw}
    if isinstance(raw, Mapping):
        stated = cast("Mapping[str, object]", raw)
        return {"low": stated.get("value"), "high": stated.get("value"), **stated}
    return raw


def _from_quantity(quantity: Quantity) -> float | dict[str, Any]:
    content: dict[str, Any] = {"value": quantity.value}
    if not quantity.exact:
        content |= {"low": quantity.low, "high": quantity.high}
    if quantity.source is not None:
        content["source"] = quantity.source
    return content if len(content) > 1 else quantity.value


def _in_file(number: dict[str, Any], description: str) -> WithJsonSchema:
    """What a quantity looks like in a file, for the JSON Schemas."""
    return WithJsonSchema(
        {
            "title": "Quantity",
            "description": description,
            "anyOf": [
                number,
                {
                    "type": "object",
                    "properties": {
                        **dict.fromkeys(("value", "low", "high"), number),
                        "source": {"anyOf": [{"enum": [*get_args(Source)]}, {"type": "null"}]},
                    },
                    "required": ["value"],
                    "additionalProperties": False,
                },
            ],
        }
    )


def _positive(quantity: Quantity) -> Quantity:
    if quantity.low <= 0:
        raise ValueError(f"must be greater than 0 over its interval, not {quantity.low:g}")
    return quantity


AnyQuantity = Annotated[
    Quantity,
    BeforeValidator(_to_quantity),
    PlainSerializer(_from_quantity, when_used="always"),
    _in_file({"type": "number"}, "a number, or a value with its 95 % interval"),
]
PositiveQuantity = Annotated[
    Quantity,
    BeforeValidator(_to_quantity),
    AfterValidator(_positive),
    PlainSerializer(_from_quantity, when_used="always"),
    _in_file(
        {"type": "number", "exclusiveMinimum": 0},
        "a number above zero, or a value with its 95 % interval",
    ),
]


def quantity(
    value: float, low: float | None = None, high: float | None = None, source: Source | None = None
) -> Quantity:
    """A Quantity from a value and, if it is uncertain, its 95 % interval."""
    return Quantity(
        value=value,
        low=value if low is None else low,
        high=value if high is None else high,
        source=source,
    )


class Covariance(Document):
    """Joint covariance of everything identified together, in the units of the device."""

    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
    degrees_of_freedom: float = Field(gt=0)

    @model_validator(mode="after")
    def _square(self) -> Covariance:
        size = len(self.parameters)
        lengths = {len(row) for row in self.matrix}
        if len(self.matrix) != size or lengths != {size} or len(set(self.parameters)) < size:
            shape = f"{len(self.matrix)} x {' or '.join(map(str, sorted(lengths)))}"
            listed = ", ".join(self.parameters)
            raise ValueError(
                f"matrix is {shape} for {len(set(self.parameters))} parameters, {listed}"
            )
        matrix = np.array(self.matrix)
        variances = np.diag(matrix)
        if np.any(variances < 0):
            raise ValueError(f"matrix has a negative variance, {variances.min():g}")
        scale = np.sqrt(np.where(variances > 0, variances, 1.0))
        correlations = matrix / np.outer(scale, scale)
        uneven = np.argwhere(np.abs(correlations - correlations.T) > _ROUNDED)
        if uneven.size:
            row, column = uneven[0]
            raise ValueError(
                f"matrix is not symmetric: {matrix[row, column]:g} in row {row + 1}, column "
                f"{column + 1}, and {matrix[column, row]:g} the other way round"
            )
        least = float(np.linalg.eigvalsh(correlations)[0])
        if least < -_ROUNDED:
            raise ValueError(
                "matrix is not positive definite: an eigenvalue of its correlations is "
                f"{least:.3g}, needed is 0 or more"
            )
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Simultaneous region of what is not known exactly; each entry (low, high), SI units.

    Attributes:
        mass: kg.
        damping: N·s/m.
        sample_time: s.
        delay: s.
        position_stiffness: slope of the device's own force by position, N/m: of k·q, and of
            gravity its steepest, of either sign.
    """

    mass: tuple[float, float]
    damping: tuple[float, float]
    sample_time: tuple[float, float]
    delay: tuple[float, float]
    position_stiffness: tuple[float, float] = (0.0, 0.0)


@cache
def widening(count: int, freedom: float, confidence: float) -> float:
    """Factor from the half-width of a 95 % interval of one of ``count`` quantities to their box.

    The box bounds the joint confidence ellipsoid: Hotelling's T² with ``freedom`` degrees of
    freedom, χ² where they are many or infinite. T²/(T² + freedom) is beta distributed (Anderson, An
    Introduction to Multivariate Statistical Analysis, 2003, section 5.2). Halved to the last bit in
    digits to spare; scipy.special, which has such quantiles, takes longer to load than a spring to
    be certified. Raises InvalidInputError for no more degrees of freedom than quantities.
    """
    from flint import arb, ctx

    if not freedom > count:
        raise InvalidInputError(
            "covariance",
            f"degrees_of_freedom is {freedom:g} for {count} parameters",
            "Identify from a longer log",
        )
    ball: Any = arb  # its stubs lack the special functions

    def is_below(square: float) -> bool:
        half = ball(count) / 2
        if freedom > _MANY:
            found = (ball(square) / 2).gamma_lower(half, 1)
        else:
            rest = (ball(freedom) - count + 1) / 2
            found = (ball(square) / (ball(square) + freedom)).beta_lower(half, rest, 1)
        return bool(found < confidence)

    with ctx.workprec(_BITS):
        low, high = 0.0, 1.0
        while is_below(high):
            low, high = high, 2 * high
        while low < (middle := (low + high) / 2) < high:
            low, high = (middle, high) if is_below(middle) else (low, middle)
    return math.sqrt(high) / NORMAL_95


def widen_interval(quantity: Quantity, factor: float) -> tuple[float, float]:
    """(low, high) of an interval widened about its value."""
    return (
        quantity.value - factor * (quantity.value - quantity.low),
        quantity.value + factor * (quantity.high - quantity.value),
    )


class Tabular:
    """A result that is a table of numbers in SI units, and that a notebook shows as one."""

    __slots__ = ()

    def _rows(self) -> list[dict[str, object]]:
        """One a row, by the name of the column."""
        raise NotImplementedError

    def to_frame(self) -> polars.DataFrame:
        """The table as a frame of polars, a row a quantity or effect; SI units."""
        import polars as pl

        return pl.DataFrame(self._rows(), infer_schema_length=None)

    def _repr_html_(self) -> str:
        """A sentence and the table: the name is IPython's protocol."""
        import polars as pl

        with pl.Config(tbl_rows=-1, tbl_hide_dataframe_shape=True, tbl_hide_column_data_types=True):
            table: Any = self.to_frame()
            cells = table._repr_html_().replace("&quot;", "")
            return f"<p>{escape(repr(self))}</p>{cells}"
