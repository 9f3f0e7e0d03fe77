"""Log files to Trajectory: CSV and MATLAB, columns named by the user, units made SI."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import InvalidInputError
from identification.trajectory import Motion, Trajectory

if TYPE_CHECKING:
    import polars

FloatArray = NDArray[np.float64]

#: Column names listed in a message at most; a wrong file may have thousands.
_MOST_NAMED = 20
#: Characters of a file's own text quoted in a message at most.
_LONGEST_QUOTE = 40
#: A MATLAB v7.3 file is HDF5 behind a header of this many bytes, or HDF5 from its first byte.
_MAT_HEADER = 512
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Separators tried; the one most frequent in the header wins, the first of equals.
_SEPARATORS = ",;\t"
#: The column a CSV file may have without being asked for it.
_DEFAULT_REFERENCE = "reference"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogColumns:
    """Which columns of a file are what, and the factors that make them SI.

    Attributes:
        time: column in s.
        force: column that, times ``force_gain``, is the force on the device in N (N·m).
        position: column that, times ``position_gain``, is the position in m (rad).
        reference: set-point column in the unit of position; None takes a CSV column named
            ``reference`` if there is one.
        force_gain: e.g. N per volt; negative turns the direction.
        position_gain: e.g. m per count; applies to reference as well.
        axis: name of the axis; None means "x".

    Raises:
        InvalidInputError: a gain that is zero, infinite or not a number.
    """

    time: str = "time"
    force: str = "force"
    position: str = "position"
    reference: str | None = None
    force_gain: float = 1.0
    position_gain: float = 1.0
    axis: str | None = None

    def __post_init__(self) -> None:
        for name in ("force_gain", "position_gain"):
            gain = getattr(self, name)
            if not math.isfinite(gain) or gain == 0:
                raise InvalidInputError(
                    "--" + name.replace("_", "-"),
                    f"is {gain:g}, not a finite number other than zero",
                    "Give what one unit of the column is in SI units",
                )


def load_trajectory(
    path: str | Path,
    columns: LogColumns | None = None,
    *,
    motion: Motion = "linear",
    axis: str | None = None,
) -> Trajectory:
    """Read one log.

    Args:
        path: a .csv file with a header, or a .mat file up to version 7.2.
        columns: names and gains; None means LogColumns().
        motion: "linear" (N, m) or "rotary" (N·m, rad).
        axis: name of the axis; None takes ``columns.axis``, then "x".

    Returns:
        Trajectory in SI units with the digest of the file. Empty cells become NaN, which
        Trajectory refuses with their number.

    Raises:
        InvalidInputError: a file that cannot be read, or not as asked; names what there is.
        LogRefusedError: columns that cannot be a log (see Trajectory).
    """
    path = Path(path)
    columns = columns or LogColumns()
    readers: dict[str, Callable[[Path, bytes, LogColumns], dict[str, FloatArray]]] = {
        ".csv": _read_csv,
        ".mat": _read_mat,
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InvalidInputError(
            path,
            f"has the ending '{path.suffix}', which is not read",
            f"Give a log that ends in {' or '.join(readers)}",
        )
    try:
        content = path.read_bytes()
    except OSError as error:
        problem = f"cannot be read ({error.strerror or error})"
        raise InvalidInputError(path, problem, "Check the name and the permissions") from None
    if not content.strip():
        raise InvalidInputError(path, "is empty", "Log or export it again")
    found = reader(path, content, columns)
    lengths = {name: column.size for name, column in found.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in lengths.items())
        raise InvalidInputError(
            path, f"has columns of different lengths ({listed})", "Export columns of one length"
        )
    reference = found.get("reference")
    return Trajectory(
        time=found["time"],
        force=found["force"] * columns.force_gain,
        position=found["position"] * columns.position_gain,
        reference=None if reference is None else reference * columns.position_gain,
        axis=axis or columns.axis or "x",
        motion=motion,
        source=path.name,
        digest="sha256:" + hashlib.sha256(content).hexdigest(),
    )


def _wanted(columns: LogColumns, present: Sequence[str], path: Path) -> dict[str, str]:
    """Role to column name; refuses names the file does not have."""
    wanted = {"time": columns.time, "force": columns.force, "position": columns.position}
    if columns.reference is not None:
        wanted["reference"] = columns.reference
    missing = {role: name for role, name in wanted.items() if name not in present}
    if missing:
        named = ", ".join(f"'{_quoted(name)}'" for name in missing.values())
        listed = ", ".join(_quoted(name) for name in present[:_MOST_NAMED])
        more = f" and {len(present) - _MOST_NAMED} more" if len(present) > _MOST_NAMED else ""
        raise InvalidInputError(
            path,
            f"has no column {named}; it has: {listed or 'none'}{more}",
            "Name the right column with " + ", ".join(f"--{role}" for role in missing),
        )
    return wanted


def _read_csv(path: Path, content: bytes, columns: LogColumns) -> dict[str, FloatArray]:
    import polars as pl

    header = content.lstrip(b"\xef\xbb\xbf").split(b"\n", 1)[0].decode("utf-8", "replace")
    separator = max(_SEPARATORS, key=header.count)
    try:
        table = pl.read_csv(
            BytesIO(content), separator=separator, infer_schema=False, encoding="utf8-lossy"
        )
        # A header line that begins with # comes from loggers that mark it as a comment.
        table = table.rename({name: name.strip("# ") for name in table.columns})
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        reason = " ".join(str(error).split("\n")[0].split())[:200]
        raise InvalidInputError(
            path,
            f"is not a table of equally long rows ({reason})",
            "Export it again as CSV with one header line",
        ) from None
    wanted = _wanted(columns, table.columns, path)
    if columns.reference is None and _DEFAULT_REFERENCE in table.columns:
        wanted["reference"] = _DEFAULT_REFERENCE
    for name in wanted.values():
        # The reader's own name for a second column of one name.
        if f"{name}_duplicated_0" in table.columns:
            raise InvalidInputError(
                path, f"has two columns named '{_quoted(name)}'", "Rename one of them"
            )
    return {role: _numbers(path, table[name]) for role, name in wanted.items()}


def _numbers(path: Path, cells: polars.Series) -> FloatArray:
    """A CSV column as numbers; an empty cell is NaN, any other text is refused by its row."""
    import polars as pl

    text = cells.str.strip_chars()
    numbers = text.cast(pl.Float64, strict=False)
    wrong = (numbers.is_null() & text.is_not_null() & (text != "")).fill_null(value=False)
    first = wrong.arg_true()
    if first.len():
        row = int(first[0])
        # Row 1 is the header, so the first cell below it stands in row 2.
        raise InvalidInputError(
            path,
            f"column '{_quoted(cells.name)}' holds '{_quoted(str(cells[row]))}' in row {row + 2}, "
            "which is not a number",
            "Write numbers with a decimal point, and leave missing cells empty",
        )
    return np.array(numbers.fill_null(float("nan")).to_numpy(), dtype=np.float64)


def _read_mat(path: Path, content: bytes, columns: LogColumns) -> dict[str, FloatArray]:
    import scipy.io

    if content.startswith(_HDF5) or content[_MAT_HEADER:].startswith(_HDF5):
        raise InvalidInputError(
            path,
            "is a MATLAB file of version 7.3 (HDF5), which is not read",
            "Save it with save(..., '-v7') or as CSV",
        )
    reader: Any = scipy.io
    try:
        present = [str(entry[0]) for entry in reader.whosmat(BytesIO(content))]
        names = _wanted(columns, present, path)
        stored = reader.loadmat(BytesIO(content), variable_names=list(names.values()))
        found = {role: stored[name] for role, name in names.items()}
    except InvalidInputError:
        raise
    except Exception as error:  # noqa: BLE001  # a damaged file trips the parser anywhere
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InvalidInputError(
            path,
            f"is not a readable MATLAB file ({reason})",
            "Save it again with save(..., '-v7')",
        ) from None
    return {role: _vector(path, names[role], value) for role, value in found.items()}


def _vector(path: Path, name: str, stored: Any) -> FloatArray:
    """A MATLAB variable as a column."""
    shape: tuple[int, ...] = getattr(stored, "shape", ())
    kind: str = getattr(getattr(stored, "dtype", None), "kind", "O")
    if kind not in "biuf" or not isinstance(stored, np.ndarray):
        raise InvalidInputError(
            path, f"variable '{name}' is not an array of real numbers", "Save it as double"
        )
    if len([size for size in shape if size != 1]) != 1:
        size = " x ".join(str(size) for size in shape)
        raise InvalidInputError(
            path,
            f"variable '{name}' is {size}, not a single column",
            "Name a variable with one value for each sample",
        )
    return np.asarray(stored, dtype=np.float64).ravel()


def _quoted(text: str) -> str:
    """A file's own text, safe and short enough to print."""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    return printable if len(printable) <= _LONGEST_QUOTE else printable[:_LONGEST_QUOTE] + "…"
