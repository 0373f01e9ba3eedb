"""The pages of the documentation, and the commands, files and settings that they name."""

from __future__ import annotations

import re
import shlex
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
# Its commands are those of an earlier commit, which its first lines name.
OF_AN_EARLIER_VERSION = ROOT / "docs" / "trials.md"
PAGES = tuple(sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")]))
TODAYS_PAGES = tuple(path for path in PAGES if path != OF_AN_EARLIER_VERSION)

# Programs that a page may call, and those that a page alone may call, since the test of that page runs them.
PROGRAMS = ("python", "ge-torchrl", "make", "source", ".venv/bin/pip", "pip")
PROGRAMS_OF_A_PAGE = {
    "first_run.md": ("pipx",),
    "microcontroller.md": ("cc", "./motor", "arm-none-eabi-gcc", "arm-none-eabi-size"),
}

_LANGUAGES = ("", "c", "dot", "iecst", "latex", "mermaid", "pycon", "python", "sh", "text", "yaml")
_DIRECTIVES = ("{eval-rst}", "{include} ../README.md", "{toctree}")

_FENCED = re.compile(r"^( *)```([^`\n]*)\n(.*?)^\1```$", flags=re.DOTALL | re.MULTILINE)
_OTHER_FENCE = re.compile(r"^[ >*-]*~~~.*|^ *>.*```.*", flags=re.MULTILINE)
# The program, called with something; as it stands outside of shell blocks, and as a shell's own file calls it.
_CALL = re.compile(r"(?:python[\d.]* -m ge_torchrl|ge-torchrl) +[^\s`)|]")
_PRINTED = re.compile(r"(?:type +)?((?:python -m ge_torchrl|ge-torchrl) +[^\s].*)")
_EVALUATED = re.compile(r'eval "\$\((ge-torchrl [^)]+)\)"')
_BEGINS_AS_A_COMMAND = re.compile(
    r"(?:[$>%] +)?"
    r"(?:python[\d.]* +(?:-m \S+ |\S+\.py)|(?:ge-torchrl|source|bash) +\S|(?:make|pip) +[a-z]|cc +-|\.venv/bin/|\./\w)"
)
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
        if self.words[:2] == ("make", "run"):
            given = dict(word.split("=", 1) for word in self.words[2:])
            return (f"env={given.get('ENV', 'cartpole')}", *given.get("ARGS", "").split())
        return self.words[3:] if self.words[:3] == ("python", "-m", "ge_torchrl") else None


def blocks(path: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return [text for name, text in _blocks(path.read_text(encoding="utf-8")) if name == language]


def inline_codes(path: Path) -> list[str]:
    """What stands in backticks, outside fenced blocks, each on one line."""
    text = _FENCED.sub("", path.read_text(encoding="utf-8"))
    return [" ".join(code.split()) for code in _INLINE.findall(text)]


def links(path: Path) -> list[str]:
    """The targets of links and pictures that lie in the repository."""
    targets = _LINK.findall(_FENCED.sub("", path.read_text(encoding="utf-8")))
    return [target for target in targets if "://" not in target]


def commands(path: Path) -> list[Command]:
    """The commands of a page, loops run through: of shell blocks, and what is printed elsewhere as one."""
    found = _commands_and_others(path)[0]
    return [Command(path.name, words) for words in found]


def unknown_commands(path: Path) -> list[str]:
    """What looks like a command of a page, but has a form that no test knows."""
    return _commands_and_others(path)[1]


def _commands_and_others(path: Path) -> tuple[list[tuple[str, ...]], list[str]]:
    text = path.read_text(encoding="utf-8")
    programs = (*PROGRAMS, *PROGRAMS_OF_A_PAGE.get(path.name, ()))
    lines: list[str] = []
    others = [line.strip() for line in _OTHER_FENCE.findall(text)]
    for language, block in _blocks(text):
        if language not in (*_LANGUAGES, *_DIRECTIVES):
            others.append(f"```{language}")
        elif language == "sh":
            for line in _loops_run_through(_joined(block)):
                words = shlex.split(line, comments=True)
                (lines if not words or words[0] in programs else others).append(line)
        else:
            _sort(block.splitlines(), lines, others)
    rest = _FENCED.sub("", text)
    _sort(inline_codes(path), lines, others)
    indented = [line for line in rest.splitlines() if line.startswith("    ")]
    _sort(indented, lines, others)
    prose = _INLINE.sub("", "\n".join(line for line in rest.splitlines() if not line.startswith("    ")))
    others += [line for line in prose.splitlines() if _CALL.search(line)]
    split = (tuple(shlex.split(line, comments=True)) for line in lines)
    return [words for words in split if words], others


def _sort(texts: Iterable[str], lines: list[str], others: list[str]) -> None:
    """Put what is a command among the lines, and what only looks like one among the others."""
    for text in map(str.strip, texts):
        if printed := _PRINTED.fullmatch(text) or _EVALUATED.fullmatch(text):
            lines.append(printed[1])
        elif text.partition(" ")[0] in PROGRAMS and _BEGINS_AS_A_COMMAND.match(text):
            lines.append(text)
        elif _CALL.search(text) or _BEGINS_AS_A_COMMAND.match(text):
            others.append(text)


def _blocks(text: str) -> list[tuple[str, str]]:
    """The language and the text of each fenced block, without the indentation of a list."""
    return [(language, textwrap.dedent(block)) for _, language, block in _FENCED.findall(text)]


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
