"""How large a log may be, and what is refused before any memory is spent on it.

Packed files can claim or unfold to far more than their size on disk.
"""

from __future__ import annotations

from math import prod
from pathlib import Path

from identification.errors import InvalidInputError
from identification.readers.columns import quote

#: Bytes. A CSV log of MOST_SAMPLES rows of three full-precision numbers is about 1.2 GB.
LARGEST_FILE = 2_000_000_000
#: Bytes of the header line and columns of a table: memory is spent on each name.
LONGEST_HEADER = 5_000_000
MOST_COLUMNS = 10_000
#: How packed streams begin; a reader of text would unpack some of them by itself.
_PACKED = {
    b"\x1f\x8b": "gzip",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"\x78\x01": "zlib",
    b"\x78\x5e": "zlib",
    b"\x78\x9c": "zlib",
    b"\x78\xda": "zlib",
    b"PK\x03\x04": "zip or spreadsheet",
    b"\xfd7zXZ\x00": "xz",
    b"BZh": "bzip2",
}
#: Over five hours at 1 kHz; more tells nothing new of one axis. 160 MB a column.
MOST_SAMPLES = 20_000_000


def refuse_long(path: Path, samples: int) -> None:
    """Raises InvalidInputError for more samples than a log may have."""
    if samples > MOST_SAMPLES:
        raise InvalidInputError(
            path,
            f"holds or claims {samples} samples, more than the {MOST_SAMPLES} that are read",
            "Cut the log to a shorter part",
        )


def refuse_packed(path: Path, content: bytes) -> None:
    """Raises InvalidInputError for a packed stream where text is expected."""
    for beginning, kind in _PACKED.items():
        if content.startswith(beginning):
            raise InvalidInputError(
                path, f"is a packed file ({kind}), not text", "Unpack it, and give what was in it"
            )


def refuse_wide(path: Path, header: bytes, columns: int) -> None:
    """Raises InvalidInputError for a header line no table of a log has.

    Args:
        path: the file, for the message.
        header: its first line.
        columns: how many columns the line names.
    """
    if len(header) > LONGEST_HEADER:
        problem = f"has a header line of {len(header)} bytes, more than {LONGEST_HEADER}"
    elif columns > MOST_COLUMNS:
        problem = f"has {columns} columns, more than {MOST_COLUMNS}"
    else:
        return
    raise InvalidInputError(path, problem, "Export the columns of the log alone, a row a line")


def refuse_open_quote(path: Path, header: bytes) -> None:
    """Raises InvalidInputError for a header line that goes on in the next one."""
    if header.count(b'"') % 2:
        raise InvalidInputError(
            path, "has a quote in its header line that is not closed", "Leave out the quote"
        )


def refuse_shape(path: Path, name: str, shape: tuple[int, ...]) -> None:
    """Raises InvalidInputError for a stored array that is no single column, or too long."""
    refuse_long(path, prod(shape))
    if len([size for size in shape if size != 1]) != 1:
        size = " x ".join(str(size) for size in shape) or "a single number"
        raise InvalidInputError(
            path,
            f"variable '{quote(name)}' is {size}, not a single column",
            "Name a variable with one value for each sample",
        )
