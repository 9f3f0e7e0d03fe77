"""The sampled plant in z in ball arithmetic: as printed, or from the exponential of its matrix."""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb, arb_mat, arb_poly

from tune.certificate.point import Point


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledPlant:
    """Measured position from commanded force, numerator over denominator, in z.

    Attributes:
        numerator: with the delay.
        denominator: its root z = 1 of free motion taken out where ``integrates``.
        integrates: nothing holds the position.
    """

    numerator: arb_poly
    denominator: arb_poly
    integrates: bool


def sampled_plant(point: Point) -> SampledPlant:
    """The plant at one point; to be called within `precision`."""
    return _printed(point) if point.plain else _by_exponential(point)


def _printed(point: Point) -> SampledPlant:
    """b²/m·(z-1)(z-ε) under z(ε-1+δ) + 1-(1+δ)ε, and T²/(2m)·(z+1) over (z-1)² where b = 0."""
    m, b, T = arb(point.mass), arb(point.damping), arb(point.sample_time)
    if point.damping == 0:
        decay = arb(1)
        numerator = arb_poly([1, 1]) * (T * T / (2 * m))
    else:
        delta = b * T / m
        decay = (-delta).exp()
        numerator = arb_poly([1 - (1 + delta) * decay, decay - 1 + delta]) * (m / (b * b))
    late = arb_poly([0] * int(point.delay_samples) + [1])
    return SampledPlant(
        numerator=numerator, denominator=arb_poly([-decay, 1]) * late, integrates=True
    )


def _by_exponential(point: Point) -> SampledPlant:
    """x[k+1] = Φ·x[k] + Γ_old·F[k-d-1] + Γ_new·F[k-d], the new force acting from fT on."""
    T = arb(point.sample_time)
    whole = int(point.delay_samples)
    fraction = arb(point.delay_samples) - whole
    motion, drive, read = _state_space(point)
    size = len(motion)
    augmented = arb_mat([[*motion[i], drive[i]] for i in range(size)] + [[arb(0)] * (size + 1)])
    late = (augmented * ((1 - fraction) * T)).exp()
    transition = _block(late, size) if fraction == 0 else _block((augmented * T).exp(), size)
    new = [late[i, size] for i in range(size)]
    numerators = _resolvent(transition, read, new)
    if fraction == 0:
        numerator, delays = numerators, whole
    else:
        early = (augmented * (fraction * T)).exp()
        kept = _block(late, size)
        old = [sum((kept[i, j] * early[j, size] for j in range(size)), arb(0)) for i in range(size)]
        numerator = numerators * arb_poly([0, 1]) + _resolvent(transition, read, old)
        delays = whole + 1
    denominator = transition.charpoly()
    if not point.grounded:
        denominator = denominator // arb_poly([-1, 1])
    return SampledPlant(
        numerator=numerator,
        denominator=denominator * arb_poly([0] * delays + [1]),
        integrates=not point.grounded,
    )


def _state_space(point: Point) -> tuple[list[list[arb]], list[arb], list[arb]]:
    """(A, B, C) of (q, q̇ and, with a lag, the actuator's force) from command to encoder."""
    m = arb(point.mass)
    encoder = [arb(1), *(arb(mode.at_encoder) for mode in point.modes)]
    handle = [arb(1), *(arb(mode.at_handle) for mode in point.modes)]
    count = len(encoder)
    omegas = [2 * arb.pi() * arb(mode.frequency_hz) for mode in point.modes]
    dampings = [
        arb(point.damping),
        *(2 * arb(p.damping_ratio) * w * m for p, w in zip(point.modes, omegas, strict=True)),
    ]
    springs = [arb(point.position_stiffness), *(w * w * m for w in omegas)]
    grip = point.hand
    hm, hb, hk = (
        arb(x) for x in ((grip.mass, grip.damping, grip.stiffness) if grip else (0, 0, 0))
    )

    def matrix(diagonal: list[arb], hand: arb) -> arb_mat:
        return arb_mat(
            [
                [
                    handle[i] * handle[j] * hand + (diagonal[i] if i == j else 0)
                    for j in range(count)
                ]
                for i in range(count)
            ]
        )

    inverse = matrix([m] * count, hm).inv()
    by_position = inverse * matrix(springs, hk) * -1
    by_velocity = inverse * matrix(dampings, hb) * -1
    by_force = inverse * arb_mat([[e] for e in encoder])
    lagged = point.current_lag > 0
    size = 2 * count + lagged
    motion = [[arb(0)] * size for _ in range(size)]
    drive = [arb(0)] * size
    for i in range(count):
        motion[i][count + i] = arb(1)
        for j in range(count):
            motion[count + i][j] = by_position[i, j]
            motion[count + i][count + j] = by_velocity[i, j]
        if lagged:
            motion[count + i][size - 1] = by_force[i, 0]
        else:
            drive[count + i] = by_force[i, 0]
    if lagged:
        rate = 1 / arb(point.current_lag)
        motion[size - 1][size - 1] = -rate
        drive[size - 1] = rate
    return motion, drive, encoder + [arb(0)] * (size - count)


def _block(matrix: arb_mat, size: int) -> arb_mat:
    return arb_mat([[matrix[i, j] for j in range(size)] for i in range(size)])


def _resolvent(transition: arb_mat, read: list[arb], drive: list[arb]) -> arb_poly:
    """C·adj(zI - Φ)·Γ by Faddeev and LeVerrier."""
    size = len(read)
    column = arb_mat([[x] for x in drive])
    adjugate = arb_mat([[arb(int(i == j)) for j in range(size)] for i in range(size)])
    coefficients: list[arb] = []
    for order in range(1, size + 1):
        moved = adjugate * column
        coefficients.append(sum((read[i] * moved[i, 0] for i in range(size)), arb(0)))
        product = transition * adjugate
        trace = sum((product[i, i] for i in range(size)), arb(0))
        adjugate = arb_mat(
            [
                [product[i, j] - (trace / order if i == j else 0) for j in range(size)]
                for i in range(size)
            ]
        )
    return arb_poly(coefficients[::-1])
