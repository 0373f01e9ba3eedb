"""The pages of the documentation, and the commands, files and settings that they name."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
# Its commands are those of an earlier commit, which its first lines name.
OF_AN_EARLIER_VERSION = ROOT / "docs" / "trials.md"
PAGES = tuple(sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")]))
TODAYS_PAGES = tuple(path for path in PAGES if path != OF_AN_EARLIER_VERSION)

_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
_PROGRAMS = ("python -m ge_torchrl ", "ge-torchrl ")
_INLINE = re.compile(r"`([^`]+)`")
_LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
_FOR = re.compile(r"^for (\w+) in (.*); do$")


class Command(NamedTuple):
    """A command that a page prints.

    Attributes:
        page: Name of the page.
        words: The command, as a shell would hand it on.
    """

    page: str
    words: tuple[str, ...]

    @property
    def arguments(self) -> tuple[str, ...] | None:
        """What the program itself is given; None where another program is called."""
        if self.words[0] == "ge-torchrl":
            return self.words[1:]
        return self.words[3:] if self.words[:3] == ("python", "-m", "ge_torchrl") else None


def blocks(path: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return [text for name, text in _FENCED.findall(path.read_text(encoding="utf-8")) if name == language]


def inline_codes(path: Path) -> list[str]:
    """What stands in backticks, outside fenced blocks, each on one line."""
    text = _FENCED.sub("", path.read_text(encoding="utf-8"))
    return [" ".join(code.split()) for code in _INLINE.findall(text)]


def links(path: Path) -> list[str]:
    """The targets of links and pictures that lie in the repository."""
    targets = _LINK.findall(_FENCED.sub("", path.read_text(encoding="utf-8")))
    return [target for target in targets if "://" not in target]


def commands(path: Path) -> list[Command]:
    """The commands of a page, loops run through: of its shell blocks, and the program's in backticks or indented."""
    text = path.read_text(encoding="utf-8")
    lines = [line for block in blocks(path, "sh") for line in _loops_run_through(_joined(block))]
    lines += [code for code in inline_codes(path) if code.startswith(_PROGRAMS)]
    lines += [line.strip() for line in _FENCED.sub("", text).splitlines() if line.startswith("    python -m")]
    split = (tuple(shlex.split(line, comments=True)) for line in lines)
    return [Command(path.name, words) for words in split if words]


def _joined(block: str) -> list[str]:
    """The lines of a block, those that go on after a backslash joined."""
    return [line.strip() for line in block.replace("\\\n", " ").splitlines() if line.strip()]


def _loops_run_through(lines: Iterable[str]) -> Iterator[str]:
    loop: list[str] = []
    depth = 0
    for line in lines:
        depth += bool(_FOR.match(line)) - (line == "done")
        if depth or loop:
            loop.append(line)
        else:
            yield line
        if loop and not depth:
            name, values = _FOR.match(loop[0]).groups()
            for value in values.split():
                yield from _loops_run_through(_with_value(loop[1:-1], {name: value}))
            loop = []


def _with_value(lines: Iterable[str], variables: Mapping[str, str]) -> list[str]:
    return [re.sub(r"\$(\w+)", lambda found: variables.get(found[1], found[0]), line) for line in lines]
