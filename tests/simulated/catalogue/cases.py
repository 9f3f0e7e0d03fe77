"""The refusal catalogue: for every finding a mild, a plain and a severe log."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from identification import Hardware
from tests.simulated.catalogue import arrays, machines
from tests.simulated.catalogue.raw import RawLog

Level = Literal["mild", "plain", "severe"]
LEVELS: tuple[Level, ...] = ("mild", "plain", "severe")

#: What a user of the device knows: everything but the delay.
_KNOWN = Hardware.model_validate(
    {"encoder_resolution": 6e-6, "force_limit": {"continuous": 14.0, "peak": 40.0}}
)
_NOTHING = Hardware()


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One faulty log, and what is known beside it."""

    code: str  # of the finding it must have, plain and severe; mild it may
    level: Level
    log: RawLog
    hardware: Hardware


def cases(seed: int, codes: Collection[str] | None = None) -> tuple[Case, ...]:
    """Three logs for each finding code; for some codes only, if they are named."""
    first, second, third = machines.good(seed)
    three = (first, second, third)
    broken: dict[str, Callable[[], tuple[RawLog, ...]]] = {
        "not-exciting-mass": lambda: machines.slow(seed),
        "not-exciting-damping": lambda: machines.fast(seed),
        "few-counts": lambda: tuple(map(arrays.counted, three, (130, 60, 8))),
        "force-saturated": lambda: tuple(map(arrays.clipped, three, (0.9, 0.5, 0.2))),
        "dropped-samples": lambda: (
            arrays.dropped(first, 0.01, seed),
            arrays.dropped(second, 0.33, seed),
            arrays.dropped(third, 0.5, seed, gap=0.3),
        ),
        "jitter": lambda: machines.jittered(seed),
        "clock-backward": lambda: (
            arrays.backward(first, 1, 0.001, seed),
            arrays.backward(second, 20, 0.0025, seed),
            arrays.backward(third, 0, 0.0, seed),
        ),
        "encoder-wrap": lambda: tuple(map(arrays.wrapped, three, (0.98, 0.5, 0.1))),
        "sign-flip": lambda: tuple(arrays.in_units(log, force=-1.0) for log in three),
        "gravity": lambda: machines.on_an_arm(seed),
        "stiction": lambda: machines.sticking(seed),
        "hand-on-device": lambda: machines.held(seed),
        "controller-identified": lambda: machines.rendered(seed),
        "delay-unknown": lambda: machines.late(seed, 7.0, 15.0, 25.0),
        "delay-contradicted": lambda: machines.late(seed, 1.3, 2.5, 5.0),
        "non-finite": lambda: (
            arrays.with_holes(first, 1, seed),
            arrays.with_holes(second, 80, seed),
            arrays.with_holes(third, 4000, seed, infinite=True),
        ),
        "constant-column": lambda: (
            replace(first, force=np.full_like(first.force, 3.0)),
            replace(second, position=np.zeros_like(second.position)),
            replace(third, force=np.zeros_like(third.force), position=np.ones_like(third.position)),
        ),
        "too-short": lambda: tuple(
            log.rows(slice(0, samples)) for log, samples in zip(three, (190, 60, 5), strict=True)
        ),
        "heldout-misfit": lambda: tuple(map(arrays.weakened, three, (0.02, 0.35, 1.5))),
        "unmodelled-force": lambda: machines.dragged(seed),
        "lost-rows": lambda: tuple(
            arrays.renumbered(log, part, seed)
            for log, part in zip(three, (0.002, 0.02, 0.1), strict=True)
        ),
        "repeated-rows": lambda: tuple(
            arrays.repeated(log, part, seed)
            for log, part in zip(three, (0.002, 0.02, 0.1), strict=True)
        ),
        "not-stated": lambda: tuple(arrays.in_units(log, force=1 / 30) for log in three),
        "drive-lag": lambda: machines.lagging(seed),
        "vibration-mode": lambda: machines.vibrating(seed),
        "backlash": lambda: machines.played_loose(seed),
        "load-friction": lambda: machines.loaded(seed),
    }
    # In volts of 30 N each nothing shows. A log in mN exceeds the hardware; counts show themselves.
    units = (
        (arrays.in_units(first, force=1 / 30), _NOTHING),
        (arrays.in_units(second, force=1000.0), _KNOWN),
        (arrays.in_counts(third, force=2047, position=20000), _NOTHING),
    )
    known = ("drive-lag", "delay-contradicted")
    # How well the delay is known beside fast motion: to a tenth of a sample, or hardly at all.
    delays: dict[tuple[str, Level], dict[str, float]] = {
        ("not-exciting-damping", "mild"): {"value": 1e-3, "low": 0.9e-3, "high": 1.1e-3},
        ("not-exciting-damping", "plain"): {"value": 1e-3, "low": 0.0, "high": 2e-3},
        ("not-exciting-damping", "severe"): {"value": 1e-3, "low": 0.0, "high": 4e-3},
        # Slow motion tells a lag from a delay only where the delay is known.
        **{(code, level): {"value": 1e-3} for code in known for level in LEVELS},
    }
    found = [
        Case(
            code=code,
            level=level,
            log=log,
            hardware=Hardware.model_validate(
                {"motion": log.motion, "delay": delays.get((code, level))}
            ),
        )
        for code, logs in broken.items()
        if codes is None or code in codes
        for level, log in zip(LEVELS, logs(), strict=True)
    ]
    if codes is None or "force-unit" in codes:
        found += [
            Case(code="force-unit", level=level, log=log, hardware=hardware)
            for level, (log, hardware) in zip(LEVELS, units, strict=True)
        ]
    return tuple(found)
