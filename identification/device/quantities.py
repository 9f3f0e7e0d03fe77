"""Numbers and matrices with their intervals, the region that they span, and tables of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
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
from identification.trajectory import NORMAL_95, FloatArray

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

#: Directions looked at first, and about the best of them each time closer.
_DIRECTIONS, _NEAR = 4000, 400
_CLOSER = 0.3 ** np.arange(1, 10)
#: Largest logarithm of a mass's interval to its value, a factor of a thousand.
_WIDEST = 7.0
#: The generator of directions starts here, so that a box can be repeated.
_SEED = 20_261_126

Matrix = tuple[tuple[float, ...], ...]
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
    if isinstance(raw, str | bool | list | tuple | None):
        raise ValueError("give a number or {value: …, low: …, high: …}")
    if isinstance(raw, int | float):
        return {"value": raw, "low": raw, "high": raw}
    if isinstance(raw, Mapping):
        stated = cast("Mapping[str, object]", raw)
        if len(given := {"low", "high"} & stated.keys()) == 1:
            raise ValueError(f"has {given.pop()} alone; an interval needs low and high")
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
                    "dependentRequired": {"low": ["high"], "high": ["low"]},
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


def widest(stated: Quantity | None, found: Sequence[Quantity | None]) -> Quantity | None:
    """The hull of several intervals about the value stated, or their mean; None for none."""
    known = [each for each in found if each is not None]
    if not known:
        return stated
    ends = [*known, *([] if stated is None else [stated])]
    low, high = min(each.low for each in ends), max(each.high for each in ends)
    if stated is not None:
        return stated.model_copy(update={"low": low, "high": high})
    return quantity(float(np.mean([each.value for each in known])), low, high, source="log")


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
        with np.errstate(over="ignore"):  # beyond 1 none is possible, whatever it is
            correlations = np.clip(matrix / np.outer(scale, scale), -2.0, 2.0)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Extreme:
    """The least or largest mass or damping of any direction, and the direction, a unit vector."""

    value: float
    direction: tuple[float, ...]

    def along(self, axes: Sequence[str]) -> str:
        """The direction in a sentence, its parts by the names of the axes."""
        return direction_in_words(self.direction, axes)


def direction_in_words(direction: Sequence[float], axes: Sequence[str]) -> str:
    """A direction in a sentence, its parts by the names of the axes."""
    parts = zip(direction, axes, strict=True)
    return f"along ({', '.join(f'{part:.2f} {axis}' for part, axis in parts)})"


class Pose(Document):
    """A device of several axes at one pose: Λ·q̈ + D·q̇ + Fc∘sign(q̇) + f0 = F(t - delay).

    Attributes:
        mass: Λ, kg (kg·m²), symmetric and positive definite.
        damping: D, N·s/m (N·m·s/rad), symmetric.
        coulomb_friction: Fc of each axis, N (N·m).
        force_offset: f0 of each axis, N (N·m).
        covariance: joint, of the entries of both matrices, named mass_x_y and damping_x_y.
    """

    mass: Matrix
    damping: Matrix
    coulomb_friction: tuple[float, ...]
    force_offset: tuple[float, ...]
    covariance: Covariance

    @model_validator(mode="after")
    def _sane(self) -> Pose:
        count = len(self.mass)
        for name in ("mass", "damping"):
            matrix = getattr(self, name)
            if len(matrix) != count or any(len(row) != count for row in matrix):
                raise ValueError(f"{name} must have {count} rows of {count} numbers")
            if not np.array_equal(np.array(matrix), np.array(matrix).T):
                raise ValueError(f"{name} must be symmetric")
        if len(self.coulomb_friction) != count or len(self.force_offset) != count:
            raise ValueError(f"coulomb_friction and force_offset need {count} numbers")
        least = float(np.linalg.eigvalsh(np.array(self.mass))[0])
        if least <= 0:
            raise ValueError(f"mass is {least:.3g} in some direction; it must be positive in all")
        return self

    def extremes(
        self, which: Literal["mass", "damping"], deviations: float
    ) -> tuple[Extreme, Extreme]:
        """Least and largest mass or damping of any direction, so many standard deviations away.

        Mass is widened on a logarithmic scale, because it cannot be negative.
        """
        matrix = getattr(self, which)
        size = len(matrix) * (len(matrix) + 1) // 2
        part = slice(0, size) if which == "mass" else slice(size, 2 * size)
        covariance = tuple(row[part] for row in self.covariance.matrix[part])
        return _extremes(matrix, covariance, deviations, positive=which == "mass")

    def along(self, direction: Sequence[float]) -> tuple[Quantity, Quantity]:
        """Mass and damping of motion in a direction, a unit vector n, with 95 % intervals.

        The values vᵀΛv and vᵀDv are those of v = n, where nothing moves across. The intervals span
        v = Λ⁻¹n/(nᵀΛ⁻¹n) too, which a force along n makes of a device that is free across.
        """
        unit, joint = np.array(direction), np.array(self.covariance.matrix)
        free = np.linalg.solve(np.array(self.mass), unit)
        rows, columns = np.triu_indices(unit.size)
        twice, size = np.where(rows == columns, 1.0, 2.0), rows.size
        found: list[Quantity] = []
        for which, part in (("mass", slice(0, size)), ("damping", slice(size, 2 * size))):
            ends: list[tuple[float, float, float]] = []
            for v in (unit, free / (unit @ free)):
                weights = v[rows] * v[columns] * twice
                value = float(v @ np.array(getattr(self, which)) @ v)
                half = self.deviations() * math.sqrt(weights @ joint[part, part] @ weights)
                low, high = value - half, value + half
                if which == "mass":  # which cannot be negative
                    low, high = value * math.exp(-half / value), value * math.exp(half / value)
                ends.append((value, low, high))
            lows, highs = [low for _, low, _ in ends], [high for *_, high in ends]
            found.append(quantity(ends[0][0], min(lows), max(highs)))
        return found[0], found[1]

    def deviations(self, confidence: float | None = None) -> float:
        """Standard deviations to a 95 % interval, or to a joint region of all that is estimated."""
        freedom = self.covariance.degrees_of_freedom
        if confidence is None:
            return NORMAL_95 * widening(1, freedom, 0.95)
        return NORMAL_95 * widening(len(self.covariance.parameters), freedom, confidence)


@lru_cache(maxsize=256)
def _extremes(
    matrix: Matrix, covariance: Matrix, deviations: float, *, positive: bool
) -> tuple[Extreme, Extreme]:
    """Ends of vᵀMv over unit vectors v, so many deviations away; a mass stays positive."""
    middle, joint = np.array(matrix), np.array(covariance)
    size = len(middle)
    rows, columns = np.triu_indices(size)
    twice = np.where(rows == columns, 1.0, 2.0)
    chance = np.random.default_rng(_SEED)
    first_look = np.vstack((np.linalg.eigh(middle)[1].T, chance.normal(size=(_DIRECTIONS, size))))

    def end(side: float) -> Extreme:
        def values(directions: FloatArray) -> FloatArray:
            value = np.einsum("di,ij,dj->d", directions, middle, directions)
            weights = directions[:, rows] * directions[:, columns] * twice
            variance = np.einsum("di,ij,dj->d", weights, joint, weights)
            half = side * deviations * np.sqrt(np.maximum(variance, 0.0))
            if positive:
                return value * np.exp(np.clip(half / value, -_WIDEST, _WIDEST))
            return value + half

        best, tried = first_look[0], first_look
        for closer in (0.0, *_CLOSER.tolist()):
            unit = tried / np.linalg.norm(tried, axis=1, keepdims=True)
            best = unit[np.argmax(side * values(unit))]
            tried = np.vstack((best, best + closer * chance.normal(size=(_NEAR, size))))
        best = best * np.sign(best[np.argmax(np.abs(best))])
        return Extreme(value=float(values(best[None])[0]), direction=tuple(best.tolist()))

    return end(-1.0), end(1.0)


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
