"""The command line without Hydra. The commands beside running: each reads its arguments, calls one room, and prints."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NoReturn

from ge_torchrl.cli.completing import complete, completion
from ge_torchrl.cli.environments import Compose, check, init
from ge_torchrl.cli.evaluating import evaluate
from ge_torchrl.cli.explaining import explain
from ge_torchrl.cli.exporting import export
from ge_torchrl.cli.following import status
from ge_torchrl.cli.playing import play
from ge_torchrl.cli.reporting import report
from ge_torchrl.cli.resuming import resume
from ge_torchrl.cli.statuses import OK
from ge_torchrl.errors import UserError

Verb = Callable[[list[str]], int]

RUN = "run"
"""The first word that may stand before those of a run."""
_PLAIN: Mapping[str, Verb] = MappingProxyType(
    {
        "completion": completion,
        "evaluate": evaluate,
        "explain": explain,
        "export": export,
        "play": play,
        "report": report,
        "resume": resume,
        "status": status,
    }
)
_COMPOSING: Mapping[str, Callable[[list[str], Compose], int]] = MappingProxyType(
    {"check": check, "init": init}
)
VERBS = frozenset({*_PLAIN, *_COMPOSING})
"""The first words of command lines that are no runs."""


def verb_of(arguments: Sequence[str], compose: Compose) -> Verb | None:
    """Return the command that the first word names; None where the words are those of a run.

    Args:
        arguments: The command line.
        compose: Makes a configuration of words such as those of a run.

    Returns:
        What takes the other words and returns the exit status.

    Raises:
        UserError: The word is nearly that of a command.
    """
    word = arguments[0] if arguments else ""
    known = {*VERBS, RUN}
    if word.isalpha() and word not in known and (meant := difflib.get_close_matches(word, known, n=1)):
        raise UserError(f"{word} is unknown; expected key=value, such as seed=3, or {meant[0]}; got {word!r}")
    if composing := _COMPOSING.get(word):
        return lambda words: composing(words, compose)
    return _PLAIN.get(word)


def complete_words(arguments: Sequence[str]) -> int:
    """Answer a shell that asks at TAB; see `completing.complete`."""

    def nothing(_: list[str]) -> NoReturn:
        raise UserError("a shell asks for words alone")

    verbs = {name: verb_of([name], nothing) or _run for name in (*VERBS, RUN)}
    return complete(arguments, verbs)


def _run(_: list[str]) -> int:
    return OK
