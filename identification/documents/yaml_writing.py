"""YAML out: text that readers of YAML 1.1 and 1.2 understand alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from io import StringIO
from typing import Any


def to_yaml(content: Mapping[str, Any], comment: str = "") -> str:
    """YAML text that readers of YAML 1.1 (PyYAML, ROS 2) and 1.2 understand alike.

    Floats have a point (no bare 1e-3), texts that either version takes for something else are in
    quotes, and no line is broken: a key that goes on in the next line is no key to any reader.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.nodes import ScalarNode
    from ruamel.yaml.resolver import VersionedResolver

    yaml: Any = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False
    yaml.width = _UNBROKEN
    older: Any = VersionedResolver(version=(1, 1))

    def represent_float(representer: Any, value: float) -> Any:
        text = repr(value)
        if "e" in text and "." not in text:
            text = text.replace("e", ".0e")
        return representer.represent_scalar("tag:yaml.org,2002:float", text)

    def represent_str(representer: Any, value: str) -> Any:
        # The writer leaves "x?" and ":x" plain on one line, where readers take the mark as theirs,
        # and breaks lines at ends of lines that only some readers know, but for double quotes.
        marked = value.startswith((":", "-")) or "?" in value
        text = older.resolve(ScalarNode, value, (True, False)) == older.DEFAULT_SCALAR_TAG
        plain = None if text and not marked else "'"
        style = plain if value.isprintable() else '"'
        return representer.represent_scalar("tag:yaml.org,2002:str", value, style=style)

    def represent_list(representer: Any, items: list[Any]) -> Any:
        return representer.represent_sequence(
            "tag:yaml.org,2002:seq", items, flow_style=_short(items)
        )

    def represent_dict(representer: Any, items: dict[str, Any]) -> Any:
        return representer.represent_mapping(
            "tag:yaml.org,2002:map", items, flow_style=_short(items.values(), items)
        )

    def represent_root(representer: Any, items: _Root) -> Any:
        return representer.represent_mapping("tag:yaml.org,2002:map", items, flow_style=False)

    yaml.representer.add_representer(float, represent_float)
    yaml.representer.add_representer(str, represent_str)
    yaml.representer.add_representer(list, represent_list)
    yaml.representer.add_representer(dict, represent_dict)
    yaml.representer.add_representer(_Root, represent_root)
    stream = StringIO()
    yaml.dump(_Root(content), stream)
    heading = "".join(f"# {line}\n" for line in comment.splitlines())
    return heading + stream.getvalue()


class _Root(dict[str, Any]):
    """The outermost mapping: always one key a line."""


#: Columns that no line of a file reaches.
_UNBROKEN = 1_000_000
#: Characters of a collection that still goes on one line: keys, values and what is between them.
_ONE_LINE = 88


def _short(values: Iterable[Any], keys: Iterable[str] = ()) -> bool:
    """True for a few scalars that fit on one line with their keys."""
    listed = list(values)
    return (
        bool(listed)
        and not any(isinstance(item, list | dict) for item in listed)
        and sum(len(str(item)) + 2 for item in [*listed, *keys]) <= _ONE_LINE
    )
