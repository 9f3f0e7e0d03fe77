"""Cramér-Rao bound of mass and damping for a planned force, exact, before any log.

The log's position is known up to white noise (reading noise and rounding to a count) and, where one
is stated, an unknown white force; nothing else. Initial position and velocity, the constant force,
Coulomb friction where some is guessed, and the delay where it is not known are estimated from the
same log and take their share of the information.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.estimators.estimate import NORMAL_95, UNKNOWN_FORCE
from identification.planning.response import Response
from identification.planning.stick_slip import Answer, Guess, sensitivities, simulate_stick_slip

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Bound of every unbiased estimator for the log of a planned force.

    Attributes:
        motion: of the guessed device, without noise.
        covariance: of mass and damping, shape (2, 2).
        doubt: what identify adds to it for forces no log knows better, shape (2, 2)
            (intervals.UNKNOWN_FORCE).
    """

    motion: Answer
    covariance: FloatArray
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
    an estimator that knows the model without any fault.

    Args:
        force: N (N·m), shape (n,), where it acts.
        guess: the device.
        step: T, s.
        noise: standard deviation of one position reading, m (rad).
        force_noise: rms of a white force that no log knows, held one sample, N (N·m).
        delay_known: False if the delay is estimated from the same log.
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
