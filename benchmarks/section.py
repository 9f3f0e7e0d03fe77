"""One part of the benchmarks: what was measured, and who is at the front."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.row import Row, with_unit

#: Closer than this part of one another, times count as equal, and errors without an interval.
_ALIKE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One method on one case."""

    case: str  # what is asked
    method: str  # who answers
    ours: bool = False  # haptune does
    seconds: float | None = None  # of one answer; None where there is none
    error: float | None = None  # as the section says; None where there is no answer
    interval: tuple[float, float] | None = None  # 95 % of the error, where it scatters over seeds
    note: str = ""  # what else is known, or why there is no answer
    unsafe: bool = False  # it lets through what is unstable: it is drawn, and at no front

    @property
    def answered(self) -> bool:
        """There is a time and an error, and no harm in the answer."""
        return self.seconds is not None and self.error is not None and not self.unsafe

    def span(self, floor: float) -> tuple[float, float]:
        """Least and largest error that scatter allows, not below a floor."""
        error = np.inf if self.error is None else self.error
        low, high = self.interval or (error * (1 - _ALIKE / 2), error * (1 + _ALIKE / 2))
        return max(low, floor), max(high, floor)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A page."""

    name: str  # of the file
    title: str
    text: str  # what is measured and how to read it, Markdown
    cells: tuple[Cell, ...] = ()  # for the picture of error against time
    error: str = "error"  # what the errors are, for the axis
    floor: float = 1e-16  # smaller errors are drawn there
    #: of a method of ours: why a peer may be ahead of it
    reasons: dict[str, str] = field(default_factory=dict[str, str])
    rows: tuple[Row, ...] = ()  # further lines, without a picture
    #: by name; smaller is better. They are kept and compared.
    ratios: dict[str, float] = field(default_factory=dict[str, float])
    shown: tuple[str, ...] = ()  # cases of a second, smaller picture

    @property
    def cases(self) -> list[str]:
        """In the order measured."""
        return list(dict.fromkeys(cell.case for cell in self.cells))

    def of(self, case: str) -> list[Cell]:
        """Cells of a case."""
        return [cell for cell in self.cells if cell.case == case]


def ahead_of(cell: Cell, others: list[Cell], floor: float) -> list[Cell]:
    """Those that are both faster and more accurate, beyond what scatters."""
    return [other for other in _faster(cell, others) if other.span(floor)[1] < cell.span(floor)[0]]


def at_the_front(cells: list[Cell], floor: float) -> list[Cell]:
    """Those surely more accurate than all that are faster, fastest first."""
    answered = [cell for cell in cells if cell.answered]
    free = [
        cell
        for cell in answered
        if all(cell.span(floor)[1] < other.span(floor)[0] for other in _faster(cell, answered))
    ]
    return sorted(free, key=lambda cell: cell.seconds or 0.0)


def _faster(cell: Cell, others: list[Cell]) -> list[Cell]:
    limit = (cell.seconds or 0.0) * (1 - _ALIKE)
    return [other for other in others if other.answered and (other.seconds or 0.0) < limit]


def sentences(section: Section) -> list[str]:
    """Of each case: who is at the front; of each method of ours: which peers are ahead of it."""
    lines: list[str] = []
    for case in section.cases:
        cells = section.of(case)
        front = ", ".join(
            f"{'**' if cell.ours else ''}{cell.method}{'**' if cell.ours else ''}"
            for cell in at_the_front(cells, section.floor)
        )
        lines.append(f"- *{case}*: at the front, fastest first: {front}.")
        peers = [cell for cell in cells if not cell.ours]
        for cell in (cell for cell in cells if cell.ours):
            before = ahead_of(cell, peers, section.floor)
            if not cell.answered:
                lines.append(f"  {cell.method}: {cell.note}.")
            elif before:
                names = ", ".join(other.method for other in before)
                why = section.reasons.get(cell.method, "")
                lines.append(f"  {cell.method} is behind {names}{': ' + why if why else '.'}")
    return lines


def time_words(cell: Cell) -> str:
    """The time with a unit, or a dash."""
    return "–" if cell.seconds is None else with_unit(cell.seconds)
