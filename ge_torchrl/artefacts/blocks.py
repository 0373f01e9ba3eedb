"""YAML in which a text of several lines, such as a grammar, stands as a block of lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

# YAML takes them for line ends too, and would read another text.
_ODD_LINE_ENDS = "\r\x85\u2028\u2029"


class _BlockDumper(yaml.SafeDumper):
    def represent_lines(self, text: str) -> yaml.ScalarNode:
        """Represent a text; what a block cannot hold exactly is quoted."""
        style = '"' if any(end in text for end in _ODD_LINE_ENDS) else "|" if "\n" in text else None
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_BlockDumper.add_representer(str, _BlockDumper.represent_lines)


def as_yaml(values: Mapping[str, Any]) -> str:
    """Return nested plain values as YAML, in their order."""
    return yaml.dump(values, Dumper=_BlockDumper, sort_keys=False, allow_unicode=True)
