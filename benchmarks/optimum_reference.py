"""What bounds the effects of elements that share combinations, and how many steps they are.

Written down anew from the documented meaning of device and scene; boundaries are those of
`benchmarks.optimum_loops`, ripple that of `benchmarks.optimum_ripple`, sizes and steps those of
`benchmarks.optimum_wishes`.
"""

# pyright: standard

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from benchmarks.optimum_loops import Corner, Loops
from benchmarks.optimum_ripple import force_ripple
from benchmarks.optimum_wishes import MARGINS, MOTION, NOTICED, felt_ends, wanted_of
from identification import Device, Quantity
from tune.documents.scene import Hand, Scene

FloatArray = NDArray[np.float64]

#: Boundaries of one combination that a solver is shown, the closest.
_SHOWN = 12
#: Gains beyond this multiple of the margin are no concern.
_FAR = 4.0
#: What an unstable ripple is allowed over what it is.
_TINY = 1e-9
#: Step of the central difference of a ripple in log-sizes.
_STEP = 1e-5
#: Below the least size, in log-sizes: not there.
_NOWHERE = 20.0


class Reference:
    """Everything that bounds the sizes of some elements on a device."""

    def __init__(
        self,
        device: Device,
        scene: Scene,
        elements: Sequence[str],
        filters_hz: tuple[float | None, float | None],
        gone: frozenset[str],
    ) -> None:
        self.gain, extra = MARGINS[scene.margin]
        box = device.simultaneous_box()
        self.wanted = [
            found
            for name in elements
            for found in wanted_of(device, name, scene.elements[name], self.gain, filters_hz)
            if found.label not in gone
        ]
        self.count = len(self.wanted)
        self.low = np.log([one.low for one in self.wanted])
        self.high = np.log([one.high for one in self.wanted])
        self.sums, self.sustained, self.peak = self._combinations(scene, elements)
        self.loops = Loops(list(_corners(device, scene.hand, extra)), filters_hz)
        usual = Corner(
            mass=device.mass.value,
            damping=device.damping.value,
            sample_time=device.sample_time.value,
            samples=box.delay[1] / device.sample_time.value,
        )
        self.usual = Loops([usual], filters_hz)
        self.resolution = device.encoder_resolution and device.encoder_resolution.value
        self.ripple = scene.ripple_limit or NOTICED
        self.force = device.force_limit
        self.felt = felt_ends(device, self.wanted, filters_hz, scene.elements)
        self._ends: dict[int, float] = {}

    def _combinations(
        self, scene: Scene, elements: Sequence[str]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Sums (combinations, 3, unknowns), and what a size costs in sustained and peak force."""
        chosen = {frozenset([name]) for name in elements}
        for group in scene.together:
            for inside in product((False, True), repeat=len(group)):
                chosen.add(frozenset(n for n, use in zip(group, inside, strict=True) if use))
        sums: list[FloatArray] = []
        costs: list[FloatArray] = []
        for names in sorted(chosen, key=sorted):
            total, cost = np.zeros((3, self.count)), np.zeros((2, self.count))
            for i, one in enumerate(self.wanted):
                if one.element in names:
                    given = scene.elements[one.element]
                    stated = (given.penetration, given.speed, given.acceleration)[one.effect]
                    total[one.effect, i] = one.sign
                    cost[1, i] = stated or MOTION[one.effect]
                    cost[0, i] = cost[1, i] * (one.effect == 0)
            if total.any():
                sums.append(total)
                costs.append(cost)
        both = np.array(costs)
        return np.array(sums), both[:, 0], both[:, 1]

    def steps(self, sizes: FloatArray) -> FloatArray:
        """Steps of each effect."""
        return np.array([w.steps(float(s)) for w, s in zip(self.wanted, sizes, strict=True)])

    def product(self, place: FloatArray) -> float:
        """The logarithm of the product of the steps."""
        return float(np.sum(np.log(self.steps(np.exp(place)))))

    def rows(self, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Limits in log-sizes, kept where not negative, with slopes (rows, unknowns).

        All are logarithms of what is allowed over what is, so that a boundary of stability, force
        or feeling is met by moving along the ray by exactly that much.
        """
        sizes = np.exp(place)
        values: list[FloatArray] = []
        slopes: list[FloatArray] = []
        found = self.loops.crossings(self.sums @ sizes, _FAR * self.gain)
        for combination, sums in enumerate(self.sums):
            value, slope = np.full(_SHOWN, np.log(_FAR)), np.zeros((_SHOWN, self.count))
            mine = np.flatnonzero(found.combination == combination)
            mine = mine[np.argsort(found.gain[mine])][:_SHOWN]
            value[: mine.size] = np.log(found.gain[mine] / self.gain)
            slope[: mine.size] = found.slopes[:, mine].T @ sums * sizes
            values.append(value)
            slopes.append(slope)
        if self.force is not None:
            limits = ((self.force.continuous, self.sustained), (self.force.peak, self.peak))
            for limit, cost in limits:
                used = cost[cost.any(axis=1)] * sizes
                total = used.sum(axis=1)
                values.append(np.log(limit / total))
                slopes.append(-used / total[:, None])
        rows = np.array([each.row(sizes) for each in self.felt]).reshape(-1, self.count)
        used = rows @ sizes
        near = used > 1 / _FAR
        values.append(np.where(near, -np.log(np.where(near, used, 1.0)), np.log(_FAR)))
        slopes.append(np.where(near, -1 / np.where(near, used, 1.0), 0.0)[:, None] * rows * sizes)
        if self.resolution:
            value, slope = self._ripple_rows(place, self.resolution)
            values.append(value)
            slopes.append(slope)
        return np.concatenate(values), np.concatenate(slopes)

    def _ripple_rows(self, place: FloatArray, resolution: float) -> tuple[FloatArray, FloatArray]:
        """Ripple of every combination; slopes only where one may bind."""
        count = self.count

        def spare(places: FloatArray) -> FloatArray:
            totals = np.einsum("mei,ki->kme", self.sums, np.exp(places)).reshape(-1, 3)
            felt = force_ripple(self.usual, totals, resolution)
            return np.log(np.maximum(self.ripple / felt, _TINY)).reshape(len(places), -1)

        here = spare(place[None])[0]
        slopes = np.zeros((here.size, count))
        if np.min(here) > np.log(_FAR) or np.min(here) <= np.log(_TINY):
            return np.clip(here, -1.0, np.log(_FAR)), slopes
        moved = np.concatenate([_STEP * np.eye(count), -_STEP * np.eye(count)])
        rows = spare(place + moved)
        return here, (rows[:count] - rows[count:]).T / (2 * _STEP)

    def onto(self, place: FloatArray, *, also_out: bool = False) -> FloatArray:
        """Along the ray back to where every limit holds; out to it as well if wanted."""
        for _ in range(12):
            spare = min(float(np.min(self.rows(place)[0])), float(np.min(self.high - place)))
            if spare >= 0 and not also_out:
                break
            place = place + spare * (1 + 1e-12)
            if abs(spare) < 1e-13:
                break
        return place

    def alone(self, index: int) -> float:
        """The largest log-size of one effect without the others."""
        if index in self._ends:
            return self._ends[index]
        place = self.low - _NOWHERE
        place[index] = min(self.high[index], np.log(self.wanted[index].reference))
        for _ in range(60):
            spare = min(float(np.min(self.rows(place)[0])), self.high[index] - place[index])
            place[index] += spare
            if abs(spare) < 1e-12:
                break
        self._ends[index] = float(place[index])
        return self._ends[index]


def _corners(device: Device, hand: Hand | str, extra: int) -> Iterator[Corner]:
    """Corners of the simultaneous box, alone and in the hand, at each delay that may come."""
    box = device.simultaneous_box()
    grips: list[tuple[float, float, float]] = [(0.0, 0.0, 0.0)]
    if isinstance(hand, Hand):
        grips += list(product(_ends(hand.mass), _ends(hand.damping), _ends(hand.stiffness)))
    for step in sorted(set(box.sample_time)):
        first, last = (round(delay / step, 9) for delay in box.delay)
        whole = np.arange(np.ceil(first), np.floor(last + extra) + 1)
        for samples in sorted({first, last, last + extra, *whole.tolist()}):
            for mass, damping in product(sorted(set(box.mass)), sorted(set(box.damping))):
                for grip in grips:
                    yield Corner(
                        mass=mass, damping=damping, sample_time=step, samples=samples, hand=grip
                    )


def _ends(interval: Quantity) -> tuple[float, ...]:
    return tuple(sorted({interval.low, interval.high}))
