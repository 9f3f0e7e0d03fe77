"""One estimator's answer, entered where identify enters it."""

from identification import Trajectory, quantity
from identification.estimators.estimate import Estimate, Model
from identification.fitting import PreparedLog


def estimate_by(method: str, log: Trajectory, model: Model, delay: float | None) -> Estimate:
    """The estimate of one method; a delay of None (s) is found in the log and fitted."""
    stated = None if delay is None else quantity(delay)
    return PreparedLog.of(log, model, stated).fit(method)
