"""Logs of every kind of device that a user may bring, from a simulator of its own.

An answer is wrong by more than two half-widths and 1 % in mass, 3 % in damping (its slopes
counted). A log is usable if least squares with the device's true structure, its friction and forces
known but for a factor, has the mass within 2 % and the damping within 5 %. The delay is stated
where the seed is even.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi, sin
from typing import Any

import numpy as np

from identification import Hardware, LogRefusedError, Trajectory, identify
from tests.outside_axis import Axis, Body, Drive, FloatArray, Played, play, played_delay

LENGTH = 10.0  # s
KINDS = (
    *("clean-open", "clean-servo", "drag", "stribeck", "lugre", "dahl", "maxwell", "cogging"),
    *("asymmetric", "temperature", "cable", "quantised-force", "jitter", "dropped", "renumbered"),
    *("delayed", "hand", "spring", "spring-to-tremor", "servo-harmonics", "pendulum"),
    *("pendulum-bare", "lag", "mode", "backlash", "load"),
)
NEUTRAL = {"delay-unknown", "not-stated"}  # findings that ask for a fact, of any log
_BLOCKS = 30  # left out in turn for the deviation of the true fit
_WIDTHS = (0.01, 0.02, 0.04, 0.08)  # half-widths of its windows, s


@dataclass(frozen=True, slots=True, kw_only=True)
class OutsideLog:
    """One log, and what is true of its device."""

    kind: str
    seed: int
    trajectory: Trajectory
    hardware: Hardware
    mass: float
    damping: tuple[float, float]  # least and largest slope of friction over the speeds seen
    usable: bool


@dataclass(slots=True, kw_only=True)
class _Scene:
    """A device and how it is moved, which a kind may change before it is played."""

    rng: np.random.Generator
    axis: Axis
    rotary: bool
    servo: bool
    travel: float
    lines: FloatArray  # Hz
    delay: float
    disturbance: float  # not logged, part of the rms force
    sample_time: float = 0.001
    quantum: float = 0.0  # of the force, part of the largest
    bandwidth: float = 4.0  # of the servo, Hz
    gravity: float = 0.0  # known to whoever plans the force
    spoil: Callable[[Trajectory], Trajectory] | None = None

    @classmethod
    def drawn(cls, rng: np.random.Generator, *, rotary: bool) -> _Scene:
        """A rigid device with viscous and Coulomb friction."""
        scene = cls(
            rng=rng,
            axis=Axis(mass=1.0, damping=1.0),
            rotary=rotary,
            servo=bool(rng.integers(2)),
            travel=rng.uniform(0.3, 1.2) if rotary else rng.uniform(0.03, 0.12),
            lines=np.geomspace(
                rng.uniform(0.2, 0.4), rng.uniform(6, 20), int(rng.integers(10, 18))
            ),
            delay=rng.uniform(0, 0.0025),
            disturbance=float(rng.choice([0.0, 0.002, 0.005])),
        )
        scene.weigh(scene.between(1e-4, 1e-2) if rotary else scene.between(0.05, 5))
        return scene

    def weigh(self, mass: float) -> None:
        """Another mass, with damping and friction to match."""
        self.change(mass=mass, damping=mass * self.between(1, 10), coulomb=0.0)
        self.change(coulomb=self.between(0.03, 0.4) * self.force)

    def between(self, low: float, high: float) -> float:
        """A number even on a logarithmic scale."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def change(self, **sizes: Any) -> None:
        self.axis = replace(self.axis, **sizes)

    def shaft(self, low: float, high: float) -> None:
        """Part of the mass is joined by a spring; both swing freely between two frequencies."""
        total, part, rate = self.axis.mass, self.rng.uniform(0.1, 0.5), self.between(low, high)
        motor, load = total * (1 - part), total * part
        stiffness = motor * part * (2 * pi * rate) ** 2
        damping = 2 * self.between(0.01, 0.1) * motor * part * 2 * pi * rate
        self.change(mass=motor, body=Body(mass=load, stiffness=stiffness, damping=damping))

    def noise(self, low: float, high: float) -> FloatArray:
        """Noise of unit rms between two frequencies."""
        count = round(LENGTH / self.sample_time)
        spectrum = np.fft.rfft(self.rng.standard_normal(count))
        frequency = np.fft.rfftfreq(count, self.sample_time)
        course = np.fft.irfft(np.where((frequency < low) | (frequency > high), 0, spectrum), count)
        return np.asarray(course / np.std(course), dtype=np.float64)

    @property
    def motion(self) -> FloatArray:
        """Wanted motion: lines flat in velocity up to 3 Hz, eased in over a second."""
        rng = np.random.default_rng(round(1e6 * self.lines[-1]))
        moment = np.arange(round(LENGTH / self.sample_time)) * self.sample_time
        phase = rng.uniform(0, 2 * pi, (self.lines.size, 1))
        size = 1 / (self.lines * (1 + (self.lines / 3) ** 1.5))
        place = size @ np.sin(2 * pi * self.lines[:, None] * moment + phase)
        place *= 0.5 - 0.5 * np.cos(pi * np.clip(moment, 0, 1))
        return np.asarray(place * self.travel / np.ptp(place), dtype=np.float64)

    @property
    def plan(self) -> FloatArray:
        """Force that moves a roughly known device so."""
        place = self.motion
        speed = np.gradient(place, self.sample_time)
        force = 1.1 * self.axis.mass * np.gradient(speed, self.sample_time)
        force += 0.9 * self.axis.damping * speed + self.gravity * np.sin(place)
        return force + self.axis.coulomb * np.tanh(speed / (0.05 * np.abs(speed).max()))

    @property
    def force(self) -> float:
        """Rms force."""
        return float(np.std(self.plan))

    @property
    def fastest(self) -> float:
        return float(np.abs(np.gradient(self.motion, self.sample_time)).max())


def _change(scene: _Scene, kind: str) -> None:  # noqa: PLR0912
    """Make a device and a log of that kind."""
    rng, axis, between, travel = scene.rng, scene.axis, scene.between, scene.travel
    match kind:
        case "clean-open":
            scene.servo, scene.disturbance = False, 0.0
        case "clean-servo":
            scene.servo = True
        case "drag":
            drag = rng.uniform(0.02, 0.3) * scene.force / (scene.fastest / 2) ** 2
            scene.change(drag=drag)
        case "stribeck" | "lugre":
            speed = between(0.01, 0.1) * scene.fastest
            scene.change(static=rng.uniform(0.3, 1) * axis.coulomb, stribeck=speed)
            if kind == "lugre":
                bristle = axis.coulomb / (travel * between(3e-4, 1e-2))
                damping = rng.uniform(0.1, 0.6) * (bristle * axis.mass) ** 0.5
                scene.change(bristle_stiffness=bristle, bristle_damping=damping)
        case "dahl":
            scene.change(bristle_stiffness=axis.coulomb / (travel * between(1e-3, 0.03)))
        case "maxwell":
            limits = rng.dirichlet(np.ones(4)) * axis.coulomb * 1.5
            widths = travel * np.array([0.002, 0.01, 0.04, 0.12]) * between(0.5, 2)
            slips = zip((limits / widths).tolist(), limits.tolist(), strict=True)
            scene.change(slips=tuple(slips), coulomb=0.0)
        case "cogging":
            wave, at = 2 * pi * rng.uniform(1.5, 8) / travel, rng.uniform(0, 2 * pi)
            size = between(0.03, 0.3) * scene.force
            scene.change(place=lambda x: size * sin(wave * x + at))
        case "asymmetric":
            scene.change(asymmetry=rng.uniform(0.1, 0.4))
        case "temperature":
            scene.change(warming=rng.uniform(0.1, 0.4), warming_time=rng.uniform(3, 20))
        case "cable":
            scene.shaft(60, 200)
        case "mode":
            scene.shaft(10, 60)
        case "backlash":
            scene.shaft(150, 300)
            assert scene.axis.body is not None
            damping, gap = 5 * scene.axis.body.damping, travel * between(0.003, 0.05) / 2
            scene.change(body=replace(scene.axis.body, gap=gap, damping=damping))
        case "load":
            scene.change(load=rng.uniform(0.03, 0.15))
        case "lag":
            scene.change(lag_hz=between(20, 100))
        case "quantised-force":
            scene.quantum = between(0.002, 0.03)
        case "jitter":
            scene.spoil = lambda log: _read_late(
                log, rng.uniform(0, rng.uniform(0.05, 0.3), len(log))
            )
        case "dropped" | "renumbered":
            scene.spoil = lambda log: _thinned(log, rng.uniform(size=len(log)) >= 0.02, kind)
        case "delayed":
            scene.sample_time, scene.delay = 1 / between(500, 5000), rng.uniform(0, 0.01)
            scene.bandwidth = 2.0
        case "hand":
            mass, skin, ground = between(0.2, 2), between(2e3, 3e4), between(20, 400)
            push = mass * rng.uniform(0.1, 0.4) * scene.noise(8, 12)
            push += rng.uniform(0.1, 0.5) * scene.noise(0.05, 1.5)
            scene.weigh(between(0.2, 4))
            hand = Body(
                mass=mass,
                stiffness=skin,
                damping=0.6 * (skin * mass) ** 0.5,
                ground_stiffness=ground,
                ground_damping=rng.uniform(0.3, 1) * (ground * mass) ** 0.5,
                push=push,
            )
            scene.change(body=hand)
        case "spring" | "spring-to-tremor":
            stiffness = axis.mass * (2 * pi * between(0.5, 4)) ** 2
            scene.change(place=lambda x: stiffness * x)
            if kind == "spring-to-tremor":  # its excitation ends where a tremor would be
                scene.servo, scene.lines = False, np.geomspace(0.3, rng.uniform(9, 12), 14)
        case "pendulum" | "pendulum-bare":
            scene.travel = rng.uniform(0.2, 3)
            scene.weigh(axis.mass)
            scene.gravity = scene.axis.mass * (2 * pi * rng.uniform(0.4, 1.5)) ** 2
            tilt, weight = float(rng.choice([0.0, 0.3])), scene.gravity
            scene.change(place=lambda x: weight * (sin(x + tilt) - sin(tilt)))
            if kind == "pendulum-bare":
                scene.change(coulomb=0.0)
        case "servo-harmonics":  # the third or fifth of its turns lies at 8 to 12 Hz
            first = rng.uniform(8, 12) / float(rng.choice([3, 5]))
            scene.servo, scene.bandwidth, scene.lines = True, 6.0, first * np.array([0.25, 1.0])
            scene.change(coulomb=rng.uniform(0.1, 0.4) * scene.force)
        case _:
            raise ValueError(kind)


def _read_late(log: Trajectory, late: FloatArray) -> Trajectory:
    """Rows read late, and stamped so, by parts of a step."""
    time = log.time + late * log.sample_time
    return replace(log, time=time, position=np.interp(time, log.time, log.position))


def _thinned(log: Trajectory, keep: np.ndarray[Any, np.dtype[np.bool_]], kind: str) -> Trajectory:
    columns = {name: column[keep] for name, column in log.columns()}
    if kind == "renumbered":
        columns["time"] = log.time[: columns["time"].size]
    return replace(log, **columns)


def outside_log(kind: str, seed: int) -> OutsideLog:
    """One log of a kind; its delay is stated if the seed is even."""
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    either = bool(rng.integers(2)) and kind != "hand"
    scene = _Scene.drawn(rng, rotary=either or kind.startswith("pendulum"))
    _change(scene, kind)
    scene.delay = played_delay(scene.delay, scene.sample_time)
    axis, place, force = scene.axis, scene.motion, scene.plan
    limit = (6 if scene.servo else 1.5) * float(np.abs(force).max())
    rate, body = 2 * pi * scene.bandwidth, axis.body
    inertia = axis.mass + (body.mass if body else 0.0)
    grid = (
        2 * pi / 2 ** rng.integers(12, 17) if scene.rotary else scene.travel / rng.uniform(1e3, 2e4)
    )
    drive = Drive(
        sample_time=scene.sample_time,
        plan=place if scene.servo else force,
        delay=scene.delay,
        count=float(grid),
        servo=(inertia * rate**2, 1.4 * inertia * rate) if scene.servo else None,
        limit=limit,
        quantum=scene.quantum * limit,
        disturbance=scene.disturbance * float(np.std(force)),
    )
    played = play(axis, drive, rng)
    log = Trajectory(
        time=played.time,
        force=played.command,
        position=played.reading,
        reference=place if scene.servo and rng.integers(2) else None,
        motion="rotary" if scene.rotary else "linear",
        stated_units=frozenset({"force", "position"}),
        source=f"{kind}-{seed}",
    )
    known: dict[str, Any] = {
        "motion": log.motion,
        "sample_time": scene.sample_time,
        "delay": scene.delay if seed % 2 == 0 else None,
        "encoder_resolution": drive.count,
        "force_limit": {"continuous": limit, "peak": limit},
    }
    mass = axis.mass if kind == "hand" else inertia
    lost = axis.warming * (1 - float(np.exp(-LENGTH / axis.warming_time)))
    least = axis.damping * (1 - lost) * (1 - axis.asymmetry)
    most = axis.damping * (1 + axis.asymmetry)
    fitted, halves = _true_fit(played, scene.sample_time, two=body is not None)
    return OutsideLog(
        kind=kind,
        seed=seed,
        trajectory=log if scene.spoil is None else scene.spoil(log),
        hardware=Hardware(**known),
        mass=mass,
        damping=(least, most + 2 * axis.drag * played.fastest),
        usable=abs(fitted[0] / mass - 1) <= 0.02
        and 0.95 * least <= fitted[1] <= 1.05 * most
        and halves[0] <= 0.02 * mass
        and halves[1] <= 0.05 * axis.damping,
    )


Pair = tuple[float, float]


def _true_fit(played: Played, step: float, *, two: bool) -> tuple[Pair, Pair]:
    """Mass and damping, and half-widths, with friction and forces known but for their scale.

    Least squares on windows (1 + cos)²: position enters by their derivatives. The width with the
    smallest interval of the damping is taken.
    """
    fits: list[tuple[Pair, Pair]] = []
    for width in _WIDTHS:
        reach = round(width / step)
        u = pi * np.arange(-reach, reach + 1) / reach
        bump = (1 + np.cos(u)) ** 2
        first = -2 * pi / width * np.sin(u) * (1 + np.cos(u))
        second = -2 * (pi / width) ** 2 * (np.cos(u) + np.cos(2 * u))
        mean = (bump[1:] + bump[:-1]) / 2  # over the rows that forces are held for
        every, place = max(1, reach // 4), played.reading
        pairs: list[tuple[FloatArray, FloatArray]] = [
            (place, second),
            (place, first),
            (np.ones(place.size - 1), mean),
        ]
        pairs += [(each[:-1], mean) for each in (played.dry, played.further) if np.ptp(each) > 0]
        pairs += [(played.apart, second)] if two else []
        pairs.append((played.force[:-1], mean))
        fits.append(
            _jackknifed(np.array([np.convolve(*each, mode="valid")[::every] for each in pairs]))
        )
    return min(fits, key=lambda each: each[1][1] / abs(each[0][1]))


def _jackknifed(table: FloatArray) -> tuple[Pair, Pair]:
    """Weights of the first two rows in a fit of the last, and two of their deviations."""
    scale = np.sqrt(np.mean(table**2, axis=1))
    parts = np.array_split(table / scale[:, None], _BLOCKS, axis=1)
    sums = np.array([part @ part.T for part in parts])
    whole = sums.sum(axis=0)
    fits = np.array(
        [
            np.linalg.lstsq(each[:-1, :-1], each[:-1, -1], rcond=1e-12)[0][:2]
            for each in (whole, *(whole - sums))
        ]
    )
    fits *= scale[-1] / scale[:2]
    spread = 2 * np.std(fits[1:], axis=0) * np.sqrt(_BLOCKS - 1)
    return (float(fits[0, 0]), float(fits[0, 1])), (float(spread[0]), float(spread[1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What identify said of one log, against the truth."""

    kind: str
    seed: int
    usable: bool
    codes: list[str]
    refusals: list[str]  # codes that refuse; empty where the log is accepted
    wrong: str = ""  # "m", "b" or both
    low_above: bool = False  # the least damping stated is 3 % above the true least slope

    @property
    def flagged(self) -> bool:
        """Whether any finding speaks of the log."""
        return bool(set(self.codes) - NEUTRAL)


def judged(log: OutsideLog) -> Judged:
    """Identify one log and compare."""
    device = None
    try:
        found = identify(log.trajectory, hardware=log.hardware)
        findings, device = found.findings, found.device
    except LogRefusedError as error:
        findings = error.findings
    said: dict[str, Any] = {
        "kind": log.kind,
        "seed": log.seed,
        "usable": log.usable,
        "codes": sorted({each.code for each in findings}),
    }
    if device is None:
        refusals = sorted({each.code for each in findings if each.severity == "refusal"})
        return Judged(**said, refusals=refusals)
    mass, dampings, sides = device.mass, [device.damping], device.damping_by_direction
    if sides is not None:
        dampings += [sides.forward, sides.backward]
    ranges = [(each.low, each.high) for each in dampings]
    hull = [(3 * each.low - each.high) / 2 for each in dampings]
    hull += [(3 * each.high - each.low) / 2 for each in dampings]
    if device.damping_slope is not None:
        ranges.append((device.damping_slope.low, device.damping_slope.high))
        hull += ranges[-1]
    least, most = log.damping
    apart = max(min(hull) - most, least - max(hull), 0.0)
    off, half = abs(mass.value - log.mass), (mass.high - mass.low) / 2
    return Judged(
        **said,
        refusals=[],
        wrong="m" * (off > max(2 * half, 0.01 * log.mass)) + "b" * (apart > 0.03 * least),
        low_above=min(low for low, _ in ranges) > 1.03 * least,
    )


def line_of(rows: Sequence[Judged]) -> str:
    """What was made of the logs of one kind; findings are those of the usable, with refusals."""
    use = [each for each in rows if each.usable]
    taken = [each for each in rows if not each.refusals]
    wrong = [each for each in taken if each.wrong]
    said = Counter(code for each in use for code in each.codes if code not in NEUTRAL)
    cut = Counter(code for each in use for code in each.refusals)
    return (
        f"{rows[0].kind}: {len(rows)} logs, {len(use)} usable, of them "
        f"{sum(bool(each.refusals) for each in use)} refused; {len(taken)} accepted, "
        f"{len(wrong)} wrong, of them {sum(not each.flagged for each in wrong)} without a finding; "
        + ", ".join(f"{code} {count} ({cut[code]})" for code, count in said.most_common())
    )
