"""Filling a page: every value is escaped, style, script and data stand within, and nothing else may be loaded."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from string import Template
from typing import Any

_NUMBER = re.compile(r"[\u2212+]?[\d.,]+( \(.*\)| of \d+.*| s| min \d+ s| h \d+ min)?")
_SCRIPT_END = str.maketrans(
    {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
)


class Markup(str):
    """A text that is HTML already."""

    __slots__ = ()


def filled(template: str, scripts: Iterable[str], data: object, values: Mapping[str, str]) -> str:
    """Return a page.

    Args:
        template: Name of the file among the assets, with `$name` for each value.
        scripts: Names of the scripts, which become one module in this order.
        data: What the script reads: plain values.
        values: Texts, which are escaped, and `Markup`, which is not.
    """
    script = "\n".join(asset(name) for name in scripts)
    # The policy names the one script that may run, so that no text of a file can ever become another.
    digest = base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode("ascii")
    policy = (
        f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'; "
        "base-uri 'none'; form-action 'none'"
    )
    fixed = {
        "policy": html.escape(policy),
        "style": asset("page.css"),
        "script": f"\n{script}\n",
        "data": json_in_html(data),
    }
    escaped = {name: text if isinstance(text, Markup) else html.escape(text) for name, text in values.items()}
    return Template(asset(template)).substitute(escaped, **fixed)


def json_in_html(data: object) -> str:
    """Return plain values as JSON that may stand in a script element, whatever texts they hold."""
    return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).translate(_SCRIPT_END)


def element(name: str, content: str = "", **attributes: Any) -> Markup:
    """Return an element; its content is escaped unless it is `Markup`, and an attribute of None is left out.

    Args:
        name: Of the element.
        content: Text or markup.
        attributes: A trailing underscore of a name is dropped, others become hyphens.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(str(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    inner = content if isinstance(content, Markup) else html.escape(content)
    return Markup(f"<{name}{given}>{inner}</{name}>")


def joined(parts: Iterable[str]) -> Markup:
    """Return markup and texts one after another."""
    return Markup("".join(part if isinstance(part, Markup) else html.escape(part) for part in parts))


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, caption: str = "") -> Markup:
    """Return a table that scrolls within its place; columns of numbers stand to the right.

    Args:
        head: A title for each column.
        rows: Cells, as many in each row.
        caption: Stands above; an empty text for none.
    """
    cells = [list(row) for row in rows]
    kinds = ["number" if _is_number(column) else None for column in zip(*cells, strict=True)]
    kinds = kinds or [None] * len(head)
    titles = joined(
        element("th", title, scope="col", class_=kind) for title, kind in zip(head, kinds, strict=True)
    )
    body = joined(
        element("tr", joined(element("td", cell, class_=kind) for cell, kind in zip(row, kinds, strict=True)))
        for row in cells
    )
    parts = [element("thead", element("tr", titles)), element("tbody", body)]
    named = [element("caption", element("span", caption)), *parts] if caption else parts
    return element(
        "div",
        element("table", joined(named)),
        class_="scroll",
        tabindex="0",
        role="group",
        aria_label=caption or "table",
    )


def asset(name: str) -> str:
    """Return the text of a file beside this module."""
    return files("ge_torchrl.report.html").joinpath("assets", name).read_text(encoding="utf-8")


def _is_number(column: Iterable[str]) -> bool:
    """Tell whether all cells that say something are numbers, with an interval or a unit perhaps."""
    told = [cell for cell in column if cell]
    return bool(told) and all(not isinstance(cell, Markup) and _NUMBER.fullmatch(cell) for cell in told)
