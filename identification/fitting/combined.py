"""Several logs to one device: values averaged, intervals enveloped, covariances joined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identification.device.device import (
    ByDirection,
    Covariance,
    Device,
    Gravity,
    LogRecord,
    SlopeRange,
)
from identification.device.hardware import Hardware
from identification.device.quantities import Quantity, quantity
from identification.estimators.estimate import quantile
from identification.fitting.one_log import LogFit
from identification.fitting.suggested import (
    delay_of,
    force_limit_of,
    mark_stated,
    resolution_of,
    sample_time_of,
)

FloatArray = NDArray[np.float64]

#: Parameters every device states, fitted or not.
PARAMETERS = ("mass", "damping", "coulomb_friction", "force_offset")

#: Largest logarithm of the interval of a mass to its value; only a log that was allowed although it
#: does not tell the mass comes near this factor of a thousand.
WIDEST_MASS = 7.0
#: Probability that a stored interval holds the truth.
CONFIDENCE = 0.95


def device_from(
    fits: Sequence[LogFit], hardware: Hardware | None, records: Sequence[LogRecord]
) -> Device:
    """The device all logs agree with: values averaged, intervals enveloped, covariance joint.

    Args:
        fits: at least one, each with positive mass.
        hardware: what is known; of the rest the device holds what the logs suggest, with
            ``source: log``, and names it as missing.
        records: one for each fit, stored with the device.
    """
    hardware = hardware or Hardware()
    first = fits[0].trajectory
    return Device(
        name=hardware.name,
        axis=first.axis,
        serial=hardware.serial,
        date=hardware.date,
        operator=hardware.operator,
        motion=first.motion or "linear",
        missing=() if first.motion else ("motion",),
        sample_time=sample_time_of(fits, hardware),
        mass=_envelope(fits, "mass"),
        damping=_envelope(fits, "damping"),
        coulomb_friction=_envelope(fits, "coulomb_friction"),
        force_offset=_envelope(fits, "force_offset"),
        delay=delay_of(fits, hardware),
        encoder_resolution=mark_stated(hardware.encoder_resolution)
        or quantity(resolution_of(fits), source="log"),
        force_limit=hardware.force_limit or force_limit_of(fits),
        modes=hardware.modes,
        current_lag=hardware.current_lag,
        covariance=_covariance(fits),
        damping_slope=_hull_of(fits, "slope"),
        presliding_stiffness=_hull_of(fits, "presliding"),
        logs=tuple(records),
        damping_by_direction=_by_direction(fits, "damping"),
        friction_by_direction=_by_direction(fits, "friction"),
        position_stiffness=_position_stiffness(fits),
        gravity=_gravity(fits),
    )


def _confidence(fits: Sequence[LogFit]) -> float:
    """Confidence of one log's interval, so that the envelope of several has 95 % for all."""
    return 1 - (1 - CONFIDENCE) / len(fits)


def _envelope(fits: Sequence[LogFit], name: str) -> Quantity:
    """Mean of one parameter by inverse variance, and the interval that holds that of every log."""
    return _hull(fits, least=0.0 if name == "coulomb_friction" else None, **{name: 1.0})


def _hull(fits: Sequence[LogFit], *, least: float | None = None, **weights: float) -> Quantity:
    """Hull of the intervals of a weighted sum of parameters.

    Mass lies on a logarithmic scale, so that it stays positive; friction is clipped at zero, where
    physics ends.
    """
    confidence = _confidence(fits)
    pairs: FloatArray = np.array([fit.estimate.combined(**weights) for fit in fits])
    values, deviations = pairs[:, 0], pairs[:, 1]
    quantiles = [quantile(fit.estimate, confidence) for fit in fits]
    halves: FloatArray = deviations * np.array(quantiles)
    lows, highs = values - halves, values + halves
    if weights.keys() == {"mass"}:
        ratio = np.exp(np.minimum(halves / values, WIDEST_MASS))
        lows, highs = values / ratio, values * ratio
    if len(fits) == 1 or np.any(deviations == 0):
        value = float(np.mean(values))
    else:
        value = float(values @ (deviations**-2 / np.sum(deviations**-2)))
    low, high = float(lows.min()), float(highs.max())
    if least is not None:
        value, low, high = max(value, least), max(low, least), max(high, least)
    return quantity(value, low, high)


def _by_direction(fits: Sequence[LogFit], what: str) -> ByDirection | None:
    """Damping or Coulomb friction forward and backward, of the logs that tell them apart."""
    telling = [fit for fit in fits if fit.estimate.model.directional]
    if not telling:
        return None
    if what == "damping":
        forward, backward = (
            _hull(telling, damping=1.0, damping_asymmetry=side) for side in (1.0, -1.0)
        )
        return ByDirection(forward=forward, backward=backward)
    # The offset of the model holds at the mean speed; at rest damping has no asymmetry.
    speed = float(np.mean([fit.estimate.mean_speed for fit in telling]))
    forward, backward = (
        _hull(
            telling,
            least=0.0,
            coulomb_friction=1.0,
            force_offset=side,
            damping_asymmetry=-side * speed,
        )
        for side in (1.0, -1.0)
    )
    return ByDirection(forward=forward, backward=backward)


def _hull_of(fits: Sequence[LogFit], name: Literal["slope", "presliding"]) -> SlopeRange | None:
    """Range over all logs whose friction is no straight line over speed."""
    found: list[SlopeRange | None] = [getattr(each.curve, name, None) for each in fits]
    known = [each for each in found if each is not None]
    if not known:
        return None
    return SlopeRange(low=min(each.low for each in known), high=max(each.high for each in known))


def _position_stiffness(fits: Sequence[LogFit]) -> Quantity | None:
    """Stiffness over the logs that show a force in proportion to position."""
    telling = [fit for fit in fits if fit.estimate.model.gravity == "proportional"]
    return _envelope(telling, "position_stiffness") if telling else None


def _gravity(fits: Sequence[LogFit]) -> Gravity | None:
    """Gravity over the logs that show a weight."""
    telling = [fit for fit in fits if fit.estimate.model.gravity == "pendulum"]
    if not telling:
        return None
    return Gravity(
        sine=_envelope(telling, "gravity_sine"), cosine=_envelope(telling, "gravity_cosine")
    )


def _covariance(fits: Sequence[LogFit]) -> Covariance:
    """Mean covariance of the logs plus the covariance between their values.

    The degrees of freedom are those of the poorest log: between logs there are too few to count.
    """
    shared = [name for name in PARAMETERS if all(name in fit.estimate.parameters for fit in fits)]
    within: list[FloatArray] = []
    for fit in fits:
        order = [fit.estimate.parameters.index(name) for name in shared]
        within.append(fit.estimate.covariance[np.ix_(order, order)])
    total = np.mean(within, axis=0)
    if len(fits) > 1:
        values = [[fit.estimate.value(name) for name in shared] for fit in fits]
        total = total + np.cov(np.array(values).T)
    return Covariance(
        parameters=tuple(shared),
        matrix=tuple(tuple(float(cell) for cell in row) for row in total),
        degrees_of_freedom=min(fit.estimate.degrees_of_freedom for fit in fits),
    )
