"""Bytes of a text file: refused where they are packed or no text, of any encoding made UTF-8."""

from __future__ import annotations

from pathlib import Path

from identification.errors import InvalidInputError, counted

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
#: The mark that UTF-8 text may begin with; those of text of two or four bytes a letter, the longer
#: first.
MARK = b"\xef\xbb\xbf"
_WIDE_MARKS = {
    b"\xff\xfe\x00\x00": "utf-32",
    b"\x00\x00\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
#: Bytes looked at for text of two bytes a letter without a mark.
_WIDE_SAMPLE = 1000
#: Bytes that hold the header, in which letters beyond ASCII stand.
_HEADER_BYTES = 10_000


def refuse_packed(path: Path, content: bytes) -> None:
    """Refuse a packed stream where text is expected."""
    for beginning, kind in _PACKED.items():
        if content.startswith(beginning):
            raise InvalidInputError(
                path, f"is a packed file ({kind}), not text", "Unpack it, and give what was in it"
            )


def as_utf8(path: Path, content: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Text as UTF-8 with line feeds, and what was understood; text that is so is not copied."""
    encoding = _wide_encoding(content)
    notes: tuple[str, ...] = ()
    if encoding:
        name = encoding[:6].upper()
        try:
            # Letters that hold no text are refused as bytes, by what reads the lines.
            content = content.decode(encoding).encode()
        except UnicodeDecodeError as error:
            problem = f"begins as {name} text, and byte {error.start} is none"
            remedy = "Save it as UTF-8 (CSV UTF-8 in Excel)"
            raise InvalidInputError(path, problem, remedy) from None
        notes = (f"{name} text",)
    elif not _is_utf8(content[:_HEADER_BYTES]):
        # Degrees and micro are the letters in question, which stand alike in Latin-1.
        content, notes = content.decode("cp1252", "replace").encode(), ("Windows-1252 text",)
    if b"\n" not in content and b"\r" in content:
        return content.replace(b"\r", b"\n"), (*notes, "lines that end in CR")
    return content, notes


def _is_utf8(start: bytes) -> bool:
    """Whether a beginning is UTF-8, its last letter perhaps cut."""
    try:
        start.decode()
    except UnicodeDecodeError as error:
        return error.reason == "unexpected end of data"
    return True


def _wide_encoding(content: bytes) -> str:
    """Name of an encoding of two or four bytes a letter; "" for another."""
    for mark, name in _WIDE_MARKS.items():
        if content.startswith(mark):
            return name
    start = content[:_WIDE_SAMPLE]
    pairs = len(start) // 2
    for side, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        letters, zeros = start[1 - side : 2 * pairs : 2], start[side : 2 * pairs : 2]
        if pairs and zeros.count(0) == pairs and letters.count(0) == 0:
            return name
    return ""


def refuse_zeros(path: Path, content: bytes) -> None:
    """Refuse text with NUL bytes, naming the line of the first."""
    first = content.find(b"\0")
    if first < 0:
        return
    count = content.count(b"\0")
    line = content.count(b"\n", 0, first) + 1
    raise InvalidInputError(
        path,
        f"holds {counted(count, 'NUL byte')}, the first in line {line}: it is "
        "no text, or was cut off while it was written",
        "Log or export it again" + (f", or keep the lines before line {line}" * (line > 1)),
    )
