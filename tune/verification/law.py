"""What a log may be of, what is found of it, and the control law on its rows.

The logged force is a function of the logged positions, or it is not:
F[k] = -s·(K·y + B·v + M·a) + offset, v and a by the very filters of a profile on the positions of
the log. The offset is where the spring is relaxed. The filters run on every reading, from rest at
the first; where the handle moves then, what they remember from before the log has to die away.
Cut-offs with which the law explains the force as well are the interval that the log tells of a
filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification import UsageError
from tune.documents.estimators import Derivative, Estimator
from tune.documents.profile import Design, LoopProfile
from tune.documents.scene import EFFECT_NAMES, Effects
from tune.loop.loop import Filters, filters_of
from tune.loop.polynomials import FloatArray
from tune.verification.free_motion import projected

Rows = NDArray[np.bool_]
Verdict = Literal["agrees", "disagrees", "cannot tell", "not assessed"]
Combination = tuple[str, ...]

#: Joins the elements of one combination, on the command line and in sentences.
_AND = "+"


def combinations_of(profile: Design, element: str | None) -> tuple[Combination, ...]:
    """Every combination the log may be of, or the one named "wall" or "wall+water".

    One with an element that gives no force plays what the others of it play. Raises UsageError.
    """
    every = profile.combinations()
    summary = tuple(
        combination
        for combination in every
        if all(profile.elements[name].acting for name in combination)
        and effects_of(profile, combination).present()
    )
    if element is None:
        return summary
    wanted = frozenset(element.split(_AND))
    found = tuple(combination for combination in every if frozenset(combination) == wanted)
    if not found or found[0] not in summary:
        known = ", ".join(combination_in_words(combination) for combination in summary)
        problem = "has an element that gives no force" if found else "is not in the profile"
        raise UsageError("--element", f"'{element[:80]}' {problem}", f"Choose from {known}")
    return found


def effects_of(profile: Design, combination: Combination) -> Effects:
    """The sum of the effects of a combination; what sums to zero is not there."""
    elements = [profile.elements[name] for name in combination]
    sums = (sum(float(getattr(each, effect)) for each in elements) for effect in EFFECT_NAMES)
    return Effects(**dict(zip(EFFECT_NAMES, (value or None for value in sums), strict=True)))


def scale_effects(effects: Effects, gain: float) -> Effects:
    """Effects at a gain; what is not there stays away."""
    return Effects(**{name: float(size) * gain for name, size in effects.present().items()})


def combination_in_words(combination: Combination) -> str:
    """The name of a combination."""
    return _AND.join(combination)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One comparison of a log with its profile.

    It agrees or disagrees only where both sides were computed; it cannot tell where what is
    predicted is possible, and so is what must not be.
    """

    check: str  # what was compared, as `Verification` lists them
    verdict: Verdict
    seen: str  # what the log shows; the reason where nothing was assessed
    predicted: str = ""  # by the profile; "" where that was not computed
    tolerance: str = ""  # what is allowed between the two; "" likewise
    remedy: str = ""  # of a disagreement, or to have it assessed; "" otherwise
    # those in the words, by name, in the units of the words; parts of 1 for percent
    numbers: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def summary(self) -> str:
        """What was found, in one short line without the remedy."""
        if self.verdict == "not assessed":
            return f"{self.check}: not assessed: {self.seen}"
        return f"{self.check} {self.verdict}: {self.seen}; predicted: {self.predicted}"

    def __str__(self) -> str:
        allowed = "" if self.verdict == "not assessed" else f" ({self.tolerance})"
        return f"{self.summary}{allowed}. {self.remedy}".rstrip()


def compared(
    check: str, numbers: Mapping[str, float], *, agrees: bool, remedy: str = "", **words: str
) -> Outcome:
    """What was seen against what is predicted; the remedy is of a disagreement."""
    verdict = "agrees" if agrees else "disagrees"
    remedy = "" if agrees else remedy
    return Outcome(check=check, verdict=verdict, remedy=remedy, numbers=numbers, **words)


def unassessed_outcome(check: str, why: str, remedy: str = "", **numbers: float) -> Outcome:
    """Nothing is claimed, and why; with the numbers that the words name."""
    return Outcome(check=check, verdict="not assessed", seen=why, remedy=remedy, numbers=numbers)


#: Rows that are needed beyond those of the filters.
_FEWEST_ROWS = 20
#: A beginning slower than this part of the fastest motion is at rest.
_AT_REST = 0.01
#: Time constants after which a filter has forgotten: what is left is below single precision.
_FORGOTTEN = 20.0

#: Times that the face of a wall is found again at most.
_MOST_FACES = 40

#: χ² of one parameter at 99.9 %: a sum of squares that grows by this many variances rules out.
_CHI_SQUARE = 10.83
#: Rows that count as one, for what rounding leaves of slow positions is not white.
_ALIKE_ROWS = 20.0
#: Part of the force that is no residual at all.
_EXACT = 1e-6
#: The widest interval looked for: this many times below and above the stated cut-off; its ends are
#: found by so many halvings of the logarithm.
_WIDEST, _HALVINGS = 8.0, 24
#: An interval narrower than this part is one cut-off.
_THE_SAME = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Force, and position, velocity and acceleration, on the rows used, their means taken out.

    N, m, m/s and m/s², shape (n,); ``rows`` says which of the log these are.
    """

    force: FloatArray
    parts: tuple[FloatArray, ...]
    rows: Rows
    acting: Rows  # of the log: on which all that is played acts, and nothing is cut

    @property
    def scale(self) -> float:
        """rms of the force to be explained, N."""
        return rms(self.force)


@dataclass(frozen=True, slots=True, kw_only=True)
class LawFit:
    """The part of the effects that was played, and the force left over on the rows used, N."""

    gain: float
    residual: float  # rms, N
    left: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """A wall felt beside other elements, which act alone where it gives no force."""

    own: Effects
    others: Effects
    level: float  # at which its force is cut, N
    side: float  # 1.0 if it lies at higher positions, -1.0 if at lower
    part: float  # of the rows: so many, the deepest, are in it at first

    def felt(self, force: FloatArray, parts: list[FloatArray]) -> tuple[Rows, list[FloatArray]]:
        """(rows on which all act; parts of which all effects together make what is felt).

        Its face by least squares, force = -gain·(others + what its own has beyond it) + offset.
        """
        own, beside = (force_of(each, tuple(parts)) for each in (self.own, self.others))
        face = np.quantile(self.side * own, 1 - self.part)
        pushes, cut = np.ones(own.size, dtype=np.bool_), own
        for _ in range(_MOST_FACES):
            beyond = self.side * own - face
            pushes = (beyond > 0) & (beyond < self.level)
            cut = np.where(beyond < self.level, 0.0, self.side * self.level)
            law = np.column_stack((beside + pushes * own + cut, pushes, np.ones_like(own)))
            gain, at_face, _ = np.linalg.lstsq(law, force)[0]
            before, face = face, -self.side * at_face / (gain or 1.0)
            if face == before:
                break
        felt, more = list[FloatArray](), cut - pushes * self.side * face
        for part, *sizes in zip(parts, self.own.arrays(), self.others.arrays(), strict=True):
            mine, rest = (0.0 if size is None else float(size) for size in sizes)
            felt.append(((rest + pushes * mine) * part + more) / (rest + mine or 1.0))
            more = np.zeros_like(force)  # of the position alone
        return pushes, felt


@dataclass(frozen=True, slots=True, kw_only=True)
class Log:
    """What the law is judged on, N and m; rows used are not saturated, nor outside of a wall."""

    loop: LoopProfile  # whose filters forget what was before the log
    force: FloatArray
    position: FloatArray
    used: Rows
    wall: Wall | None = None  # of some rows only

    def columns(self, loop: LoopProfile, late: int = 0) -> Columns | None:
        """The regression of one variant of the law; None where too few rows are left.

        ``late`` is by how many rows the force column lags behind the position it answers.
        """
        warm = 2 + abs(late) + (loop.velocity_window_samples or 1)
        rows = np.zeros(self.force.size, dtype=np.bool_)
        for first, end in stretches(self.used & np.roll(self.used, -late)):
            rows[first + warm : max(first + warm, end - warm)] = True
        speed = np.abs(np.diff(self.position))
        if np.mean(speed[:warm]) > _AT_REST * speed.max():
            rows[: _forgetting(self.loop, _FORGOTTEN)] = False
        if np.count_nonzero(rows) < warm + _FEWEST_ROWS:
            return None

        def rest(column: FloatArray) -> FloatArray:
            return column - np.mean(column)

        every = np.roll(self.force, -late), self.position, *_estimates(self.position, loop)
        force, *parts = (rest(column[rows]) for column in every)
        acting = self.used
        if self.wall is not None:
            acting = np.zeros_like(rows)
            acting[rows], felt = self.wall.felt(force, parts)
            parts = map(rest, felt)
        return Columns(force=force, parts=tuple(parts), rows=rows, acting=acting)

    def asked(self, effects: Effects, judged: FloatArray) -> FloatArray:
        """The force of a law on every row, N, with the offset of those judged, which are no nan."""
        law = -force_of(effects, (self.position, *_estimates(self.position, self.loop)))
        return law + np.mean((self.force - law)[~np.isnan(judged)])


def fit_scaled(columns: Columns, effects: Effects) -> LawFit:
    """The one gain at which these effects explain the force best."""
    commanded = force_of(effects, columns.parts)
    energy = float(commanded @ commanded)
    gain = -float(commanded @ columns.force) / energy if energy > 0 else 0.0
    left = columns.force + gain * commanded
    return LawFit(gain=gain, residual=rms(left), left=left)


def fit_free(columns: Columns) -> tuple[Effects, float]:
    """(stiffness, damping and mass that explain the force best, bound to nothing; rms left, N)."""
    commanded, sizes = projected(np.column_stack(columns.parts), -columns.force)
    K, B, M = (float(each) for each in sizes)
    return Effects(stiffness=K, damping=B, mass=M), rms(columns.force + commanded)


@dataclass(frozen=True, slots=True, kw_only=True)
class Digits:
    """The last printed digits of a log, N and m; 0 where nothing is rounded."""

    force: float
    position: float

    def noise(self, effects: Effects, loop: LoopProfile) -> float:
        """rms of force that their rounding explains under a law, N."""
        knock = np.zeros(8 + (loop.velocity_window_samples or 0) + _forgetting(loop, 8.0))
        knock[1] = 1.0  # after one row of rest, so that the knock itself is a change
        gain = np.linalg.norm(force_of(effects, (knock, *_estimates(knock, loop))))
        return float(np.hypot(self.force, self.position * gain) / np.sqrt(12))


def _forgetting(loop: LoopProfile, constants: float) -> int:
    """Samples in so many time constants of the slowest filter."""
    cutoffs = [f for f in (loop.velocity_filter_hz, loop.acceleration_filter_hz) if f is not None]
    slowest = min(cutoffs, default=1 / loop.sample_time) * loop.filter_damping_ratio
    return int(constants / (2 * np.pi * slowest * loop.sample_time))


def rms(values: FloatArray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values * values)))


def stretches(rows: Rows) -> list[tuple[int, int]]:
    """(first, end) of every stretch of true rows, in order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.view(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def force_of(effects: Effects, parts: tuple[FloatArray, ...]) -> FloatArray:
    """K·y + B·v + M·a, N."""
    commanded = np.zeros_like(parts[0])
    for size, part in zip(effects.arrays(), parts, strict=True):
        if size is not None:
            commanded = commanded + size * part
    return commanded


def _estimates(position: FloatArray, loop: LoopProfile) -> tuple[FloatArray, FloatArray]:
    """(velocity, acceleration) of the control law, from rest at the first reading; m/s, m/s²."""
    from scipy.signal import lfilter

    change = np.diff(position, prepend=position[0]) / loop.sample_time
    again = np.diff(change, prepend=change[0]) / loop.sample_time

    def filtered(signal: FloatArray, which: Derivative) -> FloatArray:
        """docs/theory.md, 1."""
        behind = Estimator.of(loop, which, loop.sample_time)
        for section in (behind.first, behind.then):
            poles = [1.0, -section.t, section.p]
            signal = np.asarray(lfilter([section.gain], poles, signal), dtype=np.float64)
        return signal + behind.lead * np.diff(signal, prepend=signal[0])

    if loop.velocity_window_samples is not None:
        count = loop.velocity_window_samples
        velocity = np.asarray(lfilter(np.full(count, 1 / count), [1.0], change), dtype=np.float64)
    else:
        velocity = filtered(change, "velocity")
    return velocity, filtered(again, "acceleration")


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCutoff:
    """The least and the largest cut-off of a low-pass that explain the force as well, Hz."""

    name: str  # "velocity" or "acceleration"
    stated: float
    low: float
    high: float

    @property
    def outcome(self) -> Outcome:
        """The interval beside what is stated, which the law was recognised by."""
        return compared(
            f"{self.name} filter",
            {"seen_low": self.low, "seen_high": self.high, "predicted": self.stated},
            agrees=True,
            seen=f"{self.low:.5g} to {self.high:.5g} Hz",
            predicted=f"{self.stated:.5g} Hz",
            tolerance="the law with such a cut-off explains the force as well",
        )


def measured_cutoffs(log: Log, loop: LoopProfile, effects: Effects) -> tuple[MeasuredCutoff, ...]:
    """The interval of each cut-off in use, the other one as stated; effects are as played."""
    columns = log.columns(loop)
    if columns is None:
        return ()
    own = fit_scaled(columns, effects).residual
    rows = max(columns.force.size / _ALIKE_ROWS, 1.0)
    most = float(np.hypot(own * np.sqrt(1 + _CHI_SQUARE / rows), _EXACT * columns.scale))
    found: list[MeasuredCutoff] = []
    for name, size in (("velocity", effects.damping), ("acceleration", effects.mass)):
        key = f"{name}_filter_hz"
        stated: float | None = getattr(loop, key)
        if size is None or stated is None:
            continue

        def allowed(hertz: float, key: str = key) -> bool:
            columns = log.columns(loop.model_copy(update={key: hertz}))
            return columns is not None and fit_scaled(columns, effects).residual <= most

        nyquist = 0.5 / loop.sample_time
        low = _end(allowed, stated, stated / _WIDEST)
        high = _end(allowed, stated, min(stated * _WIDEST, nyquist))
        found.append(MeasuredCutoff(name=name, stated=stated, low=low, high=high))
    return tuple(found)


def allowed_filters(loop: LoopProfile, cutoffs: tuple[MeasuredCutoff, ...]) -> tuple[Filters, ...]:
    """The stated filters, and every corner of the intervals of their cut-offs."""
    every = [filters_of(loop)]
    for each in cutoffs:
        if each.high / each.low < 1 + _THE_SAME:
            continue
        key = f"{each.name}_filter_hz"
        ends = [{key: end} for end in (each.low, each.high)]
        every += [replace(filters, **end) for filters in every for end in ends]
    return tuple(every)


def _end(allowed: Callable[[float], bool], inside: float, outside: float) -> float:
    """Where allowing ends between a cut-off that is allowed and one far off."""
    if allowed(outside):
        return outside
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(inside * outside))
        inside, outside = (middle, outside) if allowed(middle) else (inside, middle)
    return outside
