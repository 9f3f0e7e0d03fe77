"""Fade times of the elements: so slow that no hand pumps by entering and leaving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from identification import InvalidInputError
from tune.documents.effects import LONGEST_FADE, SHORTEST_FADE
from tune.documents.errors import NoFeasibleEffectError
from tune.documents.profile import Design, ElementProfile
from tune.documents.scene import Scene
from tune.loop.filters import Filters
from tune.loop.state_space import Corner, corners_of
from tune.margins.time_varying import Values, shortest_fade

#: A fade is so many times slower than the shortest at which no wave of the level was found to pump:
#: of random ones, and of levels that chase a swing, the slowest that pump are 1.2 times as slow.
_SLOWER = 2.0
#: Fades are told in steps of this, s.
_DIGIT = 0.01


def with_fades(design: Design, scene: Scene) -> Design:
    """The design with the fade time of every element that fades.

    It is looked for with the margin of gain used up, and with that of delay. Where several of a
    moment fade, each at any time, all of them together move a swing as their sum does, and each
    takes so many times longer.

    Args:
        design: with the sizes that are played.
        scene: whose elements may ask for a longer time.

    Raises:
        InvalidInputError: the scene asks for a shorter time.
        NoFeasibleEffectError: no fade is slow enough.
    """
    needed = {name: SHORTEST_FADE for name, element in design.elements.items() if element.fades}
    # While a wall pushes no level moves.
    for moment in (each for each in design.moments() if design.walls.isdisjoint(each)):
        fading = [name for name in moment if name in needed]
        for name in fading:
            time = len(fading) * _slowest(design, moment, fading, name)
            needed[name] = max(needed[name], time)
    elements = dict(design.elements)
    for name, time in needed.items():
        least = (
            round(float(np.ceil(time / _DIGIT - 1e-9)) * _DIGIT, 2) if np.isfinite(time) else time
        )
        elements[name] = elements[name].model_copy(
            update={"fade_time": _stated(name, least, scene.elements[name].fade_time)}
        )
    return design.model_copy(update={"elements": elements})


def _stated(name: str, least: float, wanted: float | None) -> float:
    """The fade time of an element that must fade over a least time, s."""
    if least > LONGEST_FADE:
        raise NoFeasibleEffectError(
            (
                f"{name}: a hand that enters and leaves it in time could pump the device however "
                "slowly it fades. Give its spring an element of its own, felt together with it, or "
                "ask for damping in the same element, or for less mass",
            )
        )
    if wanted is not None and wanted < least:
        raise InvalidInputError(
            f"elements.{name}.fade_time",
            f"{wanted:g} s is too fast: a hand that enters and leaves it in time could pump the "
            f"device; it must fade over {least:g} s",
            f"Ask for {least:g} s or more, or leave fade_time out",
        )
    return least if wanted is None else wanted


def _slowest(design: Design, moment: Sequence[str], fading: Sequence[str], name: str) -> float:
    """s, for one element of a moment: with the others that fade beside it, or along with it."""
    elements = design.elements
    others = [elements[each] for each in moment if each not in fading]
    along = [elements[each] for each in fading if each != name]
    own = elements[name]
    undamped = [each.model_copy(update={"damping": min(each.damping, 0.0)}) for each in others]
    cases = [(others, [own, *along]), (undamped, [own, *along])]
    if along:
        cases += [([*others, *along], [own]), ([*undamped, *along], [own])]
    # Dampers beside it are switched at any moment.
    pairs = dict.fromkeys((_sum(beside), _sum(moved)) for beside, moved in cases)
    margin, filters = design.margin, _filters(design)
    # With both used up nothing is left by which any swing would die out.
    used = ((margin.gain, 0.0), (1.0, margin.extra_delay_samples))
    return max(
        _SLOWER * _found(_places(design, extra), filters, _times(gain, beside), _times(gain, moved))
        for beside, moved in pairs
        for gain, extra in used
    )


def _times(gain: float, values: Values) -> Values:
    return (gain * values[0], gain * values[1], gain * values[2])


@lru_cache(maxsize=1024)
def _found(places: tuple[Corner, ...], filters: Filters, beside: Values, fading: Values) -> float:
    """Fade time of an element beside a moment, kept because it is asked for more than once.

    A spring that fades in from nothing swings so slowly at low levels that only what the device
    loses bounds it there: where that is too little, it is taken to go all the way in and out.
    """
    found = shortest_fade(places, filters, beside, fading)
    if np.isfinite(found) or not fading[0]:
        return found
    return shortest_fade(places, filters, beside, fading, whole=True)


def _places(design: Design, extra: float) -> tuple[Corner, ...]:
    """Corners of the box where least is lost: least damping, longest delay and extra samples."""
    box = design.device.simultaneous_box()
    corners = corners_of(design.device, box)
    loss, late = min(c.damping for c in corners), max(c.delay for c in corners)
    return tuple(
        replace(corner, delay=late + extra * corner.sample_time)
        for corner in corners
        if corner.damping == loss and corner.delay == late
    )


def _filters(design: Design) -> Filters:
    return Filters(**design.loop.filter_settings())


def _sum(elements: Sequence[ElementProfile]) -> Values:
    """K, B and M of some elements together."""
    return (
        sum((each.stiffness for each in elements), 0.0),
        sum((each.damping for each in elements), 0.0),
        sum((each.mass for each in elements), 0.0),
    )
