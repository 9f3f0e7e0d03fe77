"""Free motion against the poles of the loop: predicted over the device's box, judged, planned."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identification import Device, counted, quantity
from tune.documents.profile import Design, LoopProfile
from tune.documents.scene import DEFAULT_MOTION, UNITS, Effects
from tune.loop.loop import Loop, filters_of
from tune.loop.polynomials import ComplexArray, FloatArray, companion_roots
from tune.verification.free_motion import (
    FreeMotion,
    Release,
    find_letting_go,
    find_release,
    measure_sprung,
    measure_unsprung,
)
from tune.verification.law import (
    Combination,
    Outcome,
    combination_in_words,
    compared,
    effects_of,
    scale_effects,
    unassessed_outcome,
)

Range = tuple[float, float]

#: Imaginary parts below this part of the modulus are rounding: the pole is real.
_REAL = 1e-9
#: A pole so near to w = -1, z = 0, is over within a sample: what a delay or a difference leaves.
_GONE = 1e-6

#: Motion of which one mode leaves more than this part is no free motion of this loop.
_MISFIT = 0.05
#: Speed below this part of the largest is rest, for motion without a spring.
_SLOW = 0.03
#: Speed that is still above this part of what it was has not been seen to fall.
_FALLEN = 0.5
#: Rows that free motion without a spring must last, windows over which its speed, s, is smoothed,
#: and how many times as long with a virtual mass; measured on simulated devices with friction.
_FEWEST_ROWS, _WINDOWS, _SMOOTHED, _WITH_MASS = 50, 2.5, 0.02, 1.4
#: What is told of a speed that would do, over the least one: no hand meets a speed.
_AMPLE = 1.2

#: What the fit of one mode is off by, measured on simulated devices of known poles: frequency by
#: 1 % and, because friction jumps and one mode does not follow as the loop does, by this part of
#: the nearness of the other modes; decay by 5 %.
_FREQUENCY_TOLERANCE, _BY_OTHER_MODES, DECAY_TOLERANCE = 0.01, 0.1, 0.05
#: Of several axes: motion across, part of that along, beyond which it is not that of one axis, and
#: what it puts in doubt of the decay, for friction holds one axis before another. Measured on
#: simulated devices, of which it was off by up to twice that part.
_MOST_BENT, _BLURRED = 0.1, 2.0
#: An interval wider than this part of what is predicted tells nothing.
_WIDEST = 0.5
#: Stiffness is looked for as an error of unit where it explains the frequency within this part.
_UNIT_ERROR = 0.2
#: Samples of delay that somebody may have overlooked.
_MOST_SAMPLES = 10
#: A sensitivity of the decay is read off over this part of the damping.
_NUDGE = 0.01

_STILL = "the handle does not move by more than noise and a few counts"
_LEFT = "the handle leaves a one-sided wall, or the force its limit, before a swing could be seen"
_ONE_TURN = "the handle comes to rest within a swing, which does not tell decay from friction"
_STOPPED = "the handle comes to rest within a swing, where the device as identified swings on"
#: What helps where the log cannot tell.
_STRAIGHTER = "Hold the other axes, or let go in a principal direction of the mass."
_HANDS_OFF = "Take the hand off, and state with --release when; or cut the log to the free motion."
_LOUDER = (
    "Release the handle from further away, without a spring push it faster, hand off, or play an "
    "element with a spring on both sides."
)
_IDENTIFY_AGAIN = (
    "If no hand stopped it, friction or damping has grown: log and identify the device again, "
    "compare the two devices, tune again, and verify that profile."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Slowest:
    """The mode in which a loop comes to rest."""

    frequency: float  # damped, Hz; 0 where it does not oscillate
    decay: float  # of its envelope exp(-decay·t), 1/s
    natural: float  # modulus of the pole, rad/s
    nearness: float  # to the other modes: its modulus over the least of theirs


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Slowest mode at the best estimate, and its range over the corners of the device's box."""

    nominal: Slowest
    frequency: Range  # Hz
    decay: Range  # 1/s

    @property
    def frequency_tolerance(self) -> float:
        """What the fit of one mode may be off by, part of the frequency."""
        return _FREQUENCY_TOLERANCE + _BY_OTHER_MODES * self.nominal.nearness

    @property
    def obstacle(self) -> str | None:
        """Why there is no decay to compare with."""
        if self.decay[0] <= 0:
            return (
                f"at this gain the loop is predicted to decay by {self.decay[0]:.3g} to "
                f"{self.decay[1]:.3g} 1/s, so it may not come to rest at all"
            )
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredMode:
    """What is known of the slow mode, tolerances included; None where nothing is."""

    frequency: Range | None  # Hz
    decay: Range | None  # 1/s


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredMotion:
    """The free motion and what the loop predicts of it; outcomes are "frequency" and "decay"."""

    prediction: Prediction
    outcomes: tuple[Outcome, ...]
    release: Release | None = None  # where it was looked for and found
    measured: FreeMotion | None = None

    @property
    def mode(self) -> MeasuredMode:
        """Frequency and decay, as far as they were assessed, with intervals and tolerances."""
        measured, prediction = self.measured, self.prediction
        if measured is None:
            return MeasuredMode(frequency=None, decay=None)
        assessed = {each.check for each in self.outcomes if each.verdict != "not assessed"}
        swings = "frequency" in assessed and self.release is not None and bool(self.release.turns)
        hertz = prediction.frequency_tolerance * measured.frequency + measured.frequency_half
        slack = DECAY_TOLERANCE * prediction.nominal.decay + measured.decay_half
        return MeasuredMode(
            frequency=(measured.frequency - hertz, measured.frequency + hertz) if swings else None,
            decay=(measured.decay - slack, measured.decay + slack) if "decay" in assessed else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """The slowest push that tells a decay."""

    rows: int  # that motion lasts after it
    speed: float  # m/s; inf where none tells
    ample: str  # a speed that would do, in words; "" where none does

    @property
    def too_slow(self) -> str:
        """What a slower one does."""
        stopped = "friction stops it" if self.ample else "it comes to rest"
        return f"{stopped} before the {self.rows} rows that are needed"

    @property
    def remedy(self) -> str:
        """What to do after a slower one."""
        faster = f"Push it to {self.ample}, or play" if self.ample else "Play"
        return f"{faster} what is said of the delay."


def predict(device: Device, loop: LoopProfile, effects: Effects) -> Prediction:
    """The free motion of a device, no hand on it, under effects at the gain they are played."""
    box = device.simultaneous_box()
    nominal = slowest(device, loop, effects)
    names = ("mass", "damping", "sample_time", "delay", "position_stiffness")
    corners = product(*(sorted(set(getattr(box, name))) for name in names))
    every = [nominal]
    for corner in corners:
        stated = {name: quantity(value) for name, value in zip(names, corner, strict=True)}
        every.append(slowest(device.model_copy(update=stated), loop, effects))
    return Prediction(
        nominal=nominal,
        frequency=(min(m.frequency for m in every), max(m.frequency for m in every)),
        decay=(min(m.decay for m in every), max(m.decay for m in every)),
    )


def binding_stiffness(device: Device, effects: Effects) -> float:
    """K and the slope of the device's own force together, N/m; 0 where the position is free."""
    return device.slope_at_zero + float(effects.present().get("stiffness", 0.0))


def poles_by_size(loop: Loop, effects: Effects, sample_time: float) -> ComplexArray:
    """Poles of each loop but a free one, 1/s, the slowest first, inf if gone; (degree, loops)."""
    closed, _ = loop.polynomial(effects)
    closed = closed[loop.lowest_power(effects) :].reshape(-1, closed[0].size)
    w = companion_roots(closed[:-1] / closed[-1])
    poles = np.full(w.shape, np.inf, dtype=np.complex128)
    alive = np.abs(1 + w) > _GONE
    poles[alive] = 2 / sample_time * np.arctanh(w[alive])
    order = np.argsort(np.abs(poles), axis=0)
    return poles[order, np.arange(w.shape[1])]


def slowest(
    device: Device, loop: LoopProfile, effects: Effects, *, extra_delay_samples: int = 0
) -> Slowest:
    """The slowest mode of the loop at the best estimate of a device."""
    built = Loop.from_parts(device, filters_of(loop), extra_delay_samples=extra_delay_samples)
    poles = poles_by_size(built, effects, device.sample_time.value)[:, 0]
    first = poles[0]
    oscillates = abs(first.imag) > _REAL * abs(first)
    pair = len(poles) > 1 and not built.has_free_pole(effects) and poles[1].imag == 0
    own = 2 if oscillates or pair else 1
    return Slowest(
        frequency=float(abs(first.imag)) / (2 * np.pi) if oscillates else 0.0,
        decay=-float(first.real),
        natural=float(abs(first)),
        nearness=float(np.max(abs(first) / np.abs(poles[own:]), initial=0.0)),
    )


def judge_motion(
    device: Device,
    loop: LoopProfile,
    effects: Effects,
    position: FloatArray,
    used: NDArray[np.bool_],
    sample_time: float,
    bent: float,
    stated: int | None,
) -> MeasuredMotion:
    """Compare the free motion of a log with the slowest mode of a loop, with effects as played.

    Position in m and the rows of the law that are used have shape (n,); before the row that is
    ``stated`` the motion is not free. ``bent`` is the part of it that goes across, of a device of
    several axes.
    """
    prediction, first = predict(device, loop, effects), stated or 0
    release = find_release(position, first)
    if release is not None and release.grows:
        return _growing(release, prediction)
    if prediction.obstacle is not None:
        return _unassessed(prediction, prediction.obstacle)
    still = _STILL
    if release is not None and not np.all(used[release.first : release.end]):
        last, still = int(np.flatnonzero(~used[first:])[-1]), _LEFT
        release = find_release(position, first + last + 1)
    hindrance = still if release is None else _ONE_TURN if len(release.turns) == 1 else ""
    remedy = _LOUDER
    if release is not None and len(release.turns) <= 1:
        start = abs(float(position[release.first] - position[-1]))
        # Twice, for where it rests is off by what friction holds.
        if _swings_on(device, effects, prediction, start, 2, 2.0):
            hindrance, remedy = _STOPPED, _IDENTIFY_AGAIN
    if bent > _MOST_BENT:
        hindrance, remedy = f"{bent:.0%} of the motion goes across", _STRAIGHTER
    if release is None or hindrance:
        return _unassessed(prediction, hindrance, remedy)
    if not binding_stiffness(device, effects):
        push = _least_push(device, effects, prediction)
        return _unsprung(
            position, sample_time, bent, release, prediction, push, stated=stated is not None
        )
    start = prediction.nominal.natural, prediction.nominal.decay
    measured = _blurred(measure_sprung(position, sample_time, release, start), bent, prediction)
    if measured.misfit > _MISFIT:
        return _not_one_mode(measured, release, prediction)
    return MeasuredMotion(
        release=release,
        measured=measured,
        prediction=prediction,
        outcomes=(
            _frequency_outcome(measured, len(release.turns), prediction, effects),
            _sprung_decay_outcome(measured, len(release.turns), prediction, device, loop, effects),
        ),
    )


def _blurred(measured: FreeMotion, bent: float, prediction: Prediction) -> FreeMotion:
    """With the part of its decay in doubt by which motion goes across."""
    doubt = _BLURRED * bent * prediction.nominal.decay
    return replace(measured, decay_half=measured.decay_half + doubt)


def _unsprung(
    position: FloatArray,
    sample_time: float,
    bent: float,
    release: Release,
    prediction: Prediction,
    push: Push,
    *,
    stated: bool,
) -> MeasuredMotion:
    """Decay of speed after a push, from where it falls as it does at the end."""
    from scipy.ndimage import uniform_filter1d

    width = _window(sample_time)
    speed = np.abs(np.gradient(uniform_filter1d(position, width)))
    top = int(np.argmax(speed[release.first : release.end])) + release.first
    slow = np.flatnonzero(speed[top:] < _SLOW * speed[top])
    end = top + int(slow[0]) if slow.size else position.size
    rows, unheld = end - top, "nothing holds the position, so nothing oscillates"
    no_frequency = unassessed_outcome("frequency", unheld)
    if rows < _FEWEST_ROWS:
        why = f"the handle moves freely for {rows} rows only, {push.rows} are needed"
        decay = unassessed_outcome("decay", why, push.remedy, rows=rows)
        return MeasuredMotion(prediction=prediction, outcomes=(no_frequency, decay))
    decay = prediction.nominal.decay
    free = find_letting_go(position, sample_time, top, end, decay)
    begin = top if free is None and stated else free
    # Of speed that does not fall any decay explains as much as any other.
    if begin is None or speed[max(begin, end - width)] > _FALLEN * speed[begin]:
        why, remedy = "a hand may still push", _HANDS_OFF
        if stated and not slow.size:
            why, remedy = "the log ends before the speed has fallen", "Log until the handle rests."
        elif speed[top] < push.speed * sample_time:
            why, remedy = f"pushed so slowly, {push.too_slow}", push.remedy
        elif stated:
            why = f"the handle is at rest {rows} rows after its largest speed, too soon to tell"
            remedy = push.remedy
        decay = unassessed_outcome("decay", why, remedy, rows=rows)
        return MeasuredMotion(prediction=prediction, outcomes=(no_frequency, decay))
    measured = measure_unsprung(position, sample_time, begin, end, decay)
    measured = _blurred(measured, bent, prediction)
    if measured.misfit > _MISFIT:
        return _not_one_mode(measured, release, prediction)
    return MeasuredMotion(
        release=release,
        measured=measured,
        prediction=prediction,
        outcomes=(no_frequency, _decay_outcome(measured, 0, prediction, "", "")),
    )


def _growing(release: Release, prediction: Prediction) -> MeasuredMotion:
    low, high = prediction.decay
    decay = compared(
        "decay",
        {"predicted_low": low, "predicted_high": high},
        agrees=False,
        seen="the swings grow until the log ends",
        predicted=f"{low:.4g} to {high:.4g} 1/s",
        tolerance="that it decays",
        remedy="Do not raise the gain. Check the sign of force and position, the filters "
        "and the delay of the controller.",
    )
    frequency = unassessed_outcome("frequency", "the motion grows")
    return MeasuredMotion(release=release, prediction=prediction, outcomes=(frequency, decay))


def _not_one_mode(measured: FreeMotion, release: Release, prediction: Prediction) -> MeasuredMotion:
    why = (
        f"one damped mode with Coulomb friction leaves {measured.misfit:.1%} of the motion, at "
        f"most {_MISFIT:.0%} is free motion"
    )
    unassessed = _unassessed(prediction, why, _HANDS_OFF)
    return replace(unassessed, release=release, measured=measured)


def _unassessed(prediction: Prediction, why: str, remedy: str = "") -> MeasuredMotion:
    outcomes = tuple(unassessed_outcome(check, why, remedy) for check in ("frequency", "decay"))
    return MeasuredMotion(prediction=prediction, outcomes=outcomes)


def _frequency_outcome(
    measured: FreeMotion, turns: int, prediction: Prediction, effects: Effects
) -> Outcome:
    """The frequency of the swings against the prediction."""
    nominal, (low, high) = prediction.nominal.frequency, prediction.frequency
    value, half = measured.frequency, measured.frequency_half
    if turns == 0:
        if low == 0:
            why = "the motion does not oscillate, which is predicted"
            return unassessed_outcome("frequency", why)
        return unassessed_outcome("frequency", "the handle does not swing back", _LOUDER)
    if half > _WIDEST * max(nominal, value):
        why = f"it is seen as {value:.4g} ± {half:.2g} Hz only"
        return unassessed_outcome("frequency", why, _LOUDER, seen=value, seen_half_width=half)
    tolerance = prediction.frequency_tolerance
    agrees = value + half >= low * (1 - tolerance) and value - half <= high * (1 + tolerance)
    return compared(
        "frequency",
        {
            "turning_points": turns,
            "predicted": nominal,
            "predicted_low": low,
            "predicted_high": high,
            "tolerance": tolerance,
            "seen": value,
            "seen_half_width": half,
        },
        agrees=agrees,
        seen=f"{value:.4g} ± {half:.2g} Hz, {turns} turning points",
        predicted=f"{low:.4g} to {high:.4g} Hz, {nominal:.4g} Hz at best",
        tolerance=f"{tolerance:.1%} and the interval of the measurement",
        remedy="" if agrees else _frequency_remedy(measured, prediction, effects),
    )


def _frequency_remedy(measured: FreeMotion, prediction: Prediction, effects: Effects) -> str:
    natural = float(np.hypot(2 * np.pi * measured.frequency, measured.decay))
    factor = (prediction.nominal.natural / natural) ** 2
    said = (
        f"As if the moving mass were {factor:.3g} times the predicted one"
        + (", the virtual mass included," if effects.mass else "")
        + f" or the actuator gave {1 / factor:.3g} times the commanded force. "
    )
    for unit, size in (("mm", 1e3), ("cm", 1e2), ("degrees", 180 / np.pi)):
        if abs(factor * size - 1) < _UNIT_ERROR:
            return said + f"Is the position in {unit}? Then state it with --position-gain."
    return said + "Check the units and the force of the actuator, then identify the device again."


def _sprung_decay_outcome(
    measured: FreeMotion,
    turns: int,
    prediction: Prediction,
    device: Device,
    loop: LoopProfile,
    effects: Effects,
) -> Outcome:
    """The decay of motion about a spring, and what damping or delay would explain it."""
    unit = "N·m" if device.motion == "rotary" else "N"
    apart = ""
    beside: dict[str, float] = {}
    if measured.friction is not None:
        friction = measured.friction * binding_stiffness(device, effects)
        apart = f", besides {friction:.2g} {unit} of Coulomb friction"
        beside = {"coulomb_friction": friction}
    missing = measured.decay - prediction.nominal.decay
    damped = device.model_copy(update={"damping": quantity(device.damping.value * (1 + _NUDGE))})
    damper = slowest(damped, loop, effects).decay
    per_damping = (damper - prediction.nominal.decay) / (_NUDGE * device.damping.value or 1.0)
    late = slowest(device, loop, effects, extra_delay_samples=1).decay
    per_sample = late - prediction.nominal.decay
    remedy = "Check for play, a slipping belt or a hand on the handle, then identify again."
    parts: list[str] = []
    if per_damping > 0:
        per_speed = f"{unit}·s/{'rad' if device.motion == 'rotary' else 'm'}"
        parts.append(f"the damping were {missing / per_damping:+.3g} {per_speed} off")
    if 0 < missing * per_sample < _MOST_SAMPLES * per_sample**2:
        parts.append(f"the delay were {counted(f'{missing / per_sample:.2g}', 'sample')} longer")
    if parts:
        remedy += f" As if {' or '.join(parts)}."
    found = _decay_outcome(measured, turns, prediction, apart, remedy)
    return replace(found, numbers={**found.numbers, **beside})


def _decay_outcome(
    measured: FreeMotion, turns: int, prediction: Prediction, apart: str, remedy: str
) -> Outcome:
    """A measured decay against the prediction; ``apart`` is said besides."""
    (low, high), nominal = prediction.decay, prediction.nominal.decay
    value, half = measured.decay, measured.decay_half
    seen = f"{value:.4g} ± {half:.2g} 1/s{apart}"
    if not turns and prediction.nominal.frequency > 0:
        return unassessed_outcome("decay", "the handle comes to rest within half a swing", _LOUDER)
    numbers = {"seen": value, "seen_half_width": half}
    if half > _WIDEST * max(nominal, abs(value)):
        return unassessed_outcome("decay", f"it is seen as {seen} only", _LOUDER, **numbers)
    slack = DECAY_TOLERANCE * nominal
    numbers |= {"predicted": nominal, "predicted_low": low, "predicted_high": high}
    return compared(
        "decay",
        numbers | {"tolerance": DECAY_TOLERANCE},
        agrees=value + half >= low - slack and value - half <= high + slack,
        seen=seen,
        predicted=f"{low:.4g} to {high:.4g} 1/s, {nominal:.4g} 1/s at best",
        tolerance=f"{DECAY_TOLERANCE:.0%} and the interval of the measurement",
        remedy=remedy or "Identify the device again, with no hand on it.",
    )


#: Turning points that make a decay known, and how large a swing must be, part of the displacement.
_TURNS, _CLEAR = 3, 0.03
#: Half-cycles after which motion that hardly decays is logged no longer.
_MOST_SWINGS = 40
#: Displacements that are tried, in penetrations of the element; part of the farthest that is used.
_DEEPER, _NEARLY = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0), 0.95
#: Time constants until motion without swings is over, and rest that is logged after it, s.
_SETTLED, _REST = 5.0, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """One log to take."""

    elements: Combination  # to play
    gain: float  # to play them at
    displacement: float | None  # from which to let go, m (rad); None where a push is needed
    speed: float | None  # of the push, m/s (rad/s); None where a displacement is needed
    duration: float  # to log, s
    fade: float  # until what fades has faded in, s; 0 where nothing does

    def words(self, motion: str) -> str:
        """An instruction, for a "linear" or "rotary" axis."""
        length = "mm" if motion == "linear" else "mrad"
        begin = f"held still for {self.fade:g} s until it has faded in, then " if self.fade else ""
        begin += (
            f"let go {1e3 * self.displacement:.3g} {length} from rest"
            if self.displacement is not None
            else f"pushed to {self.speed:.3g} {'m' if motion == 'linear' else 'rad'}/s"
        )
        return (
            f"play {combination_in_words(self.elements)} at gain {self.gain:g}, {begin}, "
            f"for {self.duration:.3g} s"
        )


def plan_play(profile: Design, combination: Combination, gain: float) -> tuple[Play | None, str]:
    """(a play of a combination at a gain that shows frequency or decay, why there is none)."""
    effects = scale_effects(effects_of(profile, combination), gain)
    prediction = predict(profile.device, profile.loop, effects)
    if prediction.obstacle is not None:
        return None, prediction.obstacle
    motions = [profile.elements[name].motion for name in combination]
    settled = _SETTLED / prediction.decay[0]
    displacement = speed = None
    stiffness = binding_stiffness(profile.device, effects)
    if not stiffness:
        speed = max(motion.speed for motion in motions)
        push = _least_push(profile.device, effects, prediction)
        if speed < push.speed:
            remedy = (
                f", unless it is pushed to {push.ample}: state that as its speed in the scene, not "
                f"{speed:g}, if a hand reaches it, and tune again"
            )
            return None, f"at gain {gain:g} {push.too_slow}{remedy if push.ample else ''}"
    elif profile.walls.intersection(combination):
        return None, "it lets go of the handle before a swing could be seen, for it never pulls"
    else:
        usual = DEFAULT_MOTION[profile.device.motion].penetration or 0.0
        deep = max(motion.penetration or usual for motion in motions)
        played = [profile.elements[name] for name in combination]
        # Each is cut at its level times the gain, wherever the gain puts the whole.
        cut = [each for each in played if each.force_level > 0 and each.stiffness > 0]
        levels = [each.force_level / each.stiffness for each in cut]
        most = min(levels, default=np.inf)
        displacement = _displacement(profile.device, effects, prediction, deep, most)
        if displacement is None:
            return None, "it comes to rest within a swing or two"
        if prediction.frequency[0] > 0:
            held = profile.device.coulomb_friction.low / stiffness
            left = float(np.exp(-prediction.decay[0] / (2 * prediction.frequency[0])))
            after = (_amplitude(displacement, left, held, k + 1) for k in range(_MOST_SWINGS))
            swings = sum(each > held for each in after)
            settled = min(settled, 0.5 * (swings + 1) / prediction.frequency[0])
    return Play(
        elements=combination,
        gain=gain,
        displacement=displacement,
        speed=speed,
        duration=float(np.ceil(2 * (settled + _REST))) / 2,
        fade=max(profile.elements[name].fade_time for name in combination),
    ), ""


def _least_push(device: Device, effects: Effects, prediction: Prediction) -> Push:
    """The slowest push after which motion is free for long enough.

    v' = -σ·(v + c), with Coulomb friction as c, comes from v₀ to a part p of it within
    ln((v₀ + c)/(p·v₀ + c))/σ.
    """
    step, decay = device.sample_time.value, prediction.decay[1]
    moved = device.mass.value + float(effects.present().get("mass", 0.0))
    held = device.coulomb_friction.high / (moved * decay)
    rows = max(_FEWEST_ROWS, round(_WINDOWS * _window(step)))
    rows = round(rows * (1.0 if effects.mass is None else _WITH_MASS))
    slowed = float(np.exp(-decay * rows * step))
    if slowed <= _SLOW:
        return Push(rows=rows, speed=float("inf"), ample="")
    speed = held * (1 - slowed) / (slowed - _SLOW)
    ample = f"{_AMPLE * speed:.3g} {UNITS[device.motion]['speed']}"
    return Push(rows=rows, speed=speed, ample=ample)


def _window(sample_time: float) -> int:
    """Rows over which speed is smoothed."""
    return max(5, round(_SMOOTHED / sample_time))


def _displacement(
    device: Device, effects: Effects, prediction: Prediction, deep: float, most: float
) -> float | None:
    """The least displacement with turning points enough, or none to expect, and no force cut, m."""
    virtual = float(effects.present().get("stiffness", 0.0))
    if device.force_limit is not None and virtual:
        most = min(most, device.force_limit.continuous / virtual)
    held = device.coulomb_friction.high / binding_stiffness(device, effects)
    for start in sorted({min(part * deep, _NEARLY * most) for part in _DEEPER}):
        still = prediction.frequency[1] == 0 and held < _CLEAR * start
        if still or _swings_on(device, effects, prediction, start, _TURNS, 1.0):
            return start
    return None


def _swings_on(
    device: Device, effects: Effects, prediction: Prediction, start: float, turns: int, times: float
) -> bool:
    """Whether a turning point is so many times beyond what holds, at most friction and decay."""
    if prediction.frequency[0] == 0:
        return False
    held = device.coulomb_friction.high / binding_stiffness(device, effects)
    left = float(np.exp(-prediction.decay[1] / (2 * prediction.frequency[0])))
    return _amplitude(start, left, held, turns) > max(times * held, _CLEAR * start)


def _amplitude(start: float, left: float, held: float, count: int) -> float:
    """Amplitude after so many half-cycles, from which friction takes twice what it holds, m."""
    taken = held * (1 + left) / (1 - left)
    return (start + taken) * left**count - taken
