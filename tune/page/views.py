"""What the page shows: curves of a log, documents in words, gains as an audit judges them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

import identification as ident
from identification import Device, IdentificationError, LogColumns, QuestionError, Trajectory
from tune.documents.estimators import DERIVATIVES
from tune.documents.profile import SafeProfile, load_profile
from tune.documents.scene import UNITS, Effects, MarginName
from tune.judging import ELEMENT, audit
from tune.loop.loop import Filters, filter_of, filters_of
from tune.page.response import step_response
from tune.presentation.limits import Boundaries, effect_uses, spread
from tune.presentation.page import plain_table
from tune.presentation.tables import audit_table, certificate_lines, device_table, verdict_on
from tune.rendering import BEYOND, SLOWEST, felt_over_frequency

FloatArray = NDArray[np.float64]

#: Parts of a curve, of each of which the least and the largest value are drawn.
_PARTS = 1200
#: Names that no column has, so that the reader tells those that there are.
_NO_COLUMN = LogColumns(time="\0t", force="\0f", position="\0x")
#: Places at which a region is drawn, fewer while a slider moves; those of what is felt.
_PLACES, _MOVING, _FELT = 160, 32, 61
#: Part of the continuous force that is the step, as in pictures; N where no limit is stated.
_STEP, _WITHOUT_LIMIT = 0.1, 1.0


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LogAsked(_Asked):
    """A log, how its columns are read, as `LogColumns`, and the times that are looked at, s."""

    file: str
    columns: dict[str, Any] = {}
    span: tuple[float, float] | None = None


class Moved(_Asked):
    """Where the sliders stand, SI units; cut-offs that are None are those of the profile."""

    device: str
    profile: str
    stiffness: float = 0.0
    damping: float = 0.0
    mass: float = 0.0
    velocity_filter_hz: float | None = None
    acceleration_filter_hz: float | None = None
    margin: MarginName = "balanced"
    extra_delay_samples: float = 0.0
    ends: tuple[float, float] | None = None
    proved: bool = False

    def command(self, filters: Filters) -> list[str]:
        """The command that tells the same; none where its options do not name these filters."""
        if filters.velocity_window_samples is not None:
            return []
        words = ["audit", self.device, "--margin", self.margin]
        given: list[tuple[str, object]] = [
            ("--stiffness", self.stiffness),
            ("--damping", self.damping),
            ("--mass", self.mass),
            ("--extra-delay-samples", self.extra_delay_samples),
        ]
        for which in DERIVATIVES:
            kind, cutoff, order = filter_of(filters, which)
            given.append((f"--{which}-filter", cutoff and f"{cutoff},{kind},{order}"))
        ratio = filters.filter_damping_ratio
        given.append(("--filter-damping-ratio", 0 if ratio == 1 else ratio))
        for option, value in given:
            words += [option, str(value)] if value else []
        return words


def log_view(path: Path, asked: LogAsked) -> dict[str, object]:
    """Names of the columns of a log, and those chosen as curves; or why there are none."""
    stamp = _stamp(path)
    told: dict[str, object] = {"names": _names(path, stamp)}
    try:
        log = _loaded(path, stamp, LogColumns(**asked.columns))
    except IdentificationError as error:
        return told | {"problem": str(error)}
    first, last = asked.span or (float(log.time[0]), float(log.time[-1]))
    rows = slice(*np.searchsorted(log.time, [first, last + log.sample_time / 2]))
    curves = {
        name: thinned(log.time[rows], column[rows])
        for name, column in log.columns()
        if name != "time"
    }
    return told | {
        "rows": len(log),
        "read_as": log.read_as,
        "sample_time": log.sample_time,
        "whole": [float(log.time[0]), float(log.time[-1])],
        "curves": curves,
    }


def _stamp(path: Path) -> int:
    """When a file was written: written anew it is another."""
    return path.stat().st_mtime_ns if path.is_file() else 0


@lru_cache(maxsize=2)
def _loaded(path: Path, stamp: int, columns: LogColumns) -> Trajectory:
    del stamp
    return ident.load_trajectory(path, columns)


@lru_cache(maxsize=8)
def _names(path: Path, stamp: int) -> tuple[str, ...]:
    del stamp
    try:
        ident.load_trajectory(path, _NO_COLUMN)
    except IdentificationError as error:
        return error.choices if isinstance(error, QuestionError) else ()
    return ()


def thinned(time: FloatArray, column: FloatArray, parts: int = _PARTS) -> list[list[float]]:
    """(times, values) of a curve with the least and the largest value of each part, and its ends.

    Time and column have shape (rows,).
    """
    count = column.size
    kept = np.arange(count)
    if count > 2 * parts:
        each = count // parts
        blocks = column[: each * parts].reshape(parts, each)
        starts = np.arange(parts) * each
        kept = np.concatenate([starts + blocks.argmin(1), starts + blocks.argmax(1), [0]])
        rest = np.arange(each * parts, count)  # fewer than a part has rows
        kept = np.unique(np.concatenate([kept, rest, [count - 1]]))
    return [time[kept].tolist(), column[kept].tolist()]


def document_view(path: str | PathLike[str]) -> dict[str, object]:
    """A YAML document as it stands, with what is to be seen of a device or a profile."""
    if isinstance(path, str):  # a known device
        return _device_view(ident.to_mapping(ident.load_device(path)))
    content = ident.load_mapping(path)
    kind = str(content.get("schema", "")).split("/")
    if "device" in kind:
        return _device_view(content)
    if "profile" in kind:
        return {"content": content} | _profile_view(load_profile(path))
    return {"content": content}


def _device_view(content: dict[str, Any]) -> dict[str, object]:
    device = ident.parse_document(ident.Device, content, "device")
    missing: list[dict[str, str]] = []
    try:
        device.require_stated()
    except ident.UnstatedError as error:
        missing = [{"key": fact.key, "hint": fact.hint} for fact in error.missing]
    table = plain_table(device_table(device))
    return {"content": content, "table": table, "missing": missing}


def _profile_view(safe: SafeProfile) -> dict[str, object]:
    device = safe.device
    return {
        "title": f"{safe.scene} on {device.name}",
        "verdict": verdict_on(safe),
        "bars": [
            {
                "words": [each.name, each.value, f"{each.steps:.3g}", each.words],
                "part": min(each.limit.part, 1.0) if each.limit else 0.0,
                "binds": each.binds,
            }
            for each in effect_uses(safe)
        ],
        "notes": safe.notes,
        "certificate": certificate_lines(safe.certificate),
        "units": UNITS[device.motion],
        "mass": device.mass.value,
        "rate": 1 / safe.loop.sample_time,
    }


def moved_view(folder: Path, asked: Moved) -> dict[str, object]:
    """What ``haptune audit`` tells of the gains; region, step and what is felt beside it.

    Only what was asked to be proved can be; whatever moves is called not proved.
    """
    known = asked.device in ident.named_devices()
    path = Path(asked.device) if known else folder / asked.device
    device = _device_of(str(path), _stamp(path))
    path = folder / asked.profile
    names = ("velocity_filter_hz", "acceleration_filter_hz")
    given = {name: hertz for name in names if (hertz := getattr(asked, name)) is not None}
    filters = replace(_loop_of(path, _stamp(path)), **given)
    gains = {name: getattr(asked, name) for name in ("stiffness", "damping", "mass")}
    found = audit(
        device,
        Effects(**gains),
        filters=filters,
        margin=asked.margin,
        extra_delay_samples=asked.extra_delay_samples,
        proved=asked.proved,
    )
    design, later = found.design, found.design.device
    element = design.elements[ELEMENT]
    boundaries = Boundaries.of(design, filters)
    B, ends = asked.damping, asked.ends
    if ends is None or not ends[0] <= B <= ends[1]:
        ends = boundaries.ends((min(B, 0.0), max(B, 0.0)), asked.mass)
    grid = spread(*ends, _PLACES if asked.proved else _MOVING)
    limit = later.force_limit
    force = _STEP * limit.continuous if limit and limit.continuous else _WITHOUT_LIMIT
    time, motion = step_response(design, element, force)
    hertz = np.geomspace(SLOWEST, BEYOND, _FELT)
    mass, damping = felt_over_frequency(later, filters, hertz, **gains)
    nearest = found.nearest.arrays() if found.nearest else ()
    return {
        "command": asked.command(filters),
        "table": plain_table(audit_table(found)),
        "faults": [f"{each.limit}: {each.seen}; needed: {each.needed}" for each in found.faults],
        "safe": found.safe,
        "nearest": [None if each is None else float(each) for each in nearest],
        "ends": ends,
        "region": {
            "damping": _plain(grid),
            "best": _plain(boundaries.at_best(grid, asked.mass)),
            "worst": _plain(boundaries.at_worst(grid, asked.mass)),
            "safe": _plain(boundaries.with_margin(grid, asked.mass)),
        },
        "step": thinned(time, motion, _PARTS // 8),
        "force": force,
        "felt": {"hertz": _plain(hertz), "mass": _plain(mass), "damping": _plain(damping)},
    }


@lru_cache(maxsize=8)
def _device_of(reference: str, stamp: int) -> Device:
    del stamp
    return ident.load_device(reference)


@lru_cache(maxsize=8)
def _loop_of(path: Path, stamp: int) -> Filters:
    del stamp
    return filters_of(load_profile(path).loop)


def _plain(values: FloatArray) -> list[float | None]:
    """Numbers as JSON has them: none for what is not finite."""
    return [each if np.isfinite(each) else None for each in values.tolist()]
