"""Prepared log: one log filtered once as a regression, and the estimates of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Protocol, cast

import numpy as np

from identification.device.quantities import Quantity
from identification.estimators.estimate import NORMAL_95, Estimate, Model, PointEstimate
from identification.estimators.least_squares import (
    MOST_SAMPLES,
    Delay,
    Regression,
    find_delay,
    prepare,
)
from identification.trajectory import Trajectory

#: Change of delay, in samples, for the slope of the estimates over delay.
_DELAY_STEP = 0.05
#: The method that is given a delay; the others fit one if nobody states it.
_GIVEN = frozenset({"least-squares"})


class _Estimator(Protocol):
    """What every file of estimators has; least squares alone has to be given a delay."""

    def fit(self, table: Regression, delay: float | None, *, start: float = 0.0) -> Estimate: ...

    def point(
        self, table: Regression, delay: float | None, *, start: float = 0.0
    ) -> PointEstimate: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedLog:
    """A prepared log and its estimates.

    Attributes:
        trajectory: the log.
        table: prepared regression; its model is that of every estimate.
        rough: the same before the delay was found and the direction of motion refined.
        stated: delay of the hardware, or None.
        found: delay read from the log, or None if it was stated.
        made: estimates by method.
    """

    trajectory: Trajectory
    table: Regression
    rough: Regression
    stated: Quantity | None
    found: Delay | None
    made: dict[str, Estimate] = field(default_factory=dict[str, Estimate])

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

    @property
    def fitted(self) -> tuple[Estimate, ...]:
        """Everything estimated so far."""
        return tuple(self.made.values())

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
        return self.stated is None and method not in _GIVEN

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
