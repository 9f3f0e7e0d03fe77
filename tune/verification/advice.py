"""What to play so that a log tells of an element whether it keeps its margin: the least gain.

A play is from where to let go, or how fast to push, and how long to log. Each trial predicts what
a log would show of the mode, finds the loops it would allow, and judges the margin on them, as a
verification does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from identification import Device, quantity
from tune.certificate.certify import refuse_unbalanced
from tune.documents import LoopError
from tune.documents.profile import Design
from tune.documents.scene import DEFAULT_MOTION, Effects
from tune.loop.loop import filters_of
from tune.verification.delay import ConsistentLoops, MarginJudge, Modes
from tune.verification.law import (
    Combination,
    combination_in_words,
    combinations_of,
    effects_of,
    scale_effects,
)
from tune.verification.motion import (
    DECAY_TOLERANCE,
    MeasuredMode,
    Prediction,
    binding_stiffness,
    predict,
)

#: Gains that are tried, the least first.
_GAINS = (0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0)
#: Other elements that are tried where an element's own motion does not tell.
_MOST_OTHERS = 5
#: Half-width of the measured frequency and decay as they are usually found, relative.
_USUAL_HALF = 0.02
#: Planning looks at whole samples of delay.
_STEP = 1.0

#: Turning points that make a decay known, and how large a swing must be, part of the displacement.
_TURNS, _CLEAR = 3, 0.03
#: Half-cycles after which motion that hardly decays is logged no longer.
_MOST_SWINGS = 40
#: Displacements that are tried, in penetrations of the element.
_DEEPER = (1.0, 2.0, 3.0, 4.0, 6.0)
#: Time constants until motion without swings is over, and rest that is logged after it, s.
_SETTLED, _REST = 5.0, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """One log to take.

    Attributes:
        elements: to play.
        gain: to play them at.
        displacement: from which to let go, m (rad); None where a push is needed.
        speed: of the push, m/s (rad/s); None where a displacement is needed.
        duration: to log, s.
    """

    elements: Combination
    gain: float
    displacement: float | None
    speed: float | None
    duration: float

    def words(self, motion: str) -> str:
        """An instruction, for a "linear" or "rotary" axis."""
        length = "mm" if motion == "linear" else "mrad"
        begin = (
            f"let go {1e3 * self.displacement:.3g} {length} from rest"
            if self.displacement is not None
            else f"pushed to {self.speed:.3g} {'m' if motion == 'linear' else 'rad'}/s"
        )
        return (
            f"play {combination_in_words(self.elements)} at gain {self.gain:g}, {begin}, "
            f"for {self.duration:.3g} s"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What to play for one combination.

    Attributes:
        elements: that are to be verified.
        play: that tells; None where nothing does.
        why: what is wrong with playing the combination itself; "" where that tells.
    """

    elements: Combination
    play: Play | None
    why: str

    def words(self, motion: str) -> str:
        """One or two sentences, for a "linear" or "rotary" axis."""
        name = combination_in_words(self.elements)
        if self.play is None:
            return f"{name} cannot be verified: {self.why}; no other element tells its delay either"
        if not self.why:
            return self.play.words(motion)
        return (
            f"{name} itself does not tell: {self.why}; for the delay {self.play.words(motion)}, "
            f"for law and filters {name}"
        )


def advise(
    profile: Design,
    targets: tuple[Combination, ...] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Advice, ...]:
    """What to play for each combination, its own motion before that of other elements.

    Args:
        profile: that is to be verified.
        targets: combinations; None is every one that plays anything.
        say: is told the combination that is looked at.

    Raises:
        CheckFailedError: a device that no effect can be certified on.
    """
    refuse_unbalanced(profile.device)
    plays = _Plays(profile)
    targets = combinations_of(profile, None) if targets is None else targets
    singles = tuple(
        combination for combination in combinations_of(profile, None) if len(combination) == 1
    )
    found: list[Advice] = []
    for number, target in enumerate(targets, 1):
        say(
            f"looking for what tells of {combination_in_words(target)} ({number} of {len(targets)})"
        )
        play, why = plays.least(target, target)
        if play is None:
            others = [each for each in singles if each != target][:_MOST_OTHERS]
            play = plays.least_of(others, target)
        found.append(Advice(elements=target, play=play, why=why))
    return tuple(found)


class _Plays:
    """What each element tells of each target, at each gain; what was found is kept."""

    def __init__(self, profile: Design) -> None:
        self._profile, self._filters = profile, (filters_of(profile.loop),)
        self._plan = cache(partial(_plan_play, profile))
        self._allowed = cache(partial(_allowed_loops, profile))
        self._judge = cache(partial(MarginJudge, profile))

    def least(
        self, player: Combination, target: Combination, most: float = np.inf
    ) -> tuple[Play | None, str]:
        """(the play of least gain that tells of the target, why there is none).

        One that would tell even with the least damping of the device's interval goes before. Of
        plays at more than the most gain none is told, unless a lesser one may have to give way.
        """
        why = ""
        likely: Play | None = None
        for gain in _GAINS:
            if gain > most and likely is None:
                break
            try:
                play, hindered = self._plan(player, gain)
                if play is None:
                    why = why or hindered
                    continue
                allowed, judge = self._allowed(player, gain), self._judge(target)
                told = [judge.keeps_all(self._filters, each) for each in allowed]
            except LoopError as error:
                why = str(error)
                continue
            if all(told):
                return play, ""
            likely = likely or (play if told[0] else None)
            why = "delays that do not keep the margin look the same in its motion"
        return likely, "" if likely is not None else why

    def least_of(self, players: Sequence[Combination], target: Combination) -> Play | None:
        """The play of least gain among these players, the first of them of any that are equal."""
        best: dict[Combination, Play] = {}
        most = np.inf
        # A spring tells a delay best: what it leaves of the gains need not be looked at.
        for player in sorted(players, key=self._position_free):
            play, _ = self.least(player, target, most)
            if play is not None:
                best[player] = play
                most = min(most, play.gain)
        told = (best[player] for player in players if player in best)
        return min(told, key=lambda each: each.gain, default=None)

    def _position_free(self, player: Combination) -> bool:
        return effects_of(self._profile, player).position_free


def _allowed_loops(
    profile: Design, player: Combination, gain: float
) -> tuple[ConsistentLoops, ...]:
    """What a log would allow of the device at its best estimate, and with its least damping."""
    device, effects = profile.device, scale_effects(effects_of(profile, player), gain)
    devices = [device]
    if device.damping.low < device.damping.value:
        devices.append(device.model_copy(update={"damping": quantity(device.damping.low)}))
    extra = profile.margin.extra_delay_samples
    modes = Modes(device, filters_of(profile.loop), effects, extra=extra, step=_STEP)
    return tuple(modes.allow(_expected(predict(each, profile.loop, effects))) for each in devices)


def _expected(prediction: Prediction) -> MeasuredMode:
    """The mode as a log would show it."""
    nominal = prediction.nominal
    hertz = (prediction.frequency_tolerance + _USUAL_HALF) * nominal.frequency
    slack = (DECAY_TOLERANCE + _USUAL_HALF) * nominal.decay
    swings = nominal.frequency - hertz, nominal.frequency + hertz
    return MeasuredMode(
        frequency=swings if nominal.frequency else None,
        decay=(nominal.decay - slack, nominal.decay + slack),
    )


def _plan_play(profile: Design, combination: Combination, gain: float) -> tuple[Play | None, str]:
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
    else:
        usual = DEFAULT_MOTION[profile.device.motion].penetration or 0.0
        deep = max(motion.penetration or usual for motion in motions)
        displacement = _displacement(profile.device, effects, prediction, deep)
        if displacement is None:
            return None, "it comes to rest within a swing or two"
        if prediction.frequency[0] > 0:
            held = profile.device.coulomb_friction.low / stiffness
            left = float(np.exp(-prediction.decay[0] / (2 * prediction.frequency[0])))
            swings = len(_swings(displacement, left, held, _MOST_SWINGS))
            settled = min(settled, 0.5 * (swings + 1) / prediction.frequency[0])
    return Play(
        elements=combination,
        gain=gain,
        displacement=displacement,
        speed=speed,
        duration=float(np.ceil(2 * (settled + _REST))) / 2,
    ), ""


def _displacement(
    device: Device, effects: Effects, prediction: Prediction, deep: float
) -> float | None:
    """The least displacement with turning points enough, or with none to expect, m."""
    virtual = 0.0 if effects.stiffness is None else float(np.asarray(effects.stiffness))
    most = np.inf
    if device.force_limit is not None and virtual:
        most = device.force_limit.continuous / virtual
    held = device.coulomb_friction.high / binding_stiffness(device, effects)
    low, high = prediction.frequency
    for start in (part * deep for part in _DEEPER):
        if start > most:
            break
        if high == 0 and held < _CLEAR * start:
            return start
        if low > 0:
            left = float(np.exp(-prediction.decay[1] / (2 * low)))
            swings = _swings(start, left, held, _TURNS)
            if len(swings) == _TURNS and swings[-1] > _CLEAR * start:
                return start
    return None


def _swings(start: float, left: float, held: float, most: int) -> list[float]:
    """Amplitudes after each half-cycle, from which friction takes twice what it holds, m."""
    amplitudes: list[float] = []
    amplitude = start
    while len(amplitudes) < most:
        amplitude = (amplitude - held) * left - held
        if amplitude <= held:
            break
        amplitudes.append(amplitude)
    return amplitudes
