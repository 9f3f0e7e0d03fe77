"""Stability of what is not linear and time-invariant: clamps, dampers that switch, jitter, fades.

**Absolute stability** (docs/theory.md, 10). The matrix Mᵢ·(δᵢⱼ/(g·sᵢ) + oᵢ·G) of multipliers Mᵢ is
D/g + C with a diagonal D that is positive: one eigenvalue problem tells the largest g, on the
frequency responses of the loops along the upper half of the unit circle.

**Jitter** (docs/theory.md, 11). One norm that shrinks under steps of any length within T(1 ± j),
that of the modes of the even loop, weighed by the Perron vectors of the largest moduli.

**Fades** (docs/theory.md, 10). In coordinates that all levels share x[k+1] = (A + l[k]·e·cᵀ)·x[k].
What pumps most goes to and fro between two levels and waits at each for part of a half swing: the
eigenvalues of one such period tell whether it grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from tune.documents.profile import Channel, Multiplier
from tune.documents.scene import Effects
from tune.loop.loop import Filters, Loop
from tune.loop.polynomials import ComplexArray, FloatArray, companion_roots
from tune.loop.state_space import Corner, SampledLoop, law_states

#: Points in equal ratios from the slowest angle, and as many evenly up to π.
_POINTS = 160
#: The slowest angle looked at, over that of the plant's slowest pole; and between which bounds.
_SLOWEST = 0.03
_LEAST, _MOST = 1e-7, 1e-2
#: A pole whose damping ratio is less than this has points of its own around its frequency, at these
#: multiples of its damping ratio.
_RESONANT = 0.5
_AROUND = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Responses:
    """Responses at z = e^jθ, all loops free or all held; each (loops, points) but the angle."""

    loop: Loop  # of shape (loops,)
    angle: FloatArray  # θ in (0, π], rad, (points,), or (loops, points) where each has its own
    position: ComplexArray  # measured position over force in T²/m
    velocity: ComplexArray  # estimate over position, in 1/T
    acceleration: ComplexArray  # estimate over position, in 1/T²
    steady: tuple[Effects, ...]  # effects that fade, on every loop at some constant level
    levels: tuple[tuple[float, ...], ...]  # of all of them, at which each loop is looked at

    @classmethod
    def of(cls, loop: Loop, steady: Sequence[Effects] = ()) -> Responses:
        """On a grid that is fine where the loops are, shape (loops,).

        ``steady`` effects are part of the device here, without springs, each at a level of its own:
        none, half or all of it. One loop becomes as many as there are levels.
        """
        return cls._at(
            loop, _grid(loop), tuple(steady), tuple(product((0.0, 0.5, 1.0), repeat=len(steady)))
        )

    @classmethod
    def _at(
        cls,
        loop: Loop,
        angle: FloatArray,
        steady: tuple[Effects, ...],
        levels: tuple[tuple[float, ...], ...],
    ) -> Responses:
        parts = loop.transfer
        position = _quotient(parts.plant_numerator, parts.plant_denominator, angle)
        velocity = _quotient(parts.beta, parts.law_denominator, angle)
        acceleration = _quotient(parts.gamma, parts.law_denominator, angle)
        if steady:
            laws = np.zeros((len(steady), *position.shape), dtype=np.complex128)
            estimates = (np.ones_like(position), velocity, acceleration)
            for place, effects in enumerate(steady):
                for value, part in zip(loop.dimensionless_effects(effects), estimates, strict=True):
                    if value is not None:
                        laws[place] += np.broadcast_to(value, loop.scales[0].shape)[:, None] * part
            position = np.concatenate(
                [position / (1 + np.tensordot(each, laws, axes=1) * position) for each in levels]
            )
            velocity, acceleration = (
                np.concatenate([part] * len(levels)) for part in (velocity, acceleration)
            )
        if angle.ndim > 1:
            angle = np.tile(angle, (len(levels), 1))
        return cls(
            loop=loop,
            angle=angle,
            position=position,
            velocity=velocity,
            acceleration=acceleration,
            steady=steady,
            levels=levels,
        )

    def at_each(self, angle: FloatArray) -> Responses:
        """Every loop at angles of its own, (loops, points)."""
        count = len(self.levels)
        parts = [
            self._at(self.loop, part, self.steady, (level,))
            for part, level in zip(np.split(angle, count), self.levels, strict=True)
        ]
        return replace(
            self,
            angle=angle,
            position=np.concatenate([part.position for part in parts]),
            velocity=np.concatenate([part.velocity for part in parts]),
            acceleration=np.concatenate([part.acceleration for part in parts]),
        )

    @property
    def scales(self) -> FloatArray:
        """(T²/m, T/m, 1/m) of each loop, shape (3, loops)."""
        return np.tile(np.stack(self.loop.scales), (1, len(self.levels)))

    @property
    def grounded(self) -> bool:
        """A spring of device or hand binds the position."""
        return self.loop.grounded


def _grid(loop: Loop) -> FloatArray:
    """Angles in (0, π] for each loop: in equal ratios, evenly, around each of its resonances."""
    denominator = loop.transfer.plant_denominator
    drop = 0 if loop.grounded else 1
    roots = companion_roots(denominator[drop:-1] / denominator[-1])
    size = np.abs(roots)
    slow = float(np.min(size, initial=_MOST))
    least = min(_MOST, max(_LEAST, _SLOWEST * slow))
    even = [np.geomspace(least, np.pi, _POINTS), np.linspace(np.pi / _POINTS, np.pi, _POINTS)]
    with np.errstate(all="ignore"):
        ratio = np.abs(roots.real) / size
    resonant = (ratio < _RESONANT) & (roots.imag > 0)
    # Shape (points,) where none resonates, else (loops, points), ascending.
    shared = np.unique(np.concatenate(even))
    if not resonant.any():
        return shared[(shared >= least) & (shared <= np.pi)]
    around = 2 * np.arctan(roots.imag) * (1 + ratio * _AROUND[:, None, None])
    around = np.where(resonant & (around >= least) & (around <= np.pi), around, np.pi)
    own = around.reshape(-1, around.shape[-1]).T
    found = np.sort(np.hstack([np.tile(shared, (len(own), 1)), own]), axis=1)
    return np.clip(found[:, : 1 + int(np.sum(found < np.pi, axis=1).max())], least, np.pi)


def _quotient(top: FloatArray, bottom: FloatArray, angle: FloatArray) -> ComplexArray:
    """A quotient of polynomials in w at w = j·tan(θ/2), each (degree+1, loops); also at θ = π."""
    sine, cosine = np.sin(angle / 2), np.cos(angle / 2)
    value = _scaled_value(top, sine, cosine) / _scaled_value(bottom, sine, cosine)
    return value * cosine ** float(len(bottom) - len(top))


def _scaled_value(polynomial: FloatArray, sine: FloatArray, cosine: FloatArray) -> ComplexArray:
    """cos^degree(θ/2) times the polynomial: even and odd powers apart."""
    shape = np.broadcast_shapes((*polynomial.shape[1:], 1), sine.shape)
    even, odd = np.zeros(shape), np.zeros(shape)
    degree = len(polynomial) - 1
    for power, row in enumerate(polynomial):
        term = row[:, None] * (sine**power * cosine ** (degree - power))
        sign = 1.0 if power % 4 < 2 else -1.0
        if power % 2:
            odd = odd + sign * term
        else:
            even = even + sign * term
    return even + 1j * odd


#: Rounds in which the highest peaks of each loop are closed in on; how many, and points of each.
_ZOOMS, _PEAKS, _ZOOM_POINTS = 4, 6, 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Nonlinearities:
    """What of a sum of elements is not linear."""

    clamps: tuple[tuple[str, Effects], ...]  # names and effects of the elements with a spring
    # of all that is damping only and switched at any moment, N·s/m (N·m·s/rad), 0 for none
    damping: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, as a certificate gives them."""
        return (*(name for name, _ in self.clamps), *["damping"] * bool(self.damping))

    @property
    def sizes(self) -> tuple[float, ...]:
        """sᵢ of the channels: K of a clamp, B of what is switched."""
        springs = (float(np.asarray(effects.stiffness)) for _, effects in self.clamps)
        return (*springs, *[self.damping] * bool(self.damping))

    def loops(self, responses: Responses) -> ComplexArray:
        """sᵢ·oᵢ·G of each channel, shape (channels, loops, points)."""
        laws = [effects for _, effects in self.clamps]
        laws += [Effects(damping=self.damping)] if self.damping else []
        sizes = np.array([[v or 0.0 for v in effects.arrays()] for effects in laws], dtype=float)
        parts = (np.ones_like(responses.position), responses.velocity, responses.acceleration)
        estimates = responses.scales[:, :, None] * np.stack(parts)
        return responses.position * np.tensordot(sizes, estimates, axes=1)


def absolute_gain(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier, *, enough: float = 0.0
) -> FloatArray:
    """Largest g such that the condition holds for all of a sum times any gain in (0, g].

    The multiplier has a channel for each part, in their order. Shape (loops,); inf where nothing
    bounds it. Where some loop is seen at once to have less than is enough, all are of the grid
    only, upper bounds.
    """
    inverse = _inverse_gain(responses, parts, multiplier)
    angle = np.broadcast_to(responses.angle, inverse.shape)
    # Between the neighbours of the highest peaks of each loop, (loops, peaks).
    order = np.argsort(np.where(is_peak(inverse), inverse, -np.inf), axis=1)[:, -_PEAKS:]
    low = np.take_along_axis(angle, np.maximum(order - 1, 0), axis=1)
    high = np.take_along_axis(angle, np.minimum(order + 1, inverse.shape[1] - 1), axis=1)
    most = inverse.max(axis=1)
    for _ in range(_ZOOMS if np.all(most * enough <= 1) else 0):
        places = np.linspace(low, high, _ZOOM_POINTS, axis=-1)
        near = responses.at_each(places.reshape(len(places), -1))
        peaks = _inverse_gain(near, parts, multiplier).reshape(places.shape)
        most = np.maximum(most, peaks.max(axis=(1, 2)))
        worst = np.argmax(peaks, axis=-1)[..., None]
        low = np.take_along_axis(places, np.maximum(worst - 1, 0), axis=-1)[..., 0]
        high = np.take_along_axis(places, np.minimum(worst + 1, _ZOOM_POINTS - 1), axis=-1)[..., 0]
    with np.errstate(divide="ignore"):
        return np.where(most > 0, 1 / most, np.inf)


def is_peak(values: FloatArray) -> NDArray[np.bool_]:
    """Where rows of values, (loops, points), are no less than on either side."""
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=-np.inf)
    return (values >= padded[:, :-2]) & (values >= padded[:, 2:])


def _inverse_gain(
    responses: Responses, parts: Nonlinearities, multiplier: Multiplier
) -> FloatArray:
    """1/g of each loop at each point: the largest eigenvalue of -D^(-½)·C·D^(-½)."""
    loops = parts.loops(responses)
    angle = np.broadcast_to(responses.angle, loops.shape[1:])
    values = np.stack(
        [
            multiplier_at(channel, angle) / (size * _slope(channel, responses.grounded))
            for channel, size in zip(multiplier.channels, parts.sizes, strict=True)
        ]
    )
    with np.errstate(all="ignore"):
        products = values * loops
        if len(products) == 1:
            found = -products[0].real / values[0].real
        else:
            roots = np.sqrt(values.real)
            sums = products[:, None] + np.conj(products)
            matrix = np.moveaxis(-sums / (2 * roots[:, None] * roots), (0, 1), (-2, -1))
            good = np.all(np.isfinite(matrix), axis=(-2, -1))
            found = np.linalg.eigvalsh(np.where(good[..., None, None], matrix, 0))[..., -1]
            found = np.where(good, found, np.inf)
    return np.where(np.isnan(found), np.inf, found)


def _slope(channel: Channel, grounded: bool) -> float:  # noqa: FBT001 - of the loops
    """What a multiplier counts over: its slope at θ = 0 where nothing holds the position."""
    if grounded or not channel.taps:
        return 1.0
    return sum(tap.weight * tap.samples for tap in channel.taps)


def multiplier_at(channel: Channel, angle: FloatArray) -> ComplexArray:
    """M(e^jθ), of the shape of the angles; its real part loses nothing at small angles."""
    total = np.full(angle.shape, complex(channel.constant))
    for tap in channel.taps:
        total += tap.weight * difference_at(tap.samples, angle)
    return total


def difference_at(samples: int, angle: FloatArray) -> ComplexArray:
    """1 - e^(-jθ·samples), of the shape of the angles."""
    turn = samples * angle
    return 2 * np.sin(turn / 2) ** 2 + 1j * np.sin(turn)


#: Parts of a sample time beyond which no jitter is looked at.
MOST_JITTER = 0.5
#: Step lengths within ±j at which the norm is computed. A(τ) is all but straight in τ, and the norm
#: of a matrix on a straight line is largest at an end.
_LENGTHS = np.linspace(-1.0, 1.0, 5)
#: The largest j is found to this part of itself, in at most so many steps.
_CLOSE, _MOST_STEPS = 1e-4, 40
#: Balancing sweeps of the moduli, and what stands for none, relative to the largest.
_SWEEPS, _NONE = 6, 1e-9


@lru_cache(maxsize=4096)
def jitter_margin(
    places: tuple[Corner, ...],
    filters: Filters,
    values: tuple[float, float, float],
    most: float = MOST_JITTER,
) -> float:
    """Largest j up to ``most`` such that steps anywhere in T(1 ± j) leave every loop stable.

    It is sufficient, not necessary, and says nothing of devices between the places. The law is the
    one made for even steps, its values K, B and M, 0 for none; its delay is counted in steps. 0
    where a loop is not stable at even steps.
    """
    far = {place: _growth(place, filters, values, most) for place in places}
    found = most
    # The worst first: the others are then looked at no further.
    for place in sorted(far, key=far.__getitem__, reverse=True):
        if far[place] < 0:
            break
        whole = found == most
        above = far[place] if whole else _growth(place, filters, values, found)
        if above >= 0:
            found = _margin_at(place, filters, values, found, above)
    return found


def _margin_at(place: Corner, filters: Filters, values: Values, most: float, above: float) -> float:
    """The margin of a loop that grows by ``above`` at ``most``, by the Illinois false position."""
    low, high = 0.0, most
    below = _growth(place, filters, values, 0.0)
    if below >= 0:
        return 0.0
    side = 0
    for _ in range(_MOST_STEPS):
        if high - low < _CLOSE * high:
            break
        # A growth without bound tells no slope. The step aims a little beyond the zero, so that
        # both ends close in.
        share = -below / (above - below) if np.isfinite(above) else 0.5
        aim = low + (high - low) * share
        middle = min(max(aim + side * _CLOSE * aim / 3, (low + aim) / 2), (high + aim) / 2)
        seen = _growth(place, filters, values, middle)
        if seen < 0:
            low, below, above = middle, seen, above / 2 if side > 0 else above
            side = 1
        else:
            high, above, below = middle, seen, below / 2 if side < 0 else below
            side = -1
    return low


def _growth(
    place: Corner, filters: Filters, values: tuple[float, float, float], jitter: float
) -> float:
    """By how much the norm of the modes exceeds 1 under the worst step within T(1 ± jitter)."""
    lengths = 1 + jitter * _LENGTHS
    transitions = SampledLoop.of(place, filters, values, lengths=lengths).pushed
    if not np.isfinite(transitions).all():
        return np.inf
    even = transitions[len(lengths) // 2]
    poles, modes = np.linalg.eig(even)
    try:  # in its modes an even step is its poles, with no rounding
        seen = np.diag(poles) + np.linalg.solve(modes, np.subtract(transitions, even) @ modes)
    except np.linalg.LinAlgError:
        return np.inf
    if values[0] == 0 and place.position_stiffness == 0:
        # Wherever the device is, it moves alike: a step keeps that mode as it is.
        kept = np.delete(np.arange(len(poles)), np.argmin(np.abs(poles - 1)))
        seen = seen[:, kept][:, :, kept]
    weights = _weights(np.abs(seen).max(axis=0))
    weighed = seen * (weights[:, None] / weights)
    return float(np.linalg.norm(weighed, 2, axis=(-2, -1)).max()) - 1


def _weights(sizes: FloatArray) -> FloatArray:
    """√(y/x) of the right and left Perron vectors x, y of a nonnegative matrix, balanced first."""
    weights = np.ones(len(sizes))
    apart = sizes * (1 - np.eye(len(sizes))) + np.finfo(float).tiny
    for _ in range(_SWEEPS):
        now = apart * (weights[:, None] / weights)
        weights = weights * (now.sum(axis=0) / now.sum(axis=1)) ** 0.25
        weights = weights / weights.max()
    balanced = sizes * (weights[:, None] / weights)
    balanced = balanced + _NONE * balanced.max()
    return weights * np.sqrt(_perron(balanced.T) / _perron(balanced))


def _perron(sizes: FloatArray) -> FloatArray:
    """The positive eigenvector of a positive matrix."""
    values, vectors = np.linalg.eig(sizes)
    return np.abs(vectors[:, np.argmax(np.real(values))])


Values = tuple[float, float, float]
Spans = NDArray[np.int64]

#: Steps of a fade, and those at which it may turn: where a spring fades, low levels swing slowest.
_STEPS = 16
_STOPS = (0, 1, 2, 4, 8, 12, 16)
#: Waits at a stop, evenly from none to half a swing.
_WAITS = 8
#: rad, how far from whole half turns a period is looked at.
_NEAR = np.linspace(-0.12, 0.12, 13)
#: s, the first fade looked at, the ratio of each to the next, and the longest: of turns at any
#: level, which guide no further where they ask for more, and of going all the way.
_FIRST, _RATIO, _LONGEST, _LONGEST_WHOLE = 0.05, 2**0.5, 1.0, 5.0
#: An eigenvalue of a period this far beyond the circle grows; less is the rounding of a double one.
_GROWS = 1e-6


def shortest_fade(
    places: Sequence[Corner],
    filters: Filters,
    beside: Values,
    fading: Values,
    *,
    whole: bool = False,
) -> float:
    """Shortest fade, s, at which no wave of the level was found to make any loop grow.

    It is necessary, not sufficient: waves of other shapes are not looked at. 0.05 s at least; inf
    where none up to 1 s, or 5 s all the way, is slow enough. The values are K, B and M of what
    stands beside and of what fades, at its full level; ``whole`` says that the level always goes
    all the way, else it may turn at other levels too.
    """
    loops = [
        _FadedLoop.of(place, filters, beside, fading)
        for place in places
        # Without any spring nothing swings.
        if beside[0] or fading[0] or place.position_stiffness or place.modes
    ]
    fade = _FIRST
    for loop in loops:
        while loop.grows(fade, (0, _STEPS) if whole else _STOPS):
            fade *= _RATIO
            if fade > (_LONGEST_WHOLE if whole else _LONGEST):
                return float("inf")
    return fade


@dataclass(frozen=True, slots=True, kw_only=True)
class _FadedLoop:
    """x[k+1] = (still + level·more)·x[k], each of shape (states, states); sample time in s.

    Where no spring of device or law binds the place at any level, it is no state.
    """

    still: FloatArray
    more: FloatArray
    sample_time: float

    @classmethod
    def of(cls, place: Corner, filters: Filters, beside: Values, fading: Values) -> _FadedLoop:
        """The estimates follow every reading; only what is made of them has a level."""
        step = place.sample_time
        plant = SampledLoop.of(place, filters, (1.0, 0.0, 0.0))
        size, command = len(plant.read), plant.command
        enter = (plant.pushed - plant.free) @ command / (command @ command)
        estimates = [law_states(filters, step, 0.0, *only) for only in ((1.0, 0.0), (0.0, 1.0))]
        total = size + sum(len(each.update) for each in estimates)
        still = np.zeros((total, total))
        still[:size, :size] = plant.free
        rows = np.zeros((3, total))
        rows[0, :size] = command
        start = size
        for row, each in zip(rows[1:], estimates, strict=True):
            end = start + len(each.update)
            still[start:end, start:end] = each.update
            still[start:end, :size] = np.outer(each.drive, plant.read)
            row[start:end] = each.command
            row[:size] = each.direct * plant.read
            start = end
        drive = np.append(enter, np.zeros(total - size))
        still += np.outer(drive, np.array(beside) @ rows)
        more = np.outer(drive, np.array(fading) @ rows)
        if not (beside[0] or fading[0] or place.position_stiffness):
            still, more = _without_place(still, more)
        return cls(still=still, more=more, sample_time=step)

    def at(self, level: FloatArray) -> FloatArray:
        """Transitions at some levels, shape (levels, states, states)."""
        return self.still + level[:, None, None] * self.more

    @np.errstate(over="ignore", invalid="ignore")  # what overflows grows
    def grows(self, fade: float, stops: Sequence[int]) -> bool:
        """Whether some wave between two stops, as fast as a fade of so many seconds, pumps."""
        count = max(1, int(fade / self.sample_time / _STEPS))
        middles = (np.arange(_STEPS) + 0.5) / _STEPS
        each = self.at(middles)
        steps = np.linalg.matrix_power(each, count)
        turned = count * np.array([_turn(matrix) for matrix in each])
        held = {stop: self.at(np.array([stop / _STEPS]))[0] for stop in stops}
        turns = {stop: _turn(matrix) for stop, matrix in held.items()}
        for place, low in enumerate(stops):
            up = down = np.eye(len(self.still))
            for before, high in pairwise(stops[place:]):
                for step in steps[before:high]:
                    up, down = step @ up, down @ step
                both, fades = (turns[low], turns[high]), 2 * float(turned[low:high].sum())
                for first, last in _waits(both, fades):
                    periods = down @ _held(held[high], last) @ up @ _held(held[low], first)
                    if not np.isfinite(periods).all():
                        return True
                    if np.abs(np.linalg.eigvals(periods)).max() > 1 + _GROWS:
                        return True
        return False


def _without_place(still: FloatArray, more: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Transitions of what is left where nothing binds the place, told relative to the place."""
    # The pole of the place is one. Beside next to no damping that of the speed is too, and rounding
    # would make growth of such a pair.
    elsewhere = np.linalg.svd(still - np.eye(len(still)))[2][-1]
    place = int(np.argmax(np.abs(elsewhere)))
    rest = np.delete(np.arange(len(still)), place)
    share = elsewhere[rest] / elsewhere[place]
    left = [each[np.ix_(rest, rest)] - np.outer(share, each[place, rest]) for each in (still, more)]
    return left[0], left[1]


def _turn(matrix: FloatArray) -> float:
    """Angle a sample of the swing that dies out last, rad; 0 where nothing swings."""
    poles = np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)
    swings = poles[poles.imag > 0]
    return float(np.angle(swings[np.argmax(np.abs(swings))])) if swings.size else 0.0


def _waits(turns: tuple[float, float], fades: float) -> list[tuple[Spans, Spans]]:
    """Pairs of waits in samples at a low and a high level, the longest half a swing at each."""
    evenly = [
        np.unique(np.linspace(0, np.pi / turn if turn else 0, _WAITS).astype(np.int64))
        for turn in turns
    ]
    first, last = (each.ravel() for each in np.meshgrid(*evenly, indexing="ij"))
    if not turns[1]:
        return [(first, last)]
    # Close to those with which a period turns the swing by whole half turns, of so many radians a
    # sample at either level and over both ways: where little is lost few periods pump.
    left = (-evenly[0] * turns[0] - fades) % np.pi
    near = (left[:, None] + _NEAR) / turns[1]
    tuned = np.maximum(np.rint(near), 0).astype(np.int64).ravel()
    return [(first, last), (np.repeat(evenly[0], len(_NEAR)), tuned)]


def _held(matrix: FloatArray, spans: Spans) -> FloatArray:
    """Transitions over some waits at one level, shape (waits, states, states)."""
    which, place = np.unique(spans, return_inverse=True)
    return np.stack([np.linalg.matrix_power(matrix, int(span)) for span in which])[place]
