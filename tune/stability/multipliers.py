"""Zames-Falb multipliers: the one that proves the largest gain, found by line searches.

The gain that a multiplier proves is quasiconcave in its weights and constants (for a fixed gain the
condition is a linear matrix inequality in them), and one or two taps reach it to a per cent: a
delay of d samples and half a sample of hold asks for a tap of 2d + 1 samples. So no solver is
called: single taps first, then the best is mixed with each other one, then the constants.

G. Zames and P. L. Falb, "Stability conditions for systems with monotone and slope-restricted
nonlinearities", SIAM J. Control 6(1), 1968; discrete: J. C. Willems and R. W. Brockett, "Some new
rearrangement inequalities having application in stability analysis", IEEE TAC 13(5), 1968. One
file: the candidates of one search, side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tune.documents.certified import Multiplier, Tap
from tune.documents.effects import Effects
from tune.stability.absolute import absolute_gain
from tune.stability.responses import Responses

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Delays of the taps that are tried, in samples: primes, so that no two vanish at one frequency.
_LADDER = (1, 2, 3, 5, 7, 11, 13, 17, 23, 31, 47, 67, 97)
#: Mixing ends when a round gains less than this, relative, or after so many rounds.
_WORTH, _ROUNDS = 3e-4, 6
#: Steps of a line search by the golden section, each of which takes away a third: to 5e-4.
_STEPS = 16
#: Parts of the first of two taps to begin with; so many of the best are looked at everywhere.
_PROPORTIONS, _SHORTLIST = (0.2, 0.5, 0.8), 6
#: Natural logarithm of the factor within which a constant is looked for.
_REACH = 3.0
#: Frequencies at which the inverse gain comes within this part of the largest are searched again.
_NEAR = 0.3
#: Parts tried of what keeps M from vanishing, largest first; the gain may fall by so much for it.
_PARTS = 10.0 ** -np.arange(1.0, 5.5, 0.5)
_GIVEN_UP = 2e-3
_GOLDEN = (np.sqrt(5) - 1) / 2


@dataclass(frozen=True, slots=True)
class _Trial:
    """Candidates side by side: weights (candidates, taps), constants (candidates,)."""

    weights: FloatArray
    damping: FloatArray
    mass: FloatArray

    def chosen(self, which: int) -> _Trial:
        parts = (self.weights, self.damping, self.mass)
        return _Trial(*(part[which : which + 1] for part in parts))


def find_multiplier(responses: Responses, effects: Effects) -> Multiplier | None:
    """The multiplier with which `absolute_gain` over all loops is largest, nearly.

    Args:
        responses: of the loops, all free or all grounded.
        effects: stiffness that is one-sided or saturates, damping and mass that are switched at
            any moment; each a positive number or absent, one of them at least present.

    Returns:
        None where no gain at all can be proved.
    """
    points = _Points.of(responses, effects)
    multiplier = _as_multiplier(_best(points), effects)
    if effects.stiffness is not None:
        multiplier = _strict(multiplier, responses, effects)
    gain = float(np.min(absolute_gain(responses, effects, multiplier)))
    return multiplier if gain > 0 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Points:
    """Where the condition is asked for: one axis of all loops and frequencies.

    Attributes:
        real, imag: of 1 - z^-i for each tap of the ladder, (taps, points).
        plant: G over T²/m, (points,).
        velocity, acceleration: estimates over position.
        sizes: α, β, γ at each point; 0 for an absent effect.
    """

    real: FloatArray
    imag: FloatArray
    plant: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray
    sizes: FloatArray

    @classmethod
    def of(cls, responses: Responses, effects: Effects) -> _Points:
        shape = responses.position.shape
        turn = np.array(_LADDER)[:, None] * np.broadcast_to(responses.angle, shape).reshape(-1)
        values = [effects.stiffness, effects.damping, effects.mass]
        given = np.array([0.0 if value is None else float(np.asarray(value)) for value in values])
        sizes = (responses.scales * given[:, None])[:, :, None] * np.ones(shape)
        return cls(
            real=2 * np.sin(turn / 2) ** 2,
            imag=np.sin(turn),
            plant=responses.position.reshape(-1),
            velocity=responses.velocity.reshape(-1),
            acceleration=responses.acceleration.reshape(-1),
            sizes=sizes.reshape(3, -1),
        )

    def only(self, which: NDArray[np.bool_] | np.bool_) -> _Points:
        return _Points(
            real=self.real[:, which],
            imag=self.imag[:, which],
            plant=self.plant[which],
            velocity=self.velocity[which],
            acceleration=self.acceleration[which],
            sizes=self.sizes[:, which],
        )

    def inverse(self, trial: _Trial) -> FloatArray:
        """1/gain of each candidate at each point, (candidates, points)."""
        alpha, beta, gamma = self.sizes
        factors: list[tuple[FloatArray, ComplexArray]] = []
        with np.errstate(all="ignore"):
            if alpha.any():
                real = trial.weights @ self.real
                factors.append((alpha / real, real + 1j * (trial.weights @ self.imag)))
            for size, constant, estimate in (
                (beta, trial.damping, self.velocity),
                (gamma, trial.mass, self.acceleration),
            ):
                if size.any():
                    factors.append((size / constant[:, None], constant[:, None] * estimate))
            total = sum(
                w * (p.real * self.plant.real - p.imag * self.plant.imag) for w, p in factors
            )
            square = self.plant.real**2 + self.plant.imag**2
            mixed: FloatArray | float = 0.0
            for i, (w, p) in enumerate(factors):
                for v, q in factors[:i]:
                    apart = p - q
                    mixed = mixed + w * v * square * (apart.real**2 + apart.imag**2)
            root = -total if len(factors) == 1 else (np.sqrt(total * total + mixed) - total) / 2
        return np.where(np.isnan(root), np.inf, root)

    def most(self, trial: _Trial) -> FloatArray:
        """The largest over the points, of each candidate."""
        return self.inverse(trial).max(axis=1)

    def critical(self, trial: _Trial) -> _Points:
        """Where one of the candidates comes near its largest."""
        values = self.inverse(trial)
        most = np.max(values, axis=1, keepdims=True)
        near = values > np.where(np.isfinite(most) & (most > 0), _NEAR * most, -np.inf)
        return self.only(np.any(near, axis=0))


def _best(points: _Points) -> _Trial:
    """The best of some pairs of taps, then mixtures; constants tied to them, then moved too."""
    if not points.sizes[0].any():
        start = _Trial(np.zeros((1, len(_LADDER))), np.ones(1), np.ones(1))
        return _constants_moved(points.critical(start), start)
    ladder = np.array(_LADDER, dtype=np.float64)
    best = _best_pair(points, ladder)
    value = points.most(best)[0]
    for _ in range(_ROUNDS):
        before = value
        for improved in (_constants_moved, _tap_added):
            trial = improved(points.critical(best), best)
            tried = points.most(trial)[0]
            if tried < value:
                best, value = trial, tried
        if not value < before * (1 - _WORTH) or value <= 0:
            break
    return best


def _best_pair(points: _Points, ladder: FloatArray) -> _Trial:
    """The best of all taps and pairs of taps in a few proportions.

    From the best single tap alone no other may help, where two others together would.
    """
    alone = np.eye(len(ladder))
    weights = np.concatenate(
        [alone]
        + [
            part * alone[i] + (1 - part) * alone[j]
            for i, j in (pair[:, None] for pair in np.transpose(np.triu_indices(len(ladder), 1)))
            for part in _PROPORTIONS
        ]
    )
    slopes = weights @ ladder
    trial = _Trial(weights, slopes, slopes**2)
    singles = _Trial(alone, ladder, ladder**2)
    order = np.argsort(points.most(singles))[:_SHORTLIST]
    few = points.critical(_Trial(alone[order], ladder[order], ladder[order] ** 2))
    short = np.argsort(few.most(trial), kind="stable")[:_SHORTLIST]
    shortlist = _Trial(weights[short], slopes[short], slopes[short] ** 2)
    return shortlist.chosen(int(np.argmin(points.most(shortlist))))


def _tap_added(points: _Points, start: _Trial) -> _Trial:
    """Mixed with the tap of the ladder that lowers the inverse gain most."""
    ladder = np.array(_LADDER, dtype=np.float64)
    others = np.eye(len(ladder))
    slope = float(start.weights[0] @ ladder)

    def mixed(part: FloatArray) -> _Trial:
        weights = (1 - part)[:, None] * start.weights + part[:, None] * others
        grown = weights @ ladder / slope
        return _Trial(weights, start.damping * grown, start.mass * grown)

    part = _least(
        lambda part: points.most(mixed(part)), np.zeros(len(ladder)), np.ones(len(ladder))
    )
    trial = mixed(part)
    return trial.chosen(int(np.argmin(points.most(trial))))


def _constants_moved(points: _Points, start: _Trial) -> _Trial:
    """The constant of the damper, then that of the mass, where there is one."""
    for place, name in ((1, "damping"), (2, "mass")):
        if points.sizes[place].any():
            base = start

            def moved(power: FloatArray, base: _Trial = base, name: str = name) -> _Trial:
                return replace(base, **{name: getattr(base, name) * np.exp(power)})

            reach = np.array([_REACH])
            start = moved(
                _least(lambda power, moved=moved: points.most(moved(power)), -reach, reach)
            )
    return start


def _least(
    value: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Where quasiconvex functions are least, side by side, by the golden section."""
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        lower = value(left) <= value(right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    return (low + high) / 2


def _as_multiplier(trial: _Trial, effects: Effects) -> Multiplier:
    taps = tuple(
        Tap(samples=samples, weight=float(weight))
        for samples, weight in zip(_LADDER, trial.weights[0], strict=True)
        if weight > 0
    )
    return Multiplier(
        taps=taps,
        damping=None if effects.damping is None else float(trial.damping[0]),
        mass=None if effects.mass is None else float(trial.mass[0]),
    )


def _strict(multiplier: Multiplier, responses: Responses, effects: Effects) -> Multiplier:
    """With as much of what keeps it from vanishing as costs nearly nothing.

    Taps of 3 and 6 samples vanish together at θ = 2π/3, where a proof would then have nothing to
    show; a tap of one sample does not below 2π. A device that is grounded asks for a constant.
    """
    slope = sum(tap.weight * tap.samples for tap in multiplier.taps)
    taps = {tap.samples: tap.weight for tap in multiplier.taps}
    trials: list[Multiplier] = []
    for part in _PARTS:
        weights = dict(sorted((taps | {1: taps.get(1, 0.0) + slope * part}).items()))
        more = {
            "taps": tuple(Tap(samples=i, weight=weight) for i, weight in weights.items()),
            "constant": float(slope * part) if responses.grounded else 0.0,
        }
        trials.append(multiplier.model_copy(update=more))
    gains = _gains(trials, responses, effects)
    least = max(gains) * (1 - _GIVEN_UP)
    return next(trial for trial, gain in zip(trials, gains, strict=True) if gain >= least)


def _gains(trials: Sequence[Multiplier], responses: Responses, effects: Effects) -> list[float]:
    """What each multiplier proves; of free loops on the grid, which tells them apart."""
    if responses.grounded:
        return [float(np.min(absolute_gain(responses, effects, trial))) for trial in trials]
    weights = [
        [sum(tap.weight for tap in trial.taps if tap.samples == samples) for samples in _LADDER]
        for trial in trials
    ]
    constants = (
        np.array([getattr(trial, name) or 0.0 for trial in trials]) for name in ("damping", "mass")
    )
    most = _Points.of(responses, effects).most(_Trial(np.array(weights), *constants))
    return [1 / value if value > 0 else np.inf for value in most.tolist()]
