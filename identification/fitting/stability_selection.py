"""Stability selection: which terms a log asks for beyond mass and damping, by sparse regression.

It never gives mass or damping. Every column is brought to unit mean square, so that no
unit decides. The log is cut into blocks; the fits with one block left out give the covariance of
the candidates whatever the colour of the residual, and the fits to random halves
of the blocks show which terms are asked for again and again (stability selection: Meinshausen and
Bühlmann, Journal of the Royal Statistical Society B 72, 2010, p. 417, in complementary halves:
Shah and Samworth, ibid. 75, 2013, p. 55). pysindy judges each half, in coordinates in which the
errors are independent.

A term is asked for if most halves ask for it, if the whole log does so by a margin that chance
does not reach, and if it is a noticeable part of the force.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import UNKNOWN_FORCE, symmetric_inverse
from identification.estimators.filters import width_of
from identification.estimators.least_squares import Regression
from identification.estimators.signals import HeldColumn

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Always part of the model, never judged.
_ALWAYS = ("mass", "damping")
#: Columns of a constant force and of the position.
_OFFSET, _POSITION = "force_offset", "position_stiffness"
#: Stand and fall together: moving the zero of the angle turns one into the other.
_GRAVITY = ("gravity_sine", "gravity_cosine")
#: A candidate is judged if at least this part of its column is not made up of mass, damping and
#: the candidates before it; 2 % lets sine and cosine in from a half range of some 0.7 rad.
_DISTINCT = 0.02
#: A position this many times further from zero than its own spread is counted from its middle:
#: the zero of such an encoder is an accident, and its column would only repeat the offset.
_FAR = 10.0
#: Size of the anchor's column and answer: dropping it would cost this much squared, more than any
#: other term, so pysindy never empties the model and never spends a step on the anchor.
_ANCHOR = 1e3
#: Blocks a log is cut into: a block of a usual log outlasts the filter many times, and the
#: covariance of seven candidates needs several times their number.
BLOCKS = 60
#: Correlation of neighbouring blocks above this is taken as this: beyond it sixty blocks cannot
#: tell a slow disturbance from a constant.
_MOST_CORRELATED = 0.9
#: Random halves of the log that are looked at, in complementary pairs: frequencies in steps of
#: 1/20, and pysindy takes some six milliseconds for each.
HALVES = 20
_SEED = 0
#: A half asks for a term worth this many of its own standard deviations.
HALF_HURDLE = 2.5
#: A term is stable if this part of the halves asks for it; without a force behind it a half does
#: so once in eighty times.
STABLE = 0.7
#: The whole log must ask with this many standard deviations: about once in 3000 by chance with
#: Student's t of 59 degrees of freedom, for each of some five candidates.
_HURDLE = 3.8
#: A term below this part of the rms force is not asked for however sure it is: amplifiers and
#: calibrations are no better, and mass and damping hardly notice.
_LEAST_SHARE = 0.01
#: Part of the mean square of a smoothed velocity that may be noise of position.
_SPEED_NOISE = 1e-4
#: Names in the report.
_WORDS = {
    "coulomb_friction": "Coulomb friction",
    _OFFSET: "a constant force or friction that differs by direction",
    _POSITION: "a force in proportion to position",
    "damping_asymmetry": "damping that differs by direction",
    "quadratic_drag": "drag with the square of speed",
    _GRAVITY[0]: "gravity with the sine of the angle",
    _GRAVITY[1]: "gravity with its cosine",
}


def scale_to_unit_rms(column: FloatArray) -> FloatArray:
    """A column over its rms, found without overflow whatever the unit; zeros stay zero."""
    largest = float(np.max(np.abs(column)))
    if largest == 0:
        return column
    moderate = column / largest
    return moderate / np.sqrt(np.mean(moderate**2))


def _distinguishable_columns(
    table: Mapping[str, FloatArray],
) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """The candidates this motion can tell apart, and the names of those it cannot.

    Columns are normalised, the simplest candidate first. What stands or falls as one is a tuple of
    names: a candidate, or _GRAVITY.
    """
    basis = [_rest(table[name], []) for name in _ALWAYS]
    groups: list[tuple[str, ...]] = []
    unjudged: list[str] = []
    pair = tuple(name for name in _GRAVITY if name in table)
    for name in table:
        if name in _ALWAYS or name in pair[1:]:
            continue
        group = pair if name in pair else (name,)
        extended = list(basis)
        for each in group:
            extended.append(_rest(table[each], extended))
        if all(np.any(new) for new in extended[len(basis) :]):
            basis = extended
            groups.append(group)
        else:
            unjudged += group
    return groups, tuple(unjudged)


def _from_its_middle(position: FloatArray, constant: FloatArray) -> FloatArray:
    """The position less its mean, if that is _FAR away; a constant that rests where it does."""
    length = float(constant @ constant)
    middle = float(position @ constant) / length if length > 0 else 0.0
    centred = position - middle * constant
    spread = float(np.linalg.norm(centred))
    return centred if abs(middle) * np.sqrt(length) > _FAR * spread else position


def _rest(column: FloatArray, basis: Sequence[FloatArray]) -> FloatArray:
    """Unit vector of what is left of a column beside orthonormal ones; zero if below _DISTINCT."""
    length = float(np.linalg.norm(column))
    left = column
    # Twice, because the first pass leaves rounding errors along the basis.
    for _ in range(2):
        for unit in basis:
            left = left - (unit @ left) * unit
    remaining = float(np.linalg.norm(left))
    return left / remaining if remaining > _DISTINCT * length else np.zeros_like(column)


def paying_terms(whitened: FloatArray, answers: FloatArray, price: float) -> BoolArray:
    """Which terms each answer asks for, by stepwise sparse regression, shape (answers, terms).

    pysindy's SSR (Boninsegna, Nüske, Clementi, Journal of Chemical Physics 148, 2018, 241723) drops
    one term after the other, always the one that is missed least, and keeps the model with the
    least χ² + price · terms on the way. Rows have independent errors with variance 1, so a rise of
    the squared residual is the χ² of what was dropped.
    """
    from pysindy import SSR
    from sklearn import config_context

    rows, count = whitened.shape
    # Columns of unit norm for the solver's sake. pysindy always keeps one term: the anchor, which
    # stands for mass and damping.
    columns = np.zeros((rows + 1, count + 1))
    columns[:rows, :count] = whitened / np.linalg.norm(whitened, axis=0)
    columns[rows, count] = 1.0
    anchor = _ANCHOR + np.linalg.norm(answers, axis=0)
    anchored = np.vstack((answers, anchor))
    # Without a charge of its own pysindy notes the squared residual of every model on the way. Its
    # own charge counts coefficients that are not zero, so a term whose coefficient happens to be
    # exactly zero would come free, and the model that holds it would be the best.
    search = SSR(alpha=0.0, kappa=0.0, criteria="model_residual", max_iter=count + 1, unbias=False)
    charges = price * np.arange(count, -1, -1, dtype=np.float64)
    chosen = np.zeros((answers.shape[1], count), dtype=bool)
    # scikit-learn, on which pysindy rests, would spend half of the time on checking arguments.
    # A warning that two terms are alike says what dropping one of them finds anyway.
    with config_context(skip_parameter_validation=True), catch_warnings():
        simplefilter("ignore")
        for index, answer in enumerate(anchored.T):
            search.fit(columns, answer[:, None])
            best = int(np.argmin(np.add(search.err_history_, charges)))
            # pysindy 2.1 overwrites the coefficients of the first model, the one with every term,
            # while it drops terms.
            chosen[index] = best == 0 or search.history_[best][0, :count] != 0
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class Resampled:
    """Coefficients of the candidates, of the whole log and of parts."""

    coefficients: FloatArray  # shape (p,), of the candidates, all in
    covariance: FloatArray  # shape (p, p), by leaving out one block in turn
    #: shape (p, p), W with WᵀW = covariance⁻¹: in W·coefficients errors are independent
    root: FloatArray
    gram: FloatArray  # shape (p, p), mean products of the candidates' columns
    normals: FloatArray  # shape (blocks, q, q), nuisance first
    rights: FloatArray  # shape (blocks, q)

    def halves(self) -> FloatArray:
        """Coefficients of random halves of the blocks, complementary in pairs, (HALVES, p)."""
        generator = np.random.default_rng(_SEED)
        blocks = len(self.normals)
        middle = blocks // 2
        parts: list[NDArray[np.intp]] = []
        for _ in range(HALVES // 2):
            order = generator.permutation(blocks)
            parts += [order[:middle], order[middle:]]
        nuisance = self.rights.shape[1] - self.coefficients.size
        return np.stack(
            [
                least_norm(self.normals[part].sum(axis=0), self.rights[part].sum(axis=0))[nuisance:]
                for part in parts
            ]
        )

    def only(self, members: list[int]) -> tuple[FloatArray, float]:
        """The fit with some candidates only: coefficients, shape (len(members),), and the rise χ².

        Generalised least squares from the fit with all of them.
        """
        target = self.root @ self.coefficients
        if not members:
            return np.empty(0), float(target @ target)
        columns = self.root[:, members]
        fitted = least_norm(columns, target)
        missed = target - columns @ fitted
        return fitted, float(missed @ missed)


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockSums:
    """Normal equations of consecutive blocks, from which any columns are fitted at once."""

    normals: FloatArray  # shape (blocks, q, q)
    rights: FloatArray  # shape (blocks, q)
    rows: int  # of the whole log
    square: float  # sum of squares of the answer

    def fit(self, members: list[int]) -> tuple[FloatArray, FloatArray]:
        """Least squares on some columns: coefficients, shape (p,), and covariance, (p, p).

        The covariance is that of leaving out one block in turn, whatever the colour of the
        residual, plus that of a force nobody knows.
        """
        normals = self.normals[:, members][:, :, members]
        rights = self.rights[:, members]
        total = normals.sum(axis=0)
        fitted = least_norm(total, rights.sum(axis=0))
        scores = rights - normals @ fitted
        # The fit without block i differs from the whole fit by -(A - A_i)⁺ c_i.
        shifts = (symmetric_inverse(total - normals) @ scores[:, :, None])[:, :, 0]
        floor = UNKNOWN_FORCE**2 * self.rows * symmetric_inverse(total)
        return fitted, _long_run(shifts) + floor

    def resampled(self, members: list[int], *, nuisance: int) -> Resampled:
        """The fit of some columns and of its parts; the first few are no candidates."""
        fitted, covariance = self.fit(members)
        normals, rights = self.normals[:, members][:, :, members], self.rights[:, members]
        return Resampled(
            coefficients=fitted[nuisance:],
            covariance=covariance[nuisance:, nuisance:],
            root=_root_of_inverse(covariance[nuisance:, nuisance:]),
            gram=normals.sum(axis=0)[nuisance:, nuisance:] / self.rows,
            normals=normals,
            rights=rights,
        )

    def left(self, members: list[int]) -> float:
        """Mean square of the answer that least squares on some columns leaves over."""
        right = self.rights[:, members].sum(axis=0)
        total = self.normals.sum(axis=0)[np.ix_(members, members)]
        return max(0.0, self.square - float(least_norm(total, right) @ right)) / self.rows


def sums_of(columns: FloatArray, answer: FloatArray) -> BlockSums:
    """Normal equations of BLOCKS blocks, of columns and an answer of mean square 1."""
    edges = np.linspace(0, answer.size, BLOCKS + 1).astype(int).tolist()
    return BlockSums(
        normals=np.stack([columns[i:j].T @ columns[i:j] for i, j in pairwise(edges)]),
        rights=np.stack([columns[i:j].T @ answer[i:j] for i, j in pairwise(edges)]),
        rows=answer.size,
        square=float(answer @ answer),
    )


def _long_run(shifts: FloatArray) -> FloatArray:
    """Covariance of a sum of shifts that are correlated from block to block, shape (q, q).

    Bartlett's weights (Newey and West, Econometrica 55, 1987, p. 703) up to the distance that is
    best for a first-order process (Andrews, Econometrica 59, 1991, p. 834).
    """
    blocks = len(shifts)
    power = np.sum(shifts * shifts, axis=0)
    crossed = np.sum(shifts[1:] * shifts[:-1], axis=0)
    correlation = float(np.max(crossed / np.where(power > 0, power, 1.0)))
    correlation = min(max(correlation, 0.0), _MOST_CORRELATED)
    memory = 4 * correlation**2 / (1 - correlation**2) ** 2
    reach = int(1.1447 * (memory * blocks) ** (1 / 3))
    total = shifts.T @ shifts
    for distance in range(1, reach + 1):
        later = shifts[distance:].T @ shifts[:-distance]
        total += (1 - distance / (reach + 1)) * (later + later.T)
    return (blocks - 1) / blocks * total


def least_norm(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution of least norm; a half of a log may lack a term altogether."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


def _root_of_inverse(covariance: FloatArray) -> FloatArray:
    """W with WᵀW the inverse of a covariance."""
    deviations = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    return (vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))).T / deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """On one candidate; sine and cosine of gravity share theirs."""

    asked: bool  # whether the log asks for it
    frequency: float  # part of the halves of the log that ask for it, 0 to 1
    share: float  # its rms over that of the force, in the model of the terms asked for and itself


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """What the log asks for beyond mass and damping."""

    asked: tuple[str, ...]  # names of the terms asked for, in the order of the columns
    sentences: tuple[str, ...]  # for the report


@dataclass(frozen=True, slots=True, kw_only=True)
class _Term:
    """What stands or falls as one: a candidate, or sine and cosine of gravity."""

    names: tuple[str, ...]  # of its columns
    members: tuple[int, ...]  # their places among the candidates


def suggest(columns: Mapping[str, FloatArray], force: FloatArray) -> Structure:
    """Terms the log asks for.

    Mass and damping are in the model anyhow; the other columns are candidates, the simplest first:
    of two that the motion cannot tell apart, the first is judged. Sine and cosine of gravity are
    one candidate, and take the place of "position_stiffness" where they explain the log better.
    """
    counted = dict(columns)
    if _OFFSET in counted and _POSITION in counted:
        counted[_POSITION] = _from_its_middle(counted[_POSITION], counted[_OFFSET])
    table = {name: scale_to_unit_rms(column) for name, column in counted.items()}
    groups, unjudged = _distinguishable_columns(table)
    if not groups:
        return Structure(asked=(), sentences=tuple(_sentences({}, unjudged)))
    places = iter(range(len(table)))
    terms = [_Term(names=group, members=tuple(next(places) for _ in group)) for group in groups]
    names = [name for group in groups for name in group]
    matrix = np.stack([table[name] for name in (*_ALWAYS, *names)], axis=1)
    sums, every = sums_of(matrix, scale_to_unit_rms(force)), list(range(matrix.shape[1]))
    fits = sums.resampled(every, nuisance=len(_ALWAYS))
    terms, doubt = _one_law_of_position(terms, fits)
    frequency = _frequencies(terms, fits)
    kept = _kept([term for term in terms if frequency[term.names] >= STABLE], fits)
    verdicts = {
        term.names: Verdict(
            asked=term in kept,
            frequency=frequency[term.names],
            share=_share(term, kept, fits),
        )
        for term in terms
    }
    sentences = list(_sentences(verdicts, unjudged))
    if doubt and any(term.names == (_POSITION,) for term in kept):
        sentences.append("gravity would explain the force in proportion to position about as well")
    return Structure(
        asked=tuple(name for term in kept for name in term.names), sentences=tuple(sentences)
    )


def _one_law_of_position(terms: list[_Term], fits: Resampled) -> tuple[list[_Term], bool]:
    """Terms with either position or gravity, and whether that is in doubt.

    Over a small range the two are alike; gravity, which is richer, must explain more by as much as
    a term must be worth.
    """
    position = next((term for term in terms if term.names == (_POSITION,)), None)
    gravity = next((term for term in terms if term.names == _GRAVITY), None)
    if position is None or gravity is None:
        return terms, False
    gain = _chi_square(gravity, terms, fits) - _chi_square(position, terms, fits)
    passed = position if gain > _HURDLE**2 else gravity
    return [term for term in terms if term != passed], bool(abs(gain) <= _HURDLE**2)


def _frequencies(terms: Sequence[_Term], fits: Resampled) -> dict[tuple[str, ...], float]:
    """Part of the halves in which pysindy asks for each term."""
    # A half knows each term with twice the variance of the whole.
    root = fits.root / np.sqrt(2)
    answers = root @ fits.halves().T
    members = _members(terms)
    picked = paying_terms(root[:, members], answers, HALF_HURDLE**2)
    frequency: dict[tuple[str, ...], float] = {}
    for term in terms:
        first = members.index(term.members[0])
        either = picked[:, first : first + len(term.members)].any(axis=1)
        frequency[term.names] = float(np.mean(either))
    return frequency


def _members(terms: Iterable[_Term]) -> list[int]:
    return [place for term in terms for place in term.members]


def _chi_square(term: _Term, kept: Sequence[_Term], fits: Resampled) -> float:
    """χ² between the kept terms with and without this one, which need not be among them."""
    others = [each for each in kept if each != term]
    return max(0.0, fits.only(_members(others))[1] - fits.only(_members([*others, term]))[1])


def _share(term: _Term, kept: Sequence[_Term], fits: Resampled) -> float:
    """Rms of a term over the rms of the force, in the model of the kept terms and this one."""
    others = [each for each in kept if each != term]
    coefficients = fits.only(_members([*others, term]))[0][-len(term.members) :]
    gram = fits.gram[np.ix_(term.members, term.members)]
    return float(np.sqrt(coefficients @ gram @ coefficients))


def _kept(terms: Sequence[_Term], fits: Resampled) -> list[_Term]:
    """The terms that the whole log asks for: sure and large enough, the weakest dropped first."""
    kept = list(terms)
    while kept:
        weakest = min(kept, key=lambda term: _chi_square(term, kept, fits))
        smallest = min(kept, key=lambda term: _share(term, kept, fits))
        if _chi_square(weakest, kept, fits) < _HURDLE**2:
            kept.remove(weakest)
        elif _share(smallest, kept, fits) < _LEAST_SHARE:
            kept.remove(smallest)
        else:
            break
    return kept


def _sentences(
    verdicts: Mapping[tuple[str, ...], Verdict], unjudged: tuple[str, ...]
) -> Iterable[str]:
    asked = [
        f"{_plain(names)} ({verdict.share:.1%} of the force, asked for by "
        f"{verdict.frequency:.0%} of the halves of the log)"
        for names, verdict in verdicts.items()
        if verdict.asked
    ]
    refused = [_plain(names) for names, verdict in verdicts.items() if not verdict.asked]
    if asked:
        yield f"beyond mass and damping the log asks for {'; '.join(asked)}"
    else:
        yield "the log asks for nothing beyond mass and damping"
    if refused:
        yield f"it does not ask for {', '.join(refused)}"
    if unjudged:
        yield (
            f"this motion cannot tell {_plain(unjudged)} from the other terms; "
            "a log of more range and more frequencies might"
        )


def _plain(names: tuple[str, ...]) -> str:
    return "gravity" if names == _GRAVITY else " and ".join(_WORDS.get(n, n) for n in names)


def structure_of(table: Regression, delay: float, *, rotary: bool) -> Structure | None:
    """Which terms one log asks for beyond mass and damping; None if the log is too short to tell.

    The regression was prepared with Coulomb friction, which settles the direction of motion and
    where the device stands; gravity may go with sine and cosine of a rotary position.
    """
    columns, force = candidate_columns(table, rotary=rotary), table.force(delay)
    # With fewer rows a block could not tell the terms apart.
    long_enough = force.size >= BLOCKS * (len(columns) + 1)
    return suggest(columns, force) if long_enough and np.any(force) else None


def candidate_columns(table: Regression, *, rotary: bool) -> dict[str, FloatArray]:
    """Every term of the equation of motion by its name, the simplest first, each shape (rows,).

    Where the device stands still every column is zero, as static friction takes up the rest.
    """
    signals, motion = table.signals, table.motion
    position = signals.position

    def held(values: FloatArray) -> FloatArray:
        return table.filtered(HeldColumn.constant(values * motion.moving, signals.steps))

    def between(samples: FloatArray) -> FloatArray:
        return held((samples[1:] + samples[:-1]) / 2)

    columns = {
        "mass": table.columns[0],
        "damping": table.columns[1],
        "force_offset": held(np.ones_like(signals.speed)),
        "coulomb_friction": table.filtered(motion.direction),
        "position_stiffness": between(position),
        # The direction is a smooth one, so noise of the velocity is not rectified.
        "damping_asymmetry": held(motion.direction.mean() * signals.speed),
    }
    if rotary:
        columns["gravity_sine"] = between(np.sin(position))
        columns["gravity_cosine"] = between(np.cos(position))
    columns["quadratic_drag"] = held(np.abs(smooth_speed(table)) * signals.speed)
    return columns


def smooth_speed(table: Regression) -> FloatArray:
    """Velocity of each interval, as smooth as noise of position asks for and no more.

    White noise of deviation σ has σ²·h/(4·√π·w³) of variance in the velocity under a bell of
    deviation w. The low-pass of the table, which is set by the acceleration, is the widest.
    """
    from scipy.ndimage import gaussian_filter1d

    signals = table.signals
    noisy = signals.noise**2 * signals.step / (4 * np.sqrt(np.pi) * _SPEED_NOISE)
    width = (
        min(float(np.cbrt(noisy / np.var(signals.speed))), width_of(table.cut_off.frequency))
        / signals.step
    )
    return np.asarray(gaussian_filter1d(signals.speed, width, mode="nearest"), dtype=np.float64)
