"""Unknowns of the design problem, made from what a scene asks of its elements."""

from __future__ import annotations

from dataclasses import dataclass

from identification import Box, Device
from tune.documents.effects import EffectName
from tune.documents.perception import PerceptionTable, Scale
from tune.documents.scene import Element, Scene
from tune.loop.filters import Filters
from tune.optimisation.unknown import Unknown
from tune.rendering.rendered import Shares

#: Sizes below this part of the reference are as good as nothing: a ten-thousandth of a step.
NOTHING = 1e-5
#: Steps that an effect keeps at least: no hand tells less from nothing. The rest is for rounding.
LEAST = 1 + 2e-5
#: Sizes above this multiple of the reference are no haptic effect on any device (46 steps at 34 %).
BOUNDLESS = 1e6
#: A device made lighter (less damped) keeps at least this part of what it has.
REMAINS = 1e-3
#: Exponent of the steps of a favoured effect (the asymmetric bargaining solution).
FAVOURED = 4.0
#: Steps of its stiffness that a wall gives up for more damping.
_YIELDS = 0.5
#: An effect of which less than this part is felt, or its opposite, counts as felt this little: no
#: size of it that is sensible then reaches a step worth having, and logarithms stay finite.
BARELY_FELT = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Asking:
    """What all unknowns of a problem share.

    Attributes:
        device: that the effects are added to.
        scene: what is wanted.
        box: of it, simultaneous.
        table: Weber fractions and thresholds.
        favour: an effect whose steps count more; None for none.
        gain: the margin's.
        filters: cut-offs of the estimators.
        felt: effects are kept at one step at least.
    """

    device: Device
    scene: Scene
    box: Box
    table: PerceptionTable
    favour: EffectName | None
    gain: float
    filters: Filters
    felt: bool

    def scale(self, name: str, effect: EffectName) -> Scale:
        """The scale of what is felt of one effect of an element."""
        motion = self.scene.motion(name, self.device.motion)
        return Scale.of(effect, self.device, self.table, motion)

    def unknown(self, name: str, effect: EffectName) -> Unknown:
        """The unknown of one effect of an element."""
        given = self.scene.elements[name]
        wish, felt = given.wishes()[effect], self.scale(name, effect)
        scale = felt.through(_share(self.device, self.filters, effect))
        bare = felt.reference
        high = BOUNDLESS * max(bare, felt.floor) if wish.high is None else abs(wish.high)
        if wish.sign < 0:
            # The bare device must keep the same margin downwards: M >= -m_low/g, B >= -b_low/g.
            lowest = {"mass": self.box.mass[0], "damping": self.box.damping[0]}[effect]
            most = min(lowest / self.gain, (1 - REMAINS) * min(bare, scale.reference))
            high = most if wish.high is None else min(high, most)
        least = abs(scale.value_at(LEAST, wish.sign))
        if not self.felt:
            least = min(NOTHING * bare, high)
        starts = wish.low if wish.kind == "range" and wish.low else 0.0
        return Unknown(
            element=name,
            effect=effect,
            sign=wish.sign,
            low=max(least, starts),
            high=high,
            wish=wish,
            scale=scale,
            level=level_of(given, effect),
            yields=_YIELDS if effect == "stiffness" and _serves(given) else 0.0,
            weight=FAVOURED if effect == self.favour else 1.0,
        )


def level_of(given: Element, effect: EffectName) -> int:
    """Rank of one effect of an element; see `Unknown`."""
    if given.wishes()[effect].kind == "value":
        return 0
    return 2 * given.priority + (effect == "damping" and _serves(given))


def _serves(given: Element) -> bool:
    """Whether it is a wall whose damping is there for its stiffness."""
    return given.one_sided and given.favour != "both"


def _share(device: Device, filters: Filters, effect: EffectName) -> float:
    """The part of a commanded effect that a hand feels as such; all of a spring."""
    if effect == "stiffness":
        return 1.0
    shares = Shares.of(device, filters)
    return max((shares.damping if effect == "damping" else shares.mass).mean, BARELY_FELT)
