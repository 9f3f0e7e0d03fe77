"""What the page shows: curves of a log, documents in words, gains as an audit judges them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np
from pydantic import validate_call

import identification as ident
from identification import IdentificationError, LogColumns, QuestionError
from tune.documents.profile import load_profile
from tune.documents.scene import UNITS, Effects, MarginName
from tune.judging import audit
from tune.loop.loop import Filters, filters_of
from tune.loop.polynomials import FloatArray
from tune.loop.state_space import Corner, Mechanism, SampledLoop, corners_of
from tune.optimisation.region import remembered
from tune.presentation.limits import Boundaries
from tune.presentation.page import plain_table
from tune.presentation.tables import audit_table, device_table, effects_table, verdict_on
from tune.rendering import BEYOND, SLOWEST, felt_over_frequency

_Answer = TypeVar("_Answer")
#: The path of a name within the folder; any other is refused.
Inside: TypeAlias = Callable[[str], Path]


@validate_call
def log_view(inside: Inside, file: str, columns: LogColumns | None = None) -> dict[str, object]:
    """Names of the columns of a log, and those chosen as curves; or why there are none."""
    path = inside(file)
    told: dict[str, object] = {"names": _read(_names, path), "curves": {}}
    try:
        log = _read(ident.load_trajectory, path, columns)
    except IdentificationError as error:
        return told | {"reading": str(error)}
    curves = {name: thinned(log.time, column) for name, column in log.columns() if name != "time"}
    about = f"{len(log)} rows", f"{1 / log.sample_time:.4g} Hz", log.read_as
    return told | {"reading": ", ".join(filter(None, about)), "curves": curves}


def _names(path: Path) -> tuple[str, ...]:
    """Names of the columns, which the reader tells where it is asked for others."""
    try:
        ident.load_trajectory(path, LogColumns(time="\0t", force="\0f", position="\0x"))
    except IdentificationError as error:
        return error.choices if isinstance(error, QuestionError) else ()
    return ()


def _read(load: Callable[..., _Answer], path: Path, *how: object) -> _Answer:
    """What a file holds, read once; written anew it is another."""
    return _once(load, path, path.stat().st_mtime_ns if path.is_file() else 0, *how)


@remembered
def _once(load: Callable[..., _Answer], path: Path, _: int, *how: object) -> _Answer:
    return load(path, *how)


def thinned(time: FloatArray, column: FloatArray, parts: int = 1200) -> list[FloatArray]:
    """(times, values) of a curve: the least and the largest value of each part, and its ends."""
    last, each = column.size - 1, -(-column.size // parts)
    whole = np.pad(column, (0, parts * each - column.size), mode="edge").reshape(parts, each)
    starts = each * np.arange(parts)
    kept = np.concatenate([starts + whole.argmin(1), starts + whole.argmax(1), [0, last]])
    kept = np.unique(kept.clip(max=last))
    return [time[kept], column[kept]]


@validate_call
def document_view(inside: Inside, file: str) -> dict[str, object]:
    """A YAML document as text and content, with what is to be seen of a device or a profile."""
    path = inside(file)
    content = ident.load_mapping(path)
    told: dict[str, object] = {"content": content, "text": path.read_text(encoding="utf-8")}
    kind = str(content.get("schema", "")).split("/")
    if "device" in kind:
        told["table"] = plain_table(device_table(_read(ident.load_device, path)))
    if "profile" in kind:
        safe = _read(load_profile, path)
        told["verdict"] = verdict_on(safe)
        told["table"] = plain_table(effects_table(safe))
        told["units"] = UNITS[safe.device.motion]
    return told


@validate_call
def moved_view(
    inside: Inside,
    *,
    device: str,
    profile: str,
    element: str,
    stiffness: float = 0.0,
    damping: float = 0.0,
    mass: float = 0.0,
    velocity_filter: float | None = None,
    acceleration_filter: float | None = None,
    margin: MarginName = "balanced",
    extra_delay_samples: float = 0.0,
    ends: tuple[float, float] | None = None,
    proved: bool = False,
) -> dict[str, object]:
    """What ``haptune audit`` tells where the sliders of an element stand; what is seen beside it.

    Filters are cut-offs, those of the profile where they are None; ``ends`` are the dampings
    between which the region was drawn, at fewer places while a slider moves. The step is a tenth
    of the continuous force, or 1 N. Only what was asked to be proved can be.
    """
    safe = _read(load_profile, inside(profile))
    hertz = {"velocity_filter_hz": velocity_filter, "acceleration_filter_hz": acceleration_filter}
    given = {name: value for name, value in hertz.items() if value is not None}
    filters = replace(filters_of(safe.loop), **given)
    found = audit(
        _read(ident.load_device, inside(device)),
        Effects(stiffness=stiffness, damping=damping, mass=mass),
        filters=filters,
        margin=margin,
        extra_delay_samples=extra_delay_samples,
        like=(safe, element),
        proved=proved,
    )
    boundaries, later = Boundaries.of(found.design), found.design.device
    if ends is None or not ends[0] <= damping <= ends[1]:
        ends = boundaries.ends((min(damping, 0.0), max(damping, 0.0)), mass)
    limit = later.force_limit
    force = 0.1 * limit.continuous if limit and limit.continuous else 1.0
    samples, sizes = np.arange(0.0, 0.5, later.sample_time.value), (stiffness, damping, mass)
    frequency = np.geomspace(SLOWEST, BEYOND, 61)
    return {
        "table": plain_table(audit_table(found)),
        "faults": [f"{each.limit}: {each.seen}; needed: {each.needed}" for each in found.faults],
        "safe": found.safe,
        "ends": ends,
        "region": boundaries.plane(ends, mass, 160 if proved else 24),
        "step": [
            thinned(samples, step_response(each, filters, sizes, force, samples.size), 150)
            for each in corners_of(later, later.simultaneous_box())
        ],
        "force": force,
        "felt": (frequency, *felt_over_frequency(later, filters, frequency, *sizes)),
    }


def step_response(
    place: Corner, filters: Filters, gains: tuple[float, float, float], force: float, samples: int
) -> FloatArray:
    """Motion, shape (samples,), m, from rest under a constant force, N, where the encoder reads.

    Gains are K, B and M. Without K it is the speed of the rigid mass, m/s. Limits of force,
    friction, counts and hands are left out.
    """
    loop = SampledLoop.of(place, filters, gains)
    # The state with a one below it, so that one matrix advances it and pushes: behind any lag.
    push = Mechanism.of(replace(place, current_lag=0.0)).held(place.sample_time)[1]
    advance = np.eye(len(loop.read) + 1)
    advance[:-1, :-1] = loop.pushed
    advance[: push.size, -1] = push * force
    states = np.eye(len(advance))[:, -1:]
    while states.shape[1] < samples:
        states = np.hstack([states, advance @ states])
        advance = advance @ advance
    motion = loop.read @ states[:-1] if gains[0] else states[loop.plant.speed]
    return np.asarray(np.nan_to_num(motion[:samples]), dtype=np.float64)
