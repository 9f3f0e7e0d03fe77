"""Jitter margin of a profile, computed anew: how uneven the steps of the loop may be.

The law comes from its polynomials in z in controllable form, the mechanism from the certificate's
own matrices. In the modes of the even loop, weighed by the Perron vectors of the largest moduli,
the norm of each transition must stay below 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import product

import numpy as np

from tune.certificate.affine import FloatArray
from tune.certificate.point import Setting, setting_of
from tune.certificate.polynomial import law_of
from tune.certificate.precision import precision
from tune.certificate.region import Region, regions_of
from tune.certificate.sampled_loops import held_motion, state_space
from tune.documents.profile import Design

#: Of a sample time, beyond which no jitter is looked at.
_MOST = 0.5
#: Steps looked at between the shortest and the longest, in parts of the jitter.
_STEPS = (-1.0, -0.5, 0.0, 0.5, 1.0)
#: A stated number has four digits and is found to a part in ten thousand.
_AGREE = 1e-3
#: Parts of a sample of delay that count as none.
_WHOLE = 1e-9
#: Sweeps that balance moduli; what stands for none, in parts of the largest.
_SWEEPS, _NONE = 6, 1e-9


def jitter_failures(design: Design, name: str) -> Iterator[str]:
    """A jitter that is not the least over the corners of the box and the moments of an element."""
    said = design.elements[name].margins.jitter
    if said is None:
        yield f"{name}: margins.jitter is missing. Tune again"
        return
    if not 0 <= said <= _MOST:
        yield f"{name}: margins.jitter says {said:.4g}, it lies within 0 to {_MOST:g}"
        return
    region = regions_of(design)[0]
    settings = (setting_of(design, moment) for moment in design.moments() if name in moment)
    loops = [
        (setting, values)
        for setting in settings
        if setting is not None
        for values in _corners(region)
    ]

    def shrinks(jitter: float) -> bool:
        """Whether the norm of every loop shrinks under all steps."""
        return all(_largest_norm(region, *loop, jitter) < 1 for loop in loops)

    if said > 0 and not shrinks(said * (1 - _AGREE)):
        yield f"{name}: margins.jitter says {said:.4g}, computed anew it is less"
    elif said < _MOST and shrinks(max(said, _AGREE) * (1 + _AGREE)):
        yield f"{name}: margins.jitter says {said:.4g}, computed anew it is more"


def _corners(region: Region) -> Iterator[FloatArray]:
    """Corners of the device, rows as in `Region.sides`; modes all least, middle or largest."""
    *rigid, rest = (*region.sides()[:6], region.sides()[6:])
    parts = (0.0, 0.5, 1.0) if any(low != high for low, high in rest) else (0.0,)
    for corner in product(*(sorted({*side}) for side in rigid)):
        for part in parts:
            yield np.array([*corner, *((1 - part) * low + part * high for low, high in rest)])


def _largest_norm(region: Region, setting: Setting, values: FloatArray, jitter: float) -> float:
    transitions = _transitions(region, setting, values, 1 + jitter * np.array(_STEPS))
    poles, modes = np.linalg.eig(transitions[_STEPS.index(0.0)])
    seen = np.linalg.inv(modes) @ transitions @ modes
    if not setting.stiffness and not region.grounded:
        free = int(np.argmin(np.abs(poles - 1)))
        seen = np.delete(np.delete(seen, free, axis=1), free, axis=2)
    moduli = np.max(np.abs(seen), axis=0)
    scale = np.ones(len(moduli))
    others = moduli - np.diag(np.diag(moduli)) + np.finfo(float).tiny
    for _ in range(_SWEEPS):
        scaled = others * np.divide.outer(scale, scale)
        scale *= np.sqrt(np.sqrt(scaled.sum(axis=0) / scaled.sum(axis=1)))
        scale /= scale.max()
    scaled = moduli * np.divide.outer(scale, scale)
    scaled = scaled + _NONE * scaled.max()
    scale *= np.sqrt(_principal(scaled.T) / _principal(scaled))
    norms = np.linalg.norm(seen * np.divide.outer(scale, scale), 2, axis=(1, 2))
    return float(np.max(norms))


def _principal(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eig(matrix)
    return np.abs(vectors[:, int(np.argmax(np.real(values)))])


def _transitions(
    region: Region, setting: Setting, values: FloatArray, lengths: FloatArray
) -> FloatArray:
    """States (mechanism, commands under way, law) after one step of so many sample times each."""
    motion, drive, read = state_space(region, np.repeat(values[:, None], len(lengths), axis=1))
    step = float(values[2])
    late = float(values[3]) / step
    whole = math.floor(late + _WHOLE)
    part = late - whole if late - whole > _WHOLE else 0.0
    update, enter, leave, through = _law(setting, step)
    n, law = len(read), len(enter)
    under_way = whole + (part > 0)
    size = n + under_way + law
    # The newest command, in terms of the states.
    newest = np.zeros(size)
    newest[:n] = through * read
    newest[n + under_way :] = leave
    commands = np.vstack([newest, np.eye(size)[n : n + under_way]])
    moved = np.repeat(np.eye(size)[None, :n], len(lengths), axis=0)
    if part:
        free, pushed = held_motion(motion, drive, part * step * lengths)
        moved = free @ moved + pushed[:, :, None] * commands[whole + 1]
    free, pushed = held_motion(motion, drive, (1 - part) * step * lengths)
    moved = free @ moved + pushed[:, :, None] * commands[whole]
    remembered = np.zeros((law, size))
    remembered[:, n + under_way :] = update
    remembered[:, :n] = np.outer(enter, read)
    below = np.vstack([commands[:under_way], remembered])
    return np.hstack([moved, np.repeat(below[None], len(lengths), axis=0)])


@lru_cache(maxsize=256)
def _law(setting: Setting, step: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """(A, B, C, D) of the force, -(law), in controllable form."""
    with precision():
        law = law_of(setting, step)
        top = [float(c) for c in law.numerator.coeffs()][::-1]
        bottom = np.array([float(c) for c in law.denominator.coeffs()][::-1])
    if law.vanishes:
        top = [a - b for a, b in zip([*top, 0.0], [0.0, *top], strict=True)]
    above = -np.array([0.0] * (len(bottom) - len(top)) + top) / bottom[0]
    below = bottom / bottom[0]
    while len(below) > 1 and below[-1] == 0 and above[-1] == 0:
        below, above = below[:-1], above[:-1]
    order = len(below) - 1
    update = np.eye(order, k=-1)
    if order:
        update[0] = -below[1:]
    return update, np.eye(order, 1)[:, 0], above[1:] - above[0] * below[1:], float(above[0])
