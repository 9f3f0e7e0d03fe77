"""What is said of a measured mode: frequency and decay in their range, or what explains them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification import Device, quantity
from tune.documents.effects import Effects
from tune.documents.profile import LoopProfile
from tune.verification.free_motion import FreeMotion
from tune.verification.outcome import Outcome, unassessed_outcome
from tune.verification.prediction import Prediction, binding_stiffness, slowest
from tune.verification.release import Release

#: What the fit of one mode is off by, measured on simulated devices of known poles: frequency by
#: 1 % and, because friction jumps and one mode does not follow as the loop does, by this part of
#: the nearness of the other modes; decay by 5 %.
FREQUENCY_TOLERANCE, _BY_OTHER_MODES, DECAY_TOLERANCE = 0.01, 0.1, 0.05
#: An interval wider than this part of what is predicted tells nothing.
_WIDEST = 0.5
#: A predicted swing below this many clear ones may stay unseen.
_CLEARLY = 2.0
#: Stiffness is looked for as an error of unit where it explains the frequency within this part.
_UNIT_ERROR = 0.2
#: Samples of delay that somebody may have overlooked.
_MOST_SAMPLES = 10
#: A sensitivity of the decay is read off over this part of the damping.
_NUDGE = 0.01

#: What helps where the log cannot tell.
LOUDER = "Release the handle from further away, hand off, or play an element with a spring."


def frequency_outcome(
    measured: FreeMotion,
    release: Release,
    prediction: Prediction,
    effects: Effects,
    device: Device,
) -> Outcome:
    """The frequency of the swings, or their absence, against the prediction."""
    nominal, (low, high) = prediction.nominal.frequency, prediction.frequency
    turns = len(release.turns)
    if turns == 0:
        if low == 0:
            return unassessed_outcome(
                "frequency", "the motion does not oscillate, which is predicted"
            )
        if _swing_back(release, prediction, effects, device) < _CLEARLY * release.clear:
            why = "the handle does not swing back, and is hardly predicted to"
            return unassessed_outcome("frequency", why)
    elif measured.frequency_half > _WIDEST * max(nominal, measured.frequency):
        why = f"it is seen as {measured.frequency:.4g} ± {measured.frequency_half:.2g} Hz only"
        half = measured.frequency_half
        return unassessed_outcome(
            "frequency", why, LOUDER, seen=measured.frequency, seen_half_width=half
        )
    tolerance = frequency_tolerance(prediction)
    agrees = turns > 0 and (
        measured.frequency + measured.frequency_half >= low * (1 - tolerance)
        and measured.frequency - measured.frequency_half <= high * (1 + tolerance)
    )
    return Outcome(
        check="frequency",
        verdict="agrees" if agrees else "disagrees",
        seen=f"{measured.frequency:.4g} ± {measured.frequency_half:.2g} Hz, {turns} turning points"
        if turns
        else "the handle does not swing back",
        predicted=f"{low:.4g} to {high:.4g} Hz, {nominal:.4g} Hz at best",
        tolerance=f"{tolerance:.1%} and the interval of the measurement",
        remedy="" if agrees else _frequency_remedy(measured, turns, prediction, effects),
        numbers={
            "turning_points": turns,
            "predicted": nominal,
            "predicted_low": low,
            "predicted_high": high,
            "tolerance": tolerance,
            **(
                {"seen": measured.frequency, "seen_half_width": measured.frequency_half}
                if turns
                else {}
            ),
        },
    )


def frequency_tolerance(prediction: Prediction) -> float:
    """What the fit of one mode may be off by, part of the frequency."""
    return FREQUENCY_TOLERANCE + _BY_OTHER_MODES * prediction.nominal.nearness


def _swing_back(
    release: Release, prediction: Prediction, effects: Effects, device: Device
) -> float:
    """How far the handle is predicted to swing back after its first overshoot, m.

    Coulomb friction takes from every half-cycle, and holds whatever ends within its reach.
    """
    left = float(np.exp(-np.pi * prediction.decay[1] / (2 * np.pi * prediction.frequency[0])))
    held = device.coulomb_friction.high / binding_stiffness(device, effects)
    overshoot = (abs(release.deviation) - 2 * held) * left - held
    return (overshoot - held) * (1 + left)


def _frequency_remedy(
    measured: FreeMotion, turns: int, prediction: Prediction, effects: Effects
) -> str:
    natural = float(np.hypot(2 * np.pi * measured.frequency, measured.decay))
    if turns == 0:
        return "Check that no hand held the handle, then identify the device again."
    factor = (prediction.nominal.natural / natural) ** 2
    virtual = 0.0 if effects.mass is None else float(np.asarray(effects.mass))
    said = (
        f"As if the moving mass were {factor:.3g} times the predicted one"
        + (", the virtual mass included," if virtual else "")
        + f" or the actuator gave {1 / factor:.3g} times the commanded force. "
    )
    for unit, size in (("mm", 1e3), ("cm", 1e2), ("degrees", 180 / np.pi)):
        if abs(factor * size - 1) < _UNIT_ERROR:
            return said + f"Is the position in {unit}? Then state it with --position-gain."
    return said + "Check the units and the force of the actuator, then identify the device again."


def decay_outcome(
    measured: FreeMotion,
    turns: int,
    prediction: Prediction,
    device: Device,
    loop: LoopProfile,
    effects: Effects,
    friction: float | None,
) -> Outcome:
    """The decay of motion about a spring; ``friction`` is what was seen of it, N."""
    unit = "N·m" if device.motion == "rotary" else "N"
    apart = "" if friction is None else f", besides {friction:.2g} {unit} of Coulomb friction"
    beside = {} if friction is None else {"coulomb_friction": friction}
    missing = measured.decay - prediction.nominal.decay
    damper = slowest(_with_damping(device, 1 + _NUDGE), loop, effects).decay
    per_damping = (damper - prediction.nominal.decay) / (_NUDGE * device.damping.value or 1.0)
    late = slowest(device, loop, effects, extra_delay_samples=1).decay
    per_sample = late - prediction.nominal.decay
    remedy = "Check for play, a slipping belt or a hand on the handle, then identify again. As if "
    parts: list[str] = []
    if per_damping > 0:
        parts.append(f"the damping were {missing / per_damping:+.3g} {unit}·s/m off")
    if 0 < missing * per_sample < _MOST_SAMPLES * per_sample**2:
        parts.append(f"the delay were {missing / per_sample:.2g} sample(s) longer")
    hint = f"{remedy}{' or '.join(parts)}." if parts else remedy.removesuffix(" As if ")
    found = judge_decay(measured, turns, prediction, apart, hint.replace("N·m·s/m", "N·m·s/rad"))
    return replace(found, numbers={**found.numbers, **beside})


def _with_damping(device: Device, factor: float) -> Device:
    return device.model_copy(update={"damping": quantity(device.damping.value * factor)})


def judge_decay(
    measured: FreeMotion, turns: int, prediction: Prediction, apart: str, remedy: str
) -> Outcome:
    """A measured decay against the prediction; ``apart`` is said besides."""
    low, high = prediction.decay
    nominal = prediction.nominal.decay
    seen = f"{measured.decay:.4g} ± {measured.decay_half:.2g} 1/s{apart}"
    if not turns and prediction.nominal.frequency > 0:
        return unassessed_outcome("decay", "the handle comes to rest within half a swing", LOUDER)
    numbers = {"seen": measured.decay, "seen_half_width": measured.decay_half}
    if measured.decay_half > _WIDEST * max(nominal, abs(measured.decay)):
        return unassessed_outcome("decay", f"it is seen as {seen} only", LOUDER, **numbers)
    slack = DECAY_TOLERANCE * nominal
    agrees = (
        measured.decay + measured.decay_half >= low - slack
        and measured.decay - measured.decay_half <= high + slack
    )
    return Outcome(
        check="decay",
        verdict="agrees" if agrees else "disagrees",
        seen=seen,
        predicted=f"{low:.4g} to {high:.4g} 1/s, {nominal:.4g} 1/s at best",
        tolerance=f"{DECAY_TOLERANCE:.0%} and the interval of the measurement",
        remedy="" if agrees else remedy or "Identify the device again, with no hand on it.",
        numbers={
            **numbers,
            "predicted": nominal,
            "predicted_low": low,
            "predicted_high": high,
            "tolerance": DECAY_TOLERANCE,
        },
    )
