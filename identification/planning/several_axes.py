"""Forces that excite all axes of a device together, so that they can be told apart.

Every axis is driven by a multisine with lines of its own, every n-th of those of one axis: what an
axis shows at the lines of another comes from the coupling between them (Pintelon and Schoukens,
System Identification, 2nd edition, 2.7). Odd lines of one base frequency keep the motion of all
axes its own opposite half a period later. The devices of the guesses that may go farthest, coupled
ones among them, are simulated exactly and all forces scaled by one factor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, pairwise, product

import numpy as np

from identification.errors import InvalidInputError, UsageError
from identification.estimators.estimate import UNKNOWN_FORCE, symmetric_inverse
from identification.estimators.joint import JointModel
from identification.estimators.joint_fits import LATER, NUDGE, devices_of
from identification.estimators.joint_motion import DevicesOfAxes
from identification.planning.information import Answer, DesignGrid, Response
from identification.planning.limits import (
    BETWEEN,
    ExcitationSpec,
    Region,
    Used,
    WorstMotion,
    describe_impossible,
    gentle_spec,
    motions_beyond,
    regions,
)
from identification.planning.signals import (
    fit_to_limits,
    line_sets,
    multisine,
    opposing_force,
    rounded,
)
from identification.trajectory import NORMAL_95, FloatArray, IndexArray

#: Lines of each axis at least: fewer cannot tell damping from friction.
_FEWEST_LINES = 2
#: Levels of friction looked at, and of mass and damping where the axes are not coupled.
_LEVELS = 3
#: Directions in which a device is lightest or heaviest: so many an axis, and so many farthest and
#: fastest devices, found at a coarse step, that are played at the step of the loop.
_DIRECTIONS, _FARTHEST = 8, 8
#: Coarse steps in a period of the fastest line, at least; times that forces are fitted again.
_COARSE, _REFITS = 20.0, 4
_SEED = 1
#: Samples of axes of devices that are simulated at once: some 500 MB.
_AT_ONCE = 10_000_000
#: Directions this much weaker than the strongest tell nothing.
_SINGULAR = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesExcitation:
    """Planned forces of several axes and what they are predicted to tell.

    Attributes:
        spec: limits and guesses it was planned for, as of one axis.
        force: N (N·m), shape (n, axes), held from sample to sample, zero at both ends.
        lines: frequencies of each axis, Hz.
        motion: of the guessed device, whose axes are not coupled; arrays of shape (n, axes).
        expected: half-width of the 95 % interval of each entry of mass and damping, by its name:
            the Cramér-Rao bound of the guessed device, with what identify adds to it.
        used: largest parts of the limits that any axis of the worst device uses.
        worst: how far and how fast the forces move devices other than guessed.
    """

    spec: ExcitationSpec
    force: FloatArray
    lines: tuple[FloatArray, ...]
    motion: Answer
    expected: dict[str, float]
    used: Used
    worst: tuple[WorstMotion, ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return self.spec.axes or ()

    @property
    def time(self) -> FloatArray:
        """s, shape (n,)."""
        return np.arange(len(self.force), dtype=np.float64) * self.spec.sample_time

    @property
    def beyond(self) -> tuple[WorstMotion, ...]:
        """Which of the worst motions leave the travel or the speed allowed."""
        return motions_beyond(self.spec, self.worst)

    @property
    def description(self) -> str:
        """The frequencies in words."""
        parts = (
            f"{axis} {each.size} lines, {each[0]:.3g} to {each[-1]:.3g} Hz"
            for axis, each in zip(self.axes, self.lines, strict=True)
        )
        return "; ".join(parts)


def plan_axes(
    spec: ExcitationSpec, *, progress: Callable[[str], None] | None = None
) -> AxesExcitation:
    """Multisines that tell the mass and damping matrices of several axes, driven all together.

    Args:
        spec: limits of every axis, guesses of every direction.
        progress: called with a sentence before each part of the work.

    Raises:
        InvalidInputError: the time is too short for lines of their own, or no force keeps every
            device the guesses allow within the limits.
        UsageError: there is one axis only.
    """
    if spec.axes is None:
        raise UsageError("axes", "are not given", "Name them, or plan one with plan_excitation")

    say: Callable[[str], None] = progress or (lambda _: None)
    wanted = gentle_spec(spec) if spec.gentle else spec
    count = len(spec.axes)
    bench = DesignGrid.of(wanted)
    say(f"designing multisines of {count} axes")
    net, lines = _net_forces(bench, count)
    every = _joined(_devices(Region.stated(wanted), count), _turned(Region.stated(wanted), count))
    fastest = max(float(each[-1]) for each in lines)
    spread = BETWEEN if wanted.ranges else 1.0
    say(f"fitting them to the limits on {len(every.mass)} devices")
    against = np.stack([opposing_force(wanted, each) for each in net.T], axis=1)

    def force_at(scale: float) -> FloatArray:
        scaled = (scale * net + against).T
        return np.stack([rounded(each, wanted.force) for each in scaled], axis=1)

    def used_by(force: FloatArray, devices: DevicesOfAxes, *, coarse: bool = False) -> Used:
        played = force, wanted.sample_time
        played = _coarse(*played, fastest) if coarse else played
        return Used.of(wanted, force, *_extremes(devices, *played), spread)

    farthest = partial(_farthest, every, step=wanted.sample_time, fastest=fastest)
    # Most of the way goes at a coarse step.
    fitted = _some(every, farthest(force_at(1.0)))
    found = fit_to_limits(force_at, partial(used_by, devices=fitted, coarse=True))
    scale = 1.0 if isinstance(found, Used) else found[0]
    looked_at, force = np.zeros(0, dtype=np.intp), force_at(scale)
    used = None
    for _ in range(_REFITS):
        added = np.setdiff1d(farthest(force), looked_at)
        if used is not None and (not added.size or used_by(force, _some(every, added)).most <= 1):
            break
        looked_at = np.union1d(looked_at, added)
        fitted = _some(every, looked_at)
        found = fit_to_limits(force_at, partial(used_by, devices=fitted), scale)
        if isinstance(found, Used):
            raise InvalidInputError("excitation", *describe_impossible(wanted, found))
        scale, force, used = found
    assert used is not None  # it is fitted once at least
    say("looking for the devices that go farthest")
    motion, expected = _predicted(force, wanted)
    return AxesExcitation(
        spec=wanted,
        force=force,
        lines=lines,
        motion=motion,
        expected=expected,
        used=used,
        worst=_worst_motions(spec, force, count, fitted, fastest),
    )


def _net_forces(bench: DesignGrid, count: int) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Net forces in mid-sample, N, (n, axes), of least merit, and the lines of each axis, Hz."""
    spec = bench.spec
    middles = (np.arange(spec.samples, dtype=np.float64) + 0.5) * spec.sample_time
    best: tuple[float, FloatArray, tuple[FloatArray, ...]] | None = None
    for lines, seed in line_sets(bench):
        parts = [lines[axis::count] for axis in range(count)]
        if min(part.size for part in parts) < _FEWEST_LINES:
            continue
        shapes = [multisine(bench, part, seed) for part in parts]
        merit = sum(bench.score(shape.force(bench.time))[0] for shape in shapes)
        if best is None or merit < best[0]:
            net = np.stack([shape.force(middles) for shape in shapes], axis=1)
            best = merit, net, tuple(part / spec.duration for part in parts)
    if best is None:
        least = 2 * _FEWEST_LINES * count / bench.highest
        raise InvalidInputError(
            "excitation",
            f"in {spec.duration:g} s there are no {_FEWEST_LINES} lines for each of {count} axes "
            f"below {bench.highest:.3g} Hz, above which the device hardly moves",
            f"Give a duration of {least:.2g} s or more",
        )
    return best[1], best[2]


def _devices(region: Region, count: int) -> DevicesOfAxes:
    """The devices that may go farthest: alike in every direction, or coupled between two axes.

    A coupled one is lightest along one diagonal of two axes and heaviest across it, its damping
    least along either. All axes have the same friction; constant forces pull each pair of
    neighbours alike or against each other.
    """
    (light, heavy), (least, most) = region.mass, region.damping
    eye = np.eye(count)
    masses, dampings = (np.linspace(*ends, _LEVELS) for ends in (region.mass, region.damping))
    sides = {(light, each) for each in dampings.tolist()}
    sides |= {(each, least) for each in masses.tolist()}
    matrices = [(mass * eye, damping * eye) for mass, damping in sorted(sides)]
    if (light, least) != (heavy, most):
        for one, other in combinations(range(count), 2):
            for sense in (1.0, -1.0):
                along = (eye[one] + sense * eye[other]) / np.sqrt(2)
                across = (eye[one] - sense * eye[other]) / np.sqrt(2)
                for near, far in ((least, most), (most, least)):
                    mass = light * eye + (heavy - light) * np.outer(across, across)
                    damping = least * eye + (near - least) * np.outer(along, along)
                    damping += (far - least) * np.outer(across, across)
                    matrices.append((mass, damping))
    frictions = np.unique(np.linspace(*region.friction, _LEVELS))[:, None] * np.ones(count)
    patterns = product(region.offset, repeat=2)
    offsets = sorted({tuple(ends[k % 2] for k in range(count)) for ends in patterns})
    return _at_rest(matrices, frictions, np.array(offsets))


def _at_rest(
    matrices: Sequence[tuple[FloatArray, FloatArray]], frictions: FloatArray, offsets: FloatArray
) -> DevicesOfAxes:
    """Devices of every pair of mass and damping with every friction and offset, a row each."""
    every = list(product(matrices, frictions, offsets))
    still = np.zeros((len(every), offsets.shape[1]))
    return DevicesOfAxes(
        mass=np.stack([mass for (mass, _), _, _ in every]),
        damping=np.stack([damping for (_, damping), _, _ in every]),
        friction=np.stack([friction for _, friction, _ in every]),
        offset=np.stack([offset for _, _, offset in every]),
        delay=still[:, 0],
        speed=still,
        place=still,
    )


def _turned(region: Region, count: int) -> DevicesOfAxes:
    """Devices that are lightest, or heaviest, in one of many directions, their damping least.

    Or least along it only. Friction is least, of one axis largest or of none.
    """
    (light, heavy), (least, most) = region.mass, region.damping
    eye = np.eye(count)
    if count == 2:
        angles = np.pi * np.arange(_DIRECTIONS * count) / (_DIRECTIONS * count)
        units = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    else:
        units = np.random.default_rng(_SEED).normal(size=(_DIRECTIONS * count, count))
        units = np.vstack((units / np.linalg.norm(units, axis=1, keepdims=True), eye))
    matrices: list[tuple[FloatArray, FloatArray]] = []
    for unit in units:
        along = np.outer(unit, unit)
        for mass in (along, eye - along)[: 1 + (count > 2)]:
            matrices += [
                (light * eye + (heavy - light) * mass, least * eye + (most - least) * damping)
                for damping in (0 * eye, eye - along)[: 1 + (most > least)]
            ]
    low, high = region.friction
    frictions = np.unique([low + (high - low) * row for row in (*eye, 0 * eye[0])], axis=0)
    offsets = np.unique([[each] * count for each in region.offset], axis=0)
    return _at_rest(matrices, frictions, offsets)


def _joined(*devices: DevicesOfAxes) -> DevicesOfAxes:
    return DevicesOfAxes(
        **{
            name: np.concatenate([getattr(each, name) for each in devices])
            for name in DevicesOfAxes.__slots__
        }
    )


def _some(devices: DevicesOfAxes, places: IndexArray | slice) -> DevicesOfAxes:
    return DevicesOfAxes(
        **{name: getattr(devices, name)[places] for name in DevicesOfAxes.__slots__}
    )


def _farthest(devices: DevicesOfAxes, force: FloatArray, step: float, fastest: float) -> IndexArray:
    """Places of the devices that go farthest, and fastest, at a coarse step."""
    played = _coarse(force, step, fastest)
    found = [np.argsort(-each)[:_FARTHEST] for each in _extremes(devices, *played)]
    return np.unique(np.concatenate(found))


def _coarse(force: FloatArray, step: float, fastest: float) -> tuple[FloatArray, float]:
    """Forces at a step that the fastest line, Hz, allows, and that step, s."""
    wide = max(1, int(1 / (_COARSE * fastest * step)))
    rest = -len(force) % wide
    filled = np.concatenate((force, np.zeros((rest, force.shape[1]))))
    return filled.reshape(-1, wide, force.shape[1]).mean(axis=1), wide * step


def _extremes(
    devices: DevicesOfAxes, force: FloatArray, step: float
) -> tuple[FloatArray, FloatArray]:
    """Largest |position| and |velocity| of any axis of each device, from rest, shape (devices,)."""
    many = len(devices.mass)
    parts = min(many, int(np.ceil(many * force.size / _AT_ONCE)))
    found: list[FloatArray] = []
    for low, high in pairwise(np.linspace(0, many, parts + 1).astype(int).tolist()):
        place = _some(devices, slice(low, high)).positions(force, step, 0)
        speed = np.diff(place, axis=0) / step
        found.append(np.stack([np.max(np.abs(each), axis=(0, 2)) for each in (place, speed)]))
    reach, fastest = np.concatenate(found, axis=1)
    return reach, fastest


def _worst_motions(
    spec: ExcitationSpec, force: FloatArray, count: int, fitted: DevicesOfAxes, fastest: float
) -> tuple[WorstMotion, ...]:
    """Worst travel and speed of any axis over the devices that a user may really have."""
    sets = list(regions(spec))
    worst: list[WorstMotion] = []
    for place, (name, words, region) in enumerate(sets):
        devices = _devices(region, count)
        if place == 0 and not spec.gentle:
            devices = _joined(devices, fitted)
        some = _some(devices, _farthest(devices, force, spec.sample_time, fastest))
        worst.append(WorstMotion.of(name, words, *_extremes(some, force, spec.sample_time)))
    return tuple(worst)


def _predicted(force: FloatArray, spec: ExcitationSpec) -> tuple[Answer, dict[str, float]]:
    """Motion of the guessed device, and half-widths of the entries of its matrices."""
    guess, step, axes = spec.guess, spec.sample_time, spec.axes or ()
    count = len(axes)
    model = JointModel(axes=axes, coulomb=(guess.coulomb_friction > 0,) * count)
    same = np.array([row == column for row, column in model.pairs], dtype=np.float64)
    rough = guess.coulomb_friction * np.ones(sum(model.coulomb))
    values = np.concatenate(
        (guess.mass * same, guess.damping * same, rough, np.full(count, guess.force_offset))
    )
    unknown = spec.delay == "unknown"
    theta = np.concatenate((values, np.zeros(unknown + 2 * count)))
    alone = devices_of(model, theta[None], np.zeros(1)).positions(force, step, 0)[:, 0]
    speed = np.diff(alone, axis=0) / step
    fast, pushed = float(np.max(np.abs(speed))), float(np.max(np.abs(force)))
    ratios = np.repeat([guess.mass, pushed / fast], same.size)
    sizes = np.concatenate(
        (
            NUDGE * np.append(ratios, np.full(rough.size + count, pushed)),
            [LATER * step] * unknown,
            NUDGE * np.repeat([fast, spec.travel], count),
        )
    )
    thetas = theta + np.diag(sizes)
    delays = thetas[:, values.size] if unknown else np.zeros(len(thetas))
    found = devices_of(model, thetas, delays).positions(force, step, 0)
    slopes = np.moveaxis((found - alone[:, None]) / sizes[:, None], 1, 0)
    response = Response(
        rate=guess.rate,
        step=step,
        count=len(force),
        noise=spec.reading_noise,
        acceleration_noise=spec.force_noise / guess.mass,
    )
    white = np.stack([[response.whitened(each) for each in slope.T] for slope in slopes])
    columns = white.reshape(len(theta), -1)
    norms = np.linalg.norm(columns, axis=1)
    seen = np.flatnonzero(norms > 0)  # what friction holds at first forgets how it started
    unit = columns[seen] / norms[seen, None]
    covariance = symmetric_inverse(unit @ unit.T, _SINGULAR) / np.outer(norms[seen], norms[seen])
    signal = values[: same.size] @ columns[: same.size]
    covariance = covariance * (1 + UNKNOWN_FORCE**2 * float(signal @ signal))
    half = NORMAL_95 * np.sqrt(np.diag(covariance)[: 2 * same.size])
    velocity = np.concatenate((np.zeros((1, count)), speed))
    names = model.parameters[: 2 * same.size]
    motion = Answer(position=alone, velocity=velocity)
    return motion, dict(zip(names, half.tolist(), strict=True))
