"""Where two files of one kind differ: keys with the value of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import cast

#: Characters of a value in a sentence.
_SHORT = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One key whose values differ; None stands for a key that is not there.

    Attributes:
        key: with the keys above it, joined by points.
        first: what the first file says.
        second: what the second file says.
    """

    key: str
    first: object
    second: object

    def words(self, first: str, second: str) -> str:
        """A sentence, with names of the two files."""
        return f"{self.key}: {_shown(self.first)} in {first}, {_shown(self.second)} in {second}"


def differences(
    first: Mapping[str, object], second: Mapping[str, object], above: str = ""
) -> Iterator[Difference]:
    """The innermost keys in which two mappings of plain YAML types differ."""
    for name in dict.fromkeys((*first, *second)):
        one: object = first.get(name)
        other: object = second.get(name)
        key = f"{above}.{name}" if above else name
        if isinstance(one, dict) and isinstance(other, dict):
            yield from differences(
                cast("dict[str, object]", one), cast("dict[str, object]", other), key
            )
        elif one != other or (name in first) != (name in second):
            yield Difference(key=key, first=first.get(name), second=second.get(name))


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    text = str(value)
    return text if len(text) <= _SHORT else text[: _SHORT - 3] + "..."
