"""Whole regions proved to the edge of what is true, and the affine forms they are proved with."""

import time
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from flint import acb
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from tests.thinned import thinned
from tune.certificate.affine import AffineForm, reciprocal
from tune.certificate.poles import closed_loop, judge, precision
from tune.certificate.region import ModeRegion, Region, Setting
from tune.certificate.value_set import Mechanism, value_set
from tune.certificate.worst_point import sampled_loops, worst_points
from tune.certificate.zero_exclusion import Claim, prove
from tune.documents.profile import HandBox

#: Samples of delay on top of the device's that every box is to stand.
EXTRA = 1.0
#: Gains between which a setting's limit is looked for.
_GAINS = np.geomspace(1e-3, 1e3, 61)
#: Bisections of the limit, to a part in 10⁹; roots of polynomials in z are not better.
_HALVINGS = 28
#: The limit found in doubles less this part has to hold in many digits.
_CLOSE = 2e-6
_MOST_CORNERS = 64


def around(value: float, spread: float) -> tuple[float, float]:
    return value * (1 - spread), value * (1 + spread)


def draw(seed: int, spread: float, *, with_everything: bool) -> tuple[Region, Setting]:
    """A device of 0.05 to 95 kg at 0.2 to 2 ms and a mix of effects; T is known to 1 %."""
    rng = np.random.default_rng([seed, 7])
    mass = 10 ** rng.uniform(np.log10(0.05), np.log10(95))
    step = 10 ** rng.uniform(np.log10(2e-4), np.log10(2e-3))
    damping = mass * 10 ** rng.uniform(-1, 1.5)
    samples = int(rng.integers(0, 3))
    kinds = rng.random(3) < 0.7
    if not kinds.any():
        kinds[rng.integers(0, 3)] = True
    sign = -1 if rng.random() < 0.15 else 1

    def cutoff() -> float | None:
        if rng.random() < 0.3:
            return None
        return float(10 ** rng.uniform(np.log10(20), np.log10(0.3 / step)))

    window = int(rng.integers(2, 16)) if rng.random() < 0.15 else None
    setting = Setting(
        stiffness=float(kinds[0] * 10 ** rng.uniform(-1, 0) * damping / step),
        damping=float(kinds[1] * 10 ** rng.uniform(-1, 1.5) * damping),
        mass=float(kinds[2] * sign * 10 ** rng.uniform(-1.5, 0) * mass * (0.5 if sign < 0 else 1)),
        velocity_filter_hz=None if window else cutoff(),
        acceleration_filter_hz=cutoff(),
        velocity_filter_order=int(rng.integers(1, 3)),
        acceleration_filter_order=int(rng.integers(1, 3)),
        filter_damping_ratio=float(rng.choice([1.0, 0.7071])),
        velocity_window_samples=window,
    )
    modes: tuple[ModeRegion, ...] = ()
    hand = None
    delay = (samples * step, samples * step)
    if with_everything:
        delay = (samples * step, (samples + rng.uniform(0, 0.5)) * step)
        modes = (
            ModeRegion(
                frequency_hz=around(10 ** rng.uniform(1.3, 2.5), 0.05),
                damping_ratio=around(10 ** rng.uniform(-2, -1), 0.2),
                at_encoder=float(rng.uniform(-0.7, 0.7)),
                at_handle=float(rng.uniform(-0.7, 0.7)),
            ),
        )
        hand = HandBox(mass=(0.02, 0.5), damping=(2.0, 20.0), stiffness=(50.0, 1500.0))
    region = Region(
        mass=around(mass, spread),
        damping=around(damping, spread),
        sample_time=around(step, 0.01),
        delay=delay,
        modes=modes,
        hand=hand,
    )
    return region, setting


def safe_gain(region: Region, setting: Setting, extra: float = EXTRA) -> float:
    """A gain at which every corner is stable, in many digits, near the largest; 0 if none is."""
    sides = (*region.sides(), (0.0, extra))
    free = [index for index, (low, high) in enumerate(sides) if high > low]
    corners = list(product((0, 1), repeat=len(free)))
    if len(corners) > _MOST_CORNERS:
        chosen = np.random.default_rng(0).choice(len(corners), _MOST_CORNERS, replace=False)
        corners = [corners[index] for index in chosen]
    values = np.repeat(np.mean(sides, axis=1)[:, None], len(corners), axis=1)
    for column, corner in enumerate(corners):
        for index, end in zip(free, corner, strict=True):
            values[index, column] = sides[index][end]
    points = [region.point(column[:-1], float(column[-1])) for column in values.T]
    loops = sampled_loops(region, [setting], values[:-1], values[-1])

    def stable(gain: float) -> bool:
        return all(judge(point, setting, gain).answer == "stable" for point in points)

    def stable_in_doubles(gain: float) -> bool:
        return not np.any(loops.radius(gain) > 1 + 1e-12)

    # Doubles come near to the limit at full gain; many digits settle it, and look below it too.
    index = next((i for i, g in enumerate(_GAINS) if not stable_in_doubles(float(g))), None)
    if index is None:
        return float(_GAINS[-1]) if stable(float(_GAINS[-1])) else 0.0
    low, high = float(_GAINS[max(index - 1, 0)]), float(_GAINS[index])
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable_in_doubles(middle) else (low, middle)
    for slack in (_CLOSE, 1e-4, 0.03, 0.3, 0.9):
        if stable(low * (1 - slack)):
            return low * (1 - slack)
    return 0.0


def unstable_samples(
    region: Region, setting: Setting, claim: Claim, count: int, rng: np.random.Generator
) -> int:
    """How many of so many samples of the box are unstable, half of them on edges and faces."""
    low, high = np.array((*region.sides(), (0.0, claim.extra))).T[:, :, None]
    parts = rng.random((len(low), count))
    parts[:, ::2] = np.clip(np.round(3 * parts[:, ::2] - 1, 1), 0, 1)
    bad = 0
    for chunk in np.array_split(np.arange(count), max(1, count // 1000)):
        values: NDArray[np.float64] = low * (1 - parts[:, chunk]) + high * parts[:, chunk]
        loops = sampled_loops(region, [setting], values[:-1], values[-1])
        for gain in (claim.gain, claim.gain * float(rng.uniform(0.05, 1))):
            for index in np.flatnonzero(loops.radius(gain) > 1 - 1e-9)[:5]:
                point = region.point(values[:-1, index], float(values[-1, index]))
                bad += judge(point, setting, claim.gain).answer != "stable"
    return bad


#: What is left of the safe gain, as the studies ask.
LEFT = 1.5
CELLS, FEW_CELLS = 200_000, 3000
#: 3 kg and 10 N·s/m within a tenth, 1 kHz within a hundredth, one sample late.
AROUND_HOMEREHAB = Region(
    mass=around(3.0, 0.1),
    damping=around(10.0, 0.1),
    sample_time=around(1e-3, 0.01),
    delay=(1e-3, 1e-3),
)


@pytest.mark.parametrize(
    ("stiffness", "damping", "mass"),
    thinned(
        [
            (1000.0, 10.0, 1.0),
            (2000.0, 0.0, 0.0),
            (0.0, 100.0, 0.0),
            (0.0, 0.0, 1.0),
            (0.0, 0.0, -1.0),
        ],
        2,
    ),
)
def test_the_proof_reaches_to_the_very_edge_of_the_margin(
    stiffness: float, damping: float, mass: float
) -> None:
    """A ±10 % box with the worst corner a part in 10⁵ inside is proved, one as far outside not."""
    setting = Setting(
        stiffness=stiffness,
        damping=damping,
        mass=mass,
        velocity_filter_hz=100.0,
        acceleration_filter_hz=20.0,
    )
    limit = safe_gain(AROUND_HOMEREHAB, setting)
    assert prove(
        AROUND_HOMEREHAB, setting, [Claim(gain=limit * (1 - 1e-5), extra=EXTRA)], 10_000
    ).proved
    assert not prove(
        AROUND_HOMEREHAB, setting, [Claim(gain=limit * (1 + 1e-4), extra=EXTRA)], 10_000
    ).proved


class Box(NamedTuple):
    """Stable at its worst point, proved, in how long and how many cells; samples unstable."""

    stable: bool
    proved: bool
    seconds: float
    cells: int
    unstable: int


def _study(spread: float, seeds: range, samples: int, *, everything: bool) -> list[Box]:
    """Boxes with a gain margin of 1.5 left."""
    rows: list[Box] = []
    for seed in seeds:
        region, setting = draw(seed, spread, with_everything=everything)
        limit = safe_gain(region, setting)
        if limit == 0:
            continue
        claim = Claim(gain=limit / LEFT, extra=EXTRA)
        worst = worst_points(region, setting, [claim])[0]
        start = time.process_time()
        proof = prove(region, setting, [claim], CELLS)
        seconds = time.process_time() - start
        bad = 0
        if proof.proved:
            assert worst.verdict.answer == "stable"
            bad = unstable_samples(region, setting, claim, samples, np.random.default_rng(seed))
        stable = worst.verdict.answer == "stable"
        rows.append(Box(stable, proof.proved, seconds, proof.cells, bad))
    return rows


@pytest.mark.parametrize(
    ("spread", "seeds", "everything"),
    thinned([(0.2, range(6), False), (0.1, range(3, 5), True), (0.1, range(6), False)], 2),
)
def test_boxes_with_margin_are_proved(spread: float, seeds: range, everything: bool) -> None:
    """A short version of the study; cells stand for time, which a busy machine would blur."""
    rows = _study(spread, seeds, 300, everything=everything)
    assert {row.proved for row in rows if row.stable} == {True}
    assert not any(row.unstable for row in rows)
    assert everything or max(row.cells for row in rows) < 3000


def test_a_loop_that_turns_back_within_a_cell_is_split_across_its_frequency() -> None:
    """Its slope says nothing there of what bends: 200 000 cells across the other sides did not."""
    region = Region(
        mass=(0.0727392, 0.0879424),
        damping=(0.798983, 1.172944),
        sample_time=(2e-3, 2e-3),
        delay=(0.0, 0.0),
    )
    setting = Setting(
        stiffness=415.682,
        damping=7.77892,
        mass=0.206991,
        velocity_filter="tracking",
        velocity_filter_hz=30.55,
        velocity_filter_order=3,
        acceleration_filter_hz=15.67,
        acceleration_filter_order=1,
        filter_damping_ratio=0.5,
    )
    assert prove(region, setting, [Claim(gain=1.5, extra=EXTRA)], 2000).proved


def test_a_hand_of_any_mass_takes_no_more_cells_for_its_aliases() -> None:
    """A light device that vibrates at 40 Hz, on a spring that nobody, or two arms, hold."""
    region = Region(
        mass=(0.038, 0.056),
        damping=(0.014, 0.05),
        sample_time=(1e-3, 1e-3),
        delay=(3e-4, 6.7e-4),
        modes=(
            ModeRegion(
                frequency_hz=(38.0, 42.0),
                damping_ratio=(0.028, 0.051),
                at_encoder=0.58,
                at_handle=-0.26,
            ),
        ),
        hand=HandBox(mass=(0.005, 1.0), damping=(1.0, 30.0), stiffness=(20.0, 2000.0)),
    )
    assert prove(region, plain(875.0, 5.2), [Claim(gain=1.0, extra=0.0)], 25_000).proved


@pytest.mark.long
@pytest.mark.parametrize(
    ("spread", "everything", "share", "seconds"),
    [(0.1, False, 0.95, 0.25), (0.2, False, 0.95, 1.0), (0.1, True, 0.80, 30.0)],
)
def test_a_thousand_boxes(spread: float, everything: bool, share: float, seconds: float) -> None:
    """Share of truly stable boxes proved, 95th percentile of the time, no unstable sample."""
    rows = _study(spread, range(1000), 10_000, everything=everything)
    assert np.mean([row.proved for row in rows if row.stable]) >= share
    assert np.quantile([row.seconds for row in rows], 0.95) <= seconds
    assert not any(row.unstable for row in rows)


def _region(rng: np.random.Generator, spread: float) -> tuple[Region, Setting]:
    """Anything at all: up to two modes, any hand, a lag, every kind of filter."""
    mass, step = 10 ** rng.uniform(-1, 1.5), 10 ** rng.uniform(-3.7, -2.7)
    damping = mass * 10 ** rng.uniform(-2, 1)
    modes = tuple(
        ModeRegion(
            frequency_hz=around(rng.uniform(0.02, 0.8) / step, spread),
            damping_ratio=around(rng.uniform(0.01, 0.1), spread),
            at_encoder=float(rng.uniform(-1, 1)),
            at_handle=float(rng.uniform(-1, 1)),
        )
        for _ in range(int(rng.integers(0, 3)))
    )
    hand, wide = None, 0
    if rng.random() < 0.6:
        grounded, wide = rng.random() < 0.6, int(rng.integers(0, 4))
        sizes = np.array([mass, mass / step, grounded * mass / step**2]) * 10 ** -rng.uniform(0, 2)
        sides = [around(size, spread) for size in sizes]
        # One of them is not known at all, the last time with the mass of the device.
        sides[wide % 3] = (sizes[wide % 3] / 20, sizes[wide % 3] * 20)
        hand = HandBox(mass=sides[0], damping=sides[1], stiffness=sides[2])
    window = rng.random() < 0.25
    setting = Setting(
        stiffness=float(rng.choice([0, 1]) * 10 ** rng.uniform(-4, -1) * mass / step**2),
        damping=10 ** rng.uniform(-3, 0) * mass / step,
        mass=10 ** rng.uniform(-2, 0.3) * mass,
        velocity_filter_hz=None if window else float(rng.uniform(0.01, 0.3) / step),
        acceleration_filter_hz=float(rng.uniform(0.01, 0.3) / step),
        velocity_filter_order=int(rng.integers(1, 3)),
        acceleration_filter_order=int(rng.integers(1, 3)),
        filter_damping_ratio=float(rng.choice([1.0, 0.7])),
        velocity_window_samples=4 if window else None,
    )
    region = Region(
        mass=(mass / 3, mass * 3) if wide == 3 else around(mass, spread),
        damping=around(damping, spread),
        sample_time=around(step, spread / 10),
        delay=around(float(rng.choice([1.0, 1.3, 0.5])) * step, spread),
        modes=modes,
        current_lag=around(rng.uniform(0.2, 2) * step, spread)
        if rng.random() < 0.4
        else (0.0, 0.0),
        hand=hand,
    )
    return region, setting


def _forms(low: np.ndarray, high: np.ndarray) -> list[AffineForm | float]:  # type: ignore[type-arg]
    """One cell: every side that has a width in its own symbol."""
    free = np.flatnonzero(high > low)
    forms: list[AffineForm | float] = []
    for row, (bottom, top) in enumerate(zip(low, high, strict=True)):
        if top == bottom:
            forms.append(float(bottom))
            continue
        slopes = (free == row)[:, None] * ((top - bottom) / 2 + 0j)
        forms.append(
            AffineForm(np.array([(bottom + top) / 2 + 0j]), slopes, np.zeros(1), np.zeros(1))
        )
    return forms


@pytest.mark.parametrize("spread", thinned([0.01, 1e-10, 1e-4, 0.1], 2))
def test_forms_hold_the_loop_of_the_matrix_exponential(spread: float) -> None:
    """D + s·N against the closed loop in z in 400 bits, at corners and inside of random cells."""
    bounded = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        region, setting = _region(rng, spread)
        middle = float(rng.choice([rng.uniform(0.01, 3.1), 10 ** rng.uniform(-3, 0)]))
        sides = (
            (middle * (1 - spread / 2), min(np.pi, middle * (1 + spread / 2))),
            *region.sides(),
        )
        low, high = np.array(sides).T
        theta, mass, damping, step, delay, lag, spring, *rest = _forms(low, high)
        assert isinstance(theta, AffineForm)
        assert isinstance(step, AffineForm)
        hand = None
        if region.hand is not None:
            hand, rest = (rest[0], rest[1], rest[2]), rest[3:]
        late = step.inverse() * delay
        mechanism = Mechanism(
            mass=mass,
            damping=damping,
            sample_time=step,
            delay=late,
            lag=lag,
            position_stiffness=spring,
            hand=hand,
            modes=tuple((rest[2 * i], rest[2 * i + 1]) for i in range(len(region.modes))),
            participations=tuple((mode.at_encoder, mode.at_handle) for mode in region.modes),
            grounded=region.grounded,
        )
        with np.errstate(all="ignore"):
            response = value_set(theta, mechanism, setting)
        free = np.flatnonzero(high > low)
        for _ in range(3):
            u = (
                rng.choice([-1.0, 1.0], len(free))
                if rng.random() < 0.5
                else rng.uniform(-1, 1, len(free))
            )
            values = (low + high) / 2
            values[free] += u * (high - low)[free] / 2
            loop = closed_loop(region.point(values[1:], 0.0), setting)
            with precision():
                z = acb(0, values[0]).exp()
                ratio = complex(loop.feedback(z) / loop.open(z))
            fixed, varied = response.fixed, response.varied
            error = abs(_at(varied, u) - ratio * _at(fixed, u))
            bound = _rest(varied) + abs(ratio) * _rest(fixed)
            # Without a bound nothing is claimed.
            assert not error > bound
            bounded += bool(np.isfinite(bound))
    assert bounded > 90


def _at(form: AffineForm, u: np.ndarray) -> complex:  # type: ignore[type-arg]
    return complex(form.centre[0] + u @ form.slopes[:, 0])


def _rest(form: AffineForm) -> float:
    return float(np.hypot(form.real[0], form.imag[0]))


def plain(stiffness: float, damping: float = 0.0) -> Setting:
    """A spring and a damper on the difference of two readings."""
    return Setting(
        stiffness=stiffness,
        damping=damping,
        mass=0.0,
        velocity_filter_hz=None,
        acceleration_filter_hz=None,
    )


def radius_of(law: NDArray[np.float64], step: float, samples: float, setting: Setting) -> float:
    """Largest pole beside d/dt (x, v) = law·(x, v, force), the force so many samples late."""
    whole, part = divmod(samples, 1.0)
    late, rest = (expm(np.vstack([law, np.zeros(3)]) * each * step) for each in (part, 1 - part))
    ages = int(whole) + 3  # of readings, that of now first
    loop = np.eye(1 + ages, k=-1)
    loop[:2] = 0.0
    loop[:2, :2] = rest[:2, :2] @ late[:2, :2]
    loop[2, :3] = [1.0, 0.0, 0.0]
    places = [0, *range(2, 1 + ages)]
    for age, pushed in ((int(whole) + 1, rest[:2, :2] @ late[:2, 2]), (int(whole), rest[:2, 2])):
        speed = setting.damping / step
        loop[:2, places[age]] -= pushed * (setting.stiffness + speed)
        loop[:2, places[age + 1]] += pushed * speed
    return float(np.max(np.abs(np.linalg.eigvals(loop))))


@pytest.mark.parametrize("setting", [plain(100.0), plain(0.0, 1.0)], ids=["spring", "damper"])
def test_every_pair_of_mass_and_stiffness_of_a_hand_is_looked_at(setting: Setting) -> None:
    """The largest spring or damper in a hand, found by poles at all corners of its box."""
    step, mass, damping = 1e-3, 0.2, 2.0
    hand = HandBox(mass=(0.05, 1.0), damping=(1.0, 3.0), stiffness=(20.0, 2000.0))
    laws = [
        np.array([[0, 1, 0], np.array([-k, -damping - b, 1.0]) / (mass + m)])
        for m, b, k in product(hand.mass, hand.damping, hand.stiffness)
    ]

    def beyond(gain: float) -> float:
        more = plain(gain * setting.stiffness, gain * setting.damping)
        return max(radius_of(law, step, 0.5, more) for law in laws) - 1

    limit = brentq(beyond, 1.0, 1e4)
    region = Region(
        mass=(mass, mass),
        damping=(damping, damping),
        sample_time=(step, step),
        delay=(step / 2, step / 2),
        hand=hand,
    )
    for part, proved in ((0.999, True), (1.001, False)):
        claim = Claim(gain=part * limit, extra=0.0)
        assert prove(region, setting, [claim], 20_000).proved == proved


def test_one_over_a_number_is_near_a_line() -> None:
    """Chebyshev's approximation: as far above 1/x at both ends as it is below it in between."""
    low, high = 0.25, 4.0
    (form,) = _forms(np.array([low]), np.array([high]))
    found = reciprocal(form)
    assert isinstance(found, AffineForm)
    u = np.linspace(-1, 1, 101)
    missed = [_at(found, np.array([each])).real - 1 / (2.125 + 1.875 * each) for each in u]
    assert np.ptp(missed) == pytest.approx(2 * found.real[0], rel=1e-3)
    assert np.max(np.abs(missed)) <= found.real[0]


def test_an_uncertain_delay_and_the_extra_one_add_up() -> None:
    """A spring at the largest of both: poles of the held loop, delayed by parts of a sample."""
    step, mass, damping, setting = 1e-3, 0.7, 3.0, plain(300.0)
    law = np.array([[0, 1, 0], [0, -damping / mass, 1 / mass]])
    limit = brentq(
        lambda gain: radius_of(law, step, 1.4 + EXTRA, plain(gain * 300.0)) - 1, 0.5, 20.0
    )
    region = Region(
        mass=(mass, mass),
        damping=(damping, damping),
        sample_time=(step, step),
        delay=(0.2 * step, 1.4 * step),
    )
    for part, proved in ((0.999, True), (1.001, False)):
        claim = Claim(gain=part * limit, extra=EXTRA)
        assert prove(region, setting, [claim], 20_000).proved == proved
