"""One play of an element: from where to let go, or how fast to push, and how long to log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification import Device
from tune.documents.effects import Effects
from tune.documents.profile import Design
from tune.documents.scene import DEFAULT_MOTION
from tune.verification.elements import effects_of, moment_in_words, scale_effects
from tune.verification.measured_motion import obstacle
from tune.verification.prediction import Prediction, binding_stiffness, predict

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
        moment: elements to play.
        gain: to play them at.
        displacement: from which to let go, m (rad); None where a push is needed.
        speed: of the push, m/s (rad/s); None where a displacement is needed.
        duration: to log, s.
    """

    moment: tuple[str, ...]
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
            f"play {moment_in_words(self.moment)} at gain {self.gain:g}, {begin}, "
            f"for {self.duration:.3g} s"
        )


def plan_play(profile: Design, moment: tuple[str, ...], gain: float) -> tuple[Play | None, str]:
    """(a play of a moment at a gain that shows frequency or decay, why there is none)."""
    effects = scale_effects(effects_of(profile, moment), gain)
    prediction = predict(profile.device, profile.loop, effects)
    hindered = obstacle(prediction)
    if hindered is not None:
        return None, hindered
    motions = [profile.elements[name].motion for name in moment]
    settled = _SETTLED / prediction.decay[0]
    displacement: float | None = None
    speed: float | None = None
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
        moment=moment,
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
