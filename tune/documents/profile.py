"""SafeProfile: what was chosen, why, and the certificate it passed, as YAML with a digest."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any, Literal

from pydantic import Field, model_validator

from identification import (
    Device,
    Document,
    Tabular,
    load_mapping,
    parse_document,
    to_mapping,
    to_yaml,
    typed,
)
from tune.documents import CheckFailedError
from tune.documents.estimators import (
    DERIVATIVES,
    FilterKind,
    filter_of,
    idle_settings,
    strange_order,
)
from tune.documents.scene import (
    EFFECT_NAMES,
    LARGEST,
    LONGEST_FADE,
    LONGEST_WINDOW,
    MARGINS,
    SMALLEST,
    EffectName,
    ElementSets,
    Hand,
    Margin,
    MarginName,
    Motion,
)

#: Taps of a multiplier; tuning tries no more than twenty, and a proof takes time for each.
_MOST_TAPS = 32


class ModePlace(Document):
    """One vibration mode at one point: Hz, damping ratio."""

    frequency_hz: float
    damping_ratio: float


class HandPlace(Document):
    """One grip at one point: kg, N·s/m, N/m."""

    mass: float
    damping: float
    stiffness: float


class WorstPoint(Document):
    """The point at which the slowest pole was found, at the full gain of the margin.

    Attributes:
        elements: felt together.
        mass: kg.
        damping: N·s/m.
        sample_time: s.
        delay_samples: the whole delay, with the extra; need not be whole.
        modes: in the order of the device's.
        current_lag: s; None for none.
        position_stiffness: slope of the device's own force by position, N/m; None for none.
        hand: None for the device alone.
        gain: of all effects.
        pole_radius: largest modulus of a pole.
    """

    elements: tuple[str, ...]
    mass: float
    damping: float
    sample_time: float
    delay_samples: float
    modes: tuple[ModePlace, ...] = ()
    current_lag: float | None = None
    position_stiffness: float | None = None
    hand: HandPlace | None = None
    gain: float
    pole_radius: float


class ModeBox(Document):
    """Intervals of one vibration mode: Hz, damping ratio."""

    frequency_hz: tuple[float, float]
    damping_ratio: tuple[float, float]


class HandBox(Document):
    """Intervals of the grip: kg, N·s/m, N/m."""

    mass: tuple[float, float]
    damping: tuple[float, float]
    stiffness: tuple[float, float]


class Tap(Document):
    """weight·(1 - z^-samples) in a multiplier."""

    samples: int = Field(ge=1)
    weight: float = Field(gt=0)


class Channel(Document):
    """The multiplier of one nonlinearity: M(z) = constant + Σ weight·(1 - z^-samples).

    Attributes:
        name: of the element whose clamp it is, or ``damping`` for what is damping only and is
            switched at any moment, all of it together.
        constant: of a clamp zero where nothing holds the position of the device, above zero where
            it is held; of damping all there is.
        taps: in rising order of samples.
    """

    name: str
    constant: float = Field(default=0.0, ge=0)
    taps: tuple[Tap, ...] = Field(default=(), max_length=_MOST_TAPS)


class Multiplier(Document):
    """Causal multipliers of Zames and Falb, one for each nonlinearity of a sum of elements.

    Attributes:
        channels: of the elements with springs, in their order, then of ``damping``, if any.
    """

    channels: tuple[Channel, ...]


class AbsoluteStability(Document):
    """What one combination is proved for beside its linear loop: clamped, switched, faded.

    Attributes:
        gain: every gain in (0, gain].
        extra_delay_samples: on top of the device's delay, any part of it.
        free: the multiplier for devices whose position nothing holds; None where there are none.
        held: the multiplier for devices held by a spring of their own, of friction or of a hand.
        covers: in words.
    """

    gain: float
    extra_delay_samples: float
    free: Multiplier | None = None
    held: Multiplier | None = None
    covers: tuple[str, ...]

    @property
    def longest_tap(self) -> int:
        """Samples of the longest tap of both multipliers, 1 at least."""
        stated = (each for each in (self.free, self.held) if each is not None)
        taps = (tap.samples for each in stated for channel in each.channels for tap in channel.taps)
        return max(taps, default=1)


class Certificate(Document):
    """What was re-checked, how, over which region, and what it takes for granted.

    Attributes:
        method: in words.
        confidence: of the box of mass and damping.
        mass: kg, and so on: the region, every combination of which is proved stable.
        delay: of the device, s.
        delay_samples: the same in samples, over the interval of the sample time.
        modes: in the order of the device's.
        current_lag: time constant of the actuator, s; None for none.
        position_stiffness: slope of the device's own force by position, N/m; None for none.
        presliding_stiffness: that slope where friction holds the device, before it slides, N/m;
            proved beside the device that slides. None for none.
        hand: None for the device alone; with a hand the device alone is proved beside it.
        gain: every gain in (0, gain].
        extra_delay_samples: on top of the device's delay, any part of it.
        points: judged one by one in many digits.
        cells: excluded one by one, of which the proof is made.
        interior: by combination; nothing but "proved" is ever written. Of elements that are alike,
            equal in all they say and apart from the same others, the first stands for all.
        absolute_stability: by combination, for those whose clamp may be reached; None for none.
        worst: found by search over all combinations.
        assumes: what the proof takes for granted.
        not_assessed: what it leaves out.
        versions: of what computed it.
    """

    method: str
    confidence: float
    mass: tuple[float, float]
    damping: tuple[float, float]
    sample_time: tuple[float, float]
    delay: tuple[float, float]
    delay_samples: tuple[float, float]
    modes: tuple[ModeBox, ...] = ()
    current_lag: tuple[float, float] | None = None
    position_stiffness: tuple[float, float] | None = None
    presliding_stiffness: tuple[float, float] | None = None
    hand: HandBox | None = None
    gain: float
    extra_delay_samples: float
    points: int
    cells: int
    interior: dict[str, Literal["proved"]]
    absolute_stability: dict[str, AbsoluteStability] | None = None
    worst: WorstPoint
    assumes: tuple[str, ...]
    not_assessed: tuple[str, ...]
    versions: dict[str, str]

    @property
    def longest_tap(self) -> int:
        """Samples of the longest tap of any multiplier, 1 at least.

        So long a clamp has to be without force before its gain may rise.
        """
        proofs = (self.absolute_stability or {}).values()
        return max((each.longest_tap for each in proofs), default=1)


class LoopProfile(Document):
    """The loop the controller must run: period, delay beyond an immediate loop, the very filters.

    Filters are those of docs/theory.md, 1, evaluated at the sample rate; without a cut-off or a
    window an estimate is a plain backward difference.

    Attributes:
        sample_time: s.
        extra_delay_samples: the device's delay in samples, need not be whole.
        velocity_filter: its kind; profiles written before there were two have low-passes.
        acceleration_filter: its kind.
        velocity_filter_hz: cut-off, the frequency of its poles, Hz.
        acceleration_filter_hz: likewise.
        velocity_filter_order: 1 or 2 poles of a low-pass, 2 or 3 states of a tracking filter.
        acceleration_filter_order: 1 or 2 poles, 3 or 4 states.
        filter_damping_ratio: of pairs of poles.
        velocity_window_samples: velocity over the last n samples instead of a filter.
    """

    sample_time: float
    extra_delay_samples: float
    velocity_filter: FilterKind = "low-pass"
    acceleration_filter: FilterKind = "low-pass"
    velocity_filter_hz: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    acceleration_filter_hz: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    velocity_filter_order: int = 1
    acceleration_filter_order: int = 2
    filter_damping_ratio: float = Field(default=1.0, ge=0.1, le=1)
    velocity_window_samples: int | None = Field(default=None, ge=1, le=LONGEST_WINDOW)

    @model_validator(mode="after")
    def _one_velocity(self) -> LoopProfile:
        if self.velocity_window_samples is not None and self.velocity_filter_hz is not None:
            raise ValueError("velocity_window_samples takes the place of velocity_filter_hz")
        for which in DERIVATIVES:
            kind, _, order = filter_of(self, which)
            if wrong := strange_order(which, kind, order):
                raise ValueError(wrong)
        return self

    def with_effects(self, *, damping: bool, mass: bool) -> LoopProfile:
        """The loop with the filters that these effects use, what they do not use at its default."""
        return self.model_copy(update=idle_settings(self, damping=damping, mass=mass))

    def filter_settings(self) -> dict[str, Any]:
        """What says which filters run, by the names that all of haptune calls them."""
        others = {"sample_time", "extra_delay_samples"}
        return {name: item for name, item in self if name not in others}


LimitedBy = Literal[
    "stability",
    "gain-margin",
    "delay-margin",
    "saturation",
    "lead",
    "force",
    "rendering",
    "ripple",
    "wanted",
    "range",
    "not-perceptible",
]

_SCHEMA = "haptune/profile/1"
#: One clamp round spring, damper and mass of an element together: F = -clamp(K·y + B·v + M·a).
LAW = "clamped-impedance"
#: Extra samples up to which a delay margin is looked for; ten spare samples are plenty, and a claim
#: costs its proof.
MOST_EXTRA_DELAY = 10


class Margins(Document):
    """Margins of one element over the whole box and every combination it is part of.

    Attributes:
        gain: stable for every gain in (0, gain].
        extra_delay_samples: further delay, in tenths of a sample, up to which every gain in (0, 1]
            is stable.
        passive: passivity by its own condition; "not-applicable" with a mode, a current lag or a
            part of a sample of delay.
        jitter: part of the sample time by which each step may be longer or shorter with the loop
            stable at its own gain, at the corners of the box; assessed, not proved. None in
            profiles written before it was computed, which `check` refuses.
        absolute_gain: the gain up to which all one-sided combinations with this element are proved
            absolutely stable, with the extra delay of the margin; None where none is.
    """

    gain: float
    extra_delay_samples: float
    passive: bool | Literal["not-applicable"]
    jitter: float | None = None
    absolute_gain: float | None = None


class Rendered(Document):
    """What a hand feels of one element at 0.5 to 5 Hz, beside the device's own mass and damping.

    Means over the logarithm of frequency, of all that the element plays: filters and delay turn
    part of a mass into damping, and let a damper take mass away and a spring damping.

    Attributes:
        mass: apparent mass, kg (kg·m²).
        damping: apparent damping, N·s/m (N·m·s/rad).
        mass_at_ends: at 0.5 and at 5 Hz.
        damping_at_ends: likewise.
        mass_in_motion: least and largest from 0.5 to 5 Hz.
        damping_in_motion: likewise.
        mass_beyond: least and largest from 5 to 20 Hz.
        damping_beyond: likewise.
    """

    mass: float
    damping: float
    mass_at_ends: tuple[float, float]
    damping_at_ends: tuple[float, float]
    mass_in_motion: tuple[float, float]
    damping_in_motion: tuple[float, float]
    mass_beyond: tuple[float, float]
    damping_beyond: tuple[float, float]


class Contact(Document):
    """What a free device meets that enters an element at the speed of its motion, without a hand.

    Attributes:
        restitution: (least, largest) speed out over speed in, over the device's box and wherever
            between two samples the element is reached; friction left out, forces below their
            limit. Of a one-sided element as it only pushes, of another as it swings once. None
            without a spring, of an element that fades, and where the device stays too long inside.
        depth_at_continuous_force: where its spring takes all of the continuous force, m (rad), or
            all that its clamp lets pass, if that is less.
        depth_at_peak_force: where its spring takes all that its clamp lets pass, m (rad).
        force_on_entry: commanded within the first sample, at most, N (N·m); an element that fades
            takes its fade time to it.
        net_damping: what its damper adds in it beyond what the lag of its spring takes,
            B - K·τ with the longest delay of the box and the margin's extra samples, N·s/m
            (N·m·s/rad). None without a spring.
        lead: speed·(B/K - τ) at the stated delay, m (rad): how far before its place an element is
            met; below zero it is met so far behind. None without a spring.
        energy_per_entry: that a mass entered in motion and left at rest, or the other way round,
            gives a hand, J. None without a mass.
    """

    restitution: tuple[float, float] | None = None
    depth_at_continuous_force: float | None = None
    depth_at_peak_force: float | None = None
    force_on_entry: float
    energy_per_entry: float | None = None
    net_damping: float | None = None
    lead: float | None = None


class ElementProfile(Document):
    """What one element plays; effects that do not act are zero.

    ``perceived_steps`` count what is felt of an effect at the motions people make; ``rendered`` and
    ``contact`` are absent in profiles written before they were computed, which `check` refuses. A
    ``one_sided`` element pushes only; its force fades in and out over ``fade_time``, s, where 0
    lets it be switched at any moment. What is felt lies within one step of what is played.
    """

    stiffness: float
    damping: float
    mass: float
    perceived_steps: dict[EffectName, float]
    margins: Margins
    ripple: float | None = None
    limited_by: dict[EffectName, LimitedBy]
    motion: Motion
    rendered: Rendered | None = None
    contact: Contact | None = None
    one_sided: bool = False
    force_level: float = Field(default=0.0, ge=0)
    lead: float | None = Field(default=None, ge=SMALLEST, le=LARGEST)
    fade_time: float = Field(default=0.0, ge=0, le=LONGEST_FADE)

    @property
    def cut(self) -> bool:
        """Whether its force is cut at the limit: it has a spring into which no depth is stated."""
        return bool(self.stiffness) and self.motion.penetration is None

    @property
    def fades(self) -> bool:
        """Whether it may not be switched: with mass or a negative effect it could pump."""
        return bool(self.mass) or min(self.stiffness, self.damping) < 0

    @property
    def acting(self) -> set[EffectName]:
        """The effects that are not zero."""
        return {effect for effect in EFFECT_NAMES if getattr(self, effect)}

    def sizes(self) -> str:
        """The effects that act, in SI units, as one phrase."""
        names = (name for name in EFFECT_NAMES if name in self.acting)
        return ", ".join(f"{name} {getattr(self, name):.6g}" for name in names) or "nothing"


class PerceptionProfile(Document):
    """How finely hands were taken to tell effects apart: what perceived steps are counted in.

    Attributes:
        name: of the perception table.
        stiffness: Weber fraction.
        damping: Weber fraction.
        mass: Weber fraction.
        threshold: smallest force noticed, N (N·m).
    """

    name: str
    stiffness: float = Field(gt=0)
    damping: float = Field(gt=0)
    mass: float = Field(gt=0)
    threshold: float = Field(gt=0)


class MarginProfile(Margin):
    """The margin that was kept, by name and number."""

    name: MarginName

    @classmethod
    def of(cls, name: MarginName) -> MarginProfile:
        """The margin that a name stands for."""
        return cls(name=name, **dict(MARGINS[name]))


class Design(ElementSets):
    """A profile before it is certified."""

    schema_: Literal["haptune/profile/1"] = Field(default=_SCHEMA, alias="schema")
    law: Literal["clamped-impedance"] = LAW
    device: Device
    scene: str
    loop: LoopProfile
    hand: Hand | None = None
    margin: MarginProfile
    elements: dict[str, ElementProfile]
    together: tuple[tuple[str, ...], ...] = ()
    apart: tuple[tuple[str, ...], ...] = ()
    ripple_limit: float = Field(ge=SMALLEST, le=LARGEST)
    perception: PerceptionProfile | None = None
    skipped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    method: dict[str, str] = Field(default_factory=dict[str, str], validate_default=True)


class SafeProfile(Design, Tabular):
    """A certified profile (profile.yaml). Only `tune.optimise` makes one.

    What is changed after that is neither written nor exported.
    """

    certificate: Certificate
    digest: str = ""

    def __repr__(self) -> str:
        played = "; ".join(f"{name}: {each.sizes()}" for name, each in self.elements.items())
        return (
            f"SafeProfile({self.scene} on {self.device.name}, margin {self.margin.name}, "
            f"{len(self.certificate.interior)} combination(s) proved; {played})"
        )

    def _rows(self) -> list[dict[str, object]]:
        return [
            {
                "element": name,
                "effect": effect,
                "value": getattr(element, effect),
                "steps": element.perceived_steps.get(effect, 0.0),
                "gain": element.margins.gain,
                "extra_delay_samples": element.margins.extra_delay_samples,
                "ripple": element.ripple,
                "limited_by": reason,
            }
            for name, element in self.elements.items()
            for effect, reason in element.limited_by.items()
        ]

    def to_yaml(self) -> str:
        """The file's text. Raises CheckFailedError where it was changed after it was certified."""
        content = signed_content(to_mapping(self), f"the profile of {self.scene}")
        return to_yaml(content, "Safe profile written by haptune; 'haptune check' re-computes it.")

    def signed(self) -> SafeProfile:
        """This profile with its digest filled in: `tune.optimise` does it, what writes does not."""
        return self.model_copy(update={"digest": digest_of(to_mapping(self))})


def digest_of(content: Mapping[str, Any]) -> str:
    """sha256 over the canonical JSON of everything but the digest itself."""
    body = {key: value for key, value in content.items() if key != "digest"}
    text = json.dumps(body, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return "sha256:" + hashlib.sha256(text.encode()).hexdigest()


@typed
def load_profile(path: str | PathLike[str]) -> SafeProfile:
    """Read a profile and compare its digest before believing anything else in it.

    Raises:
        InvalidInputError: no YAML mapping, or no profile.
        CheckFailedError: the digest does not belong to the content.
    """
    return profile_of(read_signed(path), path)


def read_signed(path: str | PathLike[str]) -> dict[str, Any]:
    """The content of a file whose digest belongs to it; raises as `load_profile`."""
    content = load_mapping(path)
    if "certificate" in content or str(content.get("schema", "")).startswith("haptune/profile/"):
        return signed_content(content, path)
    return content


def signed_content(content: dict[str, Any], source: str | PathLike[str]) -> dict[str, Any]:
    """What was given; raises CheckFailedError where its digest does not belong to it."""
    expected, stated = digest_of(content), content.get("digest")
    if stated != expected:
        seen = "has no digest" if not stated else f"states the digest {stated}"
        raise CheckFailedError(
            (
                f"{fspath(source)}: {seen}, the content has {expected}; it was changed after it "
                "was certified. Tune again instead of editing a profile",
            )
        )
    return content


def profile_of(content: Mapping[str, Any], source: str | PathLike[str]) -> SafeProfile:
    """The profile a mapping states; another law than `LAW` was certified for something else."""
    law = content.get("law")
    if law != LAW and str(content.get("schema", "")).startswith("haptune/profile/"):
        raise CheckFailedError(
            (
                f"{fspath(source)}: made for "
                + (f"the law {str(law)[:40]!r}" if law else "an earlier law of walls")
                + f", this haptune proves and plays the law {LAW!r}. Tune again",
            )
        )
    return parse_document(SafeProfile, content, source)
