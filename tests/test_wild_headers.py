"""Ways in which logs are headed in the wild: read, or refused with an option that works."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification import InvalidInputError, LogColumns, QuestionError, load_trajectory

STEP, COUNT = 0.001, 250
TIME = STEP * np.arange(COUNT)
FORCE = np.round(np.sin(200 * TIME), 4)
POSITION = np.round(0.01 * np.cos(170 * TIME), 6)


def _rows(between: str, comma: bool, scales: tuple[float, float, float]) -> list[str]:
    columns = zip(TIME, FORCE, POSITION, strict=True)
    lines = [
        between.join(f"{x * size:.10g}" for x, size in zip(row, scales, strict=True))
        for row in columns
    ]
    return [line.replace(".", ",") for line in lines] if comma else lines


def _table(header: str, between: str = ",", *, comma: bool = False, scales: Any = (1, 1, 1)) -> str:
    return "\n".join([header, *_rows(between, comma, scales), ""])


def _clocked(header: str, stamps: list[str], between: str = ",", *, comma: bool = False) -> str:
    rows = (row.split(between, 1)[1] for row in _rows(between, comma, (1, 1, 1)))
    lines = [f"{stamp}{between}{row}" for stamp, row in zip(stamps, rows, strict=True)]
    return "\n".join([header, *lines, ""])


def _stamps(text: str) -> list[str]:
    """Times of day from just before midnight on, by a format of milliseconds."""
    found = [(86_399_990 + k) % 86_400_000 for k in range(COUNT)]
    return [
        text.format(h=k // 3_600_000, m=k // 60_000 % 60, s=k // 1000 % 60, ms=k % 1000)
        for k in found
    ]


MILLI = (1e3, 1.0, 1e3)
LABVIEW = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n\t\n"
READ = {
    "units alone": _table("s,N,m"),
    "units alone in brackets": _table("[s];[N];[m]", ";"),
    "units alone, German numbers": _table("ms;N;mm", ";", comma=True, scales=MILLI),
    "abbreviations": _table("t,F,x"),
    "abbreviations, q": _table("t\tF\tq", "\t"),
    "torque and angle": _table("t,tau,theta"),
    "German, decimal commas": _table("Zeit [ms];Kraft [N];Weg [mm]", ";", comma=True, scales=MILLI),
    "German, DIN": _table("t/ms;F/N;x/mm", ";", comma=True, scales=MILLI),
    "German, in": _table("Zeit in s\tKraft in N\tWeg in mm", "\t", scales=(1, 1, 1e3)),
    "German, seconds": _table("Zeit [Sek];Kraft [N];Lage [m]", ";", comma=True),
    "German, turned": _table("Zeit;Drehmoment [Nmm];Winkel [°]", ";", scales=(1, 1e3, 180 / np.pi)),
    "degrees": _table("time,torque (N·mm),angle (°)", scales=(1, 1e3, 180 / np.pi)),
    "degrees, the other sign": _table("t,torque [Nm],angle [º]", scales=(1, 1, 180 / np.pi)),
    "French": _table("temps (s),force (N),déplacement (mm)", scales=(1, 1, 1e3)),
    "Spanish": _table("tiempo,fuerza,posición"),
    "Italian": _table("tempo;forza;posizione", ";"),
    "capitals with units": _table("TIME_MS,FORCE_N,POS_MM", scales=MILLI),
    "title above": "Rig 7, run 3\n\n" + _table("t,F,x"),
    "title and units below": "run 3\nZeit;Kraft;Weg\n[ms];[N];[mm]\n"
    + "\n".join(_rows(";", True, MILLI)),
    "unknown names, units below": "Kanal 1;Kanal 2;Kanal 3\nms;N;mm\n"
    + "\n".join(_rows(";", False, MILLI)),
    "comment above units": "# rig 7\n" + _table("t (ms)\tF (N)\tx (mm)", "\t", scales=MILLI),
    "percent header": _table("% t, F, x"),
    "quoted": _table('"Time [s]","Force [N]","Position [m]"'),
    "LabVIEW, German": LABVIEW
    + "\n".join(["X_Value\tKraft\tWeg\tComment", *_rows("\t", True, (1, 1, 1)), ""]),
    "ISO": _clocked("time,force,position", _stamps("2026-11-23T{h:02}:{m:02}:{s:02}.{ms:03}")),
    "ISO with zone": _clocked("t,F,x", _stamps("2026-11-23T{h:02}:{m:02}:{s:02}.{ms:03}+01:00")),
    "ISO with Z": _clocked("t,F,x", _stamps("2026-11-23T{h:02}:{m:02}:{s:02}.{ms:03}Z")),
    "ISO with a space": _clocked("t,F,x", _stamps("2026-11-23 {h:02}:{m:02}:{s:02}.{ms:03}")),
    "clock": _clocked("time,force,position", _stamps("{h:02}:{m:02}:{s:02}.{ms:03}")),
    "clock, colons": _clocked("t;F;x", _stamps("{h:02}:{m:02}:{s:02}:{ms:03}"), ";"),
    "clock, German": _clocked(
        "Zeit;Kraft;Weg", _stamps("{h:02}:{m:02}:{s:02},{ms:03}"), ";", comma=True
    ),
    "day and clock, German": _clocked(
        "Zeitstempel;Kraft [N];Weg [m]",
        _stamps("23.11.2026 {h:02}:{m:02}:{s:02},{ms:03}"),
        ";",
        comma=True,
    ),
    "clock of twelve hours": _clocked(
        "time,force,position", [f"11/23/2026 12:00:00.{k:03} AM" for k in range(COUNT)]
    ),
    "minutes": _clocked("t,F,x", [f"12:00.{k:03}" for k in range(COUNT)]),
    "clock with a unit": _clocked(
        "Zeit [ms];Kraft;Weg", _stamps("{h:02}:{m:02}:{s:02}.{ms:03}"), ";"
    ),
}
#: What needs a word of a person; every option told is pasted, after a choice where there are two.
REFUSED = {
    "headless": _table("").lstrip(),
    "headless, tabs": _table("", "\t").lstrip(),
    "headless, spaces": _table("", " ").lstrip(),
    "headless, German": _table("", ";", comma=True).lstrip(),
    "headless below a comment": "# rig 7" + _table(""),
    "channels": _table("Channel1,Channel2,Channel3"),
    "channels of a German amplifier": _table("Kanal 1;Kanal 2;Kanal 3", ";", comma=True),
    "LabVIEW, untitled": LABVIEW
    + "\n".join(["X_Value\tUntitled\tUntitled 1\tComment", *_rows("\t", False, (1, 1, 1)), ""]),
    "two positions": _table("t,F,x")
    .replace("t,F,x", "t,F,x,pos")
    .replace("\n", ",1\n")
    .replace("pos,1", "pos"),
    "volts": _table("t,F [V],x"),
    "amperes": _table("Zeit;Strom [A];Weg", ";"),
    "amperes below a comment": "# rig 7\n" + _table("t,motor current [A],pos (m)"),
    "counts": _table("time,force,position [counts]"),
    "unknown unit": _table("time,force [kp],position"),
    "units alone, amperes": _table("s;A;m", ";"),
    "unnamed": _table(",,"),
    "twice": _table("time,value,value"),
    "thousands": _table("t;F;x", ";").replace("\n0.001;", "\n1,234;", 1),
}


#: What no option mends: the sentence says what to do to the file.
NO_OPTION = {"twice", "thousands", "unnamed"}


@pytest.mark.parametrize("name", READ)
def test_it_is_read(name: str, tmp_path: Path) -> None:
    path = tmp_path / ("log.lvm" if "LabVIEW" in name else "log.csv")
    path.write_text(READ[name], encoding="utf-8")
    log = load_trajectory(path)
    np.testing.assert_allclose(log.time - log.time[0], TIME, atol=1e-9)
    np.testing.assert_allclose(log.force, FORCE, atol=1e-9)
    np.testing.assert_allclose(log.position, POSITION, atol=1e-9)
    assert "duplicated" not in log.read_as


def _told(error: InvalidInputError) -> dict[str, str]:
    """Options that a refusal tells, as they are pasted."""
    said = str(error)
    assert not re.search(r"duplicated|polars|column_\d", said), said
    found = re.findall(r'--([a-z-]+) ("[^"]*"|X|comma)', said)
    return {option.replace("-", "_"): shlex.split(value)[0] for option, value in found}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_with_an_option_that_works(name: str, tmp_path: Path) -> None:
    path = tmp_path / ("log.lvm" if "LabVIEW" in name else "log.csv")
    path.write_text(REFUSED[name], encoding="utf-8")
    given: dict[str, Any] = {}
    for _ in range(5):
        try:
            log = load_trajectory(path, LogColumns(**given))
            np.testing.assert_allclose(log.force, FORCE, atol=1e-9)
            return
        except InvalidInputError as error:
            told, refused = _told(error), error
        for option, word in told.items():
            given[option] = 1.0 if word == "X" else word
        if isinstance(refused, QuestionError):  # where two columns may be meant, a person chooses
            given.setdefault(refused.option, refused.choices[0] if refused.choices else 1.0)
        elif not told:
            assert name in NO_OPTION, str(refused)
            return
    raise AssertionError(given)
