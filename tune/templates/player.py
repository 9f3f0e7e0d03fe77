"""Plays a planned force on a device and logs time, force and position. Python 3.9 or newer, alone.

Fill in the device below, then
    python player.py force.csv log.csv --force 14 --travel 0.1 --speed 1.0
and keep a hand on the emergency stop of the device, which must not depend on this program.

Row k of force.csv is held from k T on; it has a force, or one of each axis (force_x,force_y). Each
sample the positions are read, compared with the limits, and only then the forces are written.
Whatever ends the play but a kill (SIGKILL) writes zero force, and the rows up to there are kept.
SI units: N, m, m/s; N m, rad, rad/s for a rotary axis. Force is positive along +position. The
device starts at rest in the middle of its travel, with no hand on it. One file: a program that is
copied to a controller as it is.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

#: Speed is a difference over this time, so that one encoder count is no speed, s.
SPEED_OVER = 0.01
#: A force that was held this much longer than planned ends the play, s; at least ten samples.
LATEST = 0.02
#: Attempts to write zero force.
ATTEMPTS = 3
#: Steps further than this part from even are no plan.
EVEN = 1e-3
#: What asks a program to end or to stop, where the system has it. SIGHUP: the terminal has gone.
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGPIPE", "SIGBREAK")


class Device:
    """The device: fill in. What fails raises an exception. Of one axis lists have one number."""

    def read_positions(self) -> list[float]:
        """Position of each axis, m (rad), in the order of the columns of the plan."""
        raise NotImplementedError("fill in read_positions")

    def write_forces(self, forces: list[float]) -> None:
        """Apply a force to each axis, N (N m), until the next call."""
        raise NotImplementedError("fill in write_forces")

    def stop_pressed(self) -> bool:
        """Whether an emergency stop or an enabling switch says that the play must end."""
        return False  # fill in if the device has one; Ctrl-C stops in any case


class Clock:
    """The clock of the system."""

    def wait_until(self, due: float) -> float:
        """Wait until a time, s, and return the time it is. The last millisecond is not slept."""
        while (left := due - time.perf_counter()) > 0:
            if left > 1e-3:
                time.sleep(left - 1e-3)
        return time.perf_counter()


@dataclass(frozen=True)
class Limits:
    """What ends a play.

    Attributes, of every axis:
        force: largest |force| in the plan, N (N m).
        travel: farthest from the start, m (rad).
        speed: m/s (rad/s).
        ramp: s over which the force fades in and out; 0 if the plan does so itself.

    Raises ValueError where one is no finite number above 0, or ramp below 0: it limits nothing.
    """

    force: float
    travel: float
    speed: float
    ramp: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what limits nothing."""
        for name, limit in vars(self).items():
            if not 0 <= limit < math.inf or (limit == 0 and name != "ramp"):
                raise ValueError(f"--{name} {limit:g} is no limit: give a number above 0")


@dataclass(frozen=True)
class Plan:
    """Forces of each axis, N (N m), each held for a sample time, s; columns are named as in it."""

    columns: list[str]
    sample_time: float
    forces: list[list[float]]

    def faded(self, sample: int, ramp: float) -> list[float]:
        """The forces of a sample, faded in and out over a ramp, s."""
        least = min(sample, len(self.forces) - 1 - sample) * self.sample_time
        return [each * (least / ramp if ramp > least else 1.0) for each in self.forces[sample]]


@dataclass
class Played:
    """What was played: rows of time, forces and positions, and how it ended.

    Attributes:
        columns: of forces.
        rows: the forces of each are held until the next; the last are zero.
        end: "" if it was played to the end, else why it stopped.
        switched_off: whether zero force was written at the end.
    """

    columns: list[str]
    rows: list[tuple[float, list[float], list[float]]] = field(
        default_factory=list[tuple[float, list[float], list[float]]]
    )
    end: str = ""
    switched_off: bool = False

    def text(self) -> str:
        """The log as CSV."""
        positions = [name.replace("force", "position", 1) for name in self.columns]
        lines = [",".join(["time", *self.columns, *positions])]
        for when, forces, places in self.rows:
            lines.append(",".join([f"{when:.9f}", *[f"{each:.12g}" for each in forces + places]]))
        return "\n".join(lines) + "\n"


class Interrupt:
    """Set by Ctrl-C and by a request to end, instead of breaking off between read and write."""

    def __init__(self) -> None:
        self.came = False

    def __call__(self, *_: object) -> None:
        """Remember a signal."""
        self.came = True


def load_plan(path: Path, limits: Limits) -> Plan:
    """The plan in a file of time and forces. Raises ValueError where it cannot be played."""
    header, *lines = path.read_text(encoding="utf-8").splitlines() or [""]
    first, *names = header.strip().split(",")
    if first != "time" or not names or not all(each.startswith("force") for each in names):
        raise ValueError(f"{path} does not begin with the line time,force or time,force_x,force_y")
    rows: list[list[float]] = []
    with suppress(ValueError):
        rows = [[float(cell) for cell in line.split(",")] for line in lines if line.strip()]
    width = 1 + len(names)
    if len(rows) < 2 or any(len(row) != width or not all(map(math.isfinite, row)) for row in rows):
        raise ValueError(f"{path} has no rows of {width} numbers")
    times, forces = [row[0] for row in rows], [row[1:] for row in rows]
    step = (times[-1] - times[0]) / (len(rows) - 1)
    uneven = (abs(when - times[0] - k * step) > EVEN * step for k, when in enumerate(times))
    if step <= 0 or any(uneven):
        raise ValueError(f"{path} has times that are not evenly spaced")
    most = max(abs(each) for row in forces for each in row)
    if most > limits.force:
        raise ValueError(f"{path} holds a force of {most:g}, beyond --force")
    if limits.ramp <= 0 and any(forces[0] + forces[-1]):
        raise ValueError(f"{path} does not begin and end with zero force; add --ramp SECONDS")
    return Plan(names, step, forces)


def play(
    device: Device,
    plan: Plan,
    limits: Limits,
    clock: Clock | None = None,
    interrupt: Interrupt | None = None,
) -> Played:
    """Play a plan within limits. Whatever happens, zero force is written in the end."""
    played = Played(plan.columns)
    try:
        _play(device, plan, limits, clock or Clock(), interrupt or Interrupt(), played)
    except BaseException as error:
        played.end = f"stopped: {type(error).__name__}: {error}"
        if not isinstance(error, (Exception, KeyboardInterrupt)):
            raise
    finally:
        played.switched_off = played.switched_off or _switch_off(device, len(plan.columns))
    return played


def _play(
    device: Device, plan: Plan, limits: Limits, clock: Clock, interrupt: Interrupt, played: Played
) -> None:
    step, count, axes = plan.sample_time, len(plan.forces), len(plan.columns)
    apart = max(1, round(SPEED_OVER / step))
    latest = max(LATEST, 10 * step)
    began = clock.wait_until(0.0)
    for sample in range(count + 1):
        now = clock.wait_until(began + sample * step) - began
        places = list(device.read_positions())
        if len(places) != axes or not all(map(math.isfinite, places)):
            played.end = f"stopped: the position is not a number for each of {axes} axes"
            return
        start = played.rows[0][2] if played.rows else places
        when, _, before = played.rows[sample - apart] if sample >= apart else (now, [], places)
        if interrupt.came or device.stop_pressed():
            played.end = "stopped: emergency stop"
        elif _apart(places, start) > limits.travel:
            played.end = "stopped: travel exceeded"
        elif _apart(places, before) > limits.speed * (now - when):
            played.end = "stopped: too fast"
        elif now - sample * step > latest:
            played.end = "stopped: a sample came too late"
        # The row after the last ends the play: from then on the force is zero.
        if played.end or sample == count:
            played.switched_off = _switch_off(device, axes)
            played.rows.append((now, [0.0] * axes, places))
            return
        forces = plan.faded(sample, limits.ramp)
        device.write_forces(forces)
        played.rows.append((now, forces, places))


def _apart(places: list[float], others: list[float]) -> float:
    """How far the axis is that moved most, m (rad)."""
    return max(abs(place - others[axis]) for axis, place in enumerate(places))


def _switch_off(device: Device, axes: int) -> bool:
    """Write zero force to every axis, more than once if need be; whether it was taken."""
    for _ in range(ATTEMPTS):
        try:
            device.write_forces([0.0] * axes)
        except Exception:  # noqa: BLE001, S112 - another attempt is all there is
            continue
        return True
    return False


def _blank(device: Device, axes: int) -> str:
    """What of the device is still to be filled in, or ""."""
    try:
        device.read_positions()
        device.write_forces([0.0] * axes)
    except NotImplementedError as error:
        return str(error)
    except Exception:  # noqa: BLE001 - the play ends by it and says so
        return ""
    return ""


def main(device: Device) -> int:
    """Play a file and keep the log; 0 if played to the end, 1 if stopped, 2 if not begun."""
    parser = argparse.ArgumentParser(description="Play a planned force and log the motion.")
    parser.add_argument("plan", type=Path)
    parser.add_argument("log", type=Path)
    for name in ("force", "travel", "speed"):
        parser.add_argument(f"--{name}", type=float, required=True)
    parser.add_argument("--ramp", type=float, default=0.0)
    given = parser.parse_args()
    try:
        limits = Limits(given.force, given.travel, given.speed, given.ramp)
        plan = load_plan(given.plan, limits)
        if blank := _blank(device, len(plan.columns)):
            raise ValueError(f"there is no device yet: {blank}")
        # Opened before anything moves: a log that cannot be kept is not played.
        log = given.log.open("w", encoding="utf-8")
    except (OSError, ValueError) as error:
        sys.stderr.write(f"player: {error}\n")
        return 2
    interrupt = Interrupt()
    for name in SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), interrupt)
    with log:
        played = play(device, plan, limits, interrupt=interrupt)
        log.write(played.text())
    end = played.end or "played to the end"
    if not played.switched_off:
        end += "; ZERO FORCE COULD NOT BE WRITTEN: CUT THE POWER"
    sys.stderr.write(f"player: {end}; {len(played.rows)} rows in {given.log}\n")
    return 1 if played.end or not played.switched_off else 0


if __name__ == "__main__":
    sys.exit(main(Device()))
