"""With cut-offs that are chosen: what a profile claims is felt, by an account of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest

from tests.optimum_pairs import random_pair
from tests.optimum_wishes import EFFECTS, MARGINS, felt_ends, felt_of, wanted_of
from tests.unlimited import stated
from tune import NoFeasibleEffectError, optimise
from tune.documents.scene import LoopFreedom

#: Of a step: digits of a written size.
ROUNDING = 1e-3
#: ... and of what a profile says is felt, four digits and the size's own.
DIGITS = 2e-3


@pytest.mark.parametrize(
    "seed", [5, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(300) if seed != 5)]
)
def test_mass_and_damping_are_felt_within_a_step_at_both_ends(seed: int) -> None:
    pair = random_pair(seed)
    scene = pair.scene.model_copy(update={"loop": LoopFreedom()})
    device = stated(pair.device)
    try:
        profile = optimise(device, scene)
    except NoFeasibleEffectError:
        return
    filters = profile.loop
    cut_offs = filters.velocity_filter_hz, filters.acceleration_filter_hz
    for name, one in profile.elements.items():
        values = one.stiffness, one.damping, one.mass
        wanted = [
            each
            for each in wanted_of(
                device, name, scene.elements[name], MARGINS[scene.margin][0], cut_offs
            )
            if values[each.effect]
        ]
        sizes = np.array([abs(values[each.effect]) for each in wanted])
        for end in felt_ends(device, wanted, cut_offs, scene.elements):
            assert end.row(sizes) @ sizes <= 1 + ROUNDING, name
        assert one.rendered is not None
        felt = np.einsum("e,ef->f", values, felt_of(device, cut_offs, np.array([0.5, 5.0])))
        ends = np.array(one.rendered.damping_at_ends)
        reach = DIGITS * (device.damping.value + np.abs(values[1]))
        assert np.all(np.abs(felt.real - ends) <= reach + DIGITS * np.abs(ends)), EFFECTS[1]
