"""`explain`: what a setting does."""

import textwrap
from collections.abc import Iterator

from ge_torchrl.cli.parser import Parser
from ge_torchrl.cli.statuses import OK
from ge_torchrl.config.explained import Explained, ExplainedSection, explained, sections
from ge_torchrl.config.files import choices, default_choices

_WIDTH = 100
_LABEL = 10


def explain(arguments: list[str]) -> int:
    """Print what a setting, a section or all sections are about, as `explain --help` tells; return the exit status."""
    parser = Parser(
        prog="ge-torchrl explain",
        description="Print what a setting does: what it may be, its default, which files of conf/ set it, and what to "
        "type.",
    )
    parser.add_argument(
        "key",
        metavar="KEY",
        nargs="?",
        help="such as ge.generations, or a section such as ge; default: list all sections",
    )
    key = parser.parse_args(arguments).key
    if key is None:
        print("\n".join(_overview()))
        return OK
    # As it is typed before a run: with a value, or with a plus.
    found = explained(key.lstrip("+").partition("=")[0])
    print("\n".join(_of_section(found) if isinstance(found, ExplainedSection) else _of_setting(found)))
    return OK


def _of_setting(setting: Explained) -> Iterator[str]:
    yield setting.key
    yield from _entry("", 0, setting.meaning)
    yield from _paragraph("allowed", setting.allowed + (f": {setting.because}" if setting.because else ""))
    default = setting.default
    if " or " in default:
        default += " (where steps of the environment are nearly free, and where they are dear)"
    yield from _paragraph("default", default)
    for i, (choice, value) in enumerate(setting.presets):
        yield from _paragraph("" if i else "set by", f"{choice} ({value})")
    yield from _paragraph("type", f"ge-torchrl {setting.example}")


def _of_section(section: ExplainedSection) -> Iterator[str]:
    yield section.name
    yield from _entry("", 0, section.meaning)
    yield ""
    width = max(len(setting.key) for setting in section.keys)
    for setting in section.keys:
        yield from _entry(setting.key, width, setting.meaning)
    yield ""
    yield f"explain {section.keys[0].key} tells more of one."


def _overview() -> Iterator[str]:
    all_sections = list(sections())
    width = max(len(section.name) for section in all_sections)
    yield "Sections of settings (key=value):"
    for section in all_sections:
        if section.name:
            yield from _entry(section.name, width, section.meaning.partition("\n")[0])
        else:
            yield from (
                line for setting in section.keys for line in _entry(setting.key, width, setting.meaning)
            )
    yield ""
    yield "Files of conf/ that set several (group=choice):"
    groups = default_choices()
    for group in groups:
        yield from _entry(group, max(map(len, groups)), ", ".join(choices(group)))
    yield ""
    yield "explain ge lists the settings of a section, explain ge.generations tells of one."


def _paragraph(label: str, text: str) -> Iterator[str]:
    yield from _entry(label, _LABEL - 2, text)


def _entry(label: str, width: int, text: str) -> Iterator[str]:
    """Yield a label and a text beside it, wrapped."""
    first = f"  {label:<{width}}  " if width else "  "
    yield from textwrap.wrap(
        " ".join(text.split()),
        _WIDTH,
        initial_indent=first,
        subsequent_indent=" " * len(first),
        break_long_words=False,
        break_on_hyphens=False,
    )
