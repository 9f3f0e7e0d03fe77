"""What each finding looks like, beside a log without it: pictures for the documentation.

``python -m tests.simulated.catalogue.pictures docs/findings`` draws one for each code.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tests.simulated.catalogue import machines
from tests.simulated.catalogue.cases import Case, cases
from tests.simulated.catalogue.raw import RawLog

FloatArray = NDArray[np.float64]

SEED = 1
#: Width and height in inches, and dots an inch.
SIZE, DOTS = (7.2, 2.3), 110
#: Colours that colour-blind readers can tell (Okabe and Ito).
BLUE, VERMILION = "#0072B2", "#D55E00"
#: Samples over which velocity and acceleration are differences.
_SPAN = 10
#: A column that varies by less is drawn as a line in the middle.
_FLAT = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What of a log shows a fault: labels of both axes, and what they show."""

    abscissa: str
    ordinate: str
    points: Callable[[RawLog], tuple[FloatArray, FloatArray]]
    style: str = "-"
    seconds: float | None = None  # shown from the first quarter of the log on; None for all
    level: str = "plain"  # of the catalogue's three logs


def _position(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return log.time, 1000 * log.position


def _force(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return log.time, log.force


def _steps(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return log.time[1:], 1000 * np.diff(log.time)


def _moves(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return log.time[1:], 1000 * np.diff(log.position)


def _velocity(log: RawLog) -> FloatArray:
    return (log.position[2 * _SPAN :] - log.position[: -2 * _SPAN]) / (
        log.time[2 * _SPAN :] - log.time[: -2 * _SPAN]
    )


def _acceleration(log: RawLog) -> FloatArray:
    step = float(np.median(np.diff(log.time))) * _SPAN
    y = log.position
    return (y[2 * _SPAN :] - 2 * y[_SPAN:-_SPAN] + y[: -2 * _SPAN]) / step**2


def _explained(log: RawLog) -> tuple[FloatArray, FloatArray]:
    """Columns of mass, damping, friction and offset (n, 4), and what each is multiplied by (4,)."""
    speed = _velocity(log)
    columns = np.column_stack((_acceleration(log), speed, np.sign(speed), np.ones_like(speed)))
    sizes = np.linalg.lstsq(columns, log.force[_SPAN:-_SPAN], rcond=None)[0]
    return columns, sizes.astype(np.float64)


def _unexplained(log: RawLog) -> FloatArray:
    columns, sizes = _explained(log)
    return log.force[_SPAN:-_SPAN] - columns @ sizes


def _unexplained_over_time(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return log.time[_SPAN:-_SPAN], _unexplained(log)


def _unexplained_over_position(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return 1000 * log.position[_SPAN:-_SPAN], _unexplained(log)


def _friction(log: RawLog) -> tuple[FloatArray, FloatArray]:
    columns, sizes = _explained(log)
    return _velocity(log), log.force[_SPAN:-_SPAN] - columns[:, 0] * sizes[0]


def _over_velocity(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return _velocity(log), log.force[_SPAN:-_SPAN]


def _over_acceleration(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return _acceleration(log), log.force[_SPAN:-_SPAN]


def _over_position(log: RawLog) -> tuple[FloatArray, FloatArray]:
    return 1000 * log.position, log.force


_TIME, _MM, _N = "time, s", "position, mm", "force, N"
_POSITION = View(abscissa=_TIME, ordinate=_MM, points=_position)
_FORCE = View(abscissa=_TIME, ordinate=_N, points=_force)
_STEPS = View(abscissa=_TIME, ordinate="step, ms", points=_steps, style=".")
_SPEED = View(abscissa="velocity, m/s", ordinate=_N, points=_over_velocity, style=",")
_LEFT = View(abscissa=_TIME, ordinate="unexplained force, N", points=_unexplained_over_time)
_PLACE = View(abscissa=_MM, ordinate=_N, points=_over_position, style=",")
_MOVES = View(
    abscissa=_TIME, ordinate="step of position, mm", points=_moves, style=".", seconds=0.5
)
_PUSHED = View(abscissa="acceleration, m/s²", ordinate=_N, points=_over_acceleration, style=",")
_FRICTION = View(abscissa="velocity, m/s", ordinate="friction, N", points=_friction, style=",")
_RINGING = replace(_LEFT, seconds=2.0, level="severe")

#: What tells a code, where unexplained force over time does not.
VIEWS: dict[str, View] = {
    "not-exciting-mass": _SPEED,
    "not-exciting-damping": _SPEED,
    "few-counts": replace(_POSITION, seconds=0.5),
    "force-saturated": replace(_FORCE, seconds=0.5),
    "force-unit": _FORCE,
    "not-stated": _FORCE,
    "dropped-samples": _STEPS,
    "lost-rows": _MOVES,
    "repeated-rows": _MOVES,
    "jitter": _STEPS,
    "clock-backward": _STEPS,
    "encoder-wrap": _POSITION,
    "sign-flip": _PUSHED,
    "gravity": View(
        abscissa="position, mm (mrad)",
        ordinate="unexplained force, N",
        points=_unexplained_over_position,
        style=",",
    ),
    "stiction": replace(_POSITION, level="severe"),
    "controller-identified": _PLACE,
    "delay-unknown": _PUSHED,
    "delay-contradicted": replace(_PUSHED, level="severe"),
    "non-finite": replace(_FORCE, style=".-", seconds=0.1, level="severe"),
    "constant-column": _POSITION,
    "too-short": _POSITION,
    "vibration-mode": _RINGING,
    "backlash": _RINGING,
    "drive-lag": replace(_FRICTION, level="severe"),
    "load-friction": replace(_FRICTION, level="severe"),
    "unmodelled-force": replace(_FRICTION, level="severe"),
}


def picture_of(case: Case, good: RawLog) -> Figure:
    """A log without the fault on the left, the faulty one on the right, by the view that tells."""
    view = VIEWS.get(case.code, _LEFT)
    figure = Figure(figsize=SIZE, layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw(left, view, good, "as it should be", BLUE)
    _draw(right, view, case.log, case.code, VERMILION)
    return figure


def _draw(panel: Axes, view: View, log: RawLog, title: str, color: str) -> None:
    axes: Any = panel  # its methods take what their types do not say
    abscissa, ordinate = view.points(log)
    if view.seconds is not None:
        begun = log.time[log.time.size // 4]
        shown = (abscissa >= begun) & (abscissa <= begun + view.seconds)
        abscissa, ordinate = abscissa[shown], ordinate[shown]
    axes.plot(abscissa, ordinate, view.style, color=color, linewidth=0.8, markersize=2)
    axes.set(title=title, xlabel=view.abscissa, ylabel=view.ordinate)
    axes.ticklabel_format(useOffset=False)
    axes.locator_params(axis="x", nbins=5)
    if np.ptp(ordinate[np.isfinite(ordinate)]) < _FLAT:
        axes.set_ylim(float(ordinate[0]) - 1, float(ordinate[0]) + 1)


def main(folder: Path) -> None:
    """Draw one picture a code into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    good = machines.good(SEED)[0]
    for case in cases(SEED):
        if case.level == VIEWS.get(case.code, _LEFT).level:
            figure: Any = picture_of(case, good)
            figure.savefig(folder / f"{case.code}.png", dpi=DOTS)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
