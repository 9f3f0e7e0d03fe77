"""Filtered least squares: every term of the equation of motion through one low-pass.

m·q̈ + b·q̇ + Fc·sign(q̇) + f0 = F(t - delay) is averaged over a triangle of two samples and then
filtered. Position enters by its second and first central difference, the held force by its mean
over the triangle, (F[k] + F[k-1])/2 without delay: exact for a pure mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.estimators.cut_off import CutOff, choose_cut_off
from identification.estimators.held import Held, delayed, unknown_intervals
from identification.estimators.linear import explained, unit_columns
from identification.estimators.low_pass import LowPass
from identification.estimators.model import Estimate, Model
from identification.estimators.motion import (
    Mechanics,
    Motion,
    always_moving,
    first_look,
    refined,
)
from identification.estimators.noise import position_noise
from identification.estimators.whiteness import whiteness
from identification.intervals import spread
from identification.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: Times the direction of motion is refined by the fitted model at most; ...
REFINEMENTS = 20
#: ... it has settled when friction changes by less than this part.
SETTLED = 1e-4
#: The cut-off is divided and multiplied by this to see whether the estimate leans on it; half of
#: the difference is one more standard deviation.
CUT_OFF_RANGE = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The filtered columns of one log.

    Attributes:
        kinematics: filtered acceleration and velocity, shape (rows, 2).
        friction: filtered columns of the friction terms, shape (rows, p - 2).
        motion: direction and standstill the friction columns were made from.
        cut_off: of the filter, and why there.
        low_pass: the filter.
        noise: standard deviation of one position reading, m.
        attenuation: mean square of noise in each column, shape (p,).
        first: sample of the first row.
    """

    trajectory: Trajectory
    model: Model
    kinematics: FloatArray
    friction: FloatArray
    motion: Motion
    cut_off: CutOff
    low_pass: LowPass
    noise: float
    attenuation: FloatArray
    first: int

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        model: Model,
        *,
        cut_off: CutOff,
        noise: float,
        delay: float,
        motion: Motion | None = None,
    ) -> Regression:
        """Columns of a log.

        Args:
            trajectory: the log.
            model: which columns.
            cut_off: of the filter.
            noise: standard deviation of one position reading, m.
            delay: s; the force can be had with any delay up to this one.
            motion: direction and standstill; None takes a first look at the position.
        """
        step = trajectory.sample_time
        low_pass = LowPass.at(cut_off.frequency, step)
        second = np.array([1.0, -2.0, 1.0]) / step**2
        central = np.array([0.5, 0.0, -0.5]) / step
        # The central difference averages velocity over a box of two samples, the force over a
        # triangle: their second moments differ by T²/6, the means by T²/12 of the curvature.
        boxed = np.convolve(central, [-1 / 12, 7 / 6, -1 / 12])
        smooth = low_pass(trajectory.position - np.mean(trajectory.position))
        acceleration = np.convolve(smooth, second, mode="valid")[1:-1]
        velocity = np.convolve(smooth, boxed, mode="valid")
        gains = [np.convolve(low_pass.kernel, difference) for difference in (second, boxed)]
        known = unknown_intervals(delay / step)
        if motion is None:
            bend = float(np.sqrt(np.mean(acceleration**2))) * step**2
            motion = (
                first_look(trajectory.position, noise=noise, bend=bend)
                if model.coulomb
                else always_moving(len(trajectory) - 1)
            )
        table = cls(
            trajectory=trajectory,
            model=model,
            kinematics=np.stack((acceleration, velocity), axis=1)[known:],
            friction=np.empty((0, 0)),
            motion=motion,
            cut_off=cut_off,
            low_pass=low_pass,
            noise=noise,
            attenuation=noise**2
            * np.array([np.sum(gain**2) for gain in gains] + [0.0] * (len(model.parameters) - 2)),
            first=2 + known + low_pass.half,
        )
        return table.with_motion(motion)

    def with_model(self, model: Model) -> Regression:
        """The same log and filter with other friction terms."""
        return replace(
            self,
            model=model,
            attenuation=np.append(self.attenuation[:2], np.zeros(len(model.parameters) - 2)),
        ).with_motion(self.motion if model.coulomb else always_moving(len(self.trajectory) - 1))

    def at_cut_off(self, frequency: float, delay: float) -> Regression:
        """The same log and direction of motion with another cut-off, Hz."""
        return Regression.of(
            self.trajectory,
            self.model,
            cut_off=CutOff(frequency=frequency),
            noise=self.noise,
            delay=delay,
            motion=self.motion,
        )

    @property
    def columns(self) -> FloatArray:
        """Shape (rows, p), in the order of the model's parameters."""
        return np.concatenate((self.kinematics, self.friction), axis=1)

    def with_motion(self, motion: Motion) -> Regression:
        """The same log with another direction of motion."""
        columns: list[FloatArray] = []
        if self.model.coulomb:
            columns.append(self._filtered(motion.direction))
        if self.model.offset:
            constant = Held(early=motion.moving, late=motion.moving, fraction=0.0)
            columns.append(self._filtered(constant))
        friction = np.stack(columns, 1) if columns else np.empty((len(self.kinematics), 0))
        return replace(self, motion=motion, friction=friction)

    def _filtered(self, held: Held) -> FloatArray:
        # Filtered triangles begin at sample 1 + half and end one row after the kinematics.
        return self.low_pass(held.triangle())[self.first - 1 - self.low_pass.half : -1]

    def held_force(self, delay: float) -> Held:
        """The force where it acts, unfiltered, delay in s."""
        return delayed(self.trajectory.force, delay / self.trajectory.sample_time)

    def force(self, delay: float) -> FloatArray:
        """The filtered force with a delay in s, shape (rows,)."""
        return self._filtered(self.held_force(delay).times(self.motion.moving))

    def solve(self, delay: float) -> FloatArray:
        """Parameters, shape (p,): least squares, less what noise adds to the squares of columns.

        Noise in a column would shrink its parameter (Fuller, Measurement Error Models, 1987,
        section 1.2); its mean square is known from the noise of a reading and the filter.
        """
        unit, norms = unit_columns(self.columns)
        normal = unit.T @ unit - np.diag(len(unit) * self.attenuation / norms**2)
        right = unit.T @ self.force(delay)
        return np.linalg.lstsq(normal, right, rcond=None)[0] / norms

    def refined(self, delay: float) -> Regression:
        """The same with the direction of motion from the fitted model."""
        if not self.model.coulomb:
            return self
        table, last = self, np.inf
        for _ in range(REFINEMENTS):
            fitted = dict(zip(self.model.parameters, table.solve(delay), strict=True))
            friction = fitted["coulomb_friction"]
            if friction <= 0:
                # Without friction nothing holds the device still, however slowly it moves.
                return table.with_motion(table.motion.released())
            if fitted["mass"] <= 0 or abs(friction - last) < SETTLED * friction:
                break
            last = friction
            motion = refined(
                self.trajectory.position,
                self.held_force(delay),
                self.trajectory.sample_time,
                kernel=self.low_pass.kernel,
                mechanics=Mechanics(
                    mass=fitted["mass"],
                    damping=fitted["damping"],
                    coulomb_friction=friction,
                    force_offset=fitted.get("force_offset", 0.0),
                ),
                motion=table.motion,
            )
            table = table.with_motion(motion)
        return table


def prepare(
    trajectory: Trajectory,
    model: Model,
    delay: float,
    *,
    cut_off: float | None = None,
    refine: bool = True,
) -> Regression:
    """The regression of one log.

    Args:
        trajectory: as for estimate.
        model: as for estimate.
        delay: s; the force can later be had with any delay up to this one.
        cut_off: as for estimate.
        refine: settle the direction of motion at this delay.
    """
    noise = position_noise(trajectory.position, trajectory.force)
    chosen = choose_cut_off(trajectory, noise) if cut_off is None else CutOff(frequency=cut_off)
    table = Regression.of(trajectory, model, cut_off=chosen, noise=noise, delay=delay)
    return table.refined(delay) if refine else table


def estimate(
    trajectory: Trajectory, model: Model, delay: float, *, cut_off: float | None = None
) -> Estimate:
    """Mass, damping and friction by filtered least squares.

    Args:
        trajectory: the log, n samples at a constant step.
        model: which friction terms to estimate.
        delay: s, command to force; a fraction of a sample is honoured.
        cut_off: Hz; None chooses one from the log (choose_cut_off).

    Returns:
        Estimate with the residual in force, filtered; its notes state the cut-off and what mass
        and damping become at half and at twice of it.
    """
    return fit(prepare(trajectory, model, delay, cut_off=cut_off), delay)


def fit(table: Regression, delay: float) -> Estimate:
    """The same from a prepared regression."""
    force, columns = table.force(delay), table.columns
    values = table.solve(delay)
    residual = force - columns @ values
    around = spread(columns, residual, len(values), signal=force)
    low, high = (
        table.at_cut_off(factor * table.cut_off.frequency, delay).solve(delay)
        for factor in (1 / CUT_OFF_RANGE, CUT_OFF_RANGE)
    )
    # What depends on the filter is an error of the model, which blocks of one log do not show.
    leaning = (high - low) / 2
    notes = (
        table.cut_off.reason,
        f"at half the cut-off mass is {low[0]:.5g} and damping {low[1]:.5g}",
        f"at twice the cut-off mass is {high[0]:.5g} and damping {high[1]:.5g}",
    )
    return Estimate(
        method="least-squares",
        model=table.model,
        delay=delay,
        values=values,
        covariance=around.covariance + np.outer(leaning, leaning),
        degrees_of_freedom=around.degrees_of_freedom,
        residual=residual,
        residual_unit="force",
        explained=explained(force, residual),
        whiteness=whiteness(residual),
        condition=around.condition,
        inflation=around.inflation,
        notes=notes,
    )
