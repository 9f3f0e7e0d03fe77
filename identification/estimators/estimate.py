"""Least squares, plain and by variable projection, the intervals of a fit, and its answer.

Variable projection: given the few nonlinear parameters, the others are a linear solve (Golub and
Pereyra, SIAM Journal on Numerical Analysis 10, 1973, p. 413, in Kaufman's form).

Residuals of a friction fit are never white: on a real axis the ordinary formula s²(XᵀX)⁻¹ is
several times too small. Intervals leave out one block of the log after the other (Künsch, Annals of
Statistics 17, 1989, p. 1217; CR3 of MacKinnon and White, Journal of Econometrics 29, 1985, p. 305).
In white noise that is 3 to 10 % wider than the unbiased CR2, which an encoder's rounding needs: it
is correlated from block to block. With instruments, whose blocks tell far less evenly, leaving out
is up to twice too wide, and CR2 it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from identification.estimators.filters import recursive, whiteness
from identification.estimators.signals import StepResponse
from identification.trajectory import FloatArray, IndexArray

#: Steps of Gauss-Newton; from least squares it converges in three to five.
_MOST_STEPS = 40
#: Times a step that makes the fit worse is halved before it is given up.
_MOST_HALVINGS = 12
#: The search ends when a step is shorter than this part of the standard deviation along it; a
#: tenth of it could no longer be told from the rounding of a million squares.
_CONVERGED = 1e-2
#: Times a linear solve is repeated on its own residual: normal equations lose half of the digits,
#: each repetition gains them back.
_REPEATS = 2
#: Singular values of unit columns below this part of the largest carry nothing but rounding.
_ROUNDING = 1e-14
#: Note on an estimate whose search was ended.
UNSETTLED = "the search ended before it settled"
#: A square of a column below this is none: its inverse would be beyond all numbers.
_NO_SQUARE = 1e-200
#: A force that moves nothing leaves 1/m at zero; it is kept this far from it, 1/kg.
_LIGHTEST = 1e-15


def unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns of unit norm and the norms, shape (n, p) and (p,); a column of zeros stays zero."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return columns / norms, norms


def solve(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution by QR of unit-norm columns, shape (p,)."""
    unit, norms = unit_columns(columns)
    q, r = np.linalg.qr(unit)
    return np.linalg.lstsq(r, q.T @ right, rcond=None)[0] / norms


def symmetric_inverse(matrices: FloatArray, nothing: float = 1e-15) -> FloatArray:
    """Pseudo-inverses, (..., p, p), without eigenvalues below ``nothing`` times the largest."""
    values, vectors = np.linalg.eigh(matrices)
    sizes = np.abs(values)
    kept = sizes > nothing * np.max(sizes, axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=kept)
    return (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def unit_inverse(slopes: FloatArray, nothing: float) -> tuple[FloatArray, FloatArray]:
    """Inverse of the normal matrix of slopes scaled to one, (k, k), and their sizes, (k,)."""
    normal = slopes @ slopes.T
    size = np.sqrt(np.diag(normal))
    # A parameter that changes nothing does not move.
    size = np.where(size > 0, size, 1.0)
    return symmetric_inverse(normal / np.outer(size, size), nothing), size


def gauss_newton(
    slopes: FloatArray, residual: FloatArray, nothing: float
) -> tuple[FloatArray, float]:
    """The Gauss-Newton step by slopes, (k, rows), and what it gains in variances of a residual."""
    inverse, size = unit_inverse(slopes, nothing)
    right = slopes @ residual / size
    move = inverse @ right
    cost = max(float(residual @ residual), np.finfo(float).tiny)
    return move / size, float(move @ right) * residual.size / cost


class Separable(Protocol):
    """A model y ≈ Xᵀ(θ)·w of one log."""

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest θ searched, shape (k,) each."""
        ...

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns X, shape (q, rows), and the target y, shape (rows,)."""
        ...

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        """Derivative of Xᵀw - y by θ, shape (k, rows); the residual is y - Xᵀw."""
        ...

    def allowed(self, theta: FloatArray) -> bool:
        """Whether a θ within the bounds, shape (k,), may be tried."""
        ...


@dataclass(frozen=True, slots=True)
class Solution:
    """The best fit found, or the linear solve at one θ."""

    theta: FloatArray  # nonlinear parameters, shape (k,)
    weights: FloatArray  # linear parameters, shape (q,)
    columns: FloatArray  # X at theta, shape (q, rows)
    target: FloatArray  # y, shape (rows,)
    residual: FloatArray  # y - Xᵀw, shape (rows,)
    inverse: FloatArray  # of the products of columns, shape (q, q)
    slopes: FloatArray  # derivative of the fit by theta, shape (k, rows); of a trial none
    converged: bool = False  # whether the search ended because steps became short

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


def solve_separable(problem: Separable, start: FloatArray, noise: Sequence[int] = ()) -> Solution:
    """Minimise ‖y - Xᵀ(θ)·w‖² over θ and w, from a start that may be rough.

    Places in θ that are of the noise go along their bounds. What else presses against one tells
    that the model is wrong: the search does not settle there.
    """
    best = _with_slopes(problem, _linear(problem, np.clip(start, *problem.bounds)))
    for _ in range(_MOST_STEPS):
        move, gain = _step(best, problem.bounds, noise)
        if gain <= _CONVERGED**2:
            return replace(best, converged=True)
        found = _improved(problem, best, move)
        if found is None:
            break
        best = _with_slopes(problem, found)
    return best


def _step(
    best: Solution, bounds: tuple[FloatArray, FloatArray], noise: Sequence[int]
) -> tuple[FloatArray, float]:
    """The step of Gauss and Newton and its gain, along bounds of the noise that it would cross."""
    low, high = bounds
    along = (best.slopes @ best.columns.T) @ best.inverse
    slopes = best.slopes - along @ best.columns
    free, move = np.ones(low.size, dtype=np.bool_), np.zeros(low.size)
    while True:
        move[free], gain = gauss_newton(slopes[free], best.residual, _ROUNDING)
        out = ((best.theta <= low) & (move < 0)) | ((best.theta >= high) & (move > 0))
        out &= np.isin(np.arange(low.size), noise)
        if not out.any():
            return move, gain
        free &= ~out
        move[out] = 0.0


def _with_slopes(problem: Separable, found: Solution) -> Solution:
    return replace(found, slopes=problem.slopes(found.theta, found.weights, found.residual))


def _improved(problem: Separable, best: Solution, move: FloatArray) -> Solution | None:
    """The longest of ever shorter steps that makes the fit better; None if there is none."""
    for halving in range(_MOST_HALVINGS):
        trial = np.clip(best.theta + move / 2**halving, *problem.bounds)
        if problem.allowed(trial):
            found = _linear(problem, trial)
            if found.cost < best.cost:
                return found
    return None


def _linear(problem: Separable, theta: FloatArray) -> Solution:
    columns, target = problem.at(theta)
    gram = columns @ columns.T
    square = np.diag(gram)
    size = np.sqrt(np.where(square > _NO_SQUARE, square, 1.0))
    scale = np.outer(size, size)
    inverse = symmetric_inverse(gram / scale, _ROUNDING) / scale
    weights = inverse @ (columns @ target)
    residual = target - weights @ columns
    for _ in range(_REPEATS):
        weights = weights + inverse @ (columns @ residual)
        residual = target - weights @ columns
    return Solution(theta, weights, columns, target, residual, inverse, np.empty(0))


def physical(best: Solution, count: int) -> tuple[FloatArray, FloatArray]:
    """Parameters m, b, terms of a solution in p = θ[0] and weights 1/m, -terms/m, and its Jacobian.

    The chain rule is taken in the columns, so a covariance computed from them is already that of
    the physical parameters. The Jacobian goes on with the other θ and the other weights.
    """
    inverse = float(best.weights[0])
    if abs(inverse) < _LIGHTEST:
        inverse = np.copysign(_LIGHTEST, inverse)
    mass, rate = 1 / inverse, float(best.theta[0])
    values = np.concatenate(([mass, rate * mass], best.weights[1 : count - 1] * -mass))
    slope = best.slopes[0]
    driven = best.weights[: count - 1] @ best.columns[: count - 1]
    jacobian = [-(driven + rate * slope) / mass, slope / mass]
    jacobian += [-column / mass for column in best.columns[1 : count - 1]]
    return values, np.stack([*jacobian, *best.slopes[1:], *best.columns[count - 1 :]])


Gravity = Literal["none", "proportional", "pendulum"]
_OF_GRAVITY: dict[Gravity, tuple[str, ...]] = {
    "none": (),
    "proportional": ("position_stiffness",),
    "pendulum": ("gravity_sine", "gravity_cosine"),
}
#: At most this many blocks: with 60, the t quantile is within 2 % of the normal one, and each
#: block of a usual log still outlasts the filter and the correlation of its residual many times.
MOST_BLOCKS = 60
#: At least this many blocks: fewer leave no degrees of freedom for a simultaneous region.
_FEWEST_BLOCKS = 8
#: Correlation is looked for between sums over this many parts of a log at most, ...
_FINEST_PARTS = 1024
#: ... of this many rows at least.
_SHORTEST_PART = 2
#: Forces between samples, turning points read from a measured motion and the solver itself are good
#: to this part of the force. Without it the interval of a noise-free log would shrink to rounding.
UNKNOWN_FORCE = 2e-6
#: Singular values this much smaller than the largest are rounding: of a sum that lost a block ...
_SINGULAR = 1e-12
#: ... and at all.
_NOTHING = 1e-30


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """Which terms stand beside mass and damping in the equation of motion.

    m·q̈ + b·q̇ + a·(|q̇| - s) + Fc·sign(q̇) + f0 + k·q + gs·sin(q) + gc·cos(q) = F(t - delay).
    """

    coulomb: bool = True  # Coulomb friction Fc is estimated; otherwise it is zero
    offset: bool = True  # a constant force f0 is estimated; otherwise it is zero
    #: friction differs by direction: damping is b + a forward and b - a backward, and Coulomb
    #: friction Fc ± (f0 - a·s). With s, the mean speed of the log, f0 stays the offset at that
    #: speed. Needs ``coulomb`` and ``offset``.
    directional: bool = False
    #: "proportional" adds k·q, "pendulum" adds gs·sin(q) + gc·cos(q), q in rad
    gravity: Gravity = "none"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of every vector and matrix of an Estimate."""
        names = ["mass", "damping"]
        names += ["coulomb_friction"] if self.coulomb else []
        names += ["force_offset"] if self.offset else []
        names += ["damping_asymmetry"] if self.directional else []
        return (*names, *self.of_gravity)

    @property
    def of_gravity(self) -> tuple[str, ...]:
        """Names of the parameters of gravity."""
        return _OF_GRAVITY[self.gravity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One method's answer for one log; SI units, or the rotary ones of Device."""

    method: str  # its name on the command line
    model: Model  # the terms estimated
    delay: float  # s, command to force: as given, or as fitted
    values: FloatArray  # shape (p,), in the order of ``model.parameters``
    covariance: FloatArray  # shape (p, p), robust against coloured residuals
    degrees_of_freedom: float  # of the covariance, for Student's t and Hotelling's T²
    residual: FloatArray  # shape (rows,), in ``residual_unit``
    residual_unit: str  # "force" (filtered, N) or "position" (m)
    explained: float  # share of the fitted signal's mean square that the model explains, at most 1
    condition: float  # condition number of the unit-norm columns
    inflation: FloatArray  # shape (p,): variance inflation of each parameter by the other columns
    #: standard deviation of a fitted delay, s; None if it was given
    delay_deviation: float | None = None
    mean_speed: float = 0.0  # s of the model, m/s; 0 where friction does not differ by direction
    #: shape (p,): what choices of the method move the estimate by, such as half of the difference
    #: between half and twice the cut-off; one more standard deviation, in the covariance. None
    #: where there is no such choice.
    choice_shift: FloatArray | None = None
    notes: tuple[str, ...] = ()  # sentences on choices made on the way, such as the cut-off

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of ``values``."""
        return self.model.parameters

    @property
    def settled(self) -> bool:
        """Whether the search ended by itself."""
        return UNSETTLED not in self.notes

    @property
    def whiteness(self) -> float:
        """Distance of the residual's cumulated spectrum from white noise, 0 to 1."""
        return whiteness(self.residual)

    def value(self, name: str) -> float:
        """The estimate of one parameter; 0 for a term the model leaves out."""
        if name not in self.parameters:
            return 0.0
        return float(self.values[self.parameters.index(name)])

    def deviation(self, name: str) -> float:
        """Standard deviation of one parameter; 0 for a term the model leaves out."""
        if name not in self.parameters:
            return 0.0
        index = self.parameters.index(name)
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def combined(self, **weights: float) -> tuple[float, float]:
        """Value and standard deviation of a weighted sum of parameters, absent ones being zero."""
        known = np.array([weights.get(name, 0.0) for name in self.parameters])
        return float(known @ self.values), float(np.sqrt(max(known @ self.covariance @ known, 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Covariance of a linear (or linearised) fit and what it rests on."""

    covariance: FloatArray  # shape (p, p), in the units of the parameters
    degrees_of_freedom: float  # blocks less one
    condition: float  # condition number of the unit-norm columns
    inflation: FloatArray  # shape (p,), variance inflation factors of the parameters


def correlation_length(sums: FloatArray) -> float:
    """Parts over which sums are correlated: their autocorrelation, summed to its first zero."""
    count = sums.size
    spectrum = np.fft.rfft(sums, 1 << int(np.ceil(np.log2(2 * count))))
    covariance = np.fft.irfft(np.abs(spectrum) ** 2)[: count // 2]
    if covariance[0] <= 0:
        return 1.0
    correlation = covariance / covariance[0]
    negative = np.flatnonzero(correlation <= 0)
    end = int(negative[0]) if negative.size else correlation.size
    return float(1 + 2 * np.sum(correlation[1:end]))


def _block_edges(columns: FloatArray, residual: FloatArray) -> IndexArray:
    """Rows at which to cut a log into blocks, none shorter than the scores are correlated."""
    rows = residual.size
    parts = int(np.clip(rows // _SHORTEST_PART, 1, _FINEST_PARTS))
    starts = np.linspace(0, rows, parts + 1).astype(np.intp)[:-1]
    longest = max(
        correlation_length(np.add.reduceat(column * residual, starts)) for column in columns
    )
    count = int(np.clip(parts // max(longest, 1.0), _FEWEST_BLOCKS, MOST_BLOCKS))
    return np.linspace(0, rows, count + 1).astype(np.intp)


def spread(
    columns: FloatArray,
    residual: FloatArray,
    keep: int,
    *,
    signal: FloatArray,
    instruments: FloatArray | None = None,
) -> Spread:
    """Block-jackknife covariance of the first ``keep`` parameters of a least-squares fit.

    Columns are regressors, or the Jacobian of a nonlinear fit, shape (p, rows); instruments are
    what the residual was made orthogonal to, if not the columns. The signal is what the logged
    force contributes: UNKNOWN_FORCE of it is in doubt.
    """
    tests = columns if instruments is None else instruments
    norms, sizes = _norms(columns), _norms(tests)
    edges = _block_edges(tests[:keep] / sizes[:keep, None], residual)
    count, shape = edges.size - 1, np.outer(sizes, norms)
    normal, right = np.empty((count, *shape.shape)), np.empty((count, norms.size))
    for index, (i, j) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        block = tests[:, i:j]
        normal[index] = block @ columns[:, i:j].T
        right[index] = block @ residual[i:j]
    normal /= shape
    right /= sizes
    total = normal.sum(axis=0)
    singular = np.linalg.svd(total, compute_uv=False)
    weakest = max(singular[-1], _NOTHING * singular[0], np.finfo(float).tiny)
    condition = float(np.sqrt(singular[0] / weakest))
    if instruments is None:
        inverse = symmetric_inverse(total, _SINGULAR)
        # The fit without a block differs from the whole one by -(A - A_i)⁺ c_i.
        lost = np.einsum("ijk,ik->ij", symmetric_inverse(total - normal, _SINGULAR), right)
        shifts = np.sqrt((count - 1) / count) * lost
    else:
        inverse = np.asarray(np.linalg.pinv(total, rcond=_SINGULAR), dtype=np.float64)
        shifts = _halfway(inverse, normal, right)
        inverse = inverse @ (tests @ tests.T / np.outer(sizes, sizes)) @ inverse.T
    # Nuisance columns take up their part of the signal, so only the rest can mislead.
    power = float(signal @ signal)
    if keep < norms.size:
        seen = columns[keep:] @ signal / norms[keep:]
        rest = columns[keep:] @ columns[keep:].T / np.outer(norms[keep:], norms[keep:])
        power -= float(seen @ symmetric_inverse(rest, _SINGULAR) @ seen)
    floor = UNKNOWN_FORCE**2 * max(power, 0.0) * inverse
    covariance = (shifts.T @ shifts + floor) / np.outer(norms, norms)
    # Rounding may leave the variance of what nothing tells a little below zero.
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), 0.0))
    return Spread(
        covariance=covariance[:keep, :keep],
        degrees_of_freedom=float(count - 1),
        condition=condition,
        inflation=np.diag(inverse)[:keep],
    )


def _halfway(inverse: FloatArray, blocks: FloatArray, right: FloatArray) -> FloatArray:
    """(I - A⁻¹A_i)^(-1/2)·A⁻¹c_i: between what a block adds and what leaving it out would change.

    A block has taken part of its own noise; the first is too small for it and the second too large
    (Bell and McCaffrey, Survey Methodology 28, 2002, p. 169). A is the sum of the blocks A_i; c_i,
    on the right, what each makes of the residual; shape (blocks, p).
    """
    rest, back = np.linalg.eig(np.eye(len(inverse)) - inverse @ blocks)
    forth = np.einsum("ijk,ik->ij", np.linalg.pinv(back), right @ inverse.T)
    # A direction that one block alone tells has no residual there.
    kept = np.abs(rest) > _SINGULAR
    magnified = np.where(kept, 1 / np.sqrt(np.where(kept, rest, 1.0).astype(complex)), 0.0)
    return np.asarray(np.einsum("ijk,ik->ij", back, magnified * forth).real, dtype=np.float64)


def _norms(columns: FloatArray) -> FloatArray:
    norms = np.sqrt(np.einsum("ij,ij->i", columns, columns))
    return np.where(norms > 0, norms, 1.0)


#: A log is looked at in so many parts at most, which hold the lines that matter.
_POSITION_PARTS = 512
#: Lines of the residual, from the lowest on, that tell the force from position noise.
_LINES = 64
#: Variances tried, from so little of the position noise in the line that shows most of it to so
#: much, each this many times the one before: its root, which intervals go by, is right to 7 %.
_LEAST, _MOST, _RATIO = 1e-3, 1e9, 1.15
#: Directions this much weaker than the strongest carry nothing but rounding.
_SPANNED = 1e-10


def process_noise_covariance(
    jacobian: FloatArray, residual: FloatArray, keep: int, *, mass: float, rate: float, step: float
) -> FloatArray:
    """What a white force adds to the covariance of a fit of positions; docs/theory.md, 7."""
    rows = residual.size
    parts = min(rows, _POSITION_PARTS)
    starts = np.linspace(0, rows, parts, endpoint=False).astype(np.intp)
    counts = np.diff(starts, append=rows)
    unit, norms = unit_columns(jacobian.T)
    sums = np.add.reduceat(unit.T, starts, axis=1)
    push = StepResponse.during(step * rows / parts, max(rate, 0.0))
    variance = _variance(sums / counts, np.add.reduceat(residual, starts) / counts, push, mass)
    inverse = symmetric_inverse(unit.T @ unit, _SPANNED)[:keep]
    moved = _pushed(inverse @ sums / norms[:keep, None], push, mass)
    return variance * moved @ moved.T


def _pushed(weights: FloatArray, push: StepResponse, mass: float) -> FloatArray:
    """Weights of forces, held for a part of a log each, in sums of positions with these weights."""
    speed, place, decay = float(push.speed), float(push.place), float(push.decay)
    turned = recursive(weights[..., ::-1], -1.0 - decay, decay)
    forces = np.zeros_like(turned)
    forces[..., 1:] = place / mass * turned[..., :-1]
    forces[..., 2:] += (speed * speed - place * decay) / mass * turned[..., :-2]
    return forces[..., ::-1]


def _variance(columns: FloatArray, residual: FloatArray, push: StepResponse, mass: float) -> float:
    """The likeliest variance of a force held for one part each, beside columns the fit took up."""
    parts = residual.size
    line = np.arange(1, min(_LINES, parts // 2) + 1)[:, None]
    lines = np.cos(np.pi * line * (np.arange(parts) + 0.5) / parts)
    taken = _directions(unit_columns(columns.T)[0].T, 1.0)
    seen = _directions(lines - (lines @ taken.T) @ taken, parts / 2)
    if not seen.size:
        return 0.0
    forces = _pushed(seen, push, mass)
    shares, axes = np.linalg.eigh(forces @ forces.T)
    power = (axes.T @ (seen @ residual)) ** 2
    rest = parts - len(taken) - len(seen)
    noise = (float(residual @ residual) - float(np.sum(power))) / max(rest, 1)
    if not (noise > 0 and shares[-1] > 0):
        return 0.0
    steps = int(np.log(_MOST / _LEAST) / np.log(_RATIO))
    tried = np.concatenate(([0.0], _LEAST * _RATIO ** np.arange(steps))) * noise / shares[-1]
    level = noise + tried[:, None] * np.maximum(shares, 0.0)
    likelihood = -np.sum(np.log(level) + power / level, axis=1)
    return float(tried[np.argmax(likelihood)])


def _directions(rows: FloatArray, power: float) -> FloatArray:
    """Orthonormal rows of the same span; ``power`` is that of a row that lost nothing."""
    powers, mixed = np.linalg.eigh(rows @ rows.T)
    strong = powers > _SPANNED * power
    return (mixed[:, strong] / np.sqrt(powers[strong])).T @ rows


def half_width(estimate: Estimate, name: str) -> float:
    """Half of the 95 % interval of one parameter: Student's t with the covariance's freedom."""
    return quantile(estimate) * estimate.deviation(name)


def quantile(estimate: Estimate, confidence: float = 0.95) -> float:
    """Half-width of an interval in standard deviations."""
    from scipy.special import stdtrit

    return float(stdtrit(estimate.degrees_of_freedom, (1 + confidence) / 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class PointEstimate:
    """A point estimate: values without intervals."""

    values: FloatArray  # of the parameters, shape (p,)
    delay: float  # s, given or fitted
    signal: FloatArray  # what was to be explained, shape (rows,)
    residual: FloatArray  # what was not, shape (rows,)

    @property
    def explained(self) -> float:
        """Share of the mean square of the signal that is not in the residual."""
        power = float(self.signal @ self.signal)
        return 1 - float(self.residual @ self.residual) / power if power > 0 else 0.0


#: The square of the difference by its variance, of two parameters, that chance exceeds as often as
#: a normal variable three of its deviations: -2·log(0.0027).
CONTRADICTED = 11.83
#: Each variance is known to some 18 % (sixty blocks left out in turn), so their difference is not
#: told from zero below this part of the larger one.
_RESOLVED = 0.25
_FAR = 1e6  # deviations beyond which it does not matter how many they are


def wald(values: FloatArray, covariance: FloatArray) -> float:
    """Wald's statistic of some parameters, χ² if they are nothing."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0, size, np.inf)
    unit = values / size
    inverse = np.linalg.pinv(covariance / np.outer(size, size), hermitian=True)
    return float(unit @ inverse @ unit)


def region(estimate: Estimate) -> float:
    """Area of the joint region of mass and damping, up to a factor all estimates share."""
    joint = estimate.covariance[:2, :2]
    return float(np.sqrt(max(np.linalg.det(joint), 0.0)))


def statistic(efficient: Estimate, robust: Estimate) -> float:
    """Square of the difference of mass and damping by its variance; χ² of 2 if the model is right.

    Hausman's test (Econometrica 46, 1978, p. 1251): where the model is right, the variance of their
    difference is the difference of their variances. In directions in which the efficient one is not
    the sharper of the two, the largest variance that their difference can have is taken.
    """
    size = np.sqrt(np.maximum(np.diag(robust.covariance)[:2], np.finfo(float).tiny))
    scale = np.outer(size, size)
    apart = (efficient.values[:2] - robust.values[:2]) / size
    values, vectors = np.linalg.eigh(robust.covariance[:2, :2] / scale)
    # Directions in which the robust variance is 1; one that rounding left without any keeps a bit.
    axes = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    shares, turned = np.linalg.eigh(axes.T @ (efficient.covariance[:2, :2] / scale) @ axes)
    shares = np.maximum(shares, 0.0)
    moved = (axes @ turned).T @ apart
    deviation = np.where(
        shares < 1, np.sqrt(np.maximum(1 - shares, _RESOLVED)), 1 + np.sqrt(shares)
    )
    return float(np.sum(np.minimum(np.abs(moved) / deviation, _FAR) ** 2))


def contradiction(efficient: Estimate, robust: Estimate) -> str:
    """What an efficient estimate says that a robust one excludes; "" if it excludes nothing."""
    if statistic(efficient, robust) <= CONTRADICTED:
        return ""
    return ", ".join(
        f"{name} {efficient.value(name):.4g} instead of {robust.value(name):.4g}"
        for name in ("mass", "damping")
    )
