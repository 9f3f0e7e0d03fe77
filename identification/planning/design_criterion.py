"""Criterion of optimal experiment design: predicted variance of a force, with its gradient.

The merit is the logarithm of the product of the variances of mass and damping: D-optimal but for
the correlation of the two. Without friction these are the Cramér-Rao variances. With friction they
stand in for them, because the exact ones have no gradient where the device sticks: each turn of the
velocity is known only as well as the velocity is, which acts as an unknown kick of 2·Fc/m·δv/|a|
(δv error of the velocity, a acceleration at the turn), carried through the least-squares fit. So a
force is sought that turns the device seldom and quickly, as one would by experience.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.planning.response import Response

FloatArray = NDArray[np.float64]

#: Width of the smooth sign of the velocity, as part of the speed scale: a few samples at a turn.
_SMOOTH = 0.03
#: Accelerations below this part of the largest count as it: slower turns are not resolved.
_SLOWEST_TURN = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Friction:
    """What Coulomb friction does to an estimate.

    Attributes:
        grip: Fc/m, m/s².
        blur: error of the velocity at a turn, m/s.
        speed: typical peak speed, m/s.
        acceleration: largest acceleration, m/s².
    """

    grip: float
    blur: float
    speed: float
    acceleration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignCriterion:
    """The merit of net forces per mass on one grid.

    Attributes:
        response: of the guessed device.
        unknowns: columns that take their share of the information, orthonormal, shape (n, 3).
        friction: or None.
        delay_known: False if the delay is estimated too.
    """

    response: Response
    unknowns: FloatArray
    friction: Friction | None
    delay_known: bool

    def __call__(self, pull: FloatArray) -> tuple[float, FloatArray]:
        """Logarithm of the product of both variances, and its gradient.

        Args:
            pull: net force per mass, shape (n,), m/s².
        """
        response, friction = self.response, self.friction
        place, slope = response.driven(pull)
        columns = [-(place + response.rate * slope), slope]
        turns = _Turns.of(response, friction, pull) if friction is not None else None
        if turns is not None:
            columns.append(response.driven(turns.sign)[0])
        if not self.delay_known:
            columns.append(response.whitened(response.speed(pull)))
        table = self._rest(np.stack(columns, axis=1))
        norms: FloatArray = np.linalg.norm(table, axis=0)
        unit: FloatArray = table / norms
        inverse = np.asarray(np.linalg.inv(unit.T @ unit), dtype=np.float64)
        weights: FloatArray = unit @ inverse  # the estimate is what these make of the noise
        wanted: FloatArray = weights[:, :2]
        spread = wanted.copy()
        variances: FloatArray = np.diag(inverse)[:2].copy()
        kicked = np.zeros_like(wanted)
        if turns is not None:
            none = np.zeros(pull.size)
            for i in (0, 1):
                kicked[:, i] = response.returned(self._rest(wanted[:, i]), none) / response.step
                carried = response.driven(turns.kicks * kicked[:, i])[0] / response.step
                spread[:, i] += self._rest(carried)
            variances += turns.kicks @ kicked**2
        value = float(np.sum(np.log(variances / norms[:2] ** 2)))
        # Gradient by the columns: P = J·(JᵀJ)⁻¹, dP = (1 - PJᵀ)·dJ·(JᵀJ)⁻¹ - P·dJᵀ·P.
        change = np.zeros_like(unit)
        change[:, :2] = 2 * spread / variances
        by_column = (change - weights @ (unit.T @ change)) @ inverse
        by_column = self._rest((by_column - weights @ (change.T @ weights)) / norms)
        by_place, by_slope = -by_column[:, 0], by_column[:, 1] - response.rate * by_column[:, 0]
        gradient = response.returned(by_place, by_slope)
        column = 2
        if turns is not None:
            none = np.zeros(pull.size)
            by_sign = response.returned(by_column[:, column], none)
            gradient = gradient + turns.returned(response, by_sign, kicked**2 @ (1 / variances))
            column += 1
        if not self.delay_known:
            # Whitening is causal like the response: transposed, it runs backwards.
            weight = response.whitened(by_column[::-1, column])[::-1]
            gradient = gradient + response.speed_returned(weight)
        return value, gradient

    def _rest(self, table: FloatArray) -> FloatArray:
        """What the unknown start and constant force leave of columns."""
        return table - self.unknowns @ (self.unknowns.T @ table)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Turns:
    """Smooth sign of the velocity in each interval and what it costs not to know it.

    Attributes:
        sign: shape (n,).
        kicks: variance of the unknown velocity kick in each interval, (m/s)², shape (n,).
        sign_slope, kicks_slope: derivatives of both by the velocity.
        kicks_bend: derivative of the kicks by the acceleration.
    """

    sign: FloatArray
    kicks: FloatArray
    sign_slope: FloatArray
    kicks_slope: FloatArray
    kicks_bend: FloatArray

    @classmethod
    def of(cls, response: Response, friction: Friction, pull: FloatArray) -> _Turns:
        after = response.speed(pull)
        before = np.concatenate(([0.0], after[:-1]))
        speed, acceleration = (after + before) / 2, (after - before) / response.step
        width = _SMOOTH * friction.speed
        root = np.hypot(speed, width)
        slope, bend = width**2 / root**3, -3 * width**2 * speed / root**5
        quick = np.hypot(acceleration, _SLOWEST_TURN * friction.acceleration)
        # ∫ slope·|a| dt = 2 over a turn, so each gets (2·Fc/m·δv/a)² in all.
        size = (2 * friction.grip * friction.blur) ** 2 * response.step / 2
        return cls(
            sign=speed / root,
            kicks=size * slope / quick,
            sign_slope=slope,
            kicks_slope=size * bend / quick,
            kicks_bend=-size * slope * acceleration / quick**3,
        )

    def returned(self, response: Response, by_sign: FloatArray, by_kicks: FloatArray) -> FloatArray:
        """Gradient by the pull from those by sign and kicks, shape (n,)."""
        by_speed = by_sign * self.sign_slope + by_kicks * self.kicks_slope
        by_acceleration = by_kicks * self.kicks_bend
        by_after = by_speed / 2 + by_acceleration / response.step
        by_before = by_speed / 2 - by_acceleration / response.step
        by_after[:-1] += by_before[1:]
        return response.speed_returned(by_after)
