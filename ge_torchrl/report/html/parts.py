"""Parts that the pages of runs have in common, finished or not."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ge_torchrl.artefacts.folder import BEST_TREE_TEXT, RunFolder
from ge_torchrl.reading import is_there, read_text
from ge_torchrl.report.html.template import Markup, element, joined
from ge_torchrl.report.unfinished import RESUME

# Typed where the user works, so that the new run gets a folder there, and none within this one's.
COMMAND = 'python -m ge_torchrl --config-path "$PWD/RUN_FOLDER" --config-name config'
"""What runs a run again; `assets/again.js` puts in the folder of the page, where that lies on a disk."""


def command_markup(command: str) -> Markup:
    """Return a command whose words stay whole, hyphens and all."""
    return Markup(" ".join(element("span", word, class_="word") for word in command.split()))


def going_on_markup() -> Markup:
    """Return how a run goes on that did not come to its end."""
    told = element("p", "To go on, as if it had been left alone:", class_="note")
    command = element("code", command_markup(f'{RESUME} "RUN_FOLDER"'))
    return joined([told, element("pre", command, class_="command")])


def verdict_markup(kind: str, word: str, told: Iterable[str]) -> Markup:
    """Return the first line of a page: a word in a badge, and what stands behind it."""
    badge = element("span", word, class_=f"badge {kind}")
    return element("p", joined([badge, " ", *told]), class_="verdict")


def facts_markup(facts: Iterable[tuple[str, str, str]]) -> Markup:
    """Return the row of figures below the verdict, from the name, the text and the key of each."""
    return joined(
        element("div", joined([element("dt", name), element("dd", value, data_figure=key)]))
        for name, value, key in facts
    )


def rule_text(run: Path) -> str:
    """Return the best tree as text, for a reader without scripts."""
    path = RunFolder(run).checked(BEST_TREE_TEXT)
    return read_text(path) if is_there(path) else ""
