"""Effects, and the scene file that asks for them: what is felt, met at once, by which hand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, product
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from identification import AnyQuantity, Document, load_document, quantity, typed
from tune.documents.estimators import (
    DERIVATIVES,
    DIFFERENCES,
    KINDS,
    RATIOS,
    Derivative,
    FilterKind,
    strange_order,
)

FloatArray = NDArray[np.float64]
EffectName = Literal["stiffness", "damping", "mass"]
EFFECT_NAMES: tuple[EffectName, ...] = ("stiffness", "damping", "mass")
#: s, over which an element that may pump fades in and out at least, and at most.
SHORTEST_FADE, LONGEST_FADE = 0.1, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """Virtual stiffness K, damping B and mass M; numbers, or arrays whose shapes broadcast.

    ``None`` says that the effect is not there at all, which is not the same as zero: without any
    stiffness the position is free by design and the pole at z = 1 is not held against the loop,
    while a stiffness of zero leaves the loop marginal and is not stable. Arrays are not copied.

    Attributes:
        stiffness: K, N/m (N·m/rad if rotary).
        damping: B, N·s/m (N·m·s/rad); negative values compensate friction.
        mass: M, kg (kg·m²); negative values make the device lighter.
    """

    stiffness: ArrayLike | None = None
    damping: ArrayLike | None = None
    mass: ArrayLike | None = None

    @property
    def position_free(self) -> bool:
        """True when no spring is part of the structure."""
        return self.stiffness is None

    def present(self) -> dict[EffectName, FloatArray]:
        """Those that are there, by name, as float64 arrays of the shapes given."""
        named = zip(EFFECT_NAMES, self.arrays(), strict=True)
        return {name: values for name, values in named if values is not None}

    def arrays(self) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
        """(K, B, M) as float64 arrays of the shapes given, ``None`` kept."""
        K, B, M = (
            None if values is None else np.asarray(values, dtype=np.float64)
            for values in (self.stiffness, self.damping, self.mass)
        )
        return K, B, M


#: Units by motion of the axis.
UNITS: dict[Literal["linear", "rotary"], dict[str, str]] = {
    "linear": {
        "stiffness": "N/m",
        "damping": "N·s/m",
        "mass": "kg",
        "force": "N",
        "length": "m",
        "speed": "m/s",
    },
    "rotary": {
        "stiffness": "N·m/rad",
        "damping": "N·m·s/rad",
        "mass": "kg·m²",
        "force": "N·m",
        "length": "rad",
        "speed": "rad/s",
    },
}


def format_number(number: float) -> str:
    """Four digits, without an exponent where there are no more than six before the point."""
    return f"{float(f'{number:.4g}'):g}"


#: Elements felt together are certified in every subset, 2^n - 1 sums.
_LARGEST_GROUP = 10
#: Sums of several elements in a scene, each a set that a guard knows; and of them those of unlike
#: elements, each tuned, certified and rehearsed, and each with keys of its own in a profile.
MOST_SUMS, MOST_UNLIKE_SUMS = 10_000, 1013
#: Elements of a scene; alone each takes a fraction of a second. In a profile each takes up to 90
#: keys, values and brackets of the 20 000 that a file may hold.
MOST_ELEMENTS = 200


def groups_of(
    elements: Iterable[str], together: Iterable[Sequence[str]]
) -> tuple[tuple[str, ...], ...]:
    """The groups as a profile states them: each set once, names in the order of the elements."""
    order = {name: place for place, name in enumerate(elements)}
    return tuple(dict.fromkeys(tuple(sorted(set(g), key=order.__getitem__)) for g in together))


class Hand(Document):
    """A grip as mass, damper and spring to a place that rests: m_h·ẍ + b_h·ẋ + k_h·x.

    Every combination within the three intervals is certified, and the device without any hand.
    Intervals that end where they begin say that the grip is known.

    Attributes:
        mass: m_h, kg (kg·m² if rotary), not negative.
        damping: b_h, N·s/m (N·m·s/rad), not negative.
        stiffness: k_h, N/m (N·m/rad), positive, or exactly zero for a hand that only follows.
    """

    mass: AnyQuantity
    damping: AnyQuantity
    stiffness: AnyQuantity

    @model_validator(mode="after")
    def _passive(self) -> Hand:
        for name in ("mass", "damping", "stiffness"):
            low = getattr(self, name).low
            if low < 0:
                raise ValueError(f"{name} of a hand must not be negative, not {low:g}")
        if self.stiffness.low == 0 < self.stiffness.high:
            raise ValueError(
                "stiffness of a hand must be zero, or above zero over its interval, not 0 to "
                f"{self.stiffness.high:g}; the device without a hand is certified in any case"
            )
        return self


#: From two fingers that hardly touch to an arm that braces itself: rounded outwards from measured
#: ranges, quoted from memory. Fingertip impedance (Hajian and Howe 1997): some grams, 4 to 7 N·s/m,
#: 0.25 to 1.3 kN/m; arm stiffness (Mussa-Ivaldi, Hogan and Bizzi 1985): 0.1 to 0.8 kN/m. Rotary
#: axes have the same at a lever of 20 mm.
FREE_TO_RIGID: dict[Literal["linear", "rotary"], Hand] = {
    "linear": Hand(
        mass=quantity(0.1, 0.005, 1.0),
        damping=quantity(5.0, 1.0, 30.0),
        stiffness=quantity(300.0, 20.0, 2000.0),
    ),
    "rotary": Hand(
        mass=quantity(4e-5, 2e-6, 4e-4),
        damping=quantity(2e-3, 4e-4, 1.2e-2),
        stiffness=quantity(0.12, 8e-3, 0.8),
    ),
}


def _to_hand(raw: object) -> object:
    if isinstance(raw, dict | Hand) or raw in ("none", "free-to-rigid"):
        return cast("object", raw)
    raise ValueError("give none, free-to-rigid, or {mass: …, damping: …, stiffness: …}")


def _hand_in_file() -> WithJsonSchema:
    words = {"title", "description"}
    own = {key: part for key, part in Hand.model_json_schema().items() if key not in words}
    return WithJsonSchema({"anyOf": [{"enum": ["none", "free-to-rigid"]}, own]})


#: What a scene says of the hand.
AnyHand = Annotated[
    Hand | Literal["none", "free-to-rigid"], BeforeValidator(_to_hand), _hand_in_file()
]


def hand_of(stated: Hand | str, motion: Literal["linear", "rotary"]) -> Hand | None:
    """The box a scene's word stands for on a linear or rotary axis; None for no hand."""
    if isinstance(stated, Hand):
        return stated
    return FREE_TO_RIGID[motion] if stated == "free-to-rigid" else None


MarginName = Literal["conservative", "balanced", "firm"]

#: SI units; whatever is felt, and how, lies far inside. Beyond, formulas overflow.
SMALLEST, LARGEST = 1e-9, 1e9
#: Samples of a moving window; each raises the degree of the loop by one.
LONGEST_WINDOW = 20


class Margin(Document):
    """How far from instability: stable for every gain in (0, gain] with the delay added."""

    gain: float = Field(ge=1)
    extra_delay_samples: int = Field(ge=1)


MARGINS: dict[MarginName, Margin] = {
    "conservative": Margin(gain=3.0, extra_delay_samples=2),
    "balanced": Margin(gain=2.0, extra_delay_samples=1),
    "firm": Margin(gain=1.5, extra_delay_samples=1),
}


class Wish(Document):
    """What is wanted of one effect.

    ``max`` and ``min`` reach as far as is safe, upwards and downwards (as light, as frictionless);
    a number is met exactly or by the nearest safe value; a range keeps to its bounds.
    """

    kind: Literal["max", "min", "value", "range"]
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Wish:
        _refuse_senseless(self.kind, self.low, self.high)
        return self

    @property
    def sign(self) -> int:
        """-1 where the effect takes something away from the device."""
        negative = self.kind == "min" or (self.kind == "value" and (self.high or 0) < 0)
        return -1 if negative else 1


def _refuse_senseless(kind: str, low: float | None, high: float | None) -> None:
    for bound in (low, high):
        if bound is not None and not math.isfinite(bound):
            raise ValueError("give a finite number")
        if bound and not SMALLEST <= abs(bound) <= LARGEST:
            raise ValueError(f"{bound:g} is beyond {SMALLEST:g} to {LARGEST:g}")
    if low is not None and high is not None and low > high:
        raise ValueError(f"min {low:g} exceeds max {high:g}")
    if kind == "range" and low is not None and low < 0:
        raise ValueError(f"a range starts at zero or above, not at {low:g}")
    if kind in {"value", "range"} and high == 0:
        raise ValueError("0 asks for nothing; leave the effect out")


def _to_wish(raw: object) -> object:
    """A wish as a file states it; what is wrong is said of what the file says."""
    if isinstance(raw, Wish):
        return raw
    if isinstance(raw, str) and raw in {"max", "min"}:
        return {"kind": raw}
    low = high = raw
    if isinstance(raw, dict):
        bounds = cast("dict[object, object]", raw)
        if set(bounds) == {"min", "max"}:
            low, high = bounds["min"], bounds["max"]
    if not (isinstance(low, int | float) and isinstance(high, int | float)):
        raise ValueError("give a number, max, min, or {min: …, max: …}")
    kind = "range" if isinstance(raw, dict) else "value"
    _refuse_senseless(kind, low, high)
    return {"kind": kind, "low": low, "high": high}


def _wish_in_file(words: list[str], number: dict[str, Any]) -> WithJsonSchema:
    """What a wish looks like in a file, for the JSON Schemas."""
    bounds = {"min": {"type": "number", "minimum": 0}, "max": {"type": "number", "minimum": 0}}
    ranged = {
        "type": "object",
        "properties": bounds,
        "required": ["min", "max"],
        "additionalProperties": False,
    }
    return WithJsonSchema({"anyOf": [{"enum": words}, {"type": "number", **number}, ranged]})


AnyWish = Annotated[
    Wish, BeforeValidator(_to_wish), _wish_in_file(["max", "min"], {"not": {"const": 0}})
]
#: A negative stiffness is never stable.
StiffnessWish = Annotated[
    Wish, BeforeValidator(_to_wish), _wish_in_file(["max"], {"exclusiveMinimum": 0})
]


class Element(Document):
    """One thing in the scene: the effects wanted of it and how the hand moves in it.

    An effect that is not named is zero and costs nothing. Motions bound the forces: K·penetration,
    |B|·speed and |M|·acceleration. Where one is not given the scene's default for linear or rotary
    axes holds (0.01 m, 0.2 m/s, 2 m/s²; 0.1 rad, 2 rad/s, 20 rad/s²).

    A ``one_sided`` element is a wall: it pushes out of itself and never pulls. Its damper may push
    so far before the face, m (rad), as ``lead`` says, and its stiffness counts before its damping
    unless it says ``favour: both``. An element with mass or with a negative effect is never
    switched: its force fades in and out over ``fade_time``, s.
    """

    model_config = ConfigDict(
        json_schema_extra={"anyOf": [{"required": [name]} for name in EFFECT_NAMES]}
    )

    stiffness: StiffnessWish | None = None
    damping: AnyWish | None = None
    mass: AnyWish | None = None
    penetration: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    speed: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    acceleration: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    priority: int = Field(default=1, ge=1)
    one_sided: bool = False
    lead: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    favour: Literal["stiffness", "both"] | None = None
    fade_time: float | None = Field(default=None, ge=SHORTEST_FADE, le=LONGEST_FADE)

    @model_validator(mode="after")
    def _something(self) -> Element:
        if not self.wishes():
            raise ValueError("names no effect; give stiffness, damping or mass")
        if self.stiffness is not None and self.stiffness.sign < 0:
            raise ValueError("a negative stiffness is never stable; leave it out")
        if self.one_sided and self.stiffness is None:
            raise ValueError("one_sided is for walls; give it a stiffness, or leave one_sided out")
        if self.one_sided and self.fades:
            raise ValueError(
                "a one_sided wall only pushes, and a mass or a negative effect pulls as well; give "
                "those an element of their own, felt together with it"
            )
        for name in ("lead", "favour"):
            if getattr(self, name) is not None and not self.one_sided:
                raise ValueError(f"{name} is for walls: say one_sided: true, or leave {name} out")
        if self.fade_time is not None and not self.fades:
            raise ValueError(
                f"fade_time {self.fade_time:g} has nothing to fade: only a mass and negative "
                "effects fade; leave it out"
            )
        return self

    @property
    def fades(self) -> bool:
        """Whether it fades in and out: elements with mass or with a negative effect do."""
        return self.mass is not None or any(wish.sign < 0 for wish in self.wishes().values())

    def wishes(self) -> dict[EffectName, Wish]:
        """The effects asked for."""
        return {name: wish for name in EFFECT_NAMES if (wish := getattr(self, name)) is not None}


class Motion(Document):
    """Penetration (m or rad), speed and acceleration, per s and s², that a hand reaches.

    Without a penetration a hand may go in as deep as it likes, and the force is cut at its limit.
    """

    penetration: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    speed: float = Field(ge=SMALLEST, le=LARGEST)
    acceleration: float = Field(ge=SMALLEST, le=LARGEST)


DEFAULT_MOTION = {
    "linear": Motion(penetration=0.01, speed=0.2, acceleration=2.0),
    "rotary": Motion(penetration=0.1, speed=2.0, acceleration=20.0),
}

#: m and rad: what is met so far before a face is less than a hand can tell of position (2° at wrist
#: and elbow: Tan, Srinivasan, Eberman and Cheng 1994).
DEFAULT_LEAD = {"linear": 1e-3, "rotary": 1e-2}


def _to_cutoff(raw: object) -> object:
    if isinstance(raw, int | float) or raw in ("free", "none"):
        return raw
    raise ValueError("give a frequency in Hz, free or none")


Cutoff = Annotated[
    float | Literal["free", "none"],
    BeforeValidator(_to_cutoff),
    WithJsonSchema(
        {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"enum": ["free", "none"]}]}
    ),
]


class LoopFreedom(Document):
    """Filters shared by all elements: a cut-off in Hz, ``none``, or ``free``; and their kind.

    A kind that is not stated is free where its cut-off is: kind and order are chosen with it, and
    the damping ratio unless it is stated. Else it is a low-pass.

    Attributes:
        velocity_filter: kind of the filter behind the backward difference.
        acceleration_filter: kind of the filter behind the double difference.
        velocity_filter_hz: its cut-off, the frequency of its poles, Hz.
        acceleration_filter_hz: likewise.
        velocity_filter_order: 1 (usual) or 2 poles of a low-pass, 2 or 3 (usual) states.
        acceleration_filter_order: 1 or 2 (usual) poles of a low-pass, 3 or 4 (usual) states.
        filter_damping_ratio: of pairs of poles; 1 (usual) is two equal poles, 0.7071 Butterworth.
        velocity_window_samples: velocity over the last n samples instead of a filter.
    """

    velocity_filter_hz: Cutoff = "free"
    acceleration_filter_hz: Cutoff = "free"
    velocity_filter: FilterKind | Literal["free"] | None = None
    acceleration_filter: FilterKind | Literal["free"] | None = None
    velocity_filter_order: int | None = Field(default=None, ge=1, le=3)
    acceleration_filter_order: int | None = Field(default=None, ge=1, le=4)
    filter_damping_ratio: float | None = Field(default=None, ge=0.1, le=1)
    velocity_window_samples: int | None = Field(default=None, ge=1, le=LONGEST_WINDOW)

    @field_validator("velocity_filter", "acceleration_filter", mode="before")
    @classmethod
    def _kind(cls, raw: object, info: ValidationInfo) -> object:
        if raw is None or raw in ("low-pass", "tracking", "free"):
            return raw
        hint = "" if isinstance(raw, str) else f"; did you mean {info.field_name}_hz?"
        raise ValueError(f"give low-pass, tracking or free{hint}")

    @model_validator(mode="after")
    def _positive(self) -> LoopFreedom:
        for which in DERIVATIVES:
            name = f"{which}_filter_hz"
            value = getattr(self, name)
            if isinstance(value, float) and not SMALLEST <= value <= LARGEST:
                raise ValueError(
                    f"{name} must lie in {SMALLEST:g} to {LARGEST:g}, not {value:g} Hz"
                )
            order = getattr(self, f"{which}_filter_order")
            if getattr(self, f"{which}_filter") == "free" and (
                value != "free" or order is not None
            ):
                raise ValueError(
                    f"{which}_filter: free needs {name}: free and no {which}_filter_order, not "
                    f"{value} and {order}"
                )
            if wrong := strange_order(which, *self.kind(which)):
                raise ValueError(wrong)
        if self.velocity_window_samples is not None and self.velocity_filter is not None:
            raise ValueError(
                f"velocity_window_samples: {self.velocity_window_samples} takes the place of a "
                f"velocity filter; leave out velocity_filter: {self.velocity_filter}"
            )
        if self.velocity_window_samples is not None and isinstance(self.velocity_filter_hz, float):
            raise ValueError(
                f"velocity_window_samples: {self.velocity_window_samples} takes the place of a "
                f"velocity filter; leave out velocity_filter_hz: {self.velocity_filter_hz:g}"
            )
        return self

    def kind(self, which: Derivative) -> tuple[FilterKind, int]:
        """Kind and order of a filter as they are stated, or what stands for them."""
        tracks = getattr(self, f"{which}_filter") == "tracking"
        order = getattr(self, f"{which}_filter_order") or DIFFERENCES[which] + 2 * tracks
        return "tracking" if tracks else "low-pass", order

    def _is_free(self, which: Derivative) -> bool:
        """Whether the kind of a filter is looked for."""
        kind = getattr(self, f"{which}_filter")
        windowed = which == "velocity" and self.velocity_window_samples is not None
        if kind or windowed or getattr(self, f"{which}_filter_order"):
            return kind == "free"
        return getattr(self, f"{which}_filter_hz") == "free"

    def kinds(self, which: Derivative) -> tuple[tuple[FilterKind, int], ...]:
        """Kinds and orders to choose from where they are free, else the stated one."""
        return KINDS[which] if self._is_free(which) else (self.kind(which),)

    def ratios(self) -> tuple[float, ...]:
        """Damping ratios to choose from: one where it is stated or no kind is free."""
        if self.filter_damping_ratio is not None:
            return (self.filter_damping_ratio,)
        return RATIOS if any(map(self._is_free, DERIVATIVES)) else RATIOS[:1]


class ElementSets(Document):
    """Elements of a scene or a design: which are met together, kept apart, or alike."""

    if TYPE_CHECKING:  # each has them where its file does
        elements: dict[str, Any]
        together: tuple[tuple[str, ...], ...]
        apart: tuple[tuple[str, ...], ...]

    @model_validator(mode="after")
    def _known(self) -> Self:
        """Refuse names that cannot be read and groups or pairs that are no such sets."""
        for name in self.elements:
            if not name.strip() or not name.isprintable():
                raise ValueError(f"an element is named {name!r}; give it a word")
        for word, group in [*product(["together"], self.together), *product(["apart"], self.apart)]:
            unknown = [name for name in group if name not in self.elements]
            if unknown:
                raise ValueError(f"{word} names {', '.join(unknown)[:80]}, which is no element")
        for pair in self.apart:
            if len(pair) != 2 or len(set(pair)) != 2:
                seen = f"apart needs two different elements, not [{', '.join(pair)}]"
                raise ValueError(seen[:200])
        for group in self.together:
            if len(set(group)) != len(group) or len(group) < 2:
                seen = f"together needs two or more different elements, not [{', '.join(group)}]"
                raise ValueError(seen[:200])
            if len(group) > _LARGEST_GROUP:
                seen = f"together holds {len(group)} elements, more than {_LARGEST_GROUP}"
                raise ValueError(seen)
            for pair in (each for each in self.apart if set(each) <= set(group)):
                raise ValueError(f"{' and '.join(pair)} are both together and apart"[:200])
        count = len(self.elements)
        if count > MOST_ELEMENTS:
            raise ValueError(f"there are {count} elements, more than {MOST_ELEMENTS}; split them")
        unlike = {*self.alike().values()}
        sums = [each for each in self.combinations() if len(each) > 1]
        apiece = sum(unlike.issuperset(each) for each in sums)
        if apiece > MOST_UNLIKE_SUMS or len(sums) > MOST_SUMS:
            raise ValueError(
                f"{apiece} sums of unlike elements are to be certified, {len(sums)} of all, more "
                f"than {MOST_UNLIKE_SUMS} or {MOST_SUMS}; name fewer or smaller groups together, "
                "name walls apart from what they do not meet, or split the rest into scenes of "
                "their own"
            )
        return self

    @property
    def walls(self) -> frozenset[str]:
        """Names of the elements that push on one side only."""
        return frozenset(name for name, element in self.elements.items() if element.one_sided)

    def combinations(self) -> tuple[tuple[str, ...], ...]:
        """Every set of elements that can be felt at one moment, smaller sets first.

        Each alone, each part of a group, and each wall beside each set of other elements: a wall is
        geometry and is met wherever a hand happens to be. Walls of one side add where a group names
        both.
        """
        order, walls = {name: place for place, name in enumerate(self.elements)}, self.walls
        found: dict[frozenset[str], None] = {frozenset((name,)): None for name in order}
        for members in groups_of(order, self.together):
            for mask in range(1, 1 << len(members)):
                part = frozenset(name for bit, name in enumerate(members) if mask >> bit & 1)
                found[part] = None
        facing = list(dict.fromkeys(part for each in found if (part := each & walls)))
        others = list(dict.fromkeys(part for each in found if (part := each - walls)))
        found |= dict.fromkeys(other | wall for other in others for wall in facing)
        pairs = [frozenset(pair) for pair in self.apart]
        kept = (each for each in found if not any(pair <= each for pair in pairs))
        return tuple(sorted((tuple(sorted(each, key=order.__getitem__)) for each in kept), key=len))

    def alike(self) -> dict[str, str]:
        """For each element the first that is alike, often itself.

        Alike are those of equal content that are in no group and apart from the same others: what
        is tuned or proved of one is so of each.
        """
        elements, grouped = self.elements, {*chain(*self.together)}
        others = {
            name: {*chain(*(pair for pair in self.apart if name in pair))} - {name}
            for name in elements
        }
        alone = [name for name in elements if name not in grouped]
        found = {name: name for name in elements}
        for name in alone:
            alike = (each for each in alone if elements[each] == elements[name])
            found[name] = next(each for each in alike if others[each] == others[name])
        return found

    def one_of_each(self) -> Self:
        """All of it with the first element of each kind only."""
        first = {*self.alike().values()}
        elements = {name: each for name, each in self.elements.items() if name in first}
        apart = tuple(pair for pair in self.apart if first.issuperset(pair))
        return self.model_copy(update={"elements": elements, "apart": apart})


class Scene(ElementSets):
    """A scene (scene.yaml): elements, which of them act together, hand, margin, filters."""

    schema_: Literal["haptune/scene/1"] = Field(default="haptune/scene/1", alias="schema")
    name: str = "scene"
    hand: AnyHand = "none"
    margin: MarginName = "balanced"
    loop: LoopFreedom = LoopFreedom()
    ripple_limit: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    perception: str = "default"
    elements: dict[str, Element] = Field(min_length=1)
    together: tuple[tuple[str, ...], ...] = ()
    apart: tuple[tuple[str, ...], ...] = ()

    def lead(self, element: str, kind: Literal["linear", "rotary"]) -> float | None:
        """How far before its face the damper of a wall may push, m (rad); None of others."""
        given = self.elements[element]
        return (given.lead or DEFAULT_LEAD[kind]) if given.one_sided else None

    def motion(
        self, element: str, kind: Literal["linear", "rotary"], *, cut: bool = False
    ) -> Motion:
        """The motion of one element, defaults filled in.

        Args:
            element: name.
            kind: of the axis.
            cut: its force may be cut at the limit, so that no penetration is assumed.
        """
        default = DEFAULT_MOTION[kind]
        given = self.elements[element]
        return Motion(
            penetration=given.penetration or (None if cut else default.penetration),
            speed=given.speed or default.speed,
            acceleration=given.acceleration or default.acceleration,
        )


@typed
def load_scene(path: str | PathLike[str]) -> Scene:
    """Read and validate a scene file. Raises InvalidInputError."""
    return load_document(Scene, path)
