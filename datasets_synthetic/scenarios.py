"""Named scenarios: a device, what excites it and what disturbs its log, and the bundled logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from datasets_synthetic.device import Faults, FloatArray, Rig, named_rig
from datasets_synthetic.simulation import RigOfAxes, simulate
from identification import InvalidInputError, Trajectory, to_yaml

#: Lines reach from this fraction of the corner b/m, where damping rules the motion, ...
_BELOW = 0.25
#: ... to this multiple of it, where mass does.
_ABOVE = 8.0
#: Lowest line, periods per record: fewer tell little and drift far.
_FEWEST_PERIODS = 2
#: The highest line is at least this, Hz: slower motion of a slow device is lost in friction.
_FASTEST = 4.0
#: Lines asked for, spaced evenly on a logarithmic scale; coinciding ones merge.
_LINES = 16
#: The search for a scale aims at this part of the travel, ...
_AIM = 0.97
#: ... is content with this part, ...
_NEAR_ENOUGH = 0.9
#: ... and keeps the best it has after this many simulations.
_TRIES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceSignal:
    """What to play on a batch of devices, and from where.

    Attributes:
        force: N (N·m), shape (batch, n).
        start: position at t = 0 that centres the motion about zero, m (rad), shape (batch,).
    """

    force: FloatArray
    start: FloatArray


def multisine(rig: Rig, samples: int, *, fade: float = 1.0) -> FloatArray:
    """A multisine of peak 1 about each device's corner b/m, shape (batch, samples).

    The force of each line is in proportion to √ω·|jω + b/m|, half way between equal speed and equal
    travel: slow lines show the damping, fast ones the mass, and travel and force run out together.
    Phases follow Schroeder (IEEE Transactions on Information Theory 16, 1970, p. 85): each line has
    its turn in proportion to its power, which keeps the crest low. The force rises from zero over
    ``fade`` seconds along a raised cosine, so that a device starting at rest is not thrown.
    """
    force = np.empty((rig.batch, samples))
    for member in range(rig.batch):
        corner = abs(float(rig.damping[member] / rig.mass[member]))
        step = float(rig.sample_time[member])
        duration = samples * step
        base = 2 * np.pi / duration
        lowest = min(max(_FEWEST_PERIODS, _BELOW * corner / base), samples / 16)
        highest = min(max(_ABOVE * corner / base, _FASTEST * duration), samples / 8)
        lines = np.unique(np.rint(np.geomspace(lowest, highest, _LINES)).astype(np.int64))
        amplitude = lines**0.5 * np.hypot(lines * base, corner)
        power = amplitude**2 / np.sum(amplitude**2)
        turn = np.concatenate(([0.0], np.cumsum(power)[:-1]))
        phase = -2 * np.pi * np.cumsum(np.diff(lines, prepend=lines[0]) * turn)
        spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
        spectrum[lines] = amplitude * np.exp(1j * phase)
        time = np.arange(samples) * step
        rise = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / fade, 1.0))
        wave = np.fft.irfft(spectrum, samples) * rise
        force[member] = wave / np.max(np.abs(wave))
    return force


def fit_to_limits(
    rig: Rig, shape: FloatArray, *, travel: ArrayLike, force: ArrayLike
) -> ForceSignal:
    """Scale a force shape until the device just reaches its travel or its force limit.

    False position on noise-free simulations of the rig itself, friction included, between the
    force that friction just holds and the largest allowed; the scale returned has been simulated
    and stays within both limits. The force that cancels ``rig.force_offset`` is added and counts
    against the force limit.

    Args:
        rig: the devices to move.
        shape: force of peak 1, shape (batch, n).
        travel: half the range of positions allowed, m (rad), a number or shape (batch,).
        force: largest |force| allowed, N (N·m), a number or shape (batch,).

    Raises:
        ValueError: the force limit does not exceed the device's own offset and friction, or no
            scale that moves the device keeps it within its travel.
    """
    exact = replace(rig, encoder_resolution=0.0)
    travel = np.broadcast_to(np.asarray(travel, dtype=np.float64), rig.mass.shape)
    held = rig.coulomb_friction
    room = np.minimum(force, rig.force_limit) - np.abs(rig.force_offset)
    if np.any(room <= held):
        worst = int(np.argmin(room - held))
        raise ValueError(
            f"force limit leaves {room[worst]:g} above the offset of {rig.name}; "
            f"more than its friction {held[worst]:g} is needed"
        )
    low, reached, centre = np.array(held), np.zeros_like(held), np.zeros_like(held)
    high, overshot = room.copy(), np.full_like(room, np.inf)
    scale = room.copy()
    searching = np.arange(rig.batch)
    # False position for all members at once: scipy's searches take one scalar at a time.
    for _ in range(_TRIES):
        some = exact.members(searching)
        tried = scale[searching]
        position = simulate(some, _command(shape[searching], tried, some)).position
        highest, lowest = position.max(axis=1), position.min(axis=1)
        middle, reach = (highest + lowest) / 2, (highest - lowest) / 2
        within = reach <= travel[searching]
        good, bad = searching[within], searching[~within]
        low[good], reached[good], centre[good] = tried[within], reach[within], middle[within]
        high[bad], overshot[bad] = tried[~within], reach[~within]
        enough = (reached >= _NEAR_ENOUGH * travel) | (low == room)
        searching = np.flatnonzero(~enough)
        if searching.size == 0:
            break
        part = np.maximum(_AIM * travel - reached, 0.0) / (overshot - reached)
        scale = low + part * (high - low)
    if not np.all(reached > 0):
        raise ValueError(f"{rig.name} leaves its travel of {np.min(travel):g} at every force tried")
    return ForceSignal(force=_command(shape, low, rig), start=-centre)


def _command(shape: FloatArray, scale: FloatArray, rig: Rig) -> FloatArray:
    """The scaled shape with the force that cancels each device's offset, shape (batch, n)."""
    return shape * scale[:, None] + rig.force_offset[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """Everything a simulated log depends on.

    Attributes:
        name: as in ``haptune simulate NAME``.
        description: one sentence for a list of scenarios.
        device: a named device.
        duration: s.
        travel: half the range of positions the excitation may use, m (rad).
        force: largest |force| the excitation may use, N (N·m).
        force_step: resolution of the played force, N (N·m); what is logged is what is played.
        faults: noise, its fields plain numbers.
        seed: of the noise, unless another is asked for.
    """

    name: str
    description: str
    device: str
    duration: float
    travel: float
    force: float
    force_step: float = 0.001
    faults: Faults = field(default_factory=Faults)
    seed: int = 0

    def rig(self) -> Rig:
        """The true device, one member."""
        return named_rig(self.device)


def scenario_named(name: str) -> Scenario:
    """The scenario of that name. Raises InvalidInputError with the names there are."""
    if name not in SCENARIOS:
        known = ", ".join(SCENARIOS)
        raise InvalidInputError(name, "is not a scenario", f"Scenarios: {known}")
    return SCENARIOS[name]


def run(scenario: str | Scenario, *, seed: int | None = None) -> Trajectory:
    """The log of one scenario, a Trajectory of round(duration/T) samples.

    Args:
        scenario: a name in SCENARIOS or a Scenario.
        seed: of the noise; None means the scenario's own.

    Raises:
        InvalidInputError: no such scenario.
    """
    chosen = scenario_named(scenario) if isinstance(scenario, str) else scenario
    excitation = _excitation(chosen)
    recording = simulate(
        chosen.rig(),
        excitation.force,
        faults=chosen.faults,
        seed=chosen.seed if seed is None else seed,
        position=excitation.start,
    )
    return replace(recording, source=f"simulated {chosen.name}").trajectory()


@lru_cache(maxsize=32)
def _excitation(scenario: Scenario) -> ForceSignal:
    """The force played, the same for every seed, shape (1, n), and where it starts."""
    rig = scenario.rig()
    samples = round(scenario.duration / float(rig.sample_time[0]))
    found = fit_to_limits(
        rig, multisine(rig, samples), travel=scenario.travel, force=scenario.force
    )
    step = scenario.force_step
    return replace(found, force=np.rint(found.force / step) * step)


_ALL = (
    Scenario(
        name="homerehab",
        description="The bundled log: HomeRehab for 8 s with friction, encoder, delay and noise.",
        device="homerehab",
        duration=8.0,
        travel=0.05,
        force=14.0,
        faults=Faults(force_noise=0.005),
        seed=1,
    ),
    Scenario(
        name="emps-open-loop",
        description="The EMPS carriage for 20 s in open loop, its friction and offset included.",
        device="emps",
        duration=20.0,
        travel=0.12,
        force=200.0,
        force_step=0.01,
        faults=Faults(force_noise=0.5),
        seed=4,
    ),
    Scenario(
        name="stylus",
        description="An illustrative light desktop stylus for 15 s within 40 mm and 0.9 N.",
        device="stylus",
        duration=15.0,
        travel=0.04,
        force=0.9,
        force_step=0.0001,
        faults=Faults(force_noise=0.0005),
        seed=5,
    ),
    Scenario(
        name="knob",
        description="An illustrative rotary knob for 15 s within 1.5 rad and 0.05 N·m.",
        device="knob",
        duration=15.0,
        travel=1.5,
        force=0.05,
        force_step=0.00001,
        faults=Faults(force_noise=0.00002),
        seed=6,
    ),
)

#: Every named scenario, in the order to show them.
SCENARIOS: Mapping[str, Scenario] = MappingProxyType({each.name: each for each in _ALL})


#: Decimals printed, trailing zeros dropped: a picometre, a piconewton, a picosecond.
_DECIMALS = 12


def bundled_path(name: str) -> Path:
    """A bundled file: homerehab.csv, planar.csv, and hardware.yaml and truth.yaml of both.

    Raises:
        InvalidInputError: no such file, with the names there are.
    """
    folder = Path(str(files("datasets_synthetic").joinpath("logs")))
    known = sorted(path.name for path in folder.iterdir() if path.is_file())
    if name not in known:
        raise InvalidInputError(name, "is not a bundled file", f"Bundled: {', '.join(known)}")
    return folder / name


def log_text(trajectory: Trajectory) -> str:
    """The log as CSV: a header of column names, then one row a sample in SI units."""
    columns = trajectory.columns()
    return _csv([name for name, _ in columns], zip(*(each for _, each in columns), strict=True))


def _csv(names: Iterable[str], rows: Iterable[Iterable[float]]) -> str:
    lines = [",".join(names), *(",".join(map(_decimal, row)) for row in rows)]
    return "\n".join(lines) + "\n"


#: HomeRehab played in a plane; the paper gives its mass, damping, encoder and force for one axis,
#: the rest is an illustration.
_PLANAR = RigOfAxes(
    mass=np.array([[[3.3, 0.5], [0.5, 2.8]]]),
    damping=np.array([[[10.5, 1.5], [1.5, 9.5]]]),
    sample_time=0.001,
    delay=0.001,
    coulomb_friction=np.array([[0.8, 0.7]]),
    encoder_resolution=6e-6,
    position_noise=1e-6,
)
#: Samples of its log, and the most force on each axis, N.
_PLANAR_SAMPLES, _PLANAR_FORCE = 4000, 12.0


def planar_texts() -> dict[str, str]:
    """File name → text of the log of a plane, of what is known before, and of the truth."""
    alone = Rig(mass=3.0, damping=10.0, sample_time=_PLANAR.sample_time)
    wave = multisine(alone, _PLANAR_SAMPLES)[0]
    # The same lines backwards have other phases: they tell the axes apart.
    force = np.round(_PLANAR_FORCE * np.stack((wave, wave[::-1]), axis=1), 4)
    seen = _PLANAR.run(force[None], start=0.0, seed=1)
    time = _PLANAR.sample_time * np.arange(_PLANAR_SAMPLES)
    table = np.column_stack((time, seen.force[0], seen.position[0]))
    facts = {"axes": ["x", "y"], "motion": "linear", "sample_time": 0.001, "delay": 0.001}
    facts |= {"encoder_resolution": 6e-6, "force_limit": {"continuous": 14.0, "peak": 28.0}}
    truth = {name: getattr(_PLANAR, name)[0].tolist() for name in ("mass", "damping")}
    return {
        "planar.csv": _csv(("time", "force_x", "force_y", "position_x", "position_y"), table),
        "planar.hardware.yaml": to_yaml(
            {"schema": "haptune/hardware/1", "name": "planar"} | facts,
            "What is known before planar.csv is looked at.",
        ),
        "planar.truth.yaml": to_yaml(
            truth | {"coulomb_friction": [0.8, 0.7]},
            "What planar.csv was simulated from; SI units.",
        ),
    }


def _decimal(value: float) -> str:
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


if __name__ == "__main__":
    texts = planar_texts() | {"homerehab.csv": log_text(run("homerehab"))}
    for file_name, text in texts.items():
        place = Path(str(files("datasets_synthetic").joinpath("logs"))) / file_name
        place.write_text(text, encoding="utf-8", newline="\n")
