"""Names of elements as identifiers, and any text as a harmless comment."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Iterable

#: Letters of an identifier, before a number that tells it from others.
_LONGEST = 40
#: Columns of a comment.
_WIDTH = 96

#: Words of C, C++ and Python, and what YAML 1.1 reads as something else than text.
_WORDS = """
    alignas alignof and asm assert async auto await bool break case catch char class const continue
    def default del delete do double elif else enum except explicit export extern false finally
    float for friend from global goto if import in inline int is lambda long mutable n namespace new
    no none nonlocal not null nullptr off on operator or pass private protected public raise
    register restrict return short signed sizeof static struct switch template this throw true try
    typedef typename union unsigned using virtual void volatile while with xor y yes yield
"""
_RESERVED = frozenset(_WORDS.split())


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """A different identifier for each name: small ASCII letters, digits and single underscores.

    A name that is one already keeps it; no identifier is a word of C, C++, Python or YAML, even
    with another case.
    """
    wanted = {name: _identifier(name) for name in names}
    found = {name: name for name, word in wanted.items() if name == word}
    taken = set(found.values())
    for name, word in wanted.items():
        if name in found:
            continue
        free, number = word, 1
        while free in taken:
            number += 1
            free = f"{word}_{number}"
        found[name] = free
        taken.add(free)
    return {name: found[name] for name in wanted}


def _identifier(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:_LONGEST].strip("_")
    if not word or word[0].isdigit() or word in _RESERVED:
        return f"element_{word}".rstrip("_")
    return word


def quote_yaml(text: str) -> str:
    """A text in double quotes as YAML takes it, ASCII only."""
    return '"' + "".join(_letter(letter) for letter in text) + '"'


def _letter(letter: str) -> str:
    code = ord(letter)
    if letter in '"\\':
        return "\\" + letter
    if 0x20 <= code < 0x7F:
        return letter
    if code <= 0xFF:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def block_comment(lines: Iterable[str]) -> str:
    """A C comment; nothing in the lines can end it."""
    body = "".join(f" * {line}".rstrip() + "\n" for line in _wrapped(lines))
    return f"/*\n{body} */\n"


def hash_comment(lines: Iterable[str]) -> str:
    """Comment lines of YAML."""
    return "".join(f"# {line}".rstrip() + "\n" for line in _wrapped(lines))


def inside_comment(text: str) -> str:
    """One line of ASCII that neither ends nor begins a C comment, nor continues a line."""
    plain = " ".join(text.encode("ascii", "backslashreplace").decode().split())
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??/", "?? /").rstrip("\\")


def _wrapped(lines: Iterable[str]) -> Iterable[str]:
    for line in lines:
        indent = "    " if line.startswith("- ") else ""
        yield from textwrap.wrap(inside_comment(line), _WIDTH, subsequent_indent=indent) or [""]
