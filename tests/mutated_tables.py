"""A motion as a table, changes to its columns, each by chance, and its files of every format."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.mutated_text import one_of


def motion(rows: int, rng: np.random.Generator) -> dict[str, Any]:
    """A device of 3 kg and 10 N·s/m under random forces, counted in 6 µm."""
    step = 0.001
    force = np.convolve(rng.normal(size=rows + 30), np.ones(31) / 6, "valid")
    velocity, place = np.zeros(rows), np.zeros(rows)
    for k in range(1, rows):
        velocity[k] = velocity[k - 1] + step * (force[k - 1] - 10 * velocity[k - 1]) / 3
        place[k] = place[k - 1] + step * velocity[k]
    return {
        "time": np.arange(rows) * step,
        "force": force,
        "position": np.rint(place / 6e-6) * 6e-6,
    }


def _some(table: dict[str, Any], rng: np.random.Generator) -> str:
    return str(one_of(rng, tuple(table)))


def _scaled(table: dict[str, Any], rng: np.random.Generator) -> None:
    name = _some(table, rng)
    table[name] = np.asarray(table[name], dtype=float) * 10.0 ** float(rng.uniform(-20, 20))


def _spoiled(table: dict[str, Any], rng: np.random.Generator) -> None:
    name = _some(table, rng)
    column = np.array(table[name], dtype=float)
    column[rng.integers(0, column.size, 3)] = one_of(
        rng, (np.nan, np.inf, -np.inf, 0.0, 1e308, -1e9, 1e-300)
    )
    table[name] = column


def _constant(table: dict[str, Any], rng: np.random.Generator) -> None:
    name = _some(table, rng)
    table[name] = np.full(len(table[name]), one_of(rng, (0.0, 1.0, -1e9)))


def _replaced(table: dict[str, Any], rng: np.random.Generator) -> None:
    """By another column, noise, whole numbers, a sine, a step, or a line."""
    name, other = _some(table, rng), _some(table, rng)
    rows = len(table[name])
    table[name] = one_of(
        rng,
        (
            np.array(table[other]),
            rng.normal(size=rows),
            rng.integers(-3, 3, rows),
            np.sin(0.1 * np.arange(rows)),
            (np.arange(rows) > rows // 2) * 1.0,
            np.arange(rows) * 1e-3,
            -np.asarray(table[name], dtype=float),
        ),
    )


def _uneven(table: dict[str, Any], rng: np.random.Generator) -> None:
    """Steps of very different length; lost rows; a clock that is short, or stands."""
    rows = len(table["time"])
    steps = one_of(
        rng,
        (
            rng.exponential(1e-3, rows),
            10.0 ** rng.uniform(-6, -1, rows),
            np.full(rows, 2e-7),
            np.where(rng.random(rows) < 0.02, 0.5, 1e-3),
            rng.choice([0.0, 1e-3], rows),
        ),
    )
    table["time"] = np.cumsum(steps)


def _kind(table: dict[str, Any], rng: np.random.Generator) -> None:
    name = _some(table, rng)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table[name] = np.asarray(table[name]).astype(
            one_of(rng, ("f4", "i4", "u1", "?", "U8", "c16", "f2", "datetime64[ms]"))
        )


def _shorter(table: dict[str, Any], rng: np.random.Generator) -> None:
    name = _some(table, rng)
    table[name] = table[name][: int(rng.integers(0, len(table[name])))]


def _lacking(table: dict[str, Any], rng: np.random.Generator) -> None:
    if len(table) > 1:
        kept = table.pop(_some(table, rng))
        table[one_of(rng, ("x", "reference", "", "ü", "time ", "a" * 400))] = kept
    table.setdefault("time", np.arange(3.0))


TABLE_MUTATIONS: Any = (
    *(_scaled, _spoiled, _constant, _replaced, _replaced, _uneven, _uneven, _kind, _shorter),
    _lacking,
)


def csv(table: dict[str, Any]) -> bytes:
    rows = zip(*(column.tolist() for column in table.values()), strict=False)
    lines = [",".join(table), *(",".join(str(cell) for cell in row) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def _npz(table: dict[str, Any]) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **{name or "_": column for name, column in table.items()})
    return stream.getvalue()


def _mat(table: dict[str, Any]) -> bytes:
    import scipy.io

    stream = io.BytesIO()
    named = {
        "".join(letter for letter in name if letter.isascii() and letter.isalnum())[:30] or "a": (
            column.astype(float) if column.dtype.kind in "Mm" else column
        )
        for name, column in table.items()
    }
    writer: Any = scipy.io
    writer.savemat(stream, named, do_compression=True)
    return stream.getvalue()


def _parquet(table: dict[str, Any]) -> bytes:
    import polars as pl

    rows = min(len(column) for column in table.values())
    stream = io.BytesIO()
    pl.DataFrame(
        {
            name: (column.real if column.dtype.kind == "c" else column)[:rows].tolist()
            for name, column in table.items()
        },
        strict=False,
    ).write_parquet(stream)
    return stream.getvalue()


WRITERS: dict[str, Callable[[dict[str, Any]], bytes]] = {
    "csv": csv,
    "npz": _npz,
    "mat": _mat,
    "parquet": _parquet,
}
