"""How large a log may be, and what is refused before any memory is spent on it.

Packed files can claim or unfold to far more than their size on disk.
"""

from __future__ import annotations

from math import prod
from pathlib import Path

from identification.errors import InvalidInputError
from identification.readers.columns import quoted

#: Bytes. A CSV log of MOST_SAMPLES rows of three full-precision numbers is about 1.2 GB.
LARGEST_FILE = 2_000_000_000
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


def refuse_shape(path: Path, name: str, shape: tuple[int, ...]) -> None:
    """Raises InvalidInputError for a stored array that is no single column, or too long."""
    refuse_long(path, prod(shape))
    if len([size for size in shape if size != 1]) != 1:
        size = " x ".join(str(size) for size in shape) or "a single number"
        raise InvalidInputError(
            path,
            f"variable '{quoted(name)}' is {size}, not a single column",
            "Name a variable with one value for each sample",
        )
