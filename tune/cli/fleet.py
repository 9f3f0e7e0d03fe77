"""``haptune fleet``: a profile for each device of a manifest, a table of all, a page."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import Argument, Option

import identification as ident
from identification import IdentificationError, InvalidInputError, NotWrittenError, UsageError
from tune.cli import session as opt
from tune.cli.session import Session, command, refuse_standard_output
from tune.documents import Exit, TuneError

if TYPE_CHECKING:
    from identification import Device, LogColumns, Method
    from tune.documents.manifest import FleetEntry
    from tune.documents.profile import SafeProfile
    from tune.documents.scene import MarginName

#: What a folder of a fleet holds.
_PROFILES, _RECORDS, _TABLE, _PAGE = "profiles", "records", "results.parquet", "summary.html"
#: Where facts are stated that a device of a manifest lacks.
_IN_MANIFEST = (
    "State them in a hardware file and give it with --hardware, or in the column 'hardware' of the "
    "manifest ('haptune new hardware' writes the form):"
)
#: Refusals that are printed; the table has all.
_MOST_TOLD = 8


class DevicesRefusedError(TuneError):
    """A fleet of which some devices have no profile; its exit code is that of the first."""

    def __init__(self, sentence: str, code: int) -> None:
        self.exit_code = Exit(code)
        super().__init__(sentence)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """One device to be calibrated: its entry, paths resolved, and what all have in common."""

    entry: FleetEntry
    logs: tuple[Path, ...]
    device: str | None
    scene: Path
    hardware: Path | None
    columns: LogColumns
    method: Method
    allow: tuple[str, ...]
    margin: MarginName | None


@dataclass(slots=True)
class _Digests:
    """Digests of what results come from; files that devices have in common are read once."""

    made_by: list[str]
    files: dict[Path, str] = field(default_factory=dict[Path, str])
    scenes: dict[Path, str] = field(default_factory=dict[Path, str])

    def of(self, job: _Job) -> str:
        """The digest of all that the result of a job comes from."""
        beside = () if job.device is None else (Path(job.device),)
        files = [self._of_file(file) for file in (*job.logs, job.hardware, *beside) if file]
        common = (job.method, job.allow, job.margin, asdict(job.columns))
        content = (self.made_by, job.entry.model_dump(), common, files, self._of_scene(job.scene))
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def _of_file(self, path: Path) -> str:
        """What cannot be read has a digest too, so that it is done once it can."""
        if path not in self.files:
            try:
                with path.open("rb") as stream:
                    self.files[path] = hashlib.file_digest(stream, "sha256").hexdigest()
            except OSError as error:
                self.files[path] = f"unreadable: {error.errno}"
        return self.files[path]

    def _of_scene(self, path: Path) -> str:
        """With the perception table that it names."""
        if path not in self.scenes:
            self.scenes[path] = self._of_file(path)
            with suppress(IdentificationError):  # told by whoever tunes for it
                named = str(ident.load_mapping(path).get("perception", "default"))
                self.scenes[path] += self._of_file(path.parent / named)
        return self.scenes[path]


@command()
def fleet_command(
    session: Session,
    manifest: Annotated[
        Path,
        Argument(
            help="A table (CSV) or YAML with a row for each device: serial; log or device; where "
            "they differ axis, hardware, scene, date, operator."
        ),
    ],
    scene: Annotated[
        Path | None, Option(metavar="SCENE", help="scene.yaml of all that name none.")
    ] = None,
    output: Annotated[
        Path, Option("-o", "--output", metavar="FOLDER", help="Folder of the fleet.")
    ] = Path("fleet"),
    *,
    options: opt.LogOptions,
    hardware: opt.HardwareFile = None,
    allow: opt.Allow = None,
    method: opt.MethodOption = "auto",
    margin: opt.MarginOption = None,
    workers: Annotated[
        int | None, Option(min=1, help="Processes on this machine; default one for each processor.")
    ] = None,
    scheduler: Annotated[
        str | None,
        Option(
            metavar="ADDRESS",
            help="Work on a Dask cluster, tcp://HOST:PORT, whose workers see the same files "
            "(extra fleet).",
        ),
    ] = None,
    dry_run: opt.DryRun = False,
) -> None:
    """A profile for each device of a manifest, in parallel, with a table and a page of all.

    What is done and unchanged is not done again; one refusal stops no other device.
    """
    from tune.cli.profiles import read_request
    from tune.optimisation.study import in_parallel

    common: dict[str, Any] = {"columns": options.columns(), "method": method, "margin": margin}
    common |= {"allow": tuple(sorted(allow or ())), "scene": scene, "hardware": hardware}
    refuse_standard_output(output)
    jobs = list(_jobs(manifest, common))
    if scene is not None:
        read_request(scene, margin)
    if hardware is not None:
        ident.load_document(ident.Hardware, hardware)
    _make(output, dry_run=dry_run)
    if not dry_run:
        for folder in (output / _PROFILES, output / _RECORDS):
            _make(folder)
        for name in (_TABLE, _PAGE):
            session.target(output / name, manifest, scene, hardware)
    rows, sealed = _known(session, output, jobs)
    left = [place for place, row in enumerate(rows) if row is None]
    all_ = ident.counted(len(jobs), "device")
    session.say(f"{all_}, {len(jobs) - len(left)} done before")
    session.details |= {"devices": len(jobs), "done_before": len(jobs) - len(left)}
    if dry_run:
        session.say_each(f"dry run: {jobs[place].entry.name} would be done" for place in left)
        return
    with session.progress("starting workers") as say:
        waiting = [jobs[place] for place in left]
        done = in_parallel(_calibrated, waiting, workers=workers or -1, scheduler=scheduler)
        for number, (turn, (row, text)) in enumerate(done, start=1):
            place = left[turn]
            _store(output, jobs[place].entry.name, sealed[place], row, text)
            rows[place] = row
            done_now = f"{len(jobs) - len(left) + number} of {all_} done"
            session.so_far = f"{done_now}; run it again for the rest"
            say(f"calibrating {jobs[place].entry.name} and others ({number} of {len(left)})")
    _conclude(session, f"Fleet of {manifest.name}", output, cast("list[dict[str, Any]]", rows))


def _known(
    session: Session, output: Path, jobs: list[_Job]
) -> tuple[list[dict[str, Any] | None], list[str]]:
    """The row of each device that is done and unchanged, and the digests of what all come from."""
    from importlib.metadata import version

    digests = _Digests([version(each) for each in ("haptune", "numpy", "python-flint")])
    rows, sealed = list[dict[str, Any] | None](), list[str]()
    with session.progress() as say:
        for number, job in enumerate(jobs, start=1):
            say(f"comparing with what is done ({number} of {len(jobs)})")
            sealed.append(digests.of(job))
            rows.append(_kept(output, job.entry.name, sealed[-1]))
    return rows, sealed


def _conclude(session: Session, title: str, output: Path, rows: list[dict[str, Any]]) -> None:
    """Write table and page of all devices. Raises DevicesRefusedError where some are refused."""
    from tune.optimisation.study import frame_of
    from tune.presentation.fleet import fleet_html, fleet_verdicts, unlike_others

    frame = frame_of(rows)
    unlike = unlike_others(frame)
    session.details |= {"unlike": [asdict(each) for each in unlike], "rows": rows}
    stream = BytesIO()
    frame.write_parquet(stream)
    with session.progress("drawing"):
        page = fleet_html(title, frame, unlike)
    session.store(output / _TABLE, stream.getvalue())
    session.store(output / _PAGE, page.encode())
    session.say_each(fleet_verdicts(frame, unlike))
    refused = [row for row in rows if row["exit_code"]]
    if refused:
        told = [f"{row['name']} ({row['exit_code']}): {row['sentence']}" for row in refused]
        more = [f"and {len(told) - _MOST_TOLD} more"] if len(told) > _MOST_TOLD else []
        all_ = ident.counted(len(rows), "device")
        first = f"{len(refused)} of {all_} without a profile; {output / _TABLE} says why"
        sentence = "\n".join([first, *told[:_MOST_TOLD], *more])
        raise DevicesRefusedError(sentence, refused[0]["exit_code"])


def _jobs(manifest: Path, common: dict[str, Any]) -> Iterator[_Job]:
    """What is to be done; files that the manifest names lie beside it. Raises UsageError."""
    from tune.documents.manifest import load_manifest

    for entry in load_manifest(manifest).devices:
        own: dict[str, Any] = {
            each: manifest.parent / name
            for each in ("scene", "hardware", "device")
            if (name := getattr(entry, each)) is not None
        }
        device = own.pop("device", None)
        own["device"] = str(device) if device is not None and device.exists() else entry.device
        own["logs"] = tuple(manifest.parent / log for log in entry.log)
        if (common | own)["scene"] is None:
            seen = f"{entry.name} has no scene"
            raise UsageError("--scene", seen, "Give --scene, or a column 'scene' in the manifest")
        yield _Job(entry=entry, **(common | own))


def _calibrated(job: _Job) -> tuple[dict[str, Any], str | None]:
    """The row of one device and its profile's text; runs in a worker, which writes nothing."""
    from tune.cli.profiles import read_request, tune_device
    from tune.optimisation.study import attempted, device_columns, profile_columns

    session = Session(command="fleet", as_json=True, quiet=True, no_input=True)
    row: dict[str, Any] = {}

    def tuned() -> SafeProfile:
        wish = read_request(job.scene, job.margin)
        device = _device(session, job)
        row.update({"motion": None if "motion" in device.missing else device.motion})
        row.update({"axis": device.axis} | device_columns(device))
        device.require_stated(
            subject=job.hardware or f"the device of {job.entry.name}", where=_IN_MANIFEST
        )
        return tune_device(session, device, wish)

    code, sentence, profile = attempted(tuned)
    entry = job.entry
    findings = dict.fromkeys(each.code for each in session.findings)
    head = {"name": entry.name, "serial": entry.serial, "axis": entry.axis, "motion": None}
    head |= {"exit_code": int(code), "sentence": sentence, "digest": None}
    row = head | row | {"findings": ", ".join(findings)}
    if profile is None:
        return row, None
    return row | profile_columns(profile), profile.to_yaml()


def _device(session: Session, job: _Job) -> Device:
    """The device of an entry, with what the entry says of it. Raises as `identify`."""
    from tune.cli.logs import identify_logs

    entry = job.entry
    if job.device is not None:
        device = ident.load_device(job.device)
        if device.serial not in {None, entry.serial}:
            seen = f"states serial {device.serial}, and the manifest {entry.serial}"
            raise InvalidInputError(job.device, seen, "Correct one of them")
    else:
        columns = replace(job.columns, axis=entry.axis or job.columns.axis)
        device = identify_logs(
            session, list(job.logs), columns, job.hardware, job.method, list(job.allow)
        ).device
    said = {name: getattr(entry, name) for name in ("serial", "date", "operator")}
    content = ident.to_mapping(device) | {key: each for key, each in said.items() if each}
    return ident.parse_document(ident.Device, content, f"{entry.name} of the manifest")


def _paths(folder: Path, name: str) -> tuple[Path, Path]:
    """(profile, record) of a device."""
    return folder / _PROFILES / f"{name}.yaml", folder / _RECORDS / f"{name}.json"


def _kept(folder: Path, name: str, inputs: str) -> dict[str, Any] | None:
    """The row of a device that was done from the same inputs; None where it is to be done."""
    profile, record = _paths(folder, name)
    try:
        found = json.loads(record.read_text(encoding="utf-8"))
        if found["inputs"] != inputs or found["row"]["exit_code"] == Exit.INTERNAL_ERROR:
            return None
        if found["profile"] != (profile.exists() and _sha(profile.read_bytes())):
            return None
        return found["row"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _store(folder: Path, name: str, inputs: str, row: dict[str, Any], text: str | None) -> None:
    """Write the profile of a device and then its record: one without the other is done again."""
    profile, record = _paths(folder, name)
    content = None if text is None else text.encode()
    try:
        if content is not None:
            ident.write_bytes(profile, content)
        elif profile.exists():
            ident.write_bytes(profile, b"")  # keeps what stood there under another name
            profile.unlink()
        record.unlink(missing_ok=True)
    except OSError as error:
        raise NotWrittenError(profile, error.strerror or str(error)) from None
    whole = content is not None and _sha(content)
    sealed = {"schema": "haptune/record/1", "inputs": inputs, "profile": whole, "row": row}
    ident.write_bytes(record, (json.dumps(sealed, indent=1) + "\n").encode())


def _sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _make(folder: Path, *, dry_run: bool = False) -> None:
    try:
        if not dry_run or folder.exists() or not folder.parent.exists():
            folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        raise NotWrittenError(folder, f"there is no folder {folder.parent}") from None
    except OSError as error:
        raise NotWrittenError(folder, error.strerror or str(error)) from None
