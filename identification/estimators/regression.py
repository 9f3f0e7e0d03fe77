"""Regression: every term of the equation of motion at measured positions, through one low-pass.

The rows (rows.py) are exact for any time stamps; one zero-phase low-pass goes over all columns and
the force alike, so what it does to them cancels. One file: one class, and how a log becomes one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identification.estimators.cut_off import CutOff, choose_cut_off
from identification.estimators.low_pass import LowPass
from identification.estimators.model import Model
from identification.estimators.motion import Motion, measured_motion, refine_motion
from identification.estimators.rows import FIRST, Signals, of_rows
from identification.estimators.terms import others, terms
from identification.estimators.zero_order_hold import HeldColumn, even_taps, unknown_intervals
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Times the direction of motion is refined by the fitted model at most; ...
REFINEMENTS = 20
#: ... it has settled when friction comes within this part of what it was before: at the last step,
#: or some steps ago, if turns flip between neighbouring intervals for ever.
SETTLED = 1e-4
#: Numbers of filtered forces that are kept.
_MOST_KEPT = 1 << 21


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The filtered columns of one log.

    Attributes:
        signals: the log.
        model: which columns.
        known: first sample whose interval feels only logged forces.
        motion: direction and standstill the friction columns were made from.
        cut_off: of the filter, and why there.
        low_pass: the filter.
        columns: filtered acceleration, velocity and other terms, in the order of the model's
            parameters, shape (p, rows).
        mean_speed: s of the model, m/s.
        logged: force as it was sent, filtered, shape (n - 2·half,); empty if steps are uneven.
        filtered_forces: N by delay, s: the last made for this standstill, shape (rows,) each.
    """

    signals: Signals
    model: Model
    known: int
    motion: Motion
    cut_off: CutOff
    low_pass: LowPass
    columns: FloatArray
    mean_speed: float
    logged: FloatArray
    filtered_forces: dict[float, FloatArray] = field(default_factory=dict[float, FloatArray])

    @classmethod
    def of(
        cls, signals: Signals, model: Model, motion: Motion, *, cut_off: CutOff, known: int
    ) -> Regression:
        """Columns of a log; see the attributes."""
        rows, low_pass = signals.kinematics, LowPass.at(cut_off.frequency, signals.step)
        table = cls(
            signals=signals,
            model=model,
            known=known,
            motion=motion,
            cut_off=cut_off,
            low_pass=low_pass,
            columns=low_pass(np.stack((rows.acceleration, rows.velocity)))[:, known:],
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
        return Regression.of(
            self.signals,
            self.model,
            self.motion,
            cut_off=CutOff(frequency=frequency),
            known=self.known,
        )

    def knowing(self, delay: float) -> Regression:
        """With the rows that feel only logged forces at a delay, s, or a shorter one."""
        known = unknown_intervals(self.signals.steps, delay)
        return Regression.of(
            self.signals, self.model, self.motion, cut_off=self.cut_off, known=known
        )

    def held_terms(self, motion: Motion) -> tuple[HeldColumn, ...]:
        """The terms beside mass and damping, unfiltered, for a direction of motion."""
        return terms(self.model, motion, self.signals.position, self.signals.steps).columns

    def _with_terms(self) -> Regression:
        found = terms(self.model, self.motion, self.signals.position, self.signals.steps)
        columns = [self.columns[:2]]
        if found.columns:
            triangles = np.stack([of_rows(each.triangle()) for each in found.columns])
            columns.append(self.low_pass(triangles)[:, self.known :])
        return replace(self, columns=np.concatenate(columns), mean_speed=found.mean_speed)

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
        if self.logged.size and np.all(self.motion.moving):
            return np.stack([self._shifted(delay) for delay in delays])
        known = self.filtered_forces
        missing = [delay for delay in dict.fromkeys(delays) if delay not in known]
        if missing:
            acting = [self.held_force(delay).times(self.motion.moving) for delay in missing]
            unfiltered = np.stack([of_rows(each.triangle()) for each in acting])
            made = dict(zip(missing, self.low_pass(unfiltered)[:, self.known :], strict=True))
            found = np.stack([(known | made)[delay] for delay in delays])
            if (len(known) + len(made)) * found.shape[1] > _MOST_KEPT:
                known.clear()
            known.update(made)
            return found
        return np.stack([known[delay] for delay in delays])

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

    def refined(self, delay: float) -> Regression:
        """This regression with the direction of motion from the fitted model."""
        if not self.model.coulomb:
            return self
        signals = self.signals
        applied = smoothed = before = np.empty(0)
        table = self
        for _ in range(REFINEMENTS):
            values = dict(zip(self.model.parameters, table.solve(delay), strict=True))
            friction = values["coulomb_friction"]
            if friction <= 0:
                # Without friction nothing holds the device still, however slowly it moves.
                return table.with_motion(table.motion.released())
            if values["mass"] <= 0 or np.any(np.abs(friction - before) < SETTLED * friction):
                break
            before = np.append(before, friction)
            if not smoothed.size:
                applied = self.held_force(delay).mean()
                smoothed = self.low_pass.continued(signals.speed)
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


def prepare(
    trajectory: Trajectory,
    model: Model,
    delay: float,
    *,
    refine: bool = True,
) -> Regression:
    """The regression of one log.

    Args:
        trajectory: the log; time stamps are used as they are.
        model: which terms to estimate.
        delay: s; the force can later be had with any delay up to this one.
        refine: settle the direction of motion at this delay.
    """
    signals = Signals.of(trajectory)
    acceleration = signals.kinematics.acceleration
    chosen = choose_cut_off(acceleration, signals.step, signals.noise)
    motion = Motion.always(signals.speed.size, signals.steps)
    if model.coulomb:
        smooth = LowPass.at(chosen.frequency, signals.step)(acceleration)
        bend = float(np.sqrt(np.mean(smooth**2))) * signals.step**2
        motion = measured_motion(signals.position, signals.steps, noise=signals.noise, bend=bend)
    known = unknown_intervals(signals.steps, delay)
    table = Regression.of(signals, model, motion, cut_off=chosen, known=known)
    return table.refined(delay) if refine else table
