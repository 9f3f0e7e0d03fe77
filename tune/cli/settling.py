"""The largest effects that settle in simulation, and what is said of those that are less for it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import identification as ident
from tune.cli.preparation import RestlessError, refuse_restless
from tune.documents import NoFeasibleEffectError

if TYPE_CHECKING:
    from identification import Device
    from tune.cli.session import Session
    from tune.documents.perception import PerceptionTable
    from tune.documents.profile import SafeProfile
    from tune.documents.scene import EffectName, Scene

#: Parts of an effect that are asked for where it does not settle in simulation, one after another.
_LESS = 0.7, 0.3


def optimise_to_rest(
    session: Session, device: Device, wanted: Scene, table: PerceptionTable
) -> SafeProfile:
    """The largest effects that settle in simulation: less is asked for of what does not, and said.

    Where nothing is left of an effect, what else was less for its sake is asked for whole again.
    Raises as `optimise`, and RestlessError where less of it does not settle either.
    """
    from tune.optimisation import optimise

    asked = scene = wanted
    parts, vetoed = iter(_LESS), set[tuple[str, ...]]()
    while True:
        with session.progress() as say:
            try:
                profile = optimise(device, scene, table=table, progress=say)
            except NoFeasibleEffectError as error:
                reasons = _of_lost(error.reasons, _cuts(wanted, scene), vetoed)
                raise NoFeasibleEffectError(tuple(reasons)) from error
            whole = _with_lost(asked, scene, profile)
            if whole != asked:
                asked, scene, parts = whole, whole, iter(_LESS)
                continue
            try:
                refuse_restless(profile, say)
                return _naming_rehearsal(profile, wanted, scene, vetoed) if vetoed else profile
            except RestlessError as error:
                less = _with_less(scene, profile, error.elements, next(parts, 0.0))
                if less is None:
                    raise
                scene, restless = less, error
        vetoed |= restless.combinations
        for sentence in restless.failures:
            session.warn(f"{sentence.removesuffix('.')}; tuned again with less of it")


def _cuts(asked: Scene, less: Scene) -> list[tuple[str, EffectName]]:
    """Elements and effects of which a scene asks for less."""
    pairs = {
        name: (one.wishes(), less.elements[name].wishes()) for name, one in asked.elements.items()
    }
    return [(name, e) for name, (one, other) in pairs.items() for e in one if one[e] != other[e]]


def _with_lost(asked: Scene, less: Scene, profile: SafeProfile) -> Scene:
    """What was asked for, with less only of effects of which nothing is left so."""
    elements = dict(asked.elements)
    for name, effect in _cuts(asked, less):
        if not getattr(profile.elements[name], effect):
            wish = less.elements[name].wishes()[effect]
            elements[name] = elements[name].model_copy(update={effect: wish})
    return asked.model_copy(update={"elements": elements})


def _naming_rehearsal(
    profile: SafeProfile, asked: Scene, less: Scene, vetoed: Collection[tuple[str, ...]]
) -> SafeProfile:
    """A profile that says where it ends because more did not settle: stability, and a note."""
    from tune.certificate.certify import note_of_apart
    from tune.certificate.check import note_of_rehearsal
    from tune.documents.scene import groups_of

    elements, cuts = {**profile.elements}, _cuts(asked, less)
    notes = _of_lost(profile.notes, cuts, vetoed)
    for name, effect in cuts:
        label, words = f"{name}.{effect}", elements[name].limited_by
        if words.get(effect) == "range":
            words = {**words, effect: "stability"}
            elements[name] = elements[name].model_copy(update={"limited_by": words})
            notes.append(note_of_rehearsal(label))
    for pair in set(profile.apart).difference(groups_of(asked.elements, asked.apart)):
        said = note_of_apart(pair)
        notes += [said] * (said not in notes and all(elements[name].acting for name in pair))
    told = profile.model_copy(update={"elements": elements, "notes": tuple(notes)})
    return ident.as_stored(told).signed()


def _of_lost(
    texts: Sequence[str], cuts: Sequence[tuple[str, str]], vetoed: Collection[tuple[str, ...]]
) -> list[str]:
    """Notes and reasons; of an effect of which less, that settles, is not felt: what took it."""
    from tune.certificate.certify import note_of_dropped, note_of_unmet

    told, end = list(texts), ", limited by range"
    for name, effect in cuts:
        own = sorted({each for each in vetoed if name in each} or vetoed, key=len)
        own = [each for n, each in enumerate(own) if not any({*few} < {*each} for few in own[:n])]
        mates = " and ".join(dict.fromkeys(each for names in own for each in names if each != name))
        remedy = "Leave it out" + ", or ask for more damping beside it" * (effect != "damping")
        if mates:
            remedy = f"Keep it apart (apart:, not together:) from {mates}, or leave it out"
        why = f"with more of it {', '.join(map(' + '.join, own))} did not settle in simulation; "
        label = f"{name}.{effect}"
        for begun in (note_of_dropped(label), note_of_unmet(label)):
            for place, text in enumerate(told):
                if text.startswith(begun) and end in text:
                    less = text.removeprefix(begun).partition(end)[0]
                    told[place] = f"{begun}{why}{less}. {remedy}"
    return told


def _with_less(
    scene: Scene, profile: SafeProfile, names: Collection[str], part: float
) -> Scene | None:
    """The scene with less of the open effects of these and of what is alike; None for no less."""
    from tune.certificate.certify import note_of_apart
    from tune.documents.scene import Wish

    elements, kinds = dict(scene.elements), scene.alike()
    for name in (each for each, first in kinds.items() if not {each, first}.isdisjoint(names)):
        wishes = elements[name].wishes()
        most = {
            effect: Wish(kind="min" if size < 0 else "range", low=wished.low, high=size)
            for effect, wished in wishes.items()
            if wished.kind != "value"
            and abs(size := part * getattr(profile.elements[name], effect)) > (wished.low or 0.0)
        }
        elements[name] = elements[name].model_copy(update=most)
    if elements == scene.elements:
        return None
    # What was told apart stays so: less of one is not to be met by less of the other.
    apart = [
        *scene.apart,
        *(each for each in profile.apart if note_of_apart(each) in profile.notes),
    ]
    return scene.model_copy(update={"elements": elements, "apart": tuple(apart)})
