"""What logs tell: ``haptune doctor``, ``haptune identify``, and the reading that others share.

On a terminal it is asked for what only a person knows: columns of a log, facts of a device. Hints
of a log are shown, never filled in. No answer leaves a fact unstated.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import identification as ident
from identification import InvalidInputError, LogRefusedError, QuestionError, UnstatedError
from tune.cli import session as opt
from tune.cli.session import Session, command

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from tune.documents.results import IdentifyDetails, LogExamined, ToldQuantity

DEVICE_COMMENT = "Device identified by haptune; intervals are 95 % each, the covariance is joint."


@command(asks=True)
def identify_command(
    session: Session,
    logs: opt.Logs,
    output: opt.DeviceOut = Path("device.yaml"),
    *,
    options: opt.LogOptions,
    hardware: opt.HardwareFile = None,
    allow: opt.Allow = None,
    method: opt.MethodOption = "auto",
    picture: opt.Picture = None,
    dry_run: opt.DryRun = False,
) -> None:
    """Mass, damping and friction with 95 % intervals; several logs give their envelope."""
    session.target(output, *logs, hardware)
    session.target(picture, *logs, hardware, output)
    columns = options.columns()
    result = identify_logs(session, logs, columns, hardware, method, allow or [], dry_run=dry_run)
    if result.device.position_stiffness is not None or result.device.gravity is not None:
        from tune.certificate.certify import refusal_of

        refusal = refusal_of(result.device)
        if refusal is not None:
            session.warn(f"tune will refuse this device: {refusal}")
    session.write(
        output, ident.to_yaml(ident.to_mapping(result.device), DEVICE_COMMENT), dry_run=dry_run
    )
    session.draw(picture, lambda: ident.identified_picture(result.device, result.logs))


def read_log(
    path: Path, columns: ident.LogColumns, hardware: ident.Hardware | None
) -> ident.Trajectory | ident.Trajectories:
    """One log, of the motion and axis, or axes, of its hardware."""
    return ident.load_log(
        path,
        columns,
        motion=None if hardware is None else hardware.motion,
        axis=columns.axis or (None if hardware is None else hardware.axis),
        axes=None if hardware is None else hardware.axes,
    )


def tell_reading(session: Session, *trajectories: ident.Trajectory | ident.Trajectories) -> None:
    """One line a log that is no plain table in SI units: how it was understood."""
    for log in trajectories:
        if log.read_as:
            session.say(f"{log.source}: read with {log.read_as}")
            session.understood[log.source] = log.read_as
            session.details["read_as"] = session.understood


def identify_logs(
    session: Session,
    logs: list[Path],
    columns: ident.LogColumns,
    hardware: Path | None,
    method: ident.Method,
    allow: list[str],
    *,
    brief: bool = False,
    dry_run: bool = False,
) -> ident.Identification:
    """Read logs, identify and show the result, in a line if it is only a part of the work."""
    from tune.presentation.tables import device_line, device_table

    def read(
        columns: ident.LogColumns, known: ident.Hardware | None
    ) -> list[ident.Trajectory | ident.Trajectories]:
        with session.progress("reading logs"):
            return [read_log(path, columns, known) for path in logs]

    def identified(known: ident.Hardware | None) -> ident.Identification:
        with session.progress("identifying"):
            return ident.identify(trajectories, hardware=known, method=method, allow=allow)

    hardware = own_hardware(session, hardware)
    known = None if hardware is None else ident.load_document(ident.Hardware, hardware)
    columns, trajectories = ask_columns(session, columns, lambda columns: read(columns, known))
    result = identified(known)
    stated = ask_facts(session, result.device, known) if session.asks else None
    if stated is not None:
        write_hardware(session, hardware or HARDWARE, stated, dry_run=dry_run)
        trajectories = read(columns, stated)
        result = identified(stated)
    tell_reading(session, *trajectories)
    session.add_findings(result.findings)
    session.details |= identification_details(result)
    short = brief and not session.verbose
    session.say(device_line(result.device) if short else device_table(result.device))
    session.detail(f"method: {result.method}; {result.reason}")
    for fit in result.logs:
        source = fit.trajectory.source
        for other in fit.others:
            mass, damping = other.value("mass"), other.value("damping")
            session.detail(f"{source}, {other.method}: mass {mass:.5g}, damping {damping:.5g}")
        if fit.structure:
            session.detail(f"{source}: {fit.structure}")
    return result


def identification_details(found: ident.Identification) -> IdentifyDetails:
    """The device as its file will hold it, and how each log was identified."""
    from tune.presentation.tables import half_widths

    return {
        "device": ident.to_mapping(found.device),
        "half_widths": half_widths(found.device),
        "method": found.method,
        "logs": [
            {
                "source": fit.trajectory.source,
                "method": fit.method,
                "reason": fit.reason,
                "fitted": fit.fitted,
                "others": [
                    {
                        "method": other.method,
                        "mass": float(other.value("mass")),
                        "damping": float(other.value("damping")),
                    }
                    for other in fit.others
                ],
                "structure": [fit.structure] if fit.structure else [],
            }
            for fit in found.logs
        ],
    }


@command()
def doctor_command(
    session: Session,
    logs: opt.Logs,
    *,
    options: opt.LogOptions,
    hardware: opt.HardwareFile = None,
    allow: opt.Allow = None,
    picture: opt.Picture = None,
) -> None:
    """What each log can and cannot support; ends with 4 if identify would refuse one."""
    from tune.presentation.tables import device_table

    columns = options.columns()
    others = range(2, len(logs) + 1)
    pictures = [picture, *(picture and picture.with_stem(f"{picture.stem}-{n}") for n in others)]
    for each in pictures:
        session.target(each, *logs, hardware)
    known = None if hardware is None else ident.load_document(ident.Hardware, hardware)
    findings: list[ident.Finding] = []
    examined: list[LogExamined] = []
    session.details["logs"] = examined
    refused = False

    @contextmanager
    def told_later() -> Generator[None]:
        """One log that is refused keeps no other from being examined."""
        nonlocal refused
        try:
            yield
        except LogRefusedError as error:
            findings.extend(error.findings)
            refused = True

    several: list[ident.Trajectories] = []
    for path, drawn in zip(logs, pictures, strict=True):
        with told_later():
            with session.progress(f"reading {path.name}"):
                trajectory = read_log(path, columns, known)
            tell_reading(session, trajectory)
            if isinstance(trajectory, ident.Trajectories):
                several.append(trajectory)
                continue
            with session.progress(f"examining {path.name}"):
                seen = ident.examine(trajectory, hardware=known, allow=allow or [])
            examined.append(_examined(seen))
            session.say(_examination_table(seen))
            session.say(_verdict(seen))
            session.draw(drawn, partial(_drawn, trajectory, seen.found))
            findings += seen.findings
            refused |= seen.refused
    poses: list[tuple[ident.Trajectories, ...]] = []
    with told_later():
        poses = ident.poses_of(several)
    for pose, drawn in zip(poses, pictures, strict=False):
        with told_later():
            with session.progress(f"examining {', '.join(log.source for log in pose)}"):
                found = ident.identify(pose, hardware=known, allow=allow or [])
            session.say(device_table(found.device))
            session.say(f"usable, by {found.logs[0].reason}")
            session.draw(drawn, partial(ident.identified_picture, found.device, found.logs))
            findings += found.findings
    if refused:
        raise LogRefusedError(tuple(findings))
    session.add_findings(tuple(findings))


def _drawn(trajectory: ident.Trajectory, found: ident.Identification | None) -> Figure:
    """What identify makes of one log, or the log alone if it makes nothing of it."""
    if found is None:
        return ident.log_picture(trajectory)
    return ident.identified_picture(found.device, found.logs)


def _examination_table(seen: ident.Examination) -> Table:
    from tune.presentation.tables import headed_table, units_of

    units = units_of(seen.motion)
    table = headed_table(seen.source, ("seen in the log", "value"))
    small = f"µ{units['length'].replace('(', '(µ')}"
    count = "none seen" if seen.count is None else f"{1e6 * seen.count:.4g} {small}"
    part = "" if seen.fitted in (None, seen.samples) else f", fitted the {seen.fitted} moving most"
    for name, value in (
        ("length", f"{seen.duration:.4g} s, {seen.samples} samples{part}"),
        ("rate", f"{1 / seen.sample_time:.4g} Hz, usual step {1e3 * seen.sample_time:.4g} ms"),
        ("travel", f"{seen.travel:.4g} {units['length']}"),
        ("peak speed", f"{seen.peak_speed:.4g} {units['speed']}"),
        ("peak force", f"{seen.peak_force:.4g} {units['force']}"),
        ("encoder count", f"{count}; noise of a reading {1e6 * seen.noise:.2g} {small} rms"),
        ("excited band", f"{seen.band[0]:.3g} to {seen.band[1]:.3g} Hz"),
        ("mass", _quantity_words(seen.mass, units["mass"])),
        ("damping", _quantity_words(seen.damping, units["damping"])),
    ):
        table.add_row(name, value)
    return table


def _quantity_words(quantity: ident.Quantity | None, unit: str) -> str:
    if quantity is None:
        return "not told"
    half = (quantity.high - quantity.low) / 2
    share = f" ({100 * half / abs(quantity.value):.2g} %)" if quantity.value else ""
    return f"{quantity.value:.5g} ± {half:.2g} {unit}{share}"


def _verdict(seen: ident.Examination) -> str:
    refusals = list(dict.fromkeys(f.code for f in seen.findings if f.severity == "refusal"))
    warnings = list(dict.fromkeys(f.code for f in seen.findings if f.severity == "warning"))
    if seen.refused:
        return f"not usable: {', '.join(refusals)}; the interval above cannot be relied on"
    return "usable" + (f", with warnings: {', '.join(warnings)}" if warnings else "")


def _with_interval(quantity: ident.Quantity | None) -> ToldQuantity | None:
    from tune.presentation.tables import half_width, relative_half_width

    if quantity is None:
        return None
    return {
        "value": quantity.value,
        "low": quantity.low,
        "high": quantity.high,
        "half_width": half_width(quantity),
        "relative": relative_half_width(quantity),
    }


def _examined(seen: ident.Examination) -> LogExamined:
    return {
        "source": seen.source,
        "motion": seen.motion,
        "usable": not seen.refused,
        "samples": seen.samples,
        "fitted": seen.fitted,
        "duration": seen.duration,
        "sample_time": seen.sample_time,
        "rate_hz": 1 / seen.sample_time,
        "travel": seen.travel,
        "peak_speed": seen.peak_speed,
        "peak_force": seen.peak_force,
        "encoder_count": seen.count,
        "noise": seen.noise,
        "band_hz": seen.band,
        "mass": _with_interval(seen.mass),
        "damping": _with_interval(seen.damping),
    }


#: Where facts are written, and found again.
HARDWARE = Path("hardware.yaml")
#: What to ask for each fact and where it is found; behind each | what is typed.
_QUESTIONS = {
    "motion": "Does the handle move along a line or turn?|linear or rotary",
    "sample_time": "Period of the control loop: the controller's settings, whatever the log has."
    "|seconds, such as 0.001 for 1 kHz",
    "delay": "Delay from command to measurement: the controller's manual, or one sample for most."
    "|seconds, 0 for none",
    "encoder_resolution": "One count of the encoder at the handle: its data sheet, through the "
    "transmission.|m (rotary: rad)",
    "force_limit": "What the actuator gives at the handle: its data sheet, by the transmission."
    "|for long, N (rotary: N·m)|for a moment, N (rotary: N·m)",
}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")


def ask_columns(
    session: Session,
    columns: ident.LogColumns,
    read: Callable[[ident.LogColumns], list[ident.Trajectory | ident.Trajectories]],
) -> tuple[ident.LogColumns, list[ident.Trajectory | ident.Trajectories]]:
    """Read logs, asking for one option after the other that they leave open."""
    asked: list[str] = []
    while True:
        try:
            found = read(columns)
        except QuestionError as error:
            if not session.asks:
                raise
            session.tell(f"{error.subject}: {error.problem}.")
            for name, number in _numbered_choices(error).items():
                session.tell(f"  {number}  {name}" if number != name else f"  {name}")
            answer = _answer(session, error)
            told = f'"{answer}"' if error.choices else f"{answer:g}"
            if error.place is not None and error.option != "time":
                answer = _of_axis(columns, error, answer)
                gains = ("" if each is None else f"{each:g}" for each in answer)
                told = f'"{answer}"' if error.choices else ",".join(gains)
            columns = replace(columns, **{error.option: answer})
            asked.append(f"--{error.option.replace('_', '-')} {told}")
        else:
            if asked:
                session.tell(f"Other commands take this as {' '.join(asked)}")
            return columns, found


def _of_axis(columns: ident.LogColumns, error: QuestionError, answer: Any) -> Any:
    """The option of all axes, with the answer for the one that was asked for."""
    before: Any = getattr(columns, error.option)
    if error.choices:
        parts: list[Any] = before.split(",")
    else:
        count = len(columns.by_axis())
        parts = [*before] if isinstance(before, tuple) else [before] * count
    parts[error.place or 0] = answer
    return ",".join(parts) if error.choices else tuple(parts)


def _numbered_choices(error: QuestionError) -> dict[str, str]:
    """What to type for each choice beside itself; where names are numbers, only themselves."""
    alone = any(name.isdigit() for name in error.choices)
    return {name: name if alone else str(place) for place, name in enumerate(error.choices, 1)}


def _answer(session: Session, error: QuestionError) -> Any:
    """A name or a number as a person answers. Raises the error where nobody does."""
    names = {number: name for name, number in _numbered_choices(error).items()}
    while True:
        said = session.ask(error.question)
        if not said:
            raise error
        if said in error.choices or said in names:
            return said if said in error.choices else names[said]
        with suppress(ValueError, InvalidInputError):
            if not error.choices:
                number: Any = float(said.replace(",", "."))
                ident.LogColumns(**{error.option: number})  # refuses what is no gain
                return number
        kind = "a number or name of the list" if error.choices else "a number"
        session.tell(f"Answer with {kind}.")


def own_hardware(session: Session, given: Path | None) -> Path | None:
    """The hardware file given, unless answers are yet to make it, or this folder's if wanted."""
    if session.asks and given == HARDWARE and not HARDWARE.is_file():
        return None
    if given is None and session.asks and HARDWARE.is_file():
        wanted = session.ask(f"Take what {HARDWARE} of this folder states? yes or no")
        return None if wanted.lower().startswith("n") else HARDWARE
    return given


def ask_facts(
    session: Session, device: ident.Device, known: ident.Hardware | None
) -> ident.Hardware | None:
    """What is known with the facts that the device lacks, as a person answers; None for none."""
    named = {"axis": device.axis} if device.axes is None else {"axes": device.axes}
    before = found = known or ident.Hardware.model_validate({"name": device.name, **named})
    try:
        device.require_stated()
    except UnstatedError as error:
        facts = f"{ident.counted(len(error.missing), 'fact')} no log tells"
        session.tell(f"{facts}; a blank answer leaves one open.")
        for fact in error.missing:
            found = _stated(session, found, fact)
    return None if found == before else found


def _stated(session: Session, known: ident.Hardware, fact: ident.Unstated) -> ident.Hardware:
    """What is known with one more fact, or as it is where nothing was answered."""
    question, *prompts = _QUESTIONS[fact.key].split("|")
    session.tell(f"\n{fact.key.replace('_', ' ')}. {question}")
    if fact.hint:
        session.tell(f"  (a hint, which is not used: {fact.hint})")
    while True:
        said = [session.ask(f"  {prompt}") for prompt in prompts]
        if not all(said):
            return known
        content = ident.to_mapping(known) | {fact.key: _content(fact.key, said)}
        try:
            return ident.parse_document(ident.Hardware, content, fact.key)
        except InvalidInputError as error:
            session.tell(f"{error.problem}. Please answer again.")


def _content(key: str, said: list[str]) -> Any:
    """Answers as a hardware file holds them; what is no number is left for it to refuse."""
    words = [each.lower().replace(",", ".") for each in said]
    numbers = [float(each) if _NUMBER.fullmatch(each) else each for each in words]
    return {"continuous": numbers[0], "peak": numbers[-1]} if key == "force_limit" else numbers[0]


def write_hardware(session: Session, path: Path, known: ident.Hardware, *, dry_run: bool) -> None:
    """Keep what was stated, so that it is asked once."""
    text = ident.to_yaml(ident.to_mapping(known), "Stated by a person; numbers in SI units.")
    session.write(path, text, dry_run=dry_run, changes="facts stated")


def device_stating(device: ident.Device, known: ident.Hardware) -> ident.Device:
    """The device with facts that were stated for it."""
    content, stated = ident.to_mapping(device), ident.to_mapping(known)
    new = {fact: stated[fact] for fact in device.unstated() if stated.get(fact) is not None}
    left = [fact for fact in content.get("missing", ()) if fact not in new]
    return ident.parse_document(type(device), content | new | {"missing": left}, device.name)
