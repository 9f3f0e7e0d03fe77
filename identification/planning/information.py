"""What the log of a planned force will tell: motion, exact bound, its smooth stand-in, design grid.

Without friction, position answers a force per mass u, held for one step h, by
q[k+1] = q[k] + h·φ1·v[k] + h²·φ2·u[k], v[k+1] = (1 - p·h·φ1)·v[k] + h·φ1·u[k] with
φ1 = (1 - e^(-ph))/(ph), φ2 = (1 - φ1)/(ph), p = b/m: a filter of second order. An imaginary step of
p far below rounding gives its derivative exactly (Squire and Trapp, SIAM Review 40, 1998, p. 110).

With Coulomb friction, m·q̈ + b·q̇ + Fc·sign(q̇) + f0 = F is linear between two turns of the
velocity, so each piece is a closed form, the instant of the turn too: q̇ = 0 after
ln(1 - p·v/u)/p for a velocity v under the net pull u.

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

from cmath import log
from dataclasses import dataclass
from functools import cached_property
from math import copysign
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import UNKNOWN_FORCE
from identification.planning.limits import ExcitationSpec, Guess, phi, step_response
from identification.trajectory import NORMAL_95, ComplexArray, FloatArray

#: Imaginary step of p, as part of 1/h; nothing is subtracted, so the derivative is exact.
_RATE_STEP = 1e-30


@dataclass(frozen=True, kw_only=True)
class Response:
    """Filters of one device on one grid of n samples after the first."""

    rate: float  # p = b/m, 1/s
    step: float  # h, s
    count: int  # n
    noise: float  # standard deviation of one position reading, m
    acceleration_noise: float = 0.0  # rms of an unknown force per mass, white, held one step, m/s²

    @cached_property
    def _position(self) -> tuple[ComplexArray, ComplexArray]:
        delta = complex(self.rate * self.step, _RATE_STEP)
        first, second = phi(delta)
        decay = 1 - delta * first
        top = np.array([second, first * first - decay * second], dtype=np.complex128)
        return top * self.step**2, np.array([1, -1 - decay, decay], dtype=np.complex128)

    @cached_property
    def _velocity(self) -> tuple[FloatArray, FloatArray]:
        coast = step_response(self.rate, self.step)[0].real
        return np.array([coast]), np.array([1.0, self.rate * coast - 1.0])

    @cached_property
    def _whitening(self) -> tuple[FloatArray, FloatArray]:
        """The steady Kalman filter from position noise and unknown force to unit white noise."""
        size = self.acceleration_noise * self.step**2 / self.noise
        if size == 0:
            return np.array([1 / self.noise]), np.array([1.0])
        from scipy.linalg import solve_discrete_are

        first, second = (part.real for part in phi(self.rate * self.step))
        motion = np.array([[1.0, first], [0.0, 1 - self.rate * self.step * first]])
        kick, reading = size * np.array([second, first]), np.array([[1.0], [0.0]])
        spread = solve_discrete_are(motion.T, reading, np.outer(kick, kick), np.eye(1))
        gain = motion @ spread @ reading / (spread[0, 0] + 1)
        top = np.poly(motion) / (self.noise * np.sqrt(spread[0, 0] + 1))
        bottom = np.poly(motion - gain @ reading.T)
        return np.asarray(top, np.float64), np.asarray(bottom, np.float64)

    def driven(self, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position at samples 1 to n, in standard deviations, and its derivative by p."""
        position = np.asarray(_filtered(*self._position, pull), dtype=np.complex128)
        return self.whitened(position.real), self.whitened(position.imag) * (self.step / _RATE_STEP)

    def returned(self, weight: FloatArray, slope_weight: FloatArray) -> FloatArray:
        """What ``driven`` transposed makes of weights of position and derivative, shape (n,)."""
        # A causal filter is transposed by running it backwards.
        place, _ = self.driven(weight[::-1])
        _, slope = self.driven(slope_weight[::-1])
        return (place + slope)[::-1]

    def speed(self, pull: FloatArray) -> FloatArray:
        """Velocity at samples 1 to n, m/s; shape of ``pull``, time along the first axis."""
        return _filtered(*self._velocity, pull)

    def speed_returned(self, weight: FloatArray) -> FloatArray:
        """What ``speed`` transposed makes of a weight, shape (n,)."""
        return self.speed(weight[::-1])[::-1]

    def place(self, pull: FloatArray) -> FloatArray:
        """Position at samples 1 to n, m; shape of ``pull``, time along the first axis."""
        top, bottom = self._position
        return _filtered(top.real, bottom.real, pull)

    def whitened(self, position: FloatArray) -> FloatArray:
        """A position in m as unit white noise would have to be added to it; shape (n,)."""
        top, bottom = self._whitening
        return position * top[0] if bottom.size == 1 else _filtered(top, bottom, position)

    def unknowns(self) -> FloatArray:
        """Columns of initial position, initial velocity and constant force, orthonormal, (n, 3)."""
        ones = np.ones(self.count)
        thrown = np.zeros(self.count)
        thrown[0] = 1 / self.step
        columns = [self.whitened(ones), self.driven(thrown)[0], self.driven(ones)[0]]
        table = np.stack([column / np.linalg.norm(column) for column in columns], axis=1)
        return np.linalg.qr(table)[0]


def _filtered(top: NDArray[Any], bottom: NDArray[Any], column: FloatArray) -> NDArray[Any]:
    from scipy.signal import lfilter

    return np.asarray(lfilter(top, bottom, column, axis=0))


#: Imaginary step of a parameter in its SI unit; nothing is subtracted, so derivatives are exact.
_COMPLEX_STEP = 1e-40
#: Below this the logarithm of the instant of a turn is summed: the next term is below rounding.
_SERIES_BELOW = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Motion of a device that starts at zero and at rest."""

    position: FloatArray  # m (rad), shape (n + 1,)
    velocity: FloatArray  # m/s (rad/s), shape (n + 1,)


def sensitivities(force: FloatArray, guess: Guess, step: float) -> FloatArray:
    """Derivatives of position by m, b, Fc, f0 and start velocity, turns and all, (n + 1, 5)."""
    middle = _numbers(guess)
    columns: list[FloatArray] = []
    for index in range(len(middle)):
        moved = tuple(
            complex(value, _COMPLEX_STEP * (place == index)) for place, value in enumerate(middle)
        )
        position = np.array(_trace(force, moved, step)[0], dtype=np.complex128)
        columns.append(position.imag / _COMPLEX_STEP)
    return np.stack(columns, axis=1)


def _numbers(guess: Guess) -> tuple[float, ...]:
    return guess.mass, guess.damping, guess.coulomb_friction, guess.force_offset, 0.0


def _trace(
    force: FloatArray, device: tuple[complex, ...], step: float
) -> tuple[list[complex], list[complex]]:
    """Position and velocity of (m, b, Fc, f0, start velocity), or complex; real parts decide."""
    mass, damping, friction, offset, speed = device
    rate, grip = damping / mass, friction / mass
    coast, fall = step_response(rate, step)
    decay = 1 - rate * coast
    place = 0.0 * speed
    places, speeds = [place], [speed]
    for each in force.tolist():
        drive = (each - offset) / mass
        sense = copysign(1.0, speed.real or drive.real)
        net = drive - grip * sense
        later = decay * speed + coast * net
        if speed.real == 0 and abs(drive.real) <= grip.real:
            speed = 0.0 * speed
        elif later.real * sense >= 0:
            place += coast * speed + fall * net
            speed = later
        else:
            before = _instant(rate, speed, net)
            near, far = step_response(rate, before)
            place += near * speed + far * net
            held = abs(drive.real) <= grip.real
            onward = 0.0 * drive if held else drive - grip * copysign(1.0, drive.real)
            near, far = step_response(rate, step - before)
            place, speed = place + far * onward, near * onward
        places.append(place)
        speeds.append(speed)
    return places, speeds


def _instant(rate: complex, speed: complex, net: complex) -> complex:
    """Time until a net pull against the velocity has used it up, s: ln(1 - p·v/u)/p."""
    ratio = -speed / net
    part = rate * ratio
    if abs(part) < _SERIES_BELOW:
        return ratio * (1 - part / 2 + part**2 / 3 - part**3 / 4)
    logarithm = log(1 + part)
    return (logarithm if isinstance(part, complex) else logarithm.real) / rate


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
    position, velocity = (np.array(each, float) for each in _trace(force, _numbers(guess), step))
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
        columns.append(velocity)
    table = np.stack([response.whitened(column) for column in columns], axis=1)
    norms: FloatArray = np.linalg.norm(table, axis=0)
    # A device that static friction holds at first forgets the velocity it started with.
    table, norms = table[:, norms > 0], norms[norms > 0]
    unit = table / norms
    inverse = np.asarray(np.linalg.pinv(unit.T @ unit, hermitian=True), dtype=np.float64)
    covariance = (inverse / np.outer(norms, norms))[:2, :2]
    power = float(np.sum((guess.mass * table[:, 0]) ** 2))
    return Prediction(
        motion=Answer(position=position, velocity=velocity),
        covariance=covariance,
        doubt=UNKNOWN_FORCE**2 * power * covariance,
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
        """Force, then position and speed of each device, over their limits, (limits·count,)."""
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
