"""What-if: the perceived steps that each fact of the hardware costs, by tuning with it changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import cast

from identification import (
    Device,
    InvalidInputError,
    Quantity,
    as_stored,
    parse_document,
    quantity,
    to_mapping,
)
from tune.documents.errors import CheckFailedError, NoFeasibleEffectError
from tune.documents.perception import PerceptionTable
from tune.documents.profile import SafeProfile
from tune.documents.scene import Scene
from tune.optimisation._optimise import optimise

Progress = Callable[[str], None]
Content = dict[str, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """A scene tuned on the device with one fact of its hardware changed.

    Attributes:
        change: in words; "as it is" for the device unchanged.
        steps: perceived steps by "element.effect", of the effects that act.
        total: their sum; 0 where nothing could be tuned.
        reason: why there is no profile; None where there is one.
    """

    change: str
    steps: dict[str, float]
    total: float
    reason: str | None = None


def what_if(
    device: Device,
    scene: Scene,
    *,
    table: PerceptionTable | None = None,
    profile: SafeProfile | None = None,
    progress: Progress | None = None,
) -> tuple[Alternative, ...]:
    """Tune a scene on a device and on the same device with one fact changed at a time.

    Half the delay, twice the sample rate (the delay in seconds stays), an encoder twice as fine,
    an actuator twice as strong, half and twice the damping, and each vibration mode damped twice as
    well. What the device does not state is left out. Steps count from the device at hand: with
    twice the damping a virtual damper starts from twice as much.

    Args:
        device: as it is.
        scene: what is wanted.
        table: Weber fractions; None is the paper's study.
        profile: of the device as it is, where it was tuned already.
        progress: called with a sentence before each part of the work.

    Returns:
        The device as it is, then the changes, the most perceived steps first.

    Raises:
        UnstatedError, NoFeasibleEffectError, CheckFailedError: of the device as it is.
    """
    say = progress or _silent
    known = profile or optimise(device, scene, table=table, progress=say)
    found: list[Alternative] = []
    changes = tuple(_changed(device))
    for number, (change, content) in enumerate(changes, 1):
        say(f"tuning for {change} ({number} of {len(changes)})")
        try:
            other = as_stored(parse_document(Device, content, f"the device with {change}"))
            found.append(_of(change, optimise(other, scene, table=table)))
        except (NoFeasibleEffectError, CheckFailedError, InvalidInputError) as error:
            found.append(Alternative(change=change, steps={}, total=0.0, reason=str(error)))
    found.sort(key=lambda each: -each.total)
    return (_of("as it is", known), *found)


def _of(change: str, profile: SafeProfile) -> Alternative:
    steps = {
        f"{name}.{effect}": count
        for name, element in profile.elements.items()
        for effect, count in element.perceived_steps.items()
    }
    return Alternative(change=change, steps=steps, total=sum(steps.values()))


def _changed(device: Device) -> Iterator[tuple[str, Content]]:
    """Each change in words with the content of the changed device's file."""
    content = to_mapping(device)

    def scaled(key: str, factor: float) -> Content:
        return content | {key: _scaled(content[key], factor)}

    if device.delay.high > 0:
        yield "half the delay", scaled("delay", 0.5)
    yield "twice the sample rate", scaled("sample_time", 0.5)
    if device.encoder_resolution is not None:
        yield "an encoder twice as fine", scaled("encoder_resolution", 0.5)
    if device.force_limit is not None:
        yield "twice the force", scaled("force_limit", 2.0)
    for words, factor in (("half the damping", 0.5), ("twice the damping", 2.0)):
        keys = [
            key for key in ("damping", "damping_slope", "damping_by_direction") if key in content
        ]
        yield words, content | {key: _scaled(content[key], factor) for key in keys}
    for place, mode in enumerate(device.modes):
        ratio = _times(mode.damping_ratio, 2.0)
        better = list(device.modes)
        better[place] = mode.model_copy(update={"damping_ratio": ratio})
        yield (
            f"the mode at {mode.frequency_hz.value:.4g} Hz damped twice as well",
            to_mapping(device.model_copy(update={"modes": tuple(better)})),
        )


def _times(number: Quantity, factor: float) -> Quantity:
    return quantity(number.value * factor, number.low * factor, number.high * factor)


def _silent(sentence: str) -> None:
    del sentence


def _scaled(item: object, factor: float) -> object:
    """A number of a file, or every number in a mapping, times a factor."""
    if isinstance(item, dict):
        parts = cast("dict[str, object]", item)
        return {key: _scaled(part, factor) for key, part in parts.items()}
    return item * factor if isinstance(item, int | float) else item
