"""The estimates of one prepared log, and which of them to believe, test after test.

Hausman's test tells whether an efficient and a robust estimate of one log say the same. Where the
model is right both are, and the efficient one leaves no error that the robust one could share: the
variance of their difference is the difference of their variances (Hausman, Econometrica 46, 1978,
p. 1251). So a robust answer that is hardly known contradicts nothing, and one that is as sharp as
the efficient one contradicts at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Protocol, cast

import numpy as np

from identification.device.quantities import Quantity
from identification.estimators import GIVEN_A_DELAY
from identification.estimators.estimate import NORMAL_95, Estimate, Model, PointEstimate
from identification.estimators.filters import is_coloured
from identification.estimators.least_squares import (
    CUT_OFF_RANGE,
    MOST_SAMPLES,
    Delay,
    Regression,
    find_delay,
    prepare,
)
from identification.findings.force_balance import balance_of
from identification.findings.forces import inertia_of
from identification.trajectory import Trajectory, encoder_count

_DELAY_STEP = 0.05  # change of delay, in samples, for the slope of the estimates over delay


class _Estimator(Protocol):
    """What every file of estimators has; least squares alone has to be given a delay."""

    def fit(self, table: Regression, delay: float | None, *, start: float = 0.0) -> Estimate: ...

    def point(
        self, table: Regression, delay: float | None, *, start: float = 0.0
    ) -> PointEstimate: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedLog:
    """A prepared log and its estimates."""

    trajectory: Trajectory  # the log
    table: Regression  # prepared regression; its model is that of every estimate
    rough: Regression  # the same before the delay was found and the direction of motion refined
    stated: Quantity | None  # delay of the hardware, or None
    found: Delay | None  # delay read from the log, or None if it was stated
    made: dict[str, Estimate] = field(default_factory=dict[str, Estimate])  # estimates by method

    @classmethod
    def of(cls, trajectory: Trajectory, model: Model, stated: Quantity | None) -> PreparedLog:
        """Find the delay, unless it is stated, and the direction of motion."""
        step = trajectory.sample_time
        # Forces from before the log are left out up to the longest delay that is looked at.
        room = MOST_SAMPLES * step if stated is None else stated.value + _DELAY_STEP * step
        return cls._begun(trajectory, prepare(trajectory, model, room, refine=False), stated)

    @classmethod
    def _begun(
        cls, trajectory: Trajectory, rough: Regression, stated: Quantity | None
    ) -> PreparedLog:
        found = find_delay(trajectory, rough) if stated is None else None
        delay = stated.value if stated is not None else found.value if found is not None else 0.0
        # From the first look on, where turns seen at other delays leave nothing behind.
        table = rough
        if found is not None:
            # A fitted delay may move by a sample; rows that know all forces until then are back.
            step = trajectory.sample_time
            table = rough.knowing(min(delay + step, MOST_SAMPLES * step))
        table = table.refined(delay)
        return cls(trajectory=trajectory, table=table, rough=rough, stated=stated, found=found)

    def widened(self, model: Model) -> PreparedLog:
        """This log with more terms: without them delay and direction may have gone astray."""
        return PreparedLog._begun(self.trajectory, self.rough.with_model(model), self.stated)

    def narrowed(self, model: Model) -> PreparedLog:
        """This log prepared with fewer terms, which the delay does not miss."""
        if model == self.model:
            return self
        table = self.table.with_model(model).refined(self.delay)
        return replace(self, table=table, made={})

    @property
    def delay(self) -> float:
        """Stated or found, s."""
        if self.stated is not None:
            return self.stated.value
        return 0.0 if self.found is None else self.found.value

    @property
    def doubt(self) -> float:
        """Standard deviation of the delay, s."""
        if self.stated is not None:
            return (self.stated.high - self.stated.low) / (2 * NORMAL_95)
        return 0.0 if self.found is None else self.found.deviation

    @property
    def model(self) -> Model:
        """Terms of every estimate."""
        return self.table.model

    @property
    def has_reference(self) -> bool:
        """Whether the log carries the set-point the device followed."""
        return self.table.signals.reference is not None

    def fit(self, method: str) -> Estimate:
        """The estimate of one method, made at most once."""
        return self.refit(method, self.model)

    def refit(self, method: str, model: Model) -> Estimate:
        """The estimate of one method with some terms."""
        if model != self.model:
            return self._of_table(self.table.with_model(model), method)
        if method not in self.made:
            self.made[method] = self._of_table(self.table, method)
        return self.made[method]

    def point(self, table: Regression, method: str) -> PointEstimate:
        """The point estimate of one method from this log with other terms or another filter."""
        if self._fits_delay(method):
            return _estimator(method).point(table, None, start=self.delay)
        return _estimator(method).point(table, self.delay)

    def _fits_delay(self, method: str) -> bool:
        return self.stated is None and method not in GIVEN_A_DELAY

    def _of_table(self, table: Regression, method: str) -> Estimate:
        """The estimate of one method from this log with other terms."""
        estimator = _estimator(method)
        if self._fits_delay(method):
            return estimator.fit(table, None, start=self.delay)
        fixed = estimator.fit(table, self.delay)
        if self.doubt == 0:
            return fixed
        # A delay of d looks like an added damping of -m·ω²·d: often most of the interval.
        step = _DELAY_STEP * self.trajectory.sample_time
        slope = (estimator.point(table, self.delay + step).values - fixed.values) / step
        added = self.doubt**2 * np.outer(slope, slope)
        return replace(fixed, covariance=fixed.covariance + added)


def _estimator(method: str) -> _Estimator:
    """The file of one method; only those that a log needs are loaded."""
    module = import_module(f"identification.estimators.{method.replace('-', '_')}")
    return cast("_Estimator", module)


_JUDGED = ("mass", "damping")  # what both methods are asked for
#: The square of the difference by its variance, of two parameters, that chance exceeds as often as
#: a normal variable three of its deviations: -2·log(0.0027).
CONTRADICTED = 11.83
#: Each variance is known to some 18 % (sixty blocks left out in turn), so their difference is not
#: told from zero below this part of the larger one.
_RESOLVED = 0.25
_FAR = 1e6  # deviations beyond which it does not matter how many they are


def region(estimate: Estimate) -> float:
    """Area of the joint region of mass and damping, up to a factor all estimates share."""
    joint = estimate.covariance[:2, :2]
    return float(np.sqrt(max(np.linalg.det(joint), 0.0)))


def statistic(efficient: Estimate, robust: Estimate) -> float:
    """Square of the difference of mass and damping by its variance; χ² of 2 if the model is right.

    In directions in which the efficient one is not the sharper of the two, nothing is known of
    what they share, and the largest variance their difference can have is taken.
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
        for name in _JUDGED
    )


#: A residual of at most this many counts rms is the encoder's own, whatever its colour: rounding
#: alone is 0.289, and it is not white where the device moves slowly.
_ENCODER_RESIDUAL = 0.295
#: Distance of a residual's cumulated spectrum from white up to which the intervals of output error
#: still hold, although an octave is in excess: what the model misses is then small beside noise.
_NEARLY_WHITE = 0.025
#: ... or this over the root of half its rows, which white noise exceeds once in a hundred times.
_WHITE_BY_CHANCE = 1.63
#: Methods whose answers are heard where another is believed; output error is then astray.
CONSULTED = ("innovations", "instruments")
#: Instruments whose joint region is this many times that of least squares have nothing to say
#: against an estimate that least squares would.
_POWERLESS = 2.0
#: Areas of two regions, each of jackknifed variances, are told apart below this ratio.
_SHARPER = 0.75


def noise_explains(prepared: PreparedLog) -> str | None:
    """A sentence if position noise explains what output error leaves, or None.

    Gravity is taken at the measured position, and what noise does to it is a force of its own.
    Where least squares give no positive mass there is nothing to start output error from.
    """
    if prepared.model.gravity != "none" or prepared.fit("least-squares").value("mass") <= 0:
        return None
    simulated = prepared.fit("output-error")
    if not is_coloured(simulated.residual):
        return "its residual is white in every octave"
    count = encoder_count(prepared.trajectory.position)
    counts = float(np.sqrt(np.mean(simulated.residual**2))) / (count or np.inf)
    if 0 < counts <= _ENCODER_RESIDUAL:
        return (
            f"its residual is {counts:.2f} encoder counts rms (at most {_ENCODER_RESIDUAL:g}), no "
            "more than rounding"
        )
    return None


def choose(prepared: PreparedLog, method: str, explained: str | None) -> tuple[Estimate, str]:
    """The estimate to believe and a sentence why."""
    regression = prepared.fit("least-squares")
    if method == "least-squares":
        return regression, "least squares as asked"
    if regression.value("mass") <= 0:
        return regression, "least squares, because it gives no positive mass to start others from"
    if method != "auto":
        return prepared.fit(method), f"{method.replace('-', ' ')} as asked"
    if prepared.model.gravity != "none":
        return robust(prepared, prepared.model)
    return _evident(prepared, explained)


def _evident(prepared: PreparedLog, explained: str | None) -> tuple[Estimate, str]:
    """Output error where position noise explains what it leaves, or nearly so."""
    if explained is not None and not _contradicted_by_instruments(prepared):
        return prepared.fit("output-error"), f"output error, because {explained}"
    chosen, reason = robust(prepared, prepared.model)
    simulated = prepared.fit("output-error")
    chance = _WHITE_BY_CHANCE / np.sqrt(simulated.residual.size / 2)
    mild = simulated.whiteness <= max(_NEARLY_WHITE, chance)
    if mild and region(simulated) < region(chosen) and not contradiction(simulated, chosen):
        return simulated, (
            f"output error, because its residual is only {simulated.whiteness:.2f} from white and "
            f"its intervals, which carry that, are narrower than those of {chosen.method}"
        )
    return chosen, reason


def _contradicted_by_instruments(prepared: PreparedLog) -> bool:
    """Whether a logged reference tells another mass or damping than output error."""
    if not prepared.has_reference:
        return False
    instrumental = prepared.fit("instruments")
    simulated = prepared.fit("output-error")
    return instrumental.value("mass") > 0 and bool(contradiction(simulated, instrumental))


def robust(prepared: PreparedLog, model: Model) -> tuple[Estimate, str]:
    """The estimate to believe where forces act that the log does not know.

    Innovations weigh every frequency by what it tells, so they are best where the model is right.
    Where it is not (friction that no sign of the velocity describes), they follow its errors at
    high frequencies; least squares stays where the motion is, and instruments from a logged
    reference are free, besides, of the noise that a feedback puts into the force. So the estimate
    that leans on least comes first, and another takes its place only if its joint region of mass
    and damping is no larger and Hausman's test finds no contradiction.
    """
    leaning_least = _robust_ones(prepared, model)
    judge, at_hand = leaning_least[0], _at_hand(leaning_least)
    predicted = prepared.refit("innovations", model)
    apart = contradiction(predicted, judge)
    sharper = predicted.value("mass") > 0 and region(predicted) <= region(at_hand)
    verdict = _verdict(prepared, predicted, at_hand) if sharper else ""
    if verdict:
        return (predicted if verdict == "innovations" else at_hand), (
            f"{verdict}, because the mass that rows at equal velocity tell contradicts the other"
        )
    if sharper and not apart:
        return predicted, (
            "innovations, because forces act that the log does not know: position noise does not "
            f"explain what output error leaves, and {_named(judge)} do not contradict"
        )
    why = "innovations know mass and damping less well"
    if apart:
        why = (
            f"innovations say {apart} of {_named(judge)}: the friction or another force is not "
            "what the model has"
        )
    if prepared.has_reference and len(leaning_least) == 1 and judge.method == "instruments":
        why += "; least squares, which noise in the force biases, contradict instruments"
    return at_hand, f"{_named(at_hand)}, because {why}"


def _at_hand(leaning_least: tuple[Estimate, ...]) -> Estimate:
    """Least squares where they are not contradicted, or instruments where those are sharper."""
    usual = max(leaning_least, key=lambda each: each.method == "least-squares")
    sharpest = min(leaning_least, key=region)
    return sharpest if region(sharpest) < _SHARPER * region(usual) else usual


def _verdict(prepared: PreparedLog, predicted: Estimate, at_hand: Estimate) -> str:
    """Name of the one of two estimates that force at equal velocity leaves; "" if both or none."""
    judge = inertia_of(balance_of(prepared.trajectory, predicted))
    if judge is None or judge.contradicts(predicted) == judge.contradicts(at_hand):
        return ""
    return _named(at_hand) if judge.contradicts(predicted) else _named(predicted)


def over_cut_offs(prepared: PreparedLog, estimate: Estimate) -> Estimate:
    """Instruments with what half and twice the cut-off move, as least squares have it already."""
    if estimate.method != "instruments" or estimate.leaning is not None:
        return estimate
    table = prepared.table
    frequency = table.cut_off.frequency
    low, high = (
        prepared.point(table.at_cut_off(factor * frequency), "instruments").values
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    leaning = (high - low) / 2
    covariance = estimate.covariance + np.outer(leaning, leaning)
    return replace(estimate, covariance=covariance, leaning=leaning)


def _robust_ones(prepared: PreparedLog, model: Model) -> tuple[Estimate, ...]:
    """Estimates that do not lean on what colours the rest; the first judges the others.

    Instruments where a reference is logged, unless they know so little that they could not
    contradict, and least squares unless instruments contradict them.
    """
    regression = prepared.refit("least-squares", model)
    if not prepared.has_reference:
        return (regression,)
    # What follows a set-point is free of the noise that a feedback puts into the force.
    instrumental = prepared.refit("instruments", model)
    if instrumental.value("mass") <= 0:
        return (regression,)
    if contradiction(regression, instrumental):
        return (instrumental,)
    if region(instrumental) <= _POWERLESS * region(regression):
        return instrumental, regression
    return regression, instrumental


def _named(estimate: Estimate) -> str:
    return estimate.method.replace("-", " ")
