"""Picture of the architecture, drawn from the imports: rooms on their floors, what they import.

``python -m tests.architecture_picture`` writes docs/architecture.svg, and what it shows as a table,
docs/architecture.csv. Rooms and floors are those of `tests.test_architecture`.
"""

# matplotlib types its keyword arguments only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.test_architecture import ROOT, Graph, file_graph, floors, room_graph

DOCS = ROOT / "docs"
#: Packages that the picture shows side by side, and their colours.
SHOWN = {"identification": "#cfe0f1", "tune": "#f9d9c8"}
#: Width and height of a room, and the distance between floors.
_WIDE, _HIGH, _UP = 1.75, 0.42, 1.0
#: Bend of an arrow past other floors, so that it misses the rooms there.
_BEND = -0.28


def table(graphs: dict[str, Graph]) -> str:
    """One line a room: package, room, floor, and the rooms of the package that it imports."""
    lines = ["package,room,floor,imports"]
    for package, rooms in graphs.items():
        high = floors(rooms)
        lines += [
            f"{package},{room},{floor},{' '.join(sorted(rooms[room]))}"
            for room, floor in sorted(high.items(), key=lambda each: (each[1], each[0]))
        ]
    return "\n".join(lines) + "\n"


def needed(rooms: Graph) -> list[tuple[str, str]]:
    """(room, room it imports) less what follows from a longer way: the transitive reduction."""
    below: Graph = {}
    for room in sorted(rooms, key=floors(rooms).__getitem__):
        below[room] = set(rooms[room]).union(*(below[each] for each in rooms[room]))
    return [
        (room, each)
        for room in sorted(rooms)
        for each in sorted(rooms[room])
        if not any(each in below[other] for other in rooms[room])
    ]


def draw(graphs: dict[str, Graph], target: Path) -> None:
    """Draw the rooms of each package on their floors, with the imports that are needed."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context({"svg.hashsalt": "haptune", "svg.fonttype": "none"}):
        figure = Figure(figsize=(7, 12), layout="constrained")
        axes = figure.subplots(len(graphs), 1, squeeze=False)[:, 0]
        for place, (package, rooms) in zip(axes, graphs.items(), strict=True):
            _draw_package(place, package, rooms)
        figure.savefig(target, metadata={"Date": None})


def _broadest(rooms: Graph) -> int:
    high = list(floors(rooms).values())
    return max(high.count(floor) for floor in high)


def _draw_package(axes: Any, package: str, rooms: Graph) -> None:
    places = _places(rooms)
    for room, each in needed(rooms):
        (x, y), (u, v) = places[room], places[each]
        axes.annotate(
            "",
            xy=(u, v + _HIGH / 2),
            xytext=(x, y - _HIGH / 2),
            arrowprops={
                "arrowstyle": "->",
                "color": "#666666",
                "linewidth": 0.9,
                "connectionstyle": f"arc3,rad={_BEND if y - v > _UP else 0}",
            },
            zorder=1,
        )
    for room, (x, y) in places.items():
        axes.text(
            x,
            y,
            room,
            ha="center",
            va="center",
            fontsize=10.5,
            zorder=2,
            bbox={
                "boxstyle": "round,pad=0.35",
                "facecolor": SHOWN[package],
                "edgecolor": "#333333",
            },
        )
    half = _WIDE * _broadest(rooms) / 2
    top = max(floors(rooms).values())
    axes.set(xlim=(-half, half), ylim=(0.5, top * _UP + 0.5), title=package, ylabel="floor")
    axes.set_yticks(range(1, top + 1))
    axes.set_xticks([])
    for side in ("top", "right", "bottom", "left"):
        axes.spines[side].set_visible(False)


def _places(rooms: Graph) -> dict[str, tuple[float, float]]:
    """Middle of each room; those of a floor stand above what they import, as far as they fit."""
    high = floors(rooms)
    places: dict[str, tuple[float, float]] = {}
    for floor in range(1, max(high.values()) + 1):
        here = [room for room in sorted(rooms) if high[room] == floor]

        def middle(room: str) -> float:
            below = [places[each][0] for each in rooms[room]]
            return sum(below) / len(below) if below else 0.0

        here.sort(key=lambda room: (middle(room), room))
        for index, room in enumerate(here):
            shift = 0.3 * _WIDE if len(here) % 2 and floor % 2 else 0.0
            places[room] = ((index - (len(here) - 1) / 2) * _WIDE + shift, floor * _UP)
    return places


def shown_graphs() -> dict[str, Graph]:
    """Rooms of each package that the picture shows, and what they import of it."""
    return {package: room_graph(file_graph(package)) for package in SHOWN}


if __name__ == "__main__":
    graphs = shown_graphs()
    (DOCS / "architecture.csv").write_text(table(graphs), encoding="utf-8")
    draw(graphs, DOCS / "architecture.svg")
