"""Tables of the terminal as tables of a page: the very same numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tune.presentation.page import TableView

if TYPE_CHECKING:
    from rich.table import Table


def table_view(table: Table) -> TableView:
    """Title, headings, cells and caption of a table, as text."""
    columns = [[_plain(cell) for cell in column.cells] for column in table.columns]
    return TableView(
        title=_plain(table.title or ""),
        headings=tuple(_plain(column.header) for column in table.columns),
        numeric=tuple(column.justify == "right" for column in table.columns),
        rows=tuple(zip(*columns, strict=True)),
        lines=tuple(_plain(table.caption).splitlines()) if table.caption else (),
    )


def _plain(item: object) -> str:
    """The text of a cell; a rich Text has its own."""
    return str(getattr(item, "plain", item))
