"""Dynamics of no rigid device: a lag, vibration, play, friction by load, mass by position.

Each kind is put to the regression of a log, its parameters found by variable projection. It is
found if it takes most of the residual away, more than a delay, a simpler kind or laws of friction
do. The log is then given the force that a rigid device would have needed, and everything is
estimated and judged again from that: mass and damping become those of low frequencies, and carry
what the parameters of the kind leave in doubt.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from identification.device.hardware import AS_STATED, Hardware, Mode, is_near
from identification.device.quantities import Quantity, quantity
from identification.errors import Finding
from identification.estimators.estimate import Solution, solve_separable, spread
from identification.estimators.filters import LowPass, Spring, recursive
from identification.estimators.least_squares import LEAST, LOUD, Regression, prepare
from identification.estimators.signals import HeldColumn, kinematics_of, of_rows
from identification.fitting.log_fit import Dynamics
from identification.trajectory import NORMAL_95, FloatArray, Trajectory, excited_part

#: Rows looked at; more add time, not truth.
_LONGEST = 1 << 15
#: A kind leaves at most this part of the mean square of the residual that is not noise, the next of
#: what a delay and a simpler kind leave. The best of a scan takes at least the last part away.
_LEFT, _THAN_DELAY, _BETTER, _HINT = 0.4, 0.9, 0.7, 0.1
#: Play is looked for where so much of the force is left, rms; what is left of it beyond the next
#: part bounds nothing of what else is there, beside the impacts of play the last.
_FOR_PLAY, _MOST, _MOST_BY_PLAY = 0.012, 0.15, 0.3
#: Time constants of a drive, s.
_LAGS = (2e-4, 2e-2)
#: Resonances from so many periods in the log to this multiple of the cut-off, before the encoder
#: to the next; their damping ratios, as what is damped more does not vibrate, and those tried.
_PERIODS, _ABOVE, _FAR_ABOVE, _DAMPED, _TRIED = 8.0, 2.5, 5.0, (2e-3, 0.3), (0.02, 0.1)
#: Gaps, parts of the travel; how what is in the gap loses its speed, 1/s, and what of it impacts
#: give back. Its course is taken at this multiple of the cut-off: impacts are fast.
_FINER = 3.0
_GAPS = (1e-3, 0.1)
_COASTS = ((0.0, 0.0), (0.0, 0.4), (0.0, 0.7), (10.0, 0.0), (10.0, 0.5), (np.inf, 0.0))
#: Powers of position that a mass may depend on, over the travel, and where their weights stand.
_ALONG, _OWN = np.linspace(-1, 1, 21) ** np.arange(4)[:, None], [0, -3, -2, -1]
_SCAN = 9  # values of a parameter in a scan; of a resonance, which is sharp, three times as many
_NUDGE = 1e-3  # step of numerical derivatives, of logarithms and samples
_DAMPED_ALIKE = 2.0  # a stated mode agrees with one found within this factor of its damping ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    """What the parameters of a kind say."""

    seen: str
    remedy: str
    current_lag: Quantity | None = None
    mode: Mode | None = None
    masses: tuple[float, float] | None = None
    code: str = ""  # of the finding, if it is not that of the kind
    needed: str = ""  # where the device is refused however well the kind explains the log


@dataclass(frozen=True, slots=True)
class _Kind:
    """A delay other than the one stated; base of the kinds. θ ends with a delay if it is fitted."""

    table: Regression
    residual: FloatArray  # what the model leaves, N, shape (rows,)
    given: float | None  # delay, s; None if it is fitted, in samples
    late: float  # delay of the model, s
    scanned: list[FloatArray] = field(default_factory=list[FloatArray])  # what only a scan finds

    code: ClassVar[str] = ""

    @property
    def step(self) -> float:
        return self.table.signals.step

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        delay = () if self.given is not None else ((0.0, float(self.table.known)),)
        low, high = np.array((*self.ranges(), *delay)).reshape(-1, 2).T
        return low, high

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns of the model and beside it, and the force."""
        return self.table.columns, self.table.force(self.delay_of(theta))

    def slopes(self, theta: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
        found, high = np.empty((theta.size, residual.size)), self.bounds[1]
        for index, place in enumerate(theta):
            near = theta.copy()
            near[index] += _NUDGE if place + _NUDGE <= high[index] else -_NUDGE
            columns, target = self.at(near)
            found[index] = (weights @ columns - target + residual) / (near[index] - place)
        return found

    def allowed(self, theta: FloatArray) -> bool:
        return bool(np.all(np.isfinite(theta)))

    def delay_of(self, theta: FloatArray) -> float:
        late = self.given if self.given is not None else float(theta[-1]) * self.step
        return min(max(late, 0.0), self.table.known * self.step)

    def held(self, force: FloatArray) -> FloatArray:
        """Filtered rows of a force of each interval, nothing where the device stands."""
        return self.table.filtered(HeldColumn.constant(force * self.table.motion.moving, self.step))

    def _swinging(self, above: float) -> tuple[tuple[float, float], ...]:
        """Logs of the bounds of a resonance and of its damping ratio."""
        slowest = _PERIODS / (self.table.signals.position.size * self.step)
        fastest = min(above * self.table.cut_off.frequency, 0.2 / self.step)
        pairs = np.log(((min(slowest, fastest), fastest), _DAMPED)).tolist()
        return tuple((low, high) for low, high in pairs)

    def fitted(self) -> Solution | None:
        """The best fit; None where there is none, or none of a device."""
        start = self.start()
        if start is None:
            return None
        delay = [] if self.given is not None else [self.later(start) / self.step]
        found = solve_separable(self, np.array([*start, *delay]))
        return found if self.is_physical(found) else None

    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Bounds of its own parameters."""
        return ()

    def start(self) -> FloatArray | None:
        """Own parameters to start from; None where the log does not show it."""
        return np.empty(0)

    def later(self, start: FloatArray) -> float:
        """The delay to start from, s."""
        del start
        return self.late

    def is_physical(self, found: Solution) -> bool:
        return bool(found.weights[0] > 0)

    def corrected(self, log: Trajectory, found: Solution, table: Regression) -> FloatArray:
        """The force column of a log that a rigid device would have needed."""
        raise NotImplementedError

    def told(self, found: Solution, around: FloatArray) -> _Told:
        """What is found, from the covariance of weights and θ."""
        raise NotImplementedError


def lagged(force: FloatArray, lag: float, step: float) -> FloatArray:
    """Mean over each interval of a held force behind a lag, s."""
    decay = float(np.exp(-step / lag))
    begun = recursive(np.concatenate((force[:1], force[:-1] * (1 - decay))), -decay)
    return force + (begun - force) * (1 - decay) * lag / step


class _Lag(_Kind):
    """A current loop of first order, θ = log of its time constant."""

    __slots__ = ()
    code = "drive-lag"

    def ranges(self) -> tuple[tuple[float, float], ...]:
        return ((float(np.log(_LAGS[0])), float(np.log(_LAGS[1]))),)

    def start(self) -> FloatArray:
        costs, places = list[float](), self.places()
        for place in places:
            late = [] if self.given is not None else [self.later(place) / self.step]
            columns, force = self.at(np.array([*place, *late]))
            left = force - np.linalg.lstsq(columns.T, force)[0] @ columns
            costs.append(float(left @ left))
        return places[int(np.argmin(costs))]

    def places(self) -> FloatArray:
        """Own parameters that a scan tries, shape (places, own)."""
        return np.linspace(*self.ranges()[0], _SCAN)[:, None]

    def later(self, start: FloatArray) -> float:
        return max(self.late - float(np.exp(start[0])), 0.0)

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.table.columns, self._force(theta, self.delay_of(theta))

    def _force(self, theta: FloatArray, delay: float) -> FloatArray:
        table, commands = self.table, self.table.signals.commands
        value = self._lagged(commands.value, theta)
        signals = replace(table.signals, commands=replace(commands, value=value))
        logged = table.low_pass(value) if table.logged.size else table.logged
        return replace(table, signals=signals, logged=logged, filtered_forces={}).force(delay)

    def _lagged(self, force: FloatArray, theta: FloatArray) -> FloatArray:
        return lagged(force, float(np.exp(theta[0])), self.step)

    def corrected(self, log: Trajectory, found: Solution, table: Regression) -> FloatArray:
        del table
        return self._lagged(log.force, found.theta)

    def told(self, found: Solution, around: FloatArray) -> _Told:
        lag = _around(found.theta[0], around[len(found.weights), len(found.weights)])
        return _Told(
            seen=f"a force that lags {_range(lag, 1e3)} ms behind the command, as behind a current "
            f"loop of {1 / (2 * np.pi * lag.value):.3g} Hz",
            remedy=f"State current_lag: {_written(lag)} in the hardware file, as it is certified "
            "now, or make the current loop faster.",
            current_lag=lag,
        )


class _Elastic(_Lag):
    """A spring from the drive to what the encoder reads, θ = logs of frequency, damping ratio.

    x/F = 1/(m·s²) - 1/(m·(s² + 2·ζ·ω·s + ω²)) for two masses: the force passes a resonance, and so
    does friction where it acts on the drive.
    """

    __slots__ = ()
    code = "vibration-mode"

    def ranges(self) -> tuple[tuple[float, float], ...]:
        return self._swinging(_FAR_ABOVE)

    def places(self) -> FloatArray:
        grid = np.meshgrid(np.linspace(*self.ranges()[0], 3 * _SCAN), np.log(_TRIED))
        return np.stack(grid, axis=-1).reshape(-1, 2)

    later = _Kind.later

    def is_physical(self, found: Solution) -> bool:
        low, high = np.array(self.ranges()).T
        inside = np.abs(found.theta[:2] - (low + high) / 2) < (high - low) / 2 - _NUDGE
        return _Lag.is_physical(self, found) and bool(np.all(inside))

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns, force = _Lag.at(self, theta)
        if not self.table.model.coulomb:
            return columns, force
        moving = self.table.motion.moving
        against = self.table.motion.direction.mean() * moving
        passed = self.held(Spring.of(theta, self.step).driven(against))
        return np.vstack((columns, passed)), force

    def _lagged(self, force: FloatArray, theta: FloatArray) -> FloatArray:
        return Spring.of(theta, self.step).driven(force)

    def told(self, found: Solution, around: FloatArray) -> _Told:
        hertz = _around(found.theta[0], around[len(found.weights), len(found.weights)])
        return _Told(
            seen=f"a spring between the drive and what the encoder reads: they swing against each "
            f"other at {_range(hertz)} Hz",
            needed="an encoder that moves with the drive",
            remedy="Read the encoder of the motor, or stiffen what lies between it and the drive: "
            "a loop around this one can shake where the certificate of a rigid device holds.",
        )


class _Load(_Kind):
    """Coulomb friction that grows with the force."""

    __slots__ = ()
    code = "load-friction"

    def start(self) -> FloatArray | None:
        return np.empty(0) if self.table.model.coulomb else None

    def is_physical(self, found: Solution) -> bool:
        return bool(found.weights[0] > 0 and 0 < found.weights[-1] < 1)

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        delay, motion = self.delay_of(theta), self.table.motion
        against = np.abs(self.table.held_force(delay).mean()) * motion.direction.mean()
        return np.vstack((self.table.columns, self.held(against))), self.table.force(delay)

    def corrected(self, log: Trajectory, found: Solution, table: Regression) -> FloatArray:
        direction = table.motion.direction.mean() * table.motion.moving
        middle = log.time[:-1] + self.step / 2
        sense = np.interp(log.time + self.delay_of(found.theta) + self.step / 2, middle, direction)
        return log.force - found.weights[-1] * np.abs(log.force) * sense

    def told(self, found: Solution, around: FloatArray) -> _Told:
        half = NORMAL_95 * float(np.sqrt(np.diag(around)[len(found.weights) - 1]))
        return _Told(
            seen=f"friction that grows with the load, by {found.weights[-1]:.3g} ± {half:.1g} of "
            "the force",
            remedy="Oil or realign the gear or screw; it takes part of every force that drives the "
            "device and holds against what it gives back, which the gain margin must bear.",
        )


class _Beside(_Kind):
    """What follows from the measured motion, as that of a second mass; its weights follow the p."""

    __slots__ = ()

    def is_physical(self, found: Solution) -> bool:
        return bool(0 < found.weights[len(self.table.columns)] < found.weights[0])

    def pick(self, columns: list[FloatArray]) -> tuple[int, float]:
        """Which of some columns takes most of the residual with a weight above zero, what part."""
        rows, basis = np.stack(columns), np.linalg.qr(self.table.columns.T)[0]
        rest = rows - (rows @ basis) @ basis.T
        sizes = np.maximum(np.einsum("ij,ij->i", rest, rest), np.finfo(float).tiny)
        gain = np.maximum(rest @ self.residual, 0.0) ** 2 / sizes
        best = int(np.argmax(gain))
        return best, float(gain[best] / (self.residual @ self.residual))

    def acceleration(self, position: FloatArray) -> FloatArray:
        """Filtered rows of the acceleration of a position, nothing where the device stands."""
        rows, moving = kinematics_of(position, self.step)[0], self.table.motion.moving
        if not np.all(moving):
            rows = rows * of_rows(HeldColumn.constant(moving, self.step).triangle())
        return self.table.low_pass(rows)[self.table.known :]

    def beside(self, theta: FloatArray, *columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.vstack((self.table.columns, *columns)), self.table.force(self.delay_of(theta))

    def apart(self, found: Solution, position: FloatArray) -> FloatArray:
        """Distance of the second mass from the first, m, at each sample, less a constant."""
        raise NotImplementedError

    def corrected(self, log: Trajectory, found: Solution, table: Regression) -> FloatArray:
        del table
        late = self.delay_of(found.theta) + self.step / 2
        return log.force - np.interp(log.time + late, log.time, self.pull(found, log.position))

    def pull(self, found: Solution, position: FloatArray) -> FloatArray:
        """Force of the model beside that of a rigid device, N, at each sample."""
        bend = np.pad(np.diff(self.apart(found, position), 2) / self.step**2, 1)
        return float(found.weights[len(self.table.columns)]) * bend


class _Uneven(_Beside):
    """Mass by position, Σ w·φ(q): each φ takes the force φ·q̈ + φ'·q̇²/2 (Lagrange)."""

    __slots__ = ()
    code = "unmodelled-force"

    def start(self) -> FloatArray | None:
        pulls = self._pulls(self.table.signals.position)
        self.scanned[:] = [self.held((each[1:] + each[:-1]) / 2) for each in pulls]
        return np.empty(0)

    def is_physical(self, found: Solution) -> bool:
        return bool(np.all(found.weights[_OWN] @ _ALONG > 0))

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.beside(theta, *self.scanned)

    def _pulls(self, position: FloatArray) -> FloatArray:
        seen = self.table.signals.position
        smooth = LowPass.at(_FINER * self.table.cut_off.frequency, self.step).continued(position)
        place = (smooth - (seen.max() + seen.min()) / 2) / (np.ptp(seen) / 2)
        shapes = place ** np.arange(1, len(_ALONG))[:, None]
        turned = np.gradient(shapes, axis=1) * np.gradient(smooth) / 2
        return (shapes * np.pad(np.diff(smooth, 2), 1) + turned) / self.step**2

    def pull(self, found: Solution, position: FloatArray) -> FloatArray:
        return found.weights[_OWN[1:]] @ self._pulls(position)

    def told(self, found: Solution, around: FloatArray) -> _Told:
        masses, own = found.weights[_OWN] @ _ALONG, np.arange(len(found.weights))[_OWN]
        doubt = around[np.ix_(own, own)]
        ratio = np.exp(NORMAL_95 * np.sqrt(np.sum(_ALONG * (doubt @ _ALONG), axis=0)) / masses)
        low, high = float(np.min(masses / ratio)), float(np.max(masses * ratio))
        return _Told(
            seen=f"a mass that depends on position, as of a linkage: {low:.4g} to {high:.4g} over "
            "the travel logged",
            remedy="The interval of the mass holds all of it. A log of the positions of use alone "
            "gives a narrower one.",
            masses=(low, high),
        )


class _Resonance(_Beside):
    """A mass on a spring and damper, θ = logs of its frequency and damping ratio, driven."""

    __slots__ = ()
    code = "vibration-mode"

    def ranges(self) -> tuple[tuple[float, float], ...]:
        return self._swinging(_ABOVE)

    def start(self) -> FloatArray | None:
        places = np.linspace(*self.ranges()[0], 3 * _SCAN)
        tried = [np.array((place, damped)) for place in places for damped in np.log(_TRIED)]
        bend = self.table.columns[0]
        best, gain = self.pick([Spring.of(each, self.step).driven(bend) - bend for each in tried])
        return tried[best] if gain >= _HINT else None

    def is_physical(self, found: Solution) -> bool:
        return _Beside.is_physical(self, found) and found.theta[1] < self.ranges()[1][1]

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        position = self.table.signals.position
        spring = Spring.of(theta, self.step)
        courses = (spring.driven(position) - position, *spring.ringing(position.size))
        return self.beside(theta, *(self.acceleration(each) for each in courses))

    def apart(self, found: Solution, position: FloatArray) -> FloatArray:
        spring = Spring.of(found.theta, self.step)
        apart = spring.driven(position) - position
        if position.size != self.table.signals.position.size:  # of a long log a part was looked at
            return apart
        begun = found.weights[len(self.table.columns) :]
        return apart + begun[1:] / begun[0] @ spring.ringing(position.size)

    def told(self, found: Solution, around: FloatArray) -> _Told:
        count, own = len(self.table.columns), len(found.weights)
        mass, second = float(found.weights[0]), float(found.weights[count])
        # ω² and ζ² of the mode are m/m₁ times those of the load with the motor held.
        near = mass - second
        slope = np.zeros((2, len(around)))
        slope[:, 0], slope[:, count] = 0.5 / mass - 0.5 / near, 0.5 / near
        slope[0, own], slope[1, own + 1] = 1.0, 1.0
        places = found.theta[:2] + 0.5 * np.log(mass / near)
        variances = np.einsum("ij,jk,ik->i", slope, around, slope)
        hertz, damped = map(_around, places, variances)
        ringing = found.theta[1] - self.ranges()[1][0] < _NUDGE
        if ringing or NORMAL_95**2 * variances[1] > 1:
            return _Told(
                code="unmodelled-force",
                seen=f"a tone at {_range(hertz)} Hz that force need not excite: it dies out no "
                f"faster than at a damping ratio of {_range(damped)}, which may be zero",
                remedy="Look for what hums, as mains, a fan or a control loop do; shield the "
                "readings or turn it off, and log again.",
            )
        part = float(np.sqrt(second / near))
        mode = None
        if damped.high < 1:
            mode = Mode(frequency_hz=hertz, damping_ratio=damped, at_encoder=part, at_handle=part)
        return _Told(
            seen=f"a vibration at {_range(hertz)} Hz, damping ratio {_range(damped)}, of "
            f"{second / mass:.0%} of the mass",
            remedy=f"State modes: [{{frequency_hz: {_written(hertz)}, damping_ratio: "
            f"{_written(damped)}, at_encoder: {part:.3g}}}] in the hardware file, as it is "
            "certified now beside what is stated, at_handle too where the hand grips elsewhere; or "
            "stiffen the device.",
            mode=mode,
        )


class _Play(_Beside):
    """A mass behind a gap; a scan finds the gap and the rate, for impacts make the fit jump."""

    __slots__ = ()
    code = "backlash"

    def start(self) -> FloatArray | None:
        low, high = np.log(_GAPS).tolist()
        gaps: FloatArray = np.linspace(low, high, _SCAN, dtype=np.float64)
        width, coasts = (high - low) / (_SCAN - 1), _COASTS
        for _ in range(2):
            places = [np.array((np.exp(gap), *coast)) for gap in gaps for coast in coasts]
            courses = self._coasting(np.stack(places), self.table.signals.position)
            tried = [self.acceleration(each) for each in courses]
            best, gain = self.pick(tried)
            if gain < _HINT:
                return None
            self.scanned[:] = [places[best], tried[best]]
            gaps = np.log(places[best][0]) + width * np.linspace(-0.5, 0.5, _SCAN)
            coasts = (coasts[best % len(coasts)],)
        return np.empty(0)

    def at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.beside(theta, self.scanned[1])

    def apart(self, found: Solution, position: FloatArray) -> FloatArray:
        del found
        return self._coasting(self.scanned[0][None], position)[0]

    def _coasting(self, places: FloatArray, position: FloatArray) -> FloatArray:
        """Distance from a mass that coasts in a gap until it closes, shape (gaps, n)."""
        smooth = LowPass.at(_FINER * self.table.cut_off.frequency, self.step).continued(position)
        half, kept = places[:, 0] * np.ptp(position) / 2, np.exp(-places[:, 1] * self.step)
        second, moved, before = np.full(half.size, smooth[0]), np.zeros(half.size), smooth[0]
        course = np.empty((smooth.size, half.size))
        for row, place in zip(course, smooth.tolist(), strict=True):
            free, step = second + moved, place - before
            second = np.minimum(np.maximum(free, place - half), place + half)
            back = step + places[:, 2] * (step - moved)
            moved = np.where(second == free, moved * kept, back)
            row[:], before = second, place
        return np.ascontiguousarray((course - smooth[:, None]).T)

    def told(self, found: Solution, around: FloatArray) -> _Told:
        del around
        mass, second = float(found.weights[0]), float(found.weights[-1])
        gap = float(self.scanned[0][0] * np.ptp(self.table.signals.position))
        return _Told(
            seen=f"play of about {gap:.2g} before {second / mass:.0%} of the mass, {mass:.4g}",
            remedy="Take the play out of the gear, belt or coupling. In the gap the actuator moves "
            f"{mass - second:.3g} alone: the interval of the mass goes from there to all of it.",
            masses=(mass - second, mass),
        )


#: Other parts than _LEFT: no model follows impacts of play, drives before a spring stick (devices
#: without one leave 0.64 or more), mass by position leaves 0.03, a force that saturates 0.22.
_OTHER: dict[type[_Kind], float] = {_Play: 0.7, _Elastic: 0.6, _Uneven: 0.15}


def find_dynamics(
    log: Trajectory, whole: Regression, late: float, hardware: Hardware, *, least: float
) -> Dynamics | None:
    """The kind that takes most of what the model leaves away; None where there is none.

    None also where another delay does as well, or friction, which leaves ``least``, mean squares.
    """
    part, table = excited_part(log, _LONGEST), whole
    if part is not log:
        room = whole.known * whole.signals.step
        table = prepare(part, whole.model, room, refine=False).refined(late)
    force = table.force(late)
    residual = force - np.linalg.lstsq(table.columns.T, force)[0] @ table.columns
    before, power = float(residual @ residual), float(force @ force)
    noise = force.size * table.noise_force(late) ** 2
    given = None if hardware.delay is None else late
    best: tuple[_Kind, Solution] | None = None
    cost = before
    for make in (_Kind, _Lag, _Load, _Uneven, _Elastic, _Resonance, _Play):
        lowest = _FOR_PLAY if make is _Play else LEAST  # play takes longest to look for
        quiet = cost < max(lowest**2 * power, LOUD * noise) and make is not _Lag
        known = (
            given is None if make is _Kind else make is _Lag and hardware.current_lag is not None
        )
        if quiet or known:
            continue
        kind = make(table, residual, None if make is _Kind else given, late)
        found = kind.fitted()
        most = noise + _OTHER.get(make, _LEFT) * (before - noise)
        better = 1.0 if best is None else _THAN_DELAY if best[0].code == "" else _BETTER
        if found is not None and found.cost < min(most, better * cost):
            best, cost = (kind, found), found.cost
    if best is None or best[0].code == "" or cost >= least * power:
        return None
    if before - cost < max(LEAST**2 * power, noise):
        return None
    left = max(cost - noise, 0.0) / (before - noise)
    return _described(log, whole, *best, left, float(np.sqrt(cost / power)), hardware)


def _described(
    log: Trajectory,
    whole: Regression,
    kind: _Kind,
    found: Solution,
    left: float,
    share: float,
    hardware: Hardware,
) -> Dynamics:
    from identification.estimators.response import departure_of

    count = len(kind.table.columns)
    jacobian = np.concatenate((found.columns, found.slopes))
    around = spread(jacobian, found.residual, len(jacobian), signal=found.target).covariance
    shared = around[:count, count:]
    doubt = shared @ np.linalg.pinv(around[count:, count:], hermitian=True) @ shared.T
    most = _MOST_BY_PLAY if isinstance(kind, _Play) else _MOST
    told = kind.told(found, around)
    refused = share > most or told.needed != ""
    named = Finding(
        code=told.code or kind.code,
        severity="refusal" if refused else "warning",
        seen=f"{log.source} shows {told.seen}; with it {left:.0%} is left of the mean square that "
        f"mass, damping and friction miss of the force{departure_of(kind.table, kind.late)}",
        needed=told.needed or f"at most {most:.0%} of the force explained by neither"
        if refused
        else "a device that moves as one mass, driven by the force as commanded",
        remedy=told.remedy,
    )
    return Dynamics(
        log=replace(log, force=kind.corrected(log, found, whole)),
        doubt=(doubt + doubt.T) / 2,
        left=float(np.sqrt(left)) if isinstance(kind, _Play) else left,
        share=share,
        findings=(named,) if refused or not _is_stated(told, hardware) else (),
        current_lag=told.current_lag,
        mode=told.mode,
        masses=told.masses,
    )


def _around(logarithm: float, variance: float) -> Quantity:
    """A positive quantity from its logarithm and the variance of that, with its 95 % interval."""
    value, ratio = np.exp(logarithm), np.exp(NORMAL_95 * min(np.sqrt(max(variance, 0.0)), 1.0))
    return quantity(float(value), float(value / ratio), float(value * ratio), source="log")


def _is_stated(told: _Told, hardware: Hardware) -> bool:
    found = told.mode
    return found is not None and any(
        is_near(found.frequency_hz, each.frequency_hz)
        and is_near(found.damping_ratio, each.damping_ratio, _DAMPED_ALIKE)
        and found.at_encoder <= abs(each.at_encoder) * AS_STATED
        for each in hardware.modes
    )


def _range(number: Quantity, unit: float = 1.0) -> str:
    return f"{number.value * unit:.3g} ± {(number.high - number.low) / 2 * unit:.1g}"


def _written(number: Quantity) -> str:
    return f"{{value: {number.value:.4g}, low: {number.low:.4g}, high: {number.high:.4g}}}"
