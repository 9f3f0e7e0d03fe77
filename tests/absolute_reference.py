"""Absolute stability by other means: matrix exponentials, and eigenvalues on dense grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from tune.documents.certified import Multiplier

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Frequencies at which conditions are looked at.
DENSE: FloatArray = np.unique(
    np.concatenate([np.geomspace(1e-6, np.pi, 4000), np.linspace(1e-3, np.pi, 4000)])
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One device, SI units; a mode is (Hz, damping ratio, participation at the encoder)."""

    mass: float
    damping: float
    sample_time: float = 1e-3
    delay_samples: float = 0.0
    lag: float = 0.0
    mode: tuple[float, float, float] | None = None
    own_stiffness: float = 0.0

    def response(self, angle: FloatArray) -> ComplexArray:
        """Measured position over held force at z = e^jθ."""
        transition, old, new, read = self.sampled()
        z = np.exp(1j * angle)
        resolvent = z[:, None, None] * np.eye(len(read)) - transition
        states = np.linalg.solve(resolvent, np.stack([new, old], axis=1)[None])
        late = np.floor(self.delay_samples)
        both = np.einsum("i,kij->kj", read, states)
        return (both[:, 0] + both[:, 1] / z) * z**-late

    def sampled(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """(Φ, Γ of the force before, Γ of the force now, C), the delay's whole samples left out."""
        shares = [1.0] if self.mode is None else [1.0, self.mode[2]]
        count = len(shares)
        size = 2 * count + (self.lag > 0)
        motion = np.zeros((size, size))
        drive = np.zeros(size)
        springs, dampings = [self.own_stiffness / self.mass], [self.damping / self.mass]
        if self.mode is not None:
            omega = 2 * np.pi * self.mode[0]
            springs.append(omega**2)
            dampings.append(2 * self.mode[1] * omega)
        for i, share in enumerate(shares):
            motion[i, count + i] = 1.0
            motion[count + i, i] = -springs[i]
            motion[count + i, count + i] = -dampings[i]
            if self.lag > 0:
                motion[count + i, -1] = share / self.mass
            else:
                drive[count + i] = share / self.mass
        if self.lag > 0:
            motion[-1, -1], drive[-1] = -1 / self.lag, 1 / self.lag
        fraction = self.delay_samples - np.floor(self.delay_samples)

        def held(time: float) -> tuple[FloatArray, FloatArray]:
            whole = np.zeros((size + 1, size + 1))
            whole[:size, :size], whole[:size, size] = motion * time, drive * time
            result = expm(whole)
            return result[:size, :size], result[:size, size]

        late, new = held((1 - fraction) * self.sample_time)
        early = held(fraction * self.sample_time)[1]
        transition = held(self.sample_time)[0]
        return transition, late @ early, new, np.array([*shares, *[0.0] * (size - count)])


def velocity(angle: FloatArray, sample_time: float, cutoff: float | None) -> ComplexArray:
    """Backward difference behind a first-order low-pass."""
    z = np.exp(1j * angle)
    difference = (1 - 1 / z).astype(np.complex128) / sample_time
    if cutoff is None:
        return difference
    pole = np.exp(-2 * np.pi * cutoff * sample_time)
    return difference * (1 - pole) / (1 - pole / z)


def least_eigenvalue(
    axis: Axis,
    stiffness: float,
    damping: float | None,
    multiplier: Multiplier,
    cutoff: float | None = None,
    angle: FloatArray = DENSE,
) -> float:
    """The least eigenvalue of the Hermitian condition over a dense grid, scaled to its diagonal."""
    position = axis.response(angle)
    z = np.exp(1j * angle)
    factor = multiplier.constant + sum(t.weight * (1 - z**-t.samples) for t in multiplier.taps)
    if damping is None:
        value = (factor * (1 / stiffness + position)).real
        return float(np.min(value / np.abs(factor / stiffness)))
    assert multiplier.damping is not None
    constant = multiplier.damping * axis.sample_time
    estimate = velocity(angle, axis.sample_time, cutoff)
    matrix: ComplexArray = np.empty((angle.size, 2, 2), dtype=np.complex128)
    matrix[:, 0, 0] = factor * (1 / stiffness + position)
    matrix[:, 0, 1] = factor * position
    matrix[:, 1, 0] = constant * estimate * position
    matrix[:, 1, 1] = constant * (1 / damping + estimate * position)
    hermitian: ComplexArray = matrix + np.conj(np.swapaxes(matrix, 1, 2))
    size = np.sqrt(np.abs(np.real(hermitian[:, [0, 1], [0, 1]])))
    scaled = hermitian / (size[:, :, None] * size[:, None, :])
    return float(np.min(np.linalg.eigvalsh(scaled)))


def radius(axis: Axis, stiffness: float) -> float:
    """Largest pole modulus of a linear spring on an axis without delay."""
    transition, _, new, read = axis.sampled()
    closed = transition - stiffness * np.outer(new, read)
    return float(np.max(np.abs(np.linalg.eigvals(closed))))
