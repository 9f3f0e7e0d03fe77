"""Text of other encodings made UTF-8, where its bytes leave no doubt which it is."""

from __future__ import annotations

from pathlib import Path

from identification.errors import InvalidInputError

#: Marks that text of two or four bytes a letter begins with, the longer first.
_MARKS = {
    b"\xff\xfe\x00\x00": "UTF-32",
    b"\x00\x00\xfe\xff": "UTF-32",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
#: Bytes looked at for text of two bytes a letter without a mark.
_SAMPLE = 1000
#: Bytes that hold the header, in which letters beyond ASCII stand.
_BEGINNING = 10_000


def as_utf8(path: Path, content: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Text as UTF-8 with line feeds, and what was understood; text that is so is not copied.

    Args:
        path: the file, for the message.
        content: all of it.

    Raises:
        InvalidInputError: a mark of UTF-16 or UTF-32 before bytes that are none.
    """
    encoding = _wide_encoding(content)
    notes: tuple[str, ...] = ()
    if encoding:
        try:
            # Letters that hold no text are refused as bytes, by what reads the lines.
            content = content.decode(encoding).encode()
        except UnicodeDecodeError as error:
            raise InvalidInputError(
                path,
                f"begins as {encoding[:6].upper()} text, and byte {error.start} is none",
                "Save it as UTF-8 (CSV UTF-8 in Excel)",
            ) from None
        notes = (f"{encoding[:6].upper()} text",)
    elif not _is_utf8(content[:_BEGINNING]):
        # Degrees and micro are the letters in question, which stand alike in Latin-1.
        content, notes = content.decode("cp1252", "replace").encode(), ("Windows-1252 text",)
    if b"\n" not in content and b"\r" in content:
        return content.replace(b"\r", b"\n"), (*notes, "lines that end in CR")
    return content, notes


def refuse_zeros(path: Path, content: bytes) -> None:
    """Raises InvalidInputError for text with NUL bytes, naming the line of the first."""
    first = content.find(b"\0")
    if first < 0:
        return
    count = content.count(b"\0")
    line = content.count(b"\n", 0, first) + 1
    raise InvalidInputError(
        path,
        f"holds {count} NUL byte{'' if count == 1 else 's'}, the first in line {line}: it is "
        "no text, or was cut off while it was written",
        "Log or export it again" + (f", or keep the lines before line {line}" * (line > 1)),
    )


def _is_utf8(start: bytes) -> bool:
    """Whether a beginning is UTF-8, its last letter perhaps cut."""
    try:
        start.decode()
    except UnicodeDecodeError as error:
        return error.reason == "unexpected end of data"
    return True


def _wide_encoding(content: bytes) -> str:
    """Name of an encoding of two or four bytes a letter; "" for another."""
    for mark, name in _MARKS.items():
        if content.startswith(mark):
            return name.lower()
    start = content[:_SAMPLE]
    pairs = len(start) // 2
    for side, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        letters, zeros = start[1 - side : 2 * pairs : 2], start[side : 2 * pairs : 2]
        if pairs and zeros.count(0) == pairs and letters.count(0) == 0:
            return name
    return ""
