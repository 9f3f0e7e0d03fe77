"""Questions on a terminal for what only a person knows: columns of a log, facts of a device.

Hints of a log are shown, never filled in. No answer leaves a fact unstated.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import identification as ident
from identification import InvalidInputError, QuestionError, UnstatedError

if TYPE_CHECKING:
    from identification import Device, Hardware, LogColumns, Trajectory, Unstated
    from tune.cli.session import Session

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
    session: Session, columns: LogColumns, read: Callable[[LogColumns], list[Trajectory]]
) -> tuple[LogColumns, list[Trajectory]]:
    """Read logs, asking for one option after the other that they leave open."""
    while True:
        try:
            return columns, read(columns)
        except QuestionError as error:
            if not session.asks:
                raise
            session.tell(f"{error.subject}: {error.problem}.")
            for place, name in enumerate(error.choices, 1):
                session.tell(f"  {place}  {name}")
            columns = _answered(session, columns, error)


def _answered(session: Session, columns: LogColumns, error: QuestionError) -> LogColumns:
    """The columns with one option as a person answers. Raises the error where nobody does."""
    while True:
        said = session.ask(error.question)
        if not said:
            raise error
        numbered = said.isdigit() and 1 <= int(said) <= len(error.choices)
        word = error.choices[int(said) - 1] if numbered else said.replace(",", ".")
        with suppress(ValueError, InvalidInputError):
            if word in error.choices or not error.choices:
                return replace(columns, **{error.option: word if error.choices else float(word)})
        kind = "a number or name of the list" if error.choices else "a number"
        session.tell(f"Answer with {kind}.")


def own_hardware(session: Session, given: Path | None) -> Path | None:
    """The hardware file given, or that of this folder if a person wants it."""
    if given is None and session.asks and HARDWARE.is_file():
        wanted = session.ask(f"Take what {HARDWARE} of this folder states? yes or no")
        return None if wanted.lower().startswith("n") else HARDWARE
    return given


def ask_facts(session: Session, device: Device, known: Hardware | None) -> Hardware | None:
    """What is known with the facts that the device lacks, as a person answers; None for none."""
    before = found = known or ident.Hardware(name=device.name, axis=device.axis)
    try:
        device.require_stated()
    except UnstatedError as error:
        session.tell(f"{len(error.missing)} facts no log tells; a blank answer leaves one open.")
        for fact in error.missing:
            found = _stated(session, found, fact)
    return None if found == before else found


def _stated(session: Session, known: Hardware, fact: Unstated) -> Hardware:
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


def write_hardware(session: Session, path: Path, known: Hardware, *, dry_run: bool) -> None:
    """Keep what was stated, so that it is asked once."""
    text = ident.to_yaml(ident.to_mapping(known), "Stated by a person; numbers in SI units.")
    session.write(path, text, dry_run=dry_run, changes="facts stated")


def device_stating(device: Device, known: Hardware) -> Device:
    """The device with facts that were stated for it."""
    content, stated = ident.to_mapping(device), ident.to_mapping(known)
    new = {fact: stated[fact] for fact in device.unstated() if stated.get(fact) is not None}
    left = [fact for fact in content.get("missing", ()) if fact not in new]
    return ident.parse_document(type(device), content | new | {"missing": left}, device.name)
