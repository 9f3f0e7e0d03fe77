"""What names one device among its kind: serial number, date of calibration, operator."""

from __future__ import annotations

import datetime
from typing import Annotated

from pydantic import BeforeValidator, Field

#: Characters of a name; more is a text.
_LONGEST = 120


def _one_line(raw: object) -> object:
    if isinstance(raw, int | float):
        raise ValueError("put it in quotes; a number loses its leading zeros")
    if isinstance(raw, str) and not (raw.strip() and raw.isprintable()):
        raise ValueError("give one line of text, or leave the key out")
    return raw


def _iso_date(raw: object) -> object:
    try:
        return datetime.date.fromisoformat(str(raw)).isoformat()
    except ValueError:
        raise ValueError("give a date as year-month-day, such as 2026-11-22") from None


#: One line of text.
Label = Annotated[str, BeforeValidator(_one_line), Field(max_length=_LONGEST)]
#: A day as year-month-day (ISO 8601).
Day = Annotated[str, BeforeValidator(_iso_date), Field(json_schema_extra={"format": "date"})]
