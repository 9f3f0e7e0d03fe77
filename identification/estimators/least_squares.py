"""Filtered least squares: a log as a regression, its low-pass, its delay and the estimate.

Every term of the equation of motion at measured positions makes a column. The rows are exact for
any time stamps; one zero-phase low-pass goes over all columns and the force alike, so what it does
to them cancels. The other estimators begin with this regression, or with its inputs (Drive).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from identification.estimators.estimate import (
    Estimate,
    Model,
    PointEstimate,
    Spread,
    spread,
    unit_columns,
)
from identification.estimators.filters import REACH, LowPass, width_of
from identification.estimators.motion import Motion, measured_motion, others, refine_motion, terms
from identification.estimators.signals import (
    FIRST,
    Commands,
    HeldColumn,
    HeldResponse,
    Signals,
    even_taps,
    kinematics_of,
    mean_step,
    of_rows,
    unknown_intervals,
)
from identification.trajectory import FloatArray, Trajectory, excited_part

#: Noise may make up this share of the power of the filtered acceleration; it attenuates the mass
#: by the same share.
_NOISE_SHARE = 1e-4
#: The cut-off need not exceed this multiple of the frequency that holds most of the acceleration:
#: above it there is nothing to learn, only vibration modes that the model does not have.
_HEADROOM = 5.0
#: ... most of its power, that is.
_MOST = 0.99
#: Highest cut-off, part of the sampling rate: central differences stay accurate below.
_HIGHEST = 0.1
#: The kernel may take this part of a log, or too few independent rows are left.
_LONGEST_KERNEL = 0.1
#: Cut-offs looked at, evenly spaced on a logarithmic scale.
_CANDIDATES = 40
#: Bins of frequency, evenly spaced on a logarithmic scale, for the sums over candidates.
_BINS = 400
#: Rows looked at, from the middle of the log; more add time, not truth.
_LONGEST = 1 << 17
#: Times the direction of motion is refined by the fitted model at most; ...
REFINEMENTS = 20
#: ... it has settled when friction comes within this part of what it was before: at the last step,
#: or some steps ago, if turns flip between neighbouring intervals for ever.
_SETTLED = 1e-4
#: Numbers of filtered forces that are kept.
_MOST_KEPT = 1 << 21
#: The cut-off is divided and multiplied by this to see whether the estimate leans on it; half of
#: the difference is one more standard deviation.
CUT_OFF_RANGE = 2.0
#: Longest delay looked for, s, part of the log at most, and sample times at least; a longer one is
#: to be stated.
_LONGEST_DELAY, _LONGEST_PART, _LONGEST_SAMPLES = 0.010, 0.1, 4
#: Fastest |p| searched, per sample: there nothing of a motion is left after one, and no log tells a
#: faster one. A bound that a device may reach would be taken for its rate.
FASTEST = 50.0
#: Fastest growth searched, per log: e^50 exceeds any travel.
_GROWTH = 50.0
#: Intervals whose mean speed is where a search for the velocity at the start begins.
FIRST_LOOK = 10
#: Steps of the scan, s, and sample times at least, ...
_SCAN_STEP, _SCAN_SAMPLES = 2.5e-4, 0.5
#: ... and the finer steps about the best, parts of it, each with a parabola through the best three.
_FINER = (0.5, 0.1, 0.02)
#: ... and as often as the lowest of three is the first or the last, up to so many times.
_MOST_MOVES = 8
#: Scans: the direction of motion is refined at the delay of the scan before.
_ROUNDS = 2
#: Samples of the rough scan.
_ROUGH = 1 << 13
#: A residual is loud from this part of the force on, rms, and this many mean squares of noise.
#: Noise beside a resonance near the cut-off looks like a lighter device there.
LEAST, LOUD = 0.003, 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class CutOff:
    """A cut-off and why."""

    frequency: float  # Hz
    reason: str = "low-pass as given"  # what set it, if it was chosen from a log


def choose_cut_off(acceleration: FloatArray, step: float, noise: float) -> CutOff:
    """The highest cut-off at which noise of the position reading still does no harm.

    The lower the cut-off, the less noise in the acceleration; the higher, the more of the motion is
    used. Both powers are read from the log: noise is white in position, so its acceleration grows
    with ω⁴.
    """
    middle = max(0, (acceleration.size - _LONGEST) // 2)
    part = acceleration[middle : middle + _LONGEST]
    window = np.hanning(part.size)
    power = np.abs(np.fft.rfft(part * window)) ** 2
    frequency = np.fft.rfftfreq(part.size, step).astype(np.float64)
    relative = 2 * np.sin(np.pi * frequency * step)
    floor = (noise / step**2) ** 2 * np.sum(window**2) * relative**4
    highest = _HIGHEST / step
    # Both reaches of the kernel together, REACH standard deviations each.
    lowest = min(highest, 2 * REACH * width_of(1.0) / (_LONGEST_KERNEL * step * acceleration.size))
    candidates = np.geomspace(lowest, highest, _CANDIDATES)
    total, parasitic = _passed(frequency, candidates, np.stack((power, floor)))
    share = parasitic / np.maximum(np.maximum(total, parasitic), np.finfo(float).tiny)
    quiet = np.flatnonzero(share <= _NOISE_SHARE)
    index = int(quiet[-1]) if quiet.size else int(np.argmin(share))
    chosen, why = float(candidates[index]), "position noise"
    if index == _CANDIDATES - 1:
        why = "the sampling rate"
    signal: FloatArray = (
        np.maximum(power - floor, 0.0) * np.exp(-np.log(2) * (frequency / chosen) ** 2)
    ).cumsum()
    reached = int(np.argmax(signal >= _MOST * signal[-1]))
    enough = _HEADROOM * float(frequency[reached])
    if enough < chosen:
        chosen, why = max(enough, lowest), "where the motion has its power"
    return CutOff(frequency=chosen, reason=f"low-pass at {chosen:.3g} Hz, set by {why}")


def _passed(frequency: FloatArray, candidates: FloatArray, powers: FloatArray) -> FloatArray:
    """What each cut-off lets through of each power, in fine bins, shape (powers, candidates)."""
    edges: FloatArray = (
        candidates[0] / 100 * (100 * frequency[-1] / candidates[0]) ** np.linspace(0, 1, _BINS)
    )
    where = np.searchsorted(edges, frequency[1:])
    centre = np.concatenate((edges[:1], np.sqrt(edges[1:] * edges[:-1]), edges[-1:]))
    gathered = np.stack([np.bincount(where, power[1:], minlength=centre.size) for power in powers])
    return gathered @ np.exp(-np.log(2) * (centre[:, None] / candidates) ** 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The filtered columns of one log."""

    signals: Signals  # the log
    model: Model  # which columns
    known: int  # first sample whose interval feels only logged forces
    motion: Motion  # direction and standstill the friction columns were made from
    cut_off: CutOff  # of the filter, and why there
    low_pass: LowPass  # the filter
    #: filtered acceleration, velocity and other terms, in the order of the model's parameters,
    #: shape (p, rows)
    columns: FloatArray
    mean_speed: float  # s of the model, m/s
    #: force as it was sent, filtered, shape (n - 2·half,); empty if steps are uneven
    logged: FloatArray
    #: N by delay, s: the last made for this standstill, shape (rows,) each
    filtered_forces: dict[float, FloatArray] = field(default_factory=dict[float, FloatArray])

    @classmethod
    def of(
        cls, signals: Signals, model: Model, motion: Motion, *, cut_off: CutOff, known: int
    ) -> Regression:
        """Columns of a log; see the attributes."""
        low_pass = LowPass.at(cut_off.frequency, signals.step)
        table = cls(
            signals=signals,
            model=model,
            known=known,
            motion=motion,
            cut_off=cut_off,
            low_pass=low_pass,
            columns=low_pass(signals.kinematics)[:, known:],
            mean_speed=0.0,
            logged=np.empty(0)
            if isinstance(signals.steps, np.ndarray)
            else low_pass(signals.commands.value),
        )
        return table._with_terms()

    @property
    def first(self) -> int:
        """Sample of the first filtered row."""
        return FIRST + self.low_pass.half + self.known

    def with_model(self, model: Model) -> Regression:
        """This regression with other terms, log and filter as they are."""
        intervals = self.signals.speed.size
        motion = self.motion if model.coulomb else Motion.always(intervals, self.signals.steps)
        return replace(self, model=model)._moved(motion)

    def with_motion(self, motion: Motion) -> Regression:
        """This regression with another direction of motion; itself where that is no other."""
        return self if motion is self.motion else self._moved(motion)

    def _moved(self, motion: Motion) -> Regression:
        same = np.array_equal(motion.moving, self.motion.moving)
        forces = self.filtered_forces if same else {}
        return replace(self, motion=motion, filtered_forces=forces)._with_terms()

    def at_cut_off(self, frequency: float) -> Regression:
        """This regression at another cut-off, Hz, its direction of motion as it is."""
        cut_off = CutOff(frequency=frequency)
        return Regression.of(
            self.signals, self.model, self.motion, cut_off=cut_off, known=self.known
        )

    def with_delays_to(self, delay: float) -> Regression:
        """With the rows that feel only logged forces at a delay, s, or a shorter one."""
        known = unknown_intervals(self.signals.steps, delay)
        return Regression.of(
            self.signals, self.model, self.motion, cut_off=self.cut_off, known=known
        )

    def unfiltered(self, position: FloatArray, motion: Motion) -> FloatArray:
        """Columns of another position and direction of motion before the filter."""
        steps = self.signals.steps
        beside, _ = terms(self.model, motion, position, steps)
        triangles = [of_rows(each.triangle()) for each in beside]
        return np.stack((*kinematics_of(position - np.mean(position), steps), *triangles))

    def _with_terms(self) -> Regression:
        signals, columns = self.signals, [self.columns[:2]]
        found, mean_speed = terms(self.model, self.motion, signals.position, signals.steps)
        if found:
            triangles = np.stack([of_rows(each.triangle()) for each in found])
            columns.append(self.low_pass(triangles)[:, self.known :])
        return replace(self, columns=np.concatenate(columns), mean_speed=mean_speed)

    def filtered(self, held: HeldColumn) -> FloatArray:
        """Rows of a held column, filtered, shape (rows,)."""
        return self.low_pass(of_rows(held.triangle()))[self.known :]

    def held_force(self, delay: float) -> HeldColumn:
        """The force where it acts, unfiltered, delay in s."""
        return self.signals.commands.after(delay)

    def force(self, delay: float) -> FloatArray:
        """The filtered force with a delay in s, shape (rows,)."""
        kept = self.filtered_forces.get(delay)
        return self.forces([delay])[0] if kept is None else kept

    def forces(self, delays: Sequence[float]) -> FloatArray:
        """The filtered force with several delays in s, shape (delays, rows)."""
        logged = unknown_intervals(self.signals.steps, max(delays)) <= self.known
        if logged and self.logged.size and np.all(self.motion.moving):
            return np.stack([self._shifted(delay) for delay in delays])
        known = self.filtered_forces
        for delay in delays:
            if delay not in known:
                known[delay] = self.filtered(self.held_force(delay).times(self.motion.moving))
        found = np.stack([known[delay] for delay in delays])
        if len(known) * found.shape[1] > _MOST_KEPT:
            known.clear()
        return found

    def _shifted(self, delay: float) -> FloatArray:
        """The filtered force of a log with even steps in which nothing stands, shape (rows,)."""
        whole, taps = even_taps(delay, self.signals.step)
        first, rows = self.known + FIRST - whole, self.columns.shape[1]
        parts = (self.logged[first - back : first - back + rows] for back in range(len(taps)))
        return sum((tap * part for tap, part in zip(taps, parts, strict=True)), np.zeros(rows))

    def solve(self, delay: float) -> FloatArray:
        """Parameters, shape (p,): least squares, less what noise adds to the squares of columns.

        Noise in a column would shrink its parameter (Fuller, Measurement Error Models, 1987,
        section 1.2); its mean square is known from the noise of a reading and the filter.
        """
        squares = self.columns @ self.columns.T
        norms = np.sqrt(np.diag(squares))
        norms = np.where(norms > 0, norms, 1.0)
        squares -= np.diag(self.columns.shape[1] * self._attenuation())
        right = self.columns @ self.force(delay)
        return np.linalg.lstsq(squares / np.outer(norms, norms), right / norms)[0] / norms

    def _attenuation(self) -> FloatArray:
        """Mean square of noise of a reading in each column, shape (p,)."""
        # As the second and the central difference pass it on.
        acceleration, velocity = self.low_pass.noise_gains(self.signals.step)
        gains = {"mass": acceleration, "damping": velocity, "damping_asymmetry": velocity}
        of_columns = [gains.get(name, 0.0) for name in self.model.parameters]
        return self.signals.noise**2 * np.array(of_columns)

    def noise_force(self, delay: float) -> float:
        """Rms of the force that noise of the readings makes of the mass, N."""
        return float(abs(self.solve(delay)[0]) * np.sqrt(self._attenuation()[0]))

    def is_loud(self, delay: float) -> bool:
        """Whether more of the force is left than noise explains; never said of uneven steps."""
        if isinstance(self.signals.steps, np.ndarray):
            return False
        force = self.force(delay)
        left = float(np.mean((force - self.solve(delay) @ self.columns) ** 2))
        least = LEAST**2 * float(np.mean(force**2))
        return left > max(least, LOUD * self.noise_force(delay) ** 2)

    def refined(self, delay: float) -> Regression:
        """This regression with the direction of motion from the fitted model."""
        if not self.model.coulomb:
            return self
        signals = self.signals
        applied, smoothed = self.held_force(delay).mean(), self.low_pass.continued(signals.speed)
        table, before = self, np.empty(0)
        for _ in range(REFINEMENTS):
            values = dict(zip(self.model.parameters, table.solve(delay), strict=True))
            friction = values["coulomb_friction"]
            if friction <= 0:
                # Without friction nothing holds the device still, however slowly it moves.
                return table.with_motion(table.motion.released())
            if values["mass"] <= 0 or np.any(np.abs(friction - before) < _SETTLED * friction):
                break
            before = np.append(before, friction)
            motion = refine_motion(
                table.motion,
                smoothed,
                applied - others(self.model, table.motion, signals.position, signals.steps, values),
                steps=signals.steps,
                low_pass=self.low_pass,
                mass=values["mass"],
                damping=values["damping"],
                friction=friction,
            )
            table = table.with_motion(motion)
        return table


@dataclass(frozen=True, slots=True)
class Drive:
    """Inputs of one log; the delay is given, or one more nonlinear parameter."""

    commands: Commands  # forces as logged
    terms: tuple[HeldColumn, ...]  # columns of the terms beside mass and damping
    moving: FloatArray  # 1, or 0 where the device stands, shape (n - 1,)
    steps: float | FloatArray  # of the log, s: one number, or shape (n - 1,)
    delay: float | None  # s, or None if it is fitted

    @classmethod
    def of(cls, table: Regression, delay: float | None) -> Drive:
        """Inputs as a prepared regression knows them."""
        signals, motion = table.signals, table.motion
        beside, _ = terms(table.model, motion, signals.position, signals.steps)
        return cls(signals.commands, beside, motion.moving, signals.steps, delay)

    @classmethod
    def bare(cls, signals: Signals, delay: float | None) -> Drive:
        """The force alone, as if the device never stood."""
        return cls(signals.commands, (), np.ones(signals.speed.size), signals.steps, delay)

    def inputs(self, delay: float) -> tuple[HeldColumn, ...]:
        """Force, then the terms, where they act."""
        return (self.commands.after(delay).times(self.moving), *self.terms)

    def slope_by_delay(self, device: HeldResponse, delay: float) -> FloatArray:
        """What the force adds in each interval, differentiated by its delay."""
        force = self.commands.after(delay)
        return device.slope_by_delay(force, float(self.commands.value[0])) * self.moving

    @property
    def rates(self) -> tuple[float, float]:
        """p searched, 1/s."""
        step = mean_step(self.steps)
        return -_GROWTH / step / self.moving.size, FASTEST / step

    def rate_of(self, values: FloatArray) -> float:
        """b/m as far as it is searched: where the force follows the position there is no mass."""
        return float(np.clip(values[1] / values[0] if values[0] > 0 else 0.0, *self.rates))

    def bounds(self, *between: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest θ searched: p, what is between, and the delay if it is fitted."""
        ranges = [self.rates, *between, *([self.delays] if self.delay is None else [])]
        low, high = np.array(ranges).T
        return low, high

    def delay_of(self, theta: FloatArray) -> float:
        """The delay, s: as given, or the last parameter."""
        return float(theta[-1]) if self.delay is None else self.delay

    @property
    def delays(self) -> tuple[float, float]:
        """Delays searched, s."""
        return 0.0, longest_delay(mean_step(self.steps), self.moving.size)


def prepare(
    trajectory: Trajectory, model: Model, delay: float, *, refine: bool = True
) -> Regression:
    """The regression of one log, whose force can be had with any delay up to the one given, s."""
    signals = Signals.of(trajectory)
    acceleration = signals.kinematics[0]
    chosen = choose_cut_off(acceleration, signals.step, signals.noise)
    motion = Motion.always(signals.speed.size, signals.steps)
    if model.coulomb:
        smooth = LowPass.at(chosen.frequency, signals.step)(acceleration)
        bend = float(np.sqrt(np.mean(smooth**2))) * signals.step**2
        motion = measured_motion(signals.position, signals.steps, noise=signals.noise, bend=bend)
    known = unknown_intervals(signals.steps, delay)
    table = Regression.of(signals, model, motion, cut_off=chosen, known=known)
    return table.refined(delay) if refine else table


def complete_estimate(
    method: str,
    table: Regression,
    found: PointEstimate,
    around: Spread,
    *,
    fitted: bool,
    unit: Literal["force", "position"],
    notes: Sequence[str],
    choice_shift: FloatArray | None = None,
) -> Estimate:
    """The Estimate of one fit, whose covariance ends with the delay if that was fitted."""
    size = found.values.size
    covariance = around.covariance[:size, :size]
    if choice_shift is not None:
        covariance = covariance + np.outer(choice_shift, choice_shift)
    return Estimate(
        method=method,
        model=table.model,
        delay=found.delay,
        delay_deviation=float(np.sqrt(around.covariance[size, size])) if fitted else None,
        values=found.values,
        covariance=covariance,
        degrees_of_freedom=around.degrees_of_freedom,
        residual=found.residual,
        residual_unit=unit,
        explained=found.explained,
        condition=around.condition,
        inflation=around.inflation[:size],
        mean_speed=table.mean_speed,
        choice_shift=choice_shift,
        notes=tuple(notes),
    )


def point(table: Regression, delay: float, *, fits_delay: bool = False) -> PointEstimate:
    """What ``fit`` finds, without intervals."""
    del fits_delay  # GIVEN_A_DELAY
    force, values = table.force(delay), table.solve(delay)
    residual = force - values @ table.columns
    return PointEstimate(values=values, delay=delay, signal=force, residual=residual)


def fit(table: Regression, delay: float, *, fits_delay: bool = False) -> Estimate:
    """Mass, damping and friction by filtered least squares; the delay is not fitted."""
    found = point(table, delay, fits_delay=fits_delay)
    force, residual = found.signal, found.residual
    around = spread(table.columns, residual, len(table.columns), signal=force)
    low, high = (
        table.at_cut_off(factor * table.cut_off.frequency).solve(delay)
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    notes = (
        table.cut_off.reason,
        f"at half the cut-off mass is {low[0]:.5g} and damping {low[1]:.5g}",
        f"at twice the cut-off mass is {high[0]:.5g} and damping {high[1]:.5g}",
    )
    return complete_estimate(
        "least-squares",
        table,
        found,
        around,
        fitted=False,
        unit="force",
        notes=notes,
        # What depends on the filter is an error of the model, which blocks of one log do not show.
        choice_shift=(high - low) / 2,
    )


def longest_delay(step: float, samples: int) -> float:
    """The longest delay that is looked for in a log of so many samples, s; the step is in s."""
    return max(min(_LONGEST_DELAY, _LONGEST_PART * samples * step), _LONGEST_SAMPLES * step)


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """A delay read from a log."""

    value: float  # s
    deviation: float  # standard deviation, s


def find_delay(trajectory: Trajectory, table: Regression) -> Delay:
    """The delay, up to the longest looked for, at which least squares leaves the least residual.

    Delaying a force and adding damping look alike in a log of a single frequency; then the
    deviation is large, and so becomes the interval of the damping. The regression has as many known
    intervals as the longest delay needs.
    """
    step = table.signals.step
    most = longest_delay(step, len(trajectory)) / step
    width = max(_SCAN_STEP / step, _SCAN_SAMPLES)
    grid = np.linspace(0, most, 1 + int(np.ceil(most / width)))
    # The rough scan needs no more than a part of a long log.
    rough, part = excited_part(trajectory, _ROUGH), table
    if rough is not trajectory:
        longest = longest_delay(rough.sample_time, len(trajectory))
        part = prepare(rough, table.model, longest, refine=False)
    best = 0.0
    for _ in range(_ROUNDS):
        best = _lowest(grid, _costs(part, _basis(part), grid))
        before, part = part, part.refined(best * step)
        if part is before:
            break
    if rough is trajectory:
        table = part
    basis = np.empty(0)
    for finer in _FINER:
        before, table = table, table.refined(best * step)
        if table is not before or not basis.size:
            basis = _basis(table)
        half = min(finer * width, most / 2)
        for _ in range(_MOST_MOVES):
            near = np.clip(best, half, most - half) + half * np.array([-1.0, 0.0, 1.0])
            seen, best = best, _lowest(near, _costs(table, basis, near))
            if near[0] < best < near[-1] or best == seen:
                break
    # Nothing is known of a delay but that it lies within the scan.
    ignorance = most / np.sqrt(12)
    deviation = min(shift_of_delay(table, best * step).deviation, ignorance * step)
    return Delay(value=best * step, deviation=deviation)


def shift_of_delay(table: Regression, delay: float) -> Delay:
    """How much later than assumed the force acts, s: one step of Gauss and Newton from a delay."""
    step = table.signals.step
    low, high = max(delay - step / 2, 0.0), delay + step / 2
    slope = (table.force(high) - table.force(low)) / (high - low)
    columns, force = np.vstack((-slope, table.columns)), table.force(delay)
    unit, norms = unit_columns(columns.T)
    weights = np.linalg.lstsq(unit, force, rcond=None)[0]
    shift, residual = float(weights[0] / norms[0]), force - unit @ weights
    around = spread(columns, residual, 1, signal=force)
    return Delay(value=shift, deviation=float(np.sqrt(max(around.covariance[0, 0], 0.0))))


def _basis(table: Regression) -> FloatArray:
    """Orthonormal columns that span those of the regression, shape (rows, p)."""
    return np.linalg.qr(unit_columns(table.columns.T)[0])[0]


def _costs(table: Regression, basis: FloatArray, samples: FloatArray) -> FloatArray:
    """Sum of squared residuals of the best fit at each delay, in samples."""
    step = table.signals.step
    forces = table.forces([float(each) * step for each in samples])
    return np.sum((forces - forces @ basis @ basis.T) ** 2, axis=1)


def _lowest(grid: FloatArray, costs: FloatArray) -> float:
    """The minimum of a parabola through the lowest cost and its neighbours."""
    index = int(np.argmin(costs))
    if index in {0, grid.size - 1} or grid[index - 1] == grid[index + 1]:
        return float(grid[index])
    left, middle, right = costs[index - 1 : index + 2]
    bend = left - 2 * middle + right
    shift = (left - right) / (2 * bend) if bend > 0 else 0.0
    return float(grid[index] + np.clip(shift, -1, 1) * (grid[index + 1] - grid[index]))
