"""What the effects of a scene are worth with certain filters, which cut-offs are chosen by.

What an effect adds beside itself counts against it: the damping that a mass brings because it lags,
the mass that a damper takes away. Each is as many steps as it moves what is felt of that kind, the
device and the element's own effect of that kind together. One step no hand can tell; each further
one takes a step from the effect. So filters are not drawn ever lower for a mass that the encoder
would then allow to be large, but that is felt as honey.

First, as many effects as can be are felt as themselves, with a step left at least; then the sum of
the logarithms of the steps left is as large as can be: ten per cent more are worth the same whoever
gets them. A wanted value counts as much less as it is missed by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from tune.documents.effects import EffectName
from tune.documents.errors import NoFeasibleEffectError
from tune.documents.perception import perceived_steps, references
from tune.loop.filters import Filters
from tune.optimisation.problem import Job
from tune.optimisation.solve import Solved, solve
from tune.rendering.rendered import Shares

#: Worth of an effect that is felt as itself, beside the logarithm of its steps: more than others
#: gain where it is given up, a few of them from one step to some twenty.
FELT = 30.0
#: Steps a hand cannot tell from nothing.
_UNFELT = 1.0


def worth_of_group(job: Job, elements: Sequence[str], filters: Filters) -> float:
    """Of elements that share moments, tuned; minus infinity where the scene has to be refused."""
    try:
        solved = solve(job, elements, filters, second_opinion=False)
    except NoFeasibleEffectError:
        return -math.inf
    return sum(
        worth(net_steps(job, solved, index)) - FELT * _missed(solved, index)
        for index in range(solved.sizes.size)
    )


def worth(steps: float) -> float:
    """`FELT` and ln(steps); below one step a part of it, nothing for what is felt as another."""
    return FELT + math.log(steps) if steps >= 1 else FELT / (2 - steps)


def _missed(solved: Solved, index: int) -> float:
    """The part of the steps of a wanted value that is missing; 0 where there is none."""
    unknown = solved.problem.unknowns[index]
    if unknown.wish.kind != "value":
        return 0.0
    return max(-unknown.height(float(solved.sizes[index])) / unknown.goal, 0.0)


def net_steps(job: Job, solved: Solved, index: int) -> float:
    """Steps of one effect less those, beyond what no hand can tell, that it adds beside itself."""
    unknown, size = solved.problem.unknowns[index], float(solved.sizes[index])
    shares = Shares.of(job.device, solved.problem.filters)
    beside: EffectName
    if unknown.effect == "mass":
        beside, added, share = "damping", shares.damping_of_mass.mean, shares.damping.mean
    elif unknown.effect == "damping":
        beside, added, share = "mass", shares.mass_of_damping.mean, shares.mass.mean
    else:
        return unknown.steps(size)
    there = references(job.device, job.table, penetration=1.0)[beside] + share * sum(
        other.sign * float(own)
        for other, own in zip(solved.problem.unknowns, solved.sizes, strict=True)
        if other.element == unknown.element and other.effect == beside
    )
    weber = job.table.fraction(beside).value
    unasked = perceived_steps(unknown.sign * size * added, there, weber)
    return unknown.steps(size) - max(unasked - _UNFELT, 0.0)
