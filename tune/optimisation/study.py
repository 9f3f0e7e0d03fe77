"""Many devices at once: every device with every scene and margin, in parallel, as one frame.

Each is tuned for itself, so that nothing depends on the number of workers: workers only take the
next that is left. What fails is a row with its exit code and sentence, and stops no other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from identification import Device, InvalidInputError, LogRefusedError, UsageError, load_device
from tune.documents import CheckFailedError, Exit, TuneError
from tune.documents.perception import PerceptionTable, perception_of
from tune.documents.profile import SafeProfile
from tune.documents.scene import MARGINS, MarginName, Scene, load_scene
from tune.optimisation import Progress, optimise

if TYPE_CHECKING:
    import polars

File = str | PathLike[str]
Row = dict[str, object]

#: Quantities of a device that a row has, each with the ends of its 95 % interval.
QUANTITIES = ("mass", "damping", "coulomb_friction", "force_offset", "delay")
#: How often work begins anew that a worker took down with it, before it is given up.
_MOST_DEATHS = 3

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


class WorkersLostError(TuneError):
    """Worker processes that ended in the middle of their work, again and again."""

    exit_code = Exit.NOT_WRITTEN


def study(
    devices: Mapping[str, Device | File] | Sequence[Device | File] | Device | File,
    scenes: Mapping[str, Scene | File] | Sequence[Scene | File] | Scene | File,
    *,
    margins: Sequence[MarginName] | MarginName | None = None,
    table: PerceptionTable | None = None,
    workers: int = -1,
    progress: Progress | None = None,
) -> polars.DataFrame:
    """Tune every device for every scene and margin, as `optimise` does, in parallel processes.

    Args:
        devices: documents, files or names of known devices, or a single one; the keys of a mapping
            name the rows, else serial numbers, names or files do.
        scenes: documents or files, or a single one; named alike.
        margins: of each scene, or a single one; None is its own.
        table: Weber fractions; None is what each scene says of them.
        workers: processes on this machine; 1 works in this one, -1 has one for each processor.
        progress: called with a sentence after each result, "... (3 of 7)".

    Returns:
        A row for each device, scene and margin, in this order, whatever the number of workers:
        ``device``, ``scene``, ``margin``, ``exit_code`` with its ``sentence`` (0 and null where
        there is a profile), ``digest`` of the profile; ``mass``, ``mass_low``, ``mass_high`` and so
        on with 95 % intervals; filters in Hz; of each element its effects with steps and what
        limits them, ``wall.stiffness``, ``wall.stiffness.steps``, ``wall.stiffness.limited_by``,
        and its margins, ``wall.gain`` and ``wall.extra_delay_samples``. All in SI units.

    Raises:
        UsageError: no device or scene, a margin that there is not, no workers; before any work.
        InvalidInputError: a scene that cannot be read. A device that cannot is a row.
        WorkersLostError: worker processes that were killed three times.
    """
    margins = (margins,) if isinstance(margins, str) else margins
    for margin in margins or ():
        if margin not in MARGINS:
            raise UsageError("margins", f"{margin!r} is none", f"Choose from {', '.join(MARGINS)}")
    if workers % 1 or (workers < 1 and workers != -1):
        seen = f"{workers} do no work"
        raise UsageError("workers", seen, "Give 1 or more, or -1 for one a processor")
    wishes: list[tuple[str, Scene, PerceptionTable]] = []
    for name, given in _named(scenes):
        scene = given if isinstance(given, Scene) else load_scene(given)
        beside = Path() if isinstance(given, Scene) else Path(given).parent
        wishes.append((name, scene, table or perception_of(scene, beside)))
    heads, items = list[Row](), list[tuple[Device | File, Scene, PerceptionTable]]()
    for label, device in _named(devices):
        for name, scene, chosen in wishes:
            for margin in margins or (scene.margin,):
                heads.append({"device": label, "scene": name, "margin": margin})
                items.append((device, scene.model_copy(update={"margin": margin}), chosen))
    if not items:
        raise UsageError("study", "is given no device or no scene", "Give one of each at least")
    rows: list[Row] = [{} for _ in items]
    for done, (place, row) in enumerate(in_parallel(_studied, items, workers=workers), start=1):
        rows[place] = heads[place] | row
        if progress is not None:
            progress(f"tuning devices ({done} of {len(items)})")
    return frame_of(rows)


def _named(given: Any) -> list[tuple[str, Any]]:
    """What is to be studied, each with its name."""

    def name_of(one: Device | Scene | File) -> str:
        if isinstance(one, Device):
            return one.serial or one.name
        return one.name if isinstance(one, Scene) else str(one)

    if isinstance(given, str | Scene | Device) or not hasattr(given, "__iter__"):
        given = (given,)
    return [*(given.items() if isinstance(given, Mapping) else ((name_of(x), x) for x in given))]


def _studied(item: tuple[Device | File, Scene, PerceptionTable]) -> Row:
    """The row of one device with one scene; runs in a worker."""
    given, scene, table = item
    row = Row()

    def tuned() -> SafeProfile:
        if not isinstance(cast("object", given), Device | str | PathLike):
            raise InvalidInputError("devices", f"{given!r} is none", "Give a Device, file or name")
        device = given if isinstance(given, Device) else load_device(given)
        row.update(device_columns(device))
        return optimise(device, scene, table=table)

    code, sentence, profile = attempted(tuned)
    told = {} if profile is None else profile_columns(profile)
    return {"exit_code": int(code), "sentence": sentence, "digest": None} | row | told


def attempted(work: Callable[[], _Result]) -> tuple[Exit, str | None, _Result | None]:
    """(exit code, sentence, result) of some work: the last is None where it failed."""
    try:
        return Exit.DONE, None, work()
    except CheckFailedError as error:  # what cannot be proved cannot be played, as commands say
        return Exit.NO_FEASIBLE_EFFECT, str(error), None
    except LogRefusedError as error:
        refusals = (str(each) for each in error.findings if each.severity == "refusal")
        return Exit.LOG_REFUSED, "\n".join(refusals), None
    except Exception as error:  # noqa: BLE001 - it is told, and no other device is stopped
        code = Exit.of(error)
        name = f"internal error: {type(error).__name__}: " * (code is Exit.INTERNAL_ERROR)
        return code, f"{name}{error}", None


def device_columns(device: Device) -> Row:
    """The quantities of a device with their intervals."""
    row = Row()
    for name in QUANTITIES:
        quantity = getattr(device, name)
        row |= {name: quantity.value, f"{name}_low": quantity.low, f"{name}_high": quantity.high}
    return row


def profile_columns(profile: SafeProfile) -> Row:
    """What was chosen for a device: its digest, filters, and every effect of each element."""
    row: Row = {"digest": profile.digest}
    row |= {
        name: getattr(profile.loop, name)
        for name in ("velocity_filter_hz", "acceleration_filter_hz")
    }
    for name, element in profile.elements.items():
        for effect, reason in element.limited_by.items():
            row[f"{name}.{effect}"] = float(getattr(element, effect))
            row[f"{name}.{effect}.steps"] = element.perceived_steps.get(effect, 0.0)
            row[f"{name}.{effect}.limited_by"] = reason
        row[f"{name}.gain"] = element.margins.gain
        row[f"{name}.extra_delay_samples"] = element.margins.extra_delay_samples
    return row


def frame_of(rows: Sequence[Row]) -> polars.DataFrame:
    """Rows as a frame; a column for whatever some row has, null where another has it not."""
    import polars as pl

    # Rows with most columns first: what refusals lack does not come last because of them.
    names = dict.fromkeys(name for row in sorted(rows, key=len, reverse=True) for name in row)
    columns = {name: [row.get(name) for row in rows] for name in names}
    return pl.DataFrame(columns, strict=False)


def in_parallel(
    work: Callable[[_Item], _Result],
    items: Sequence[_Item],
    *,
    workers: int = -1,
    scheduler: str | None = None,
) -> Iterator[tuple[int, _Result]]:
    """(place, result) of each item as it is done, by processes here or those of a Dask scheduler.

    Raises UsageError for a scheduler that does not answer, WorkersLostError.
    """
    from concurrent.futures.process import BrokenProcessPool

    left = set(range(len(items)))
    for death in range(_MOST_DEATHS + 1):
        calls = [(work, place, items[place]) for place in sorted(left)]
        try:
            for place, result in _results(calls, workers, scheduler):
                left.discard(place)
                yield place, result
            return
        except BrokenProcessPool as error:
            # What was in hand begins anew; with Dask the scheduler sees to that.
            if death == _MOST_DEATHS:
                raise WorkersLostError(
                    f"{len(left)} of {len(items)} are left: worker processes were killed "
                    f"{death + 1} times, as a system does that has no memory left. What is done "
                    "is kept; run it again, with fewer workers"
                ) from error


def _results(
    calls: Iterable[tuple[Any, ...]], workers: int, scheduler: str | None
) -> Iterator[tuple[int, Any]]:
    from joblib import Parallel, delayed, parallel_config

    where: dict[str, Any] = {"backend": "loky", "n_jobs": workers}
    if scheduler is not None:
        where = {"backend": "dask", "scheduler_host": scheduler}
    try:
        with parallel_config(**where):  # Dask is known to no other function by its name
            pool = Parallel(batch_size=1, return_as="generator_unordered")
        yield from pool(delayed(_placed)(*call) for call in calls)
    except (OSError, ValueError, TimeoutError) as error:
        if scheduler is None:
            raise
        reason = " ".join(str(error).split())
        remedy = "Start one with 'dask scheduler' and 'dask worker', with haptune[fleet] installed"
        raise UsageError("--scheduler", f"{scheduler} cannot be used: {reason}", remedy) from error


def _placed(work: Callable[[Any], Any], place: int, item: Any) -> tuple[int, Any]:
    return place, work(item)
