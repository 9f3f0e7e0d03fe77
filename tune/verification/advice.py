"""What to play so that a log tells of an element whether it keeps its margin: the least gain.

Each trial predicts what a log would show of the mode, finds the loops it would allow, and judges
the margin on them, as a verification does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from identification import Device, quantity
from tune.certificate.assumptions import refuse_unbalanced
from tune.documents.errors import LoopError
from tune.documents.profile import Design
from tune.loop.filters import filters_of
from tune.verification.consistent_loops import ConsistentLoops, MeasuredMode, Modes
from tune.verification.elements import effects_of, moment_in_words, moments_of, scale_effects
from tune.verification.margins_kept import MarginJudge
from tune.verification.motion_outcomes import DECAY_TOLERANCE, frequency_tolerance
from tune.verification.plays import Play, plan_play
from tune.verification.prediction import Prediction, predict

#: Gains that are tried, the least first.
GAINS = (0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0)
#: Other elements that are tried where an element's own motion does not tell.
_MOST_OTHERS = 5
#: Half-width of the measured frequency and decay as they are usually found, relative.
_USUAL_HALF = 0.02
#: Planning looks at whole samples of delay.
_STEP = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What to play for one moment.

    Attributes:
        moment: that is to be verified.
        play: that tells; None where nothing does.
        why: what is wrong with playing the moment itself; "" where that tells.
    """

    moment: tuple[str, ...]
    play: Play | None
    why: str

    def words(self, motion: str) -> str:
        """One or two sentences, for a "linear" or "rotary" axis."""
        name = moment_in_words(self.moment)
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
    targets: tuple[tuple[str, ...], ...] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Advice, ...]:
    """What to play for each moment, its own motion before that of other elements.

    Args:
        profile: that is to be verified.
        targets: moments; None is every one that plays anything.
        say: is told the moment that is looked at.

    Raises:
        CheckFailedError: a device that no effect can be certified on.
    """
    refuse_unbalanced(profile.device)
    plays = _Plays(profile)
    targets = moments_of(profile, None) if targets is None else targets
    singles = tuple(moment for moment in moments_of(profile, None) if len(moment) == 1)
    found: list[Advice] = []
    for number, target in enumerate(targets, 1):
        say(f"looking for what tells of {moment_in_words(target)} ({number} of {len(targets)})")
        play, why = plays.least(target, target)
        if play is None:
            others = [each for each in singles if each != target][:_MOST_OTHERS]
            play = plays.least_of(others, target)
        found.append(Advice(moment=target, play=play, why=why))
    return tuple(found)


class _Plays:
    """What each element tells of each target, at each gain; what was found is kept."""

    __slots__ = ("_allowed", "_judges", "_planned", "_profile")

    def __init__(self, profile: Design) -> None:
        self._profile = profile
        self._planned: dict[tuple[tuple[str, ...], float], tuple[Play | None, str]] = {}
        self._allowed: dict[tuple[tuple[str, ...], float], tuple[ConsistentLoops, ...]] = {}
        self._judges: dict[tuple[str, ...], MarginJudge] = {}

    def least(
        self, player: tuple[str, ...], target: tuple[str, ...], most: float = np.inf
    ) -> tuple[Play | None, str]:
        """(the play of least gain that tells of the target, why there is none).

        One that would tell even with the least damping of the device's interval goes before. Of
        plays at more than the most gain none is told, unless a lesser one may have to give way.
        """
        why = ""
        likely: Play | None = None
        for gain in GAINS:
            if gain > most and likely is None:
                break
            try:
                play, hindered = self._plan(player, gain)
                if play is None:
                    why = why or hindered
                    continue
                told = self._tells(player, gain, target)
            except LoopError as error:
                why = str(error)
                continue
            if all(told):
                return play, ""
            likely = likely or (play if told[0] else None)
            why = "delays that do not keep the margin look the same in its motion"
        return likely, "" if likely is not None else why

    def least_of(self, players: Sequence[tuple[str, ...]], target: tuple[str, ...]) -> Play | None:
        """The play of least gain among these players, the first of them of any that are equal."""
        best: dict[tuple[str, ...], Play] = {}
        most = np.inf
        # A spring tells a delay best: what it leaves of the gains need not be looked at.
        for player in sorted(players, key=self._pulls, reverse=True):
            play, _ = self.least(player, target, most)
            if play is not None:
                best[player] = play
                most = min(most, play.gain)
        return min(
            (best[player] for player in players if player in best),
            key=lambda each: each.gain,
            default=None,
        )

    def _pulls(self, player: tuple[str, ...]) -> bool:
        return effects_of(self._profile, player).stiffness is not None

    def _plan(self, player: tuple[str, ...], gain: float) -> tuple[Play | None, str]:
        if (player, gain) not in self._planned:
            self._planned[player, gain] = plan_play(self._profile, player, gain)
        return self._planned[player, gain]

    def _tells(
        self, player: tuple[str, ...], gain: float, target: tuple[str, ...]
    ) -> tuple[bool, ...]:
        """Whether all loops that a log would allow keep the margin of the target.

        Of the device at its best estimate, and with the least damping of its interval.
        """
        profile = self._profile
        filters = filters_of(profile.loop)
        if (player, gain) not in self._allowed:
            effects = scale_effects(effects_of(profile, player), gain)
            extra = profile.margin.extra_delay_samples
            modes = Modes(profile.device, filters, effects, extra=extra, step=_STEP)
            self._allowed[player, gain] = tuple(
                modes.allow(_expected(predict(each, profile.loop, effects)))
                for each in _devices(profile.device)
            )
        if target not in self._judges:
            self._judges[target] = MarginJudge(profile, target)
        judge = self._judges[target]
        return tuple(judge.keeps_all((filters,), each) for each in self._allowed[player, gain])


def _devices(device: Device) -> Iterator[Device]:
    """The device at its best estimate, and with the least damping of its interval."""
    yield device
    if device.damping.low < device.damping.value:
        yield device.model_copy(update={"damping": quantity(device.damping.low)})


def _expected(prediction: Prediction) -> MeasuredMode:
    """The mode as a log would show it."""
    nominal = prediction.nominal
    hertz = (frequency_tolerance(prediction) + _USUAL_HALF) * nominal.frequency
    slack = (DECAY_TOLERANCE + _USUAL_HALF) * nominal.decay
    return MeasuredMode(
        frequency=(nominal.frequency - hertz, nominal.frequency + hertz)
        if nominal.frequency
        else None,
        decay=(nominal.decay - slack, nominal.decay + slack),
    )
