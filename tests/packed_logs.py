"""Small good logs in every packed kind, and what reading a bad one says."""

import struct
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import scipy.io
from mcap.writer import Writer as BagWriter

from identification import InvalidInputError, LogColumns, LogRefusedError, load_trajectory

ROWS = 300
TIME = np.arange(ROWS) * 1e-3
FORCE = np.sin(40 * TIME)
POSITION = 0.01 * np.cos(40 * TIME)
SAMPLES = tuple(zip(TIME.tolist(), FORCE.tolist(), POSITION.tolist(), strict=True))
GOOD: dict[str, Any] = {"time": TIME, "force": FORCE, "position": POSITION}


def parquet(folder: Path, **columns: Any) -> Path:
    path = folder / "log.parquet"
    pl.DataFrame(GOOD | columns).write_parquet(path)
    return path


def npz(folder: Path, **columns: Any) -> Path:
    path = folder / "log.npz"
    np.savez_compressed(path, **(GOOD | columns))
    return path


def mat(folder: Path, **columns: Any) -> Path:
    path = folder / "log.mat"
    scipy.io.savemat(path, GOOD | columns, do_compression=True)
    return path


def csv(folder: Path, **columns: Any) -> Path:
    path = folder / "log.csv"
    pl.DataFrame(GOOD | columns).write_csv(path)
    return path


def bag_of(
    folder: Path, definition: str, rest: bytes, *, name: str = "axis", count: int = ROWS
) -> Path:
    """A bag of messages of two numbers, of a type and on a topic of a name, and what follows."""
    path = folder / "log.mcap"
    with path.open("wb") as stream:
        writer: Any = BagWriter(stream)
        writer.start("ros2", name)
        text = f"float64 position\nfloat64 force\n{definition}"
        schema = writer.register_schema(name, "ros2msg", text.encode())
        channel = writer.register_channel(f"/{name}", "cdr", schema)
        for k in range(count):
            data = b"\0\1\0\0" + struct.pack("<dd", 0.01 * k, 1.0) + rest
            writer.add_message(channel, log_time=10**6 * k, data=data, publish_time=10**6 * k)
        writer.finish()
    return path


WRITERS = (parquet, npz, mat, csv)
Writer = Callable[..., Path]


def refusal(
    path: Path,
    columns: LogColumns | None = None,
    kind: type[Exception] = InvalidInputError,
    read: Callable[..., object] = load_trajectory,
) -> str:
    """What a refusal says, in one short line and before much work; of a log, or what is read."""
    started = time.process_time()
    with pytest.raises(kind) as caught:
        read(path, *([] if columns is None else [columns]))
    assert time.process_time() - started < 10
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    return text


def assert_is_the_plain_log(folder: Path, path: Path, words: str, **asked: Any) -> None:
    """A log gives the columns of the plain CSV, and says with which words it was read."""
    plain, log = load_trajectory(csv(folder)), load_trajectory(path, LogColumns(**asked))
    for (_, found), (_, true) in zip(log.columns(), plain.columns(), strict=True):
        np.testing.assert_allclose(found, true, rtol=1e-12, atol=1e-15)
    assert log.read_as == words


def assert_damage_is_refused(whole: bytes, torn: Path, ends: Sequence[int], **asked: Any) -> None:
    """A file cut at each end is refused; with bytes changed it is read or refused, no more."""
    columns = LogColumns(**asked)
    for end in ends:
        torn.write_bytes(whole[:end])
        refusal(torn, columns)
    generator = np.random.default_rng(1)
    for _ in range(5):
        content = bytearray(whole)
        for place in generator.integers(0, len(whole), 4):
            content[place] ^= int(generator.integers(1, 256))
        torn.write_bytes(bytes(content))
        with suppress(InvalidInputError, LogRefusedError):
            load_trajectory(torn, columns)


def assert_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, path: Path, module: str, missing: str, extra: str
) -> None:
    """Without a module the refusal says what is not installed, and the extra that brings it."""
    empty = path.parent / "empty"
    (empty / module).mkdir(parents=True)
    (empty / module / "__init__.py").write_text(
        "print('loading ' * 10_000)\nraise ImportError", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(empty)
    said = refusal(path)
    assert missing in said
    assert f'pip install "haptune[{extra}]"' in said
