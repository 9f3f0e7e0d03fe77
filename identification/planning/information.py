"""What the log of a planned force will tell: exact bound, its smooth stand-in, the design grid.

The log's position is known up to white noise (reading noise and rounding to a count) and, where one
is stated, an unknown white force; nothing else. Initial position and velocity, the constant force,
Coulomb friction where some is guessed, and the delay where it is not known are estimated from the
same log and take their share of the information.

The merit that designs are brought to is the logarithm of the product of the variances of mass and
damping: D-optimal but for the correlation of the two. Without friction these are the Cramér-Rao
variances. With friction they stand in for them, because the exact ones have no gradient where the
device sticks: each turn of the velocity is known only as well as the velocity is, which acts as an
unknown kick of 2·Fc/m·δv/|a| (δv error of the velocity, a acceleration at the turn), carried
through the least-squares fit. So a force is sought that turns the device seldom and quickly, as one
would by experience.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import NORMAL_95, UNKNOWN_FORCE
from identification.planning.limits import ExcitationSpec
from identification.planning.stick_slip import (
    Answer,
    Guess,
    Response,
    sensitivities,
    simulate_stick_slip,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Bound of every unbiased estimator for the log of a planned force."""

    motion: Answer  # of the guessed device, without noise
    covariance: FloatArray  # of mass and damping, shape (2, 2)
    #: what identify adds to it for forces no log knows better, shape (2, 2)
    #: (UNKNOWN_FORCE)
    doubt: FloatArray

    @property
    def stated(self) -> tuple[float, float]:
        """Half-widths of mass and damping as identify will state them, the doubt included."""
        mass, damping = NORMAL_95 * np.sqrt(np.diag(self.covariance + self.doubt))
        return float(mass), float(damping)

    @property
    def mass(self) -> float:
        """Half-width of the 95 % interval of the mass, kg (kg·m²)."""
        return NORMAL_95 * float(np.sqrt(self.covariance[0, 0]))

    @property
    def damping(self) -> float:
        """Half-width of the 95 % interval of the damping, N·s/m (N·m·s/rad)."""
        return NORMAL_95 * float(np.sqrt(self.covariance[1, 1]))


def predict(
    force: FloatArray,
    guess: Guess,
    *,
    step: float,
    noise: float,
    force_noise: float = 0.0,
    delay_known: bool = True,
) -> Prediction:
    """Cramér-Rao bound of mass and damping for a force held over each sample, from rest.

    With Coulomb friction turns and standstills move with the parameters, exactly as in the bound of
    an estimator that knows the model without any fault. Noise is of one reading, m (rad), and of a
    white force that no log knows, held one sample, N (N·m).
    """
    motion = simulate_stick_slip(force, guess, step)
    response = Response(
        rate=guess.rate,
        step=step,
        count=force.size + 1,
        noise=noise,
        acceleration_noise=force_noise / guess.mass,
    )
    if guess.coulomb_friction > 0:
        slopes = sensitivities(force, guess, step)
    else:
        slopes = _smooth_sensitivities(force, guess, step)
    columns = [*slopes.T, np.ones(force.size + 1)]
    if not delay_known:
        columns.append(motion.velocity)
    table = np.stack([response.whitened(column) for column in columns], axis=1)
    norms: FloatArray = np.linalg.norm(table, axis=0)
    # A device that static friction holds at first forgets the velocity it started with.
    table, norms = table[:, norms > 0], norms[norms > 0]
    unit = table / norms
    inverse = np.asarray(np.linalg.pinv(unit.T @ unit, hermitian=True), dtype=np.float64)
    covariance = (inverse / np.outer(norms, norms))[:2, :2]
    power = float(np.sum((guess.mass * table[:, 0]) ** 2))
    return Prediction(
        motion=motion, covariance=covariance, doubt=UNKNOWN_FORCE**2 * power * covariance
    )


def _smooth_sensitivities(force: FloatArray, guess: Guess, step: float) -> FloatArray:
    """Derivatives of position by m, b, f0 and the velocity at the start, shape (n + 1, 4)."""
    # A step at rest comes before, so that the first row is a row too.
    response = Response(rate=guess.rate, step=step, count=force.size + 1, noise=1.0)
    net = np.append(0.0, force - guess.force_offset) / guess.mass
    place, slope = response.driven(net)
    # q = G_p[F - f0]/m with p = b/m: m·dq/dm = -(q + p·dq/dp), m·dq/db = dq/dp.
    constant = np.append(0.0, np.ones(force.size))
    thrown = np.zeros(force.size + 1)
    thrown[0] = 1 / step  # coasting since then differs from coasting since the start by a constant
    columns = [
        -(place + guess.rate * slope) / guess.mass,
        slope / guess.mass,
        response.driven(constant)[0],
        response.driven(thrown)[0],
    ]
    return np.stack(columns, axis=1)


#: Width of the smooth sign of the velocity, as part of the speed scale: a few samples at a turn.
_SMOOTH = 0.03
#: Accelerations below this part of the largest count as it: slower turns are not resolved.
_SLOWEST_TURN = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Friction:
    """What Coulomb friction does to an estimate."""

    grip: float  # Fc/m, m/s²
    blur: float  # error of the velocity at a turn, m/s
    speed: float  # typical peak speed, m/s
    acceleration: float  # largest acceleration, m/s²


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignCriterion:
    """The merit of net forces per mass on one grid."""

    response: Response  # of the guessed device
    #: columns that take their share of the information, orthonormal, shape (n, 3)
    unknowns: FloatArray
    friction: Friction | None
    delay_known: bool  # False if the delay is estimated too

    def __call__(self, pull: FloatArray) -> tuple[float, FloatArray]:
        """Logarithm of the product of both variances, and its gradient."""
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
    """Smooth sign of the velocity in each interval and what it costs not to know it."""

    sign: FloatArray  # shape (n,)
    kicks: FloatArray  # variance of the unknown velocity kick in each interval, (m/s)², shape (n,)
    sign_slope: FloatArray  # derivatives of both by the velocity
    kicks_slope: FloatArray
    kicks_bend: FloatArray  # derivative of the kicks by the acceleration

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


#: Highest frequency, as a multiple of the corner b/m or of where force or speed runs out before
#: travel does: well above it the device hardly moves.
_ABOVE = 3.0
#: Periods of the highest frequency in the shortest signal, so that there is something to choose.
_FEWEST_PERIODS = 8.0
_FEWEST_SAMPLES = 20.0  # samples of the controller in a period of the highest frequency, at least
#: Points of the grid in a period of the highest frequency; peaks between them are under 1 %.
_POINTS = 24.0
#: The velocity at a turn is as well known as readings over this part of the shortest period tell:
#: with less care, turns become so slow that output error no longer reaches the bound.
_WINDOW = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignGrid:
    """Where forces are tried."""

    spec: ExcitationSpec  # limits and guesses
    highest: float  # frequency, Hz
    step: float  # of the grid, s
    count: int  # points of the grid
    #: (mass, response) of the guess, and of the lightest and least damped device, which goes
    #: farthest, if the guesses are ranges
    devices: tuple[tuple[float, Response], ...]
    merit: DesignCriterion  # of net forces per mass of the guess

    @classmethod
    def of(cls, spec: ExcitationSpec) -> DesignGrid:
        """The bench for limits and guesses."""
        mass, damping = spec.mass.value, spec.damping.value
        room = force_room(spec)
        speed = np.sqrt(room * spec.travel / mass)
        if damping > 0:
            speed = min(speed, room / damping)
        if spec.speed is not None:
            speed = min(speed, spec.speed)
        knee = max(damping / mass, speed / spec.travel) / (2 * np.pi)
        highest = max(_ABOVE * knee, _FEWEST_PERIODS / spec.duration)
        highest = min(highest, 1 / (_FEWEST_SAMPLES * spec.sample_time))
        count = min(int(np.ceil(spec.duration * _POINTS * highest)), spec.samples)
        step = spec.duration / count
        # As many readings as the log has, told by fewer points.
        share = np.sqrt(spec.sample_time / step)

        def device(mass: float, damping: float) -> Response:
            return Response(
                rate=damping / mass,
                step=step,
                count=count,
                noise=spec.reading_noise * share,
                acceleration_noise=spec.force_noise / mass * share,
            )

        devices = [(mass, device(mass, damping))]
        if not (spec.mass.exact and spec.damping.exact):
            devices.append((spec.mass.low, device(spec.mass.low, spec.damping.low)))
        friction = None
        if spec.coulomb_friction.value > 0:
            window = _WINDOW / highest
            friction = Friction(
                grip=spec.coulomb_friction.value / mass,
                # Standard deviation of the slope of a line through the readings of the window.
                blur=spec.reading_noise * np.sqrt(12 * spec.sample_time / window**3),
                speed=speed,
                acceleration=room / mass,
            )
        response = devices[0][1]
        merit = DesignCriterion(
            response=response,
            unknowns=response.unknowns(),
            friction=friction,
            delay_known=spec.delay == "known",
        )
        return cls(
            spec=spec, highest=highest, step=step, count=count, devices=tuple(devices), merit=merit
        )

    @property
    def time(self) -> FloatArray:
        """Middles of the steps, s, shape (count,)."""
        return (np.arange(self.count, dtype=np.float64) + 0.5) * self.step

    def score(self, force: FloatArray) -> tuple[float, FloatArray]:
        """Merit of a net force (N, shape (count,)) and its gradient by the force."""
        mass = self.devices[0][0]
        value, gradient = self.merit(force / mass)
        return value, gradient / mass

    def loads(self, force: FloatArray) -> FloatArray:
        """Force, then position and speed of each device, as parts of their limits.

        A net force, in N, has shape (count,); the answer is one such row for each limit, all in one
        column of shape (limits·count,).
        """
        spec = self.spec
        rows = [force / force_room(spec)]
        for mass, response in self.devices:
            rows.append(response.place(force) / (mass * spec.travel))
            if spec.speed is not None:
                rows.append(response.speed(force) / (mass * spec.speed))
        return np.concatenate(rows)

    def loads_returned(self, weights: FloatArray) -> FloatArray:
        """Gradient by the force from that by the loads, shape (count,)."""
        spec = self.spec
        parts = iter(np.split(weights, weights.size // self.count))
        total = next(parts) / force_room(spec)
        for mass, response in self.devices:
            total = total + response.place(next(parts)[::-1])[::-1] / (mass * spec.travel)
            if spec.speed is not None:
                total = total + response.speed_returned(next(parts)) / (mass * spec.speed)
        return total


def force_room(spec: ExcitationSpec) -> float:
    """Force left to move the device when friction and offset have taken theirs, N."""
    offset = max(abs(spec.force_offset.low), abs(spec.force_offset.high))
    return spec.force - spec.coulomb_friction.high - offset


def fade(time: FloatArray, spec: ExcitationSpec) -> FloatArray:
    """Raised cosine from 0 to 1 over the first ramp and back over the last; shape of ``time``."""
    if spec.ramp == 0:
        return np.ones_like(time)
    nearer = np.minimum(time, spec.duration - time) / spec.ramp
    return np.sin(np.pi / 2 * np.clip(nearer, 0.0, 1.0)) ** 2
