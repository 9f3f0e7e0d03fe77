"""Ratios of every run, one JSON line each, and whether a new run is slower than the last."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

#: A ratio of times scatters by less, from run to run and from machine to machine of one kind.
_SLOWER = 1.5


def last_ratios(history: Path) -> dict[str, float]:
    """Of each name the ratio of the last run that has it."""
    found: dict[str, float] = {}
    if history.exists():
        for line in history.read_text(encoding="utf-8").splitlines():
            found |= json.loads(line)["ratios"]
    return found


def append(history: Path, date: str, machine: str, part: str, ratios: Mapping[str, float]) -> None:
    """One line more."""
    short = {name: float(f"{value:.4g}") for name, value in ratios.items()}
    line = {"date": date, "machine": machine, "part": part, "ratios": short}
    with history.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")


def slower(before: Mapping[str, float], now: Mapping[str, float]) -> list[str]:
    """A sentence for each ratio that grew by more than half."""
    return [
        f"{name}: {value:.3g}, {before[name]:.3g} before; at most {_SLOWER:g} times that is allowed"
        for name, value in now.items()
        if name in before and value > _SLOWER * before[name]
    ]
