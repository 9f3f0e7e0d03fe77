"""Parameters of a test of which the usual run takes a few, and the long run the others."""

from collections.abc import Iterable
from typing import Any

import pytest


def thinned(values: Iterable[Any], kept: int) -> list[Any]:
    """All values, those after the first ``kept`` for the long run; tuples are several arguments."""
    listed = list(values)
    rest = (value if isinstance(value, tuple) else (value,) for value in listed[kept:])
    return [*listed[:kept], *(pytest.param(*value, marks=pytest.mark.long) for value in rest)]
