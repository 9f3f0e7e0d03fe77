"""A profile as JSON, for programs of any kind."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from tune.documents.profile import LoopProfile, SafeProfile
from tune.exporters.heading import digest, findings_of, force_limit
from tune.exporters.largest_change import largest_change
from tune.exporters.law import Section, law_of, longest_tap

if TYPE_CHECKING:
    from tune.exporters.exported import Exported, Filter, LowPassFilter

#: The law in words, where it is not exported as code.
LAW = (
    "u = stiffness*(y - rest) + damping*v + mass*a of each element and F = -level*u, u clamped to "
    "+-force_level where there is stiffness, and at 0 where it is one_sided and would pull; the "
    "sum of F is cut at the peak force. level is the gain, 0 to 1, of what is wanted and 0 of what "
    "is not: it gets there over fade_time, s, if there is one, and not while one that is one_sided "
    "pushes; else it falls at once, and with stiffness it rises only as the element is entered or "
    "after taps samples in a row without force. With stiffness an element that is entered rests "
    "at y; one that is one_sided only if y is behind its face, and after taps samples without "
    "force at its face there again. No face or rest moves under force. What acts at once, what "
    "fades out included, is one of moments; with one_sided elements on both sides it is one "
    "without those of either side, and their faces do not overlap and, where damping/stiffness "
    "differs, lie as far apart as the sum of damping/stiffness*speed. "
    "x[k] = (t*x[k-1] - p*x[k-2]) + g*u[k] for both filters, which run on every reading of the "
    "axis. A reading farther than largest_change times the periods passed from the straight line "
    "through the last two, like one that is missing, holds the force and is bridged by a straight "
    "line"
)


def plain_files(profile: SafeProfile) -> dict[str, str]:
    """haptune_profile.json: gains, filter coefficients, limits; SI units."""
    device, seal, law = profile.device, profile.certificate, law_of(profile.loop)
    limit = force_limit(profile)
    content: Exported = {
        "schema": "haptune/export/1",
        "digest": digest(profile),
        "device": {"name": device.name, "axis": device.axis, "motion": device.motion},
        "scene": profile.scene,
        "margin": {
            "name": profile.margin.name,
            "gain": seal.gain,
            "extra_delay_samples": seal.extra_delay_samples,
        },
        "sample_time": law.sample_time,
        "delay_samples": profile.loop.extra_delay_samples,
        "velocity": filter_of(profile.loop, "velocity", law.velocity),
        "acceleration": filter_of(profile.loop, "acceleration", law.acceleration),
        "force_limit": {"continuous": limit.continuous, "peak": limit.peak},
        "elements": {
            name: {
                "stiffness": element.stiffness,
                "damping": element.damping,
                "mass": element.mass,
                "one_sided": element.one_sided,
                "force_level": element.force_level,
                "speed": element.motion.speed,
                "fade_time": element.fade_time,
            }
            for name, element in profile.elements.items()
        },
        "moments": [list(moment) for moment in profile.moments()],
        "apart": [list(pair) for pair in profile.apart],
        "taps": longest_tap(profile),
        "largest_change": largest_change(profile),
        "findings": findings_of(profile),
        "law": LAW,
        "assumes": list(seal.assumes),
        "not_assessed": list(seal.not_assessed),
    }
    return {"haptune_profile.json": json.dumps(content, indent=2) + "\n"}


def filter_of(loop: LoopProfile, which: str, section: Section) -> Filter:
    """Kind, cut-off in Hz where there is one, and coefficients of one filter.

    ``a`` is given where there is one pole or two equal ones.
    """
    window = loop.velocity_window_samples if which == "velocity" else None
    if window is not None:
        return {"kind": "window", "samples": window}
    cutoff = getattr(loop, f"{which}_filter_hz")
    if cutoff is None:
        return {"kind": "none"}
    order = getattr(loop, f"{which}_filter_order")
    found: LowPassFilter = {
        "kind": "first-order" if order == 1 else "second-order",
        "cutoff_hz": cutoff,
        "t": section.t,
        "p": section.p,
        "g": section.gain,
    }
    if order == 1 or loop.filter_damping_ratio == 1:
        found["a"] = section.t / order
    if order == 2:
        found["damping_ratio"] = loop.filter_damping_ratio
    return found
