"""A section as a page of Markdown, and the page that leads to all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from benchmarks.section import Section, sentences, time_words


def page(section: Section, about: Mapping[str, Any]) -> str:
    """Text, picture, who is at the front, tables."""
    parts = [f"# {section.title}", section.text.strip(), _about(about)]
    if section.cells:
        parts.append(f"![{section.title}]({section.name}.png)")
        parts.append(
            "The grey line joins those that are surely more accurate than all that are faster."
        )
        parts.append("\n".join(sentences(section)))
        parts.append("## Every number\n\n" + _table(section))
    if section.rows:
        heading = "## Further\n\n" if section.cells else ""
        parts.append(heading + _rows(section))
    return "\n\n".join(parts) + "\n"


def index(sections: Mapping[str, Mapping[str, Any]], order: Iterable[str]) -> str:
    """The page of contents."""
    known = [name for name in order if name in sections]
    lines = [
        f"- [{sections[name]['title']}]({name}.md), {sections[name]['date']}" for name in known
    ]
    toctree = "\n".join(known)
    return f"""# Benchmarks

Run time set against error, beside what others use, in the same run.

```sh
python -m pip install ".[benchmarks]"
python -m benchmarks --write docs/benchmarks   # these pages; names of parts measure only those
python -m benchmarks stability --compare       # ratios of times beside the last that were kept
```

The comparison fails where a ratio grew by more than half over the last of `history.jsonl`, which
has the ratios of every run; `results.json` has all numbers.

{chr(10).join(lines)}

Ours is at the front of a picture where it is surely more accurate than all that are faster: their
95 % intervals do not meet. Each page says where a peer is surely ahead, and why.

:::{{toctree}}
:hidden:

{toctree}
:::
"""


def _about(about: Mapping[str, Any]) -> str:
    versions = ", ".join(
        f"{name} {number}"
        for name, number in about["versions"].items()
        if number != "not installed"
    )
    return (
        f"Measured on {about['date']}, one thread, in {about['seconds']:.0f} s of the processor: "
        f"{about['machine']}; {versions}."
    )


def _table(section: Section) -> str:
    lines = [f"| case | method | time | {section.error} | note |", "|---|---|---|---|---|"]
    for case in section.cases:
        for cell in section.of(case):
            error = "–" if cell.error is None else f"{cell.error:.3g}"
            if cell.interval is not None:
                error += f" ({cell.interval[0]:.3g} to {cell.interval[1]:.3g})"
            name = f"**{cell.method}**" if cell.ours else cell.method
            lines.append(
                f"| {case} | {name} | {time_words(cell)} | {error} | {_plain(cell.note)} |"
            )
    return "\n".join(lines)


def _rows(section: Section) -> str:
    lines = ["| what | time | result | beside |", "|---|---|---|---|"]
    for row in section.rows:
        took = row.time_text() if row.seconds else "–"
        lines.append(f"| {row.what} | {took} | {_plain(row.error)} | {_plain(row.against)} |")
    return "\n".join(lines)


def _plain(text: str) -> str:
    """Bars and line ends would end a cell."""
    return " ".join(text.replace("|", "/").split())
