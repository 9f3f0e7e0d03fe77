"""Pictures of logs, of how well a device explains them, of what is known of it, and of plans."""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from identification.device.device import ByDirection, Device
from identification.device.quantities import Quantity
from identification.errors import UsageError
from identification.estimators.estimate import Estimate, Gravity, Model
from identification.estimators.least_squares import prepare
from identification.estimators.response import response_of
from identification.findings.force_balance import ForceBalance, balance_of
from identification.fitting import LogFit
from identification.planning import Excitation
from identification.planning.several_axes import AxesExcitation
from identification.trajectory import NORMAL_95, FloatArray, Trajectory


class NotebookFigure(Figure):
    """A matplotlib figure made without pyplot that knows its own picture.

    Notebooks draw a plain Figure only after pyplot was loaded; without, they print its name.
    """

    def _repr_png_(self) -> bytes:
        """The picture as a PNG file: the name is IPython's protocol."""
        stream = BytesIO()
        picture: Any = self  # matplotlib types its keyword arguments only in part
        picture.savefig(stream, format="png")
        return stream.getvalue()


def legend_above(axes: Axes) -> None:
    """A legend of one line above the axes, where it hides nothing."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
        ncols=4,
        fontsize=7,
        frameon=False,
        columnspacing=1.2,
        handlelength=1.5,
    )


def fit_picture(trajectory: Trajectory, device: Device, *, delay: float | None = None) -> Figure:
    """Position, and the force applied beside the force that the device's numbers explain.

    Both forces went through the filter of the least-squares estimator. What is left between them is
    what the model does not know.

    Args:
        trajectory: a log of the device.
        device: as identified; nothing is fitted here.
        delay: s, with which its numbers were found; None takes the device's, which is at least one
            sample.
    """
    known = _explained_force(trajectory, device, delay)
    figure = NotebookFigure(figsize=(11, 6), layout="constrained")
    _draw_over_time(figure.subplots(3, 1, sharex=True), trajectory, device, known)
    figure.suptitle(_fit_title(device, known))
    return figure


def _fit_title(device: Device, known: Explained) -> str:
    """Name, mass, damping and friction of a device, and what they leave of the force."""
    return (
        f"{device.name}: m = {device.mass.value:.4g}, b = {device.damping.value:.4g}, "
        f"Fc = {device.coulomb_friction.value:.3g}; unexplained {known.share:.1%} of the force"
    )


def _draw_over_time(
    axes: Sequence[Axes], trajectory: Trajectory, device: Device, known: Explained
) -> None:
    """Position, force and what is left of it, on three axes that share their time."""
    length, force = _units_of(device)
    top, middle, bottom = axes
    top.plot(trajectory.time, trajectory.position, lw=1)
    top.set_ylabel(f"position, {length}")
    middle.plot(known.time, known.applied, lw=2, color="0.7", label="applied")
    middle.plot(known.time, known.explained, "k--", lw=1, label="explained by the model")
    middle.set_ylabel(f"force, {force}")
    legend_above(middle)
    bottom.plot(known.time, known.left, lw=0.8, color="#D55E00")
    bottom.set_ylabel(f"unexplained, {force}")
    bottom.set_xlabel("time, s")


#: Inches.
_WIDTH, _OF_A_LOG, _LINE, _AXIS, _OF_ELLIPSES = 15.0, 6.5, 0.2, 0.9, 4.0
#: Pairs of axes at most whose ellipses are drawn.
_PAIRS = 3
#: Lines of poses, one after the other.
_STYLES = ("-", "--", "-.", ":")


def identified_picture(
    device: Device, fits: Sequence[LogFit], *, before: Device | None = None
) -> Figure:
    """Each log with fit, residual, its spectrum and correlation, friction, response; intervals.

    Of several axes that is of each axis alone; mass and damping of all directions are ellipses.

    Args:
        device: as identified from the logs.
        fits: of the logs, at least one.
        before: the device as it was known before, to compare with; None for none.
    """
    lines = _knowledge(device, fits, before)
    known = {"now": device} | ({} if before is None else {"before": before})
    *parts, last = _parts([*(_OF_A_LOG for _ in fits), _AXIS + _LINE * len(lines)], known)
    for part, fit in zip(parts, fits, strict=False):
        alone = [float(name == fit.trajectory.axis) for name in device.axes or ()]
        _draw_log(part, device.along(alone), fit)
    _draw_intervals(last.subplots(1, len(_SYMBOLS)), lines, _units_of_symbols(device))
    return last.figure


def _parts(heights: Sequence[float], devices: Mapping[str, Device]) -> list[SubFigure]:
    """Parts of a new figure, one below another; ellipses of several axes are its end."""
    several = {words: each for words, each in devices.items() if each.poses is not None}
    every = [*heights, *([_OF_ELLIPSES] if several else [])]
    figure = NotebookFigure(figsize=(_WIDTH, sum(every)), layout="constrained")
    grid: Any = figure.subfigures(len(every), 1, height_ratios=every, squeeze=False)
    parts: list[SubFigure] = list(grid[:, 0])
    if several:
        draw_directions(parts.pop(), several)
    return parts


def draw_directions(part: SubFigure, devices: Mapping[str, Device]) -> None:
    """Λ·u and D·u for every direction u of two axes: half axes are the principal values.

    One line a pose; of more than two axes, what each two make together while the others rest.

    Args:
        part: of a figure, to draw in.
        devices: of the same axes, several at least, by the words of a legend.
    """
    first = next(iter(devices.values()))
    names, units = first.axes or (), _units_of_symbols(first)
    pairs = list(combinations(range(len(names)), 2))[:_PAIRS]
    angle = np.linspace(0.0, 2 * np.pi, 181)
    circle = np.stack((np.cos(angle), np.sin(angle)))
    every: Any = part.subplots(1, 2 * len(pairs), squeeze=False)
    for place, axes in enumerate(every[0]):
        which, pair = ("mass", "damping")[place // len(pairs)], pairs[place % len(pairs)]
        for color, (words, device) in enumerate(devices.items()):
            for number, pose in enumerate(device.poses or ()):
                matrix = np.array(getattr(pose, which))[np.ix_(pair, pair)]
                label = words if len(device.poses or ()) == 1 else f"{words}, pose {number + 1}"
                dashes = _STYLES[number % len(_STYLES)]
                axes.plot(*(matrix @ circle), dashes, lw=1.5, color=f"C{color}", label=label)
                values, vectors = np.linalg.eigh(matrix)
                for value, vector in zip(values, vectors.T, strict=True):
                    axes.plot(*np.outer(vector, [-value, value]), lw=0.6, color=f"C{color}")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{which} along {names[pair[0]]}, {units[which]}", fontsize=8)
        axes.set_ylabel(f"along {names[pair[1]]}", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(visible=True, lw=0.3)
    if sum(len(each.poses or ()) for each in devices.values()) > 1:
        legend_above(every[0][-1])
    part.suptitle("every direction: half axes are the principal masses and dampings", fontsize=9)


def _units_of_symbols(device: Device) -> dict[str, str]:
    """Unit of each quantity that is drawn with its interval."""
    length, force = _units_of(device)
    slow = f"{force}·s/{length}"
    return {
        "mass": "kg" if length == "m" else "kg·m²" if length == "rad" else "kg (kg·m²)",
        "damping": "N·s/m (N·m·s/rad)" if "(" in length else slow,
        "coulomb_friction": force,
        "force_offset": force,
        "delay": "ms",
    }


def devices_picture(devices: Mapping[str, Device]) -> Figure:
    """Mass, damping, friction, offset and delay of devices with their 95 % intervals.

    Args:
        devices: by the words that stand beside each line, from top to bottom; of one motion.

    Raises:
        UsageError: none given.
    """
    if not devices:
        raise UsageError("devices", "none given", "Give at least one device")
    lines = [_of_device(each, words, "#0072B2") for words, each in devices.items()]
    (part,) = _parts([_AXIS + 2 * _LINE * len(lines)], devices)
    units = _units_of_symbols(next(iter(devices.values())))
    _draw_intervals(part.subplots(1, len(_SYMBOLS)), lines, units)
    return part.figure


def log_picture(trajectory: Trajectory) -> Figure:
    """Position and force of a log of which no device can be told."""
    figure = NotebookFigure(figsize=(_WIDTH, 4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(trajectory.time, trajectory.position, lw=1)
    above.set_ylabel("position, as logged")
    below.plot(trajectory.time, trajectory.force, lw=1, color="0.5")
    below.set_ylabel("force, as logged")
    below.set_xlabel("time, s")
    figure.suptitle(f"{trajectory.source}: no device can be told from it")
    return figure


def _draw_log(part: SubFigure, device: Device, fit: LogFit) -> None:
    """Over time on the left; then spectrum, correlation, friction; the response on the right."""
    # What is stated of lag and modes is no more unexplained.
    beside = fit.dynamics
    log = fit.trajectory if beside is None or beside.findings else beside.log
    known = _explained_force(log, device, fit.estimate.delay)
    _, force = _units_of(device)
    thirds: Any = part.subfigures(1, 3, width_ratios=(1.5, 1, 1))
    left, right, last = thirds
    _draw_over_time(left.subplots(3, 1, sharex=True), log, device, known)
    spectrum, correlation, friction = right.subplots(3, 1)
    _draw_spectrum(spectrum, known, force)
    _draw_correlation(correlation, fit.estimate)
    draw_friction(friction, log, device, fit.estimate, force)
    _draw_response(last.subplots(2, 1, sharex=True), device, fit, force)
    part.suptitle(
        f"{fit.trajectory.source}, {fit.method}. {_fit_title(device, known)}", fontsize=10
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """Force applied and force explained, through the filter of the least-squares estimator."""

    time: FloatArray  # s, shape (rows,)
    applied: FloatArray  # N, shape (rows,)
    explained: FloatArray  # N, shape (rows,)

    @property
    def left(self) -> FloatArray:
        """What the model does not know, N, shape (rows,)."""
        return self.applied - self.explained

    @property
    def share(self) -> float:
        """Rms of what is left, part of the rms of the force."""
        return float(np.std(self.left) / np.std(self.applied))


def _explained_force(
    trajectory: Trajectory, device: Device, delay: float | None = None
) -> Explained:
    """What the numbers of a device make of a log; nothing is fitted."""
    late = device.delay.value if delay is None else delay
    model = _model(device)
    table = prepare(trajectory, model, late)
    values = [_value(device, name) for name in model.parameters]
    applied = table.force(late)
    return Explained(
        time=trajectory.time[table.first :][: applied.size],
        applied=applied,
        explained=np.array(values) @ table.columns,
    )


def _units_of(device: Device) -> tuple[str, str]:
    """Units of length and force; both of each where nobody stated the motion."""
    if "motion" in device.missing:
        return "m (rad)", "N (N·m)"
    return ("m", "N") if device.motion == "linear" else ("rad", "N·m")


def _model(device: Device) -> Model:
    """The terms a device file states."""
    rubs = device.coulomb_friction.value > 0
    gravity: Gravity = "none"
    if device.gravity is not None:
        gravity = "pendulum"
    elif device.position_stiffness is not None:
        gravity = "proportional"
    directional = rubs and device.damping_by_direction is not None
    return Model(coulomb=rubs, offset=True, directional=directional, gravity=gravity)


def _value(device: Device, parameter: str) -> float:
    """A parameter of the model as the file states it."""
    damping, weight = device.damping_by_direction, device.gravity
    if parameter == "damping_asymmetry" and damping is not None:
        return (damping.forward.value - damping.backward.value) / 2
    if parameter.startswith("gravity_") and weight is not None:
        return weight.sine.value if parameter == "gravity_sine" else weight.cosine.value
    return float(getattr(device, parameter).value)


_LAGS = 40  # lags of the correlation that are drawn, samples
_DECADES = 1e-7  # of the largest density, what is drawn at least
_SEGMENTS = 8  # segments of Welch's spectrum, at least


def _draw_spectrum(axes: Axes, known: Explained, force: str) -> None:
    """Spectral density of the applied force and of what is left of it, by Welch's method."""
    from scipy.signal import welch

    step = float(np.median(np.diff(known.time)))
    length = max(16, known.time.size // _SEGMENTS)
    for column, color, label in (
        (known.applied, "0.6", "applied"),
        (known.left, "#D55E00", "unexplained"),
    ):
        hertz, power = welch(column, 1 / step, nperseg=min(length, column.size))
        axes.loglog(hertz[1:], np.sqrt(power[1:]), color=color, lw=1, label=label)
    top = float(axes.get_ylim()[1])
    axes.set_ylim(_DECADES * top, top)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel(f"force, {force}/√Hz")
    legend_above(axes)


_COHERENT = 0.8  # coherence below which a response is drawn grey


def _draw_response(axes: Sequence[Axes], device: Device, fit: LogFit, force: str) -> None:
    """Gain and phase from force, friction taken off, to acceleration; the model over them."""
    model, late = _model(device), fit.estimate.delay
    table = prepare(fit.trajectory, model, late)
    values = np.array([_value(device, name) for name in model.parameters])
    found = response_of(table, values, late)
    rigid = found.rigid(values)
    lines = [("rigid model", rigid, "black")]
    if fit.dynamics is not None and (fit.dynamics.current_lag or fit.dynamics.mode):
        full = fit.dynamics.response(rigid, device.mass.value, found.frequency)
        lines.append(("with lag or mode", full, "#D55E00"))
    told = found.coherence >= _COHERENT
    top, bottom = axes
    for chosen, color, label in ((told, "#0072B2", "log"), (~told, "0.8", "hardly coherent")):
        hertz, gain = found.frequency[chosen], found.gain[chosen]
        top.errorbar(
            hertz,
            np.abs(gain),
            np.abs(gain) * np.minimum(found.half_width[chosen], 0.9),
            fmt=".",
            ms=3,
            lw=0.8,
            color=color,
            label=label,
        )
        bottom.plot(hertz, np.degrees(np.angle(gain)), ".", ms=3, color=color)
    for label, gain, color in lines:
        top.plot(found.frequency, np.abs(gain), color=color, lw=1.2, label=label)
        bottom.plot(found.frequency, np.degrees(np.angle(gain)), color=color, lw=1.2)
    top.set_xscale("log")
    top.set_yscale("log")
    top.set_ylabel(f"acceleration per force, 1/s² per {force}")
    legend_above(top)
    bottom.set_ylabel("phase, °")
    bottom.set_xlabel("frequency, Hz")


def _draw_correlation(axes: Axes, estimate: Estimate) -> None:
    """Autocorrelation of the residual with the 95 % band of white noise."""
    residual = estimate.residual
    if residual.size <= _LAGS or not np.any(residual):
        axes.set_axis_off()
        return
    centred = residual - np.mean(residual)
    products = [centred[lag:] @ centred[: centred.size - lag] for lag in range(_LAGS + 1)]
    found = np.array(products) / products[0]
    band = NORMAL_95 / np.sqrt(residual.size)
    axes.axhspan(-band, band, color="0.85", lw=0, label="white noise, 95 %")
    axes.vlines(np.arange(1, _LAGS + 1), 0, found[1:], color="#0072B2", lw=2)
    axes.axhline(0, color="k", lw=0.6)
    most = min(1.0, max(4 * band, 1.2 * float(np.max(np.abs(found[1:])))))
    axes.set_ylim(-most, most)
    axes.set_xlabel(f"lag, samples (residual of {estimate.method})")
    axes.set_ylabel("correlation")
    legend_above(axes)


_CLASSES = 10  # classes of speed of which the middle value is drawn, in each direction
_FEWEST = 3  # rows that a class has at least


def draw_friction(
    axes: Axes, trajectory: Trajectory, device: Device, estimate: Estimate | None, force: str
) -> None:
    """Force less inertia, offset and weight over velocity, beside b·q̇ + Fc·sign(q̇)."""
    rows = balance_of(trajectory, estimate)
    # A friction by direction holds all of the offset.
    offset = device.force_offset.value if device.friction_by_direction is None else 0.0
    friction = rows.force - device.mass.value * rows.acceleration - offset
    if device.position_stiffness is not None:
        friction = friction - device.position_stiffness.value * rows.position
    if device.gravity is not None:
        friction = friction - device.gravity.sine.value * np.sin(rows.position)
        friction = friction - device.gravity.cosine.value * np.cos(rows.position)
    moving = rows.moving
    axes.plot(rows.velocity[moving], friction[moving], ".", color="0.75", ms=2, label="log")
    _draw_middles(axes, rows, friction)
    fastest = float(np.max(np.abs(rows.velocity)))
    for sense in (-1, 1):
        speed = np.linspace(0, fastest, 50)
        start = _toward(sense, device.friction_by_direction, device.coulomb_friction)
        viscous = _toward(sense, device.damping_by_direction, device.damping)
        axes.plot(
            sense * speed,
            sense * (start + viscous * speed),
            color="black",
            lw=1.5,
            label="b·q̇ + Fc·sign(q̇)" if sense > 0 else None,
        )
        slope = device.damping_slope
        if slope is not None:
            axes.fill_between(
                sense * speed,
                sense * (start + slope.low * speed),
                sense * (start + slope.high * speed),
                color="#D55E00",
                alpha=0.2,
                lw=0,
                label="slopes of friction" if sense > 0 else None,
            )
    axes.set_xlabel(f"velocity, {'m' if device.motion == 'linear' else 'rad'}/s")
    axes.set_ylabel(f"friction, {force}")
    legend_above(axes)


def _draw_middles(axes: Axes, rows: ForceBalance, friction: np.ndarray) -> None:
    """Median friction in classes of speed, each direction apart."""
    for sense in (-1, 1):
        chosen = np.flatnonzero(rows.moving & (sense * rows.velocity > 0))
        if chosen.size < _CLASSES * _FEWEST:
            continue
        order = chosen[np.argsort(rows.velocity[chosen])]
        parts = np.array_split(order, _CLASSES)
        axes.plot(
            [float(np.median(rows.velocity[part])) for part in parts],
            [float(np.median(friction[part])) for part in parts],
            "o",
            color="#0072B2",
            ms=3.5,
            label="log, median by speed" if sense > 0 else None,
        )


def _toward(sense: int, pair: ByDirection | None, both: Quantity) -> float:
    """What holds in one direction, or in both where they are not told apart."""
    if pair is None:
        return both.value
    return (pair.forward if sense > 0 else pair.backward).value


#: What is drawn, with the symbol of each.
_SYMBOLS = {
    "mass": "mass m",
    "damping": "damping b",
    "coulomb_friction": "friction Fc",
    "force_offset": "offset f0",
    "delay": "delay",
}
_SHORT = 22  # letters of a log's name


@dataclass(frozen=True, slots=True, kw_only=True)
class _Known:
    """One state of knowledge: a line of the picture."""

    words: str  # whose it is
    color: str  # of its line
    ends: dict[str, list[float]]  # low, value and high of each quantity it tells


def _knowledge(device: Device, fits: Sequence[LogFit], before: Device | None) -> list[_Known]:
    """What is drawn, from top to bottom."""
    lines = [_of_device(device, "now", "#D55E00")]
    if before is not None:
        dated = "" if before.date is None else f", {before.date}"
        lines.append(_of_device(before, f"before{dated}", "k"))
    for fit in fits:
        name = fit.trajectory.source
        name = name if len(name) <= _SHORT else f"{name[: _SHORT - 1]}…"
        name = f"{name}, " if len(fits) > 1 else ""
        lines += [
            _of_estimate(each, f"{name}{each.method}", "#0072B2" if believed else "0.55")
            for each, believed in ((fit.estimate, True), *((o, False) for o in fit.others))
        ]
    return lines


def _draw_intervals(axes: Sequence[Axes], lines: Sequence[_Known], units: dict[str, str]) -> None:
    """One axes a quantity, one line a state of knowledge; 95 % intervals."""
    for place, (quantity, each) in enumerate(zip(_SYMBOLS, axes, strict=True)):
        for row, known in enumerate(lines):
            if quantity not in known.ends:
                continue
            low, value, high = known.ends[quantity]
            each.plot([low, high], [-row, -row], color=known.color, lw=4, alpha=0.4)
            each.plot([value], [-row], "o", color=known.color, ms=4)
        each.set_ylim(-len(lines) + 0.5, 0.5)
        words = [known.words for known in lines] if place == 0 else [""] * len(lines)
        each.set_yticks([-row for row in range(len(lines))], words, fontsize=7)
        each.grid(visible=True, axis="y", lw=0.3)
        each.tick_params(axis="x", labelsize=7)
        each.locator_params(axis="x", nbins=3)
        each.ticklabel_format(axis="x", useOffset=False, style="plain")
        each.set_xlabel(f"{_SYMBOLS[quantity]}, {units[quantity]}", fontsize=8)


def _of_device(device: Device, words: str, color: str) -> _Known:
    ends: dict[str, list[float]] = {}
    for name in _SYMBOLS:
        quantity: Quantity = getattr(device, name)
        if name != "delay" or "delay" not in device.missing:
            factor = 1e3 if name == "delay" else 1.0
            ends[name] = [factor * end for end in (quantity.low, quantity.value, quantity.high)]
    return _Known(words=words, color=color, ends=ends)


def _of_estimate(estimate: Estimate, words: str, color: str) -> _Known:
    told = {each: (estimate.value(each), estimate.deviation(each)) for each in estimate.parameters}
    if estimate.delay_deviation is not None:
        told["delay"] = (1e3 * estimate.delay, 1e3 * estimate.delay_deviation)
    ends = {
        name: [value - NORMAL_95 * deviation, value, value + NORMAL_95 * deviation]
        for name, (value, deviation) in told.items()
    }
    return _Known(words=words, color=color, ends=ends)


def excitation_picture(excitation: Excitation | AxesExcitation) -> Figure:
    """Force, predicted position and predicted speed over time, each between its limits.

    Of several axes one line each.
    """
    spec, axes = excitation.spec, excitation.spec.axes
    length, unit = ("m", "N") if spec.motion == "linear" else ("rad", "N·m")
    if isinstance(excitation, AxesExcitation):
        force, motion = excitation.force, excitation.motion
        title = f"axes {', '.join(excitation.axes)}: {excitation.description}"
    else:
        best = excitation.best
        force, motion = best.force, best.prediction.motion
        known = ((spec.mass.value, excitation.mass), (spec.damping.value, excitation.damping))
        parts = [
            f"± {100 * half / guess:.2g} %" if guess else f"± {half:.2g}" for guess, half in known
        ]
        title = (
            f"axis {spec.axis}: {best.family}, {best.description}; predicted 95 % interval of mass "
            f"{parts[0]}, of damping {parts[1]}"
        )
    figure = NotebookFigure(figsize=(11, 7), layout="constrained")
    rows = (
        (f"force, {unit}", force, spec.force),
        (f"position, {length}", motion.position, spec.travel),
        (f"velocity, {length}/s", motion.velocity, spec.speed),
    )
    every = figure.subplots(len(rows), 1, sharex=True)
    for part, (label, column, limit) in zip(every, rows, strict=True):
        lines = part.plot(excitation.time, column, lw=1)
        for side in (-1, 1) if limit is not None else ():
            part.axhline(side * (limit or 0.0), color="#D55E00", lw=1, ls="--")
        part.set_ylabel(label)
        if axes and part is every[0]:
            part.legend(lines, axes, loc="upper right", ncols=len(axes))
    figure.axes[1].set_title(
        "\n".join(
            f"{each.words}: up to {each.travel:.2g} {length}" for each in excitation.worst[1:]
        ),
        fontsize=8,
        loc="left",
    )
    figure.axes[-1].set_xlabel("time, s")
    figure.suptitle(f"{spec.name}, {title}")
    return figure
