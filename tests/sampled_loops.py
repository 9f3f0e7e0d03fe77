"""The sampled loop of docs/theory.md, 5, in z and with 360 digits, from its definitions.

Mechanism, hand and actuator as one linear system in continuous time, matrix exponentials for the
held and delayed force, characteristic polynomials, the law as the difference equations say. Nothing
of it is taken from the code under test: coordinates are not decoupled, nothing is split into
fractions, and no w occurs. Three other routes to the same loop are compared with it: the printed
equation (`tests.reference`), the frequency response (`tests.optimum_loops`) and one sample of
everything run on unit vectors in doubles (`tests.sampled_bench`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flint import arb, arb_mat, arb_poly

from tests.reference import ReferenceLoop


@dataclass(frozen=True, kw_only=True)
class Case:
    """One device, its law and its effects; 0 or None is absent, ``stiffness`` 0 is no spring."""

    mass: float
    damping: float
    sample_time: float
    delay_samples: float = 0.0
    stiffness: float = 0.0
    added_damping: float = 0.0
    added_mass: float = 0.0
    velocity_filter_hz: float | None = None
    velocity_filter_order: int = 1
    velocity_window_samples: int | None = None
    acceleration_filter_hz: float | None = None
    acceleration_filter_order: int = 2
    filter_damping_ratio: float = 1.0
    modes: tuple[tuple[float, float, float, float], ...] = ()
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)
    current_lag: float = 0.0

    def later(self, samples: float) -> Case:
        return replace(self, delay_samples=self.delay_samples + samples)

    @property
    def free(self) -> bool:
        return not self.stiffness and not self.hand[2]


def loop_along(
    case: Case, stiffness: float | None, damping: float | None, mass: float | None
) -> ReferenceLoop:
    """P(z; s) of a case along s·(K, B, M), whatever effects it has; None is absent."""
    return loop_with(
        replace(
            case, stiffness=stiffness or 0.0, added_damping=damping or 0.0, added_mass=mass or 0.0
        )
    )


def loop_with(case: Case) -> ReferenceLoop:
    """P(z; s) along s times the effects of a case.

    Without any spring the root z = 1 of free motion is left out.
    """
    measured, _, denominator = plant(case)
    numerator, poles = law(case)
    fixed, varied = denominator * poles, measured * numerator
    if case.free:
        assert denominator(arb(1)).contains(0)
        fixed, varied = fixed // arb_poly([-1, 1]), varied // arb_poly([-1, 1])
    return ReferenceLoop(fixed=fixed, varied=varied)


def plant(case: Case) -> tuple[arb_poly, arb_poly, arb_poly]:
    """(measured, handle) numerators over one denominator in z, position in m from force in N."""
    count = 1 + len(case.modes)
    m, b, T = arb(case.mass), arb(case.damping), arb(case.sample_time)
    encoder = [arb(1), *(arb(mode[2]) for mode in case.modes)]
    handle = [arb(1), *(arb(mode[3]) for mode in case.modes)]
    grip = [arb(x) for x in case.hand]
    omegas = [arb(0), *(2 * arb.pi() * arb(mode[0]) for mode in case.modes)]
    ratios = [arb(0), *(arb(mode[1]) for mode in case.modes)]
    losses = [b, *(2 * z * w * m for z, w in zip(ratios[1:], omegas[1:], strict=True))]

    def matrix(own: list[arb], share: arb) -> arb_mat:
        return arb_mat(
            [
                [share * handle[i] * handle[j] + (own[i] if i == j else 0) for j in range(count)]
                for i in range(count)
            ]
        )

    inverse = matrix([m] * count, grip[0]).inv()
    loss = inverse * matrix(losses, grip[1])
    stiff = inverse * matrix([w * w * m for w in omegas], grip[2])
    pull = inverse * arb_mat([[x] for x in encoder])
    zero, lagging = arb(0), case.current_lag > 0
    # States: coordinates, their rates, and the force behind its lag.
    rows = [
        [arb(1) if j == count + i else zero for j in range(2 * count)] + [zero] * lagging
        for i in range(count)
    ]
    rows += [
        [-stiff[i, j] for j in range(count)]
        + [-loss[i, j] for j in range(count)]
        + [pull[i, 0]] * lagging
        for i in range(count)
    ]
    force = [zero] * count + [zero if lagging else pull[i, 0] for i in range(count)]
    if lagging:
        rows.append([zero] * (2 * count) + [-1 / arb(case.current_lag)])
        force.append(1 / arb(case.current_lag))
    whole = int(case.delay_samples)
    fraction = arb(case.delay_samples) - whole
    phi, full = _held(rows, force, T)
    _, new = _held(rows, force, (1 - fraction) * T)
    bare = phi.charpoly()
    z = arb_poly([0, 1])

    def read(weights: list[arb]) -> arb_poly:
        """Numerator of a reading: det(z - Φ + g·row) is det(z - Φ)·(1 + row·(z - Φ)⁻¹·g)."""
        row = arb_mat([[*weights, *[zero] * (len(rows) - count)]])
        now = (phi - new * row).charpoly() - bare
        if case.delay_samples == whole:
            return now
        return now * z + (phi - (full - new) * row).charpoly() - bare

    later = whole if case.delay_samples == whole else whole + 1
    return read(encoder), read(handle), bare * z**later


def _held(rows: list[list[arb]], force: list[arb], time: arb) -> tuple[arb_mat, arb_mat]:
    """What a time does to the states, and a force of one held through it."""
    size = len(rows)
    both = [[x * time for x in [*row, f]] for row, f in zip(rows, force, strict=True)]
    moved = arb_mat([*both, [arb(0)] * (size + 1)]).exp()
    return (
        arb_mat([[moved[i, j] for j in range(size)] for i in range(size)]),
        arb_mat([[moved[i, size]] for i in range(size)]),
    )


def law(case: Case) -> tuple[arb_poly, ...]:
    """Force from position, sign turned: numerator over denominator, only what is there."""
    T, z, one = arb(case.sample_time), arb_poly([0, 1]), arb_poly([1])
    step = z - one

    def second_order(hertz: float) -> tuple[arb, arb_poly]:
        zeta = arb(case.filter_damping_ratio)
        rate = 2 * arb.pi() * arb(hertz) * T
        decay = (-rate * zeta).exp()
        trace = 2 * decay * (rate * (1 - zeta * zeta).sqrt()).cos()
        return 1 - trace + decay * decay, arb_poly([decay * decay, -trace, 1])

    nv, dv = step * (1 / T), z
    if case.velocity_window_samples is not None:
        n = case.velocity_window_samples
        nv, dv = (z**n - one) * (1 / (n * T)), z**n
    elif case.velocity_filter_hz is not None and case.velocity_filter_order == 1:
        a = (-2 * arb.pi() * arb(case.velocity_filter_hz) * T).exp()
        nv, dv = ((1 - a) / T) * step, z - a
    elif case.velocity_filter_hz is not None:
        gain, poles = second_order(case.velocity_filter_hz)
        nv, dv = (gain / T) * step * z, poles
    na, da = (1 / T**2) * step * step, z * z
    if case.acceleration_filter_hz is not None and case.acceleration_filter_order == 2:
        gain, poles = second_order(case.acceleration_filter_hz)
        na, da = (gain / T**2) * step * step, poles
    elif case.acceleration_filter_hz is not None:
        a = (-2 * arb.pi() * arb(case.acceleration_filter_hz) * T).exp()
        na, da = ((1 - a) / T**2) * step * step, z * (z - a)
    if not case.added_damping:
        nv, dv = arb_poly([0]), one
    if not case.added_mass:
        na, da = arb_poly([0]), one
    numerator = (
        dv * da * arb(case.stiffness)
        + nv * da * arb(case.added_damping)
        + na * dv * arb(case.added_mass)
    )
    return _without_common_delay(numerator, dv * da)


def _without_common_delay(*polynomials: arb_poly) -> tuple[arb_poly, ...]:
    """Polynomials without the powers of z that they all share."""
    while all(polynomial[0] == 0 for polynomial in polynomials):
        polynomials = tuple(arb_poly(polynomial.coeffs()[1:]) for polynomial in polynomials)
    return polynomials
