"""The command line without Hydra. The commands beside running: each reads its arguments, calls one room, and prints."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from ge_torchrl.cli.environments import Compose, check, init
from ge_torchrl.cli.evaluating import evaluate
from ge_torchrl.cli.exporting import export
from ge_torchrl.cli.playing import play
from ge_torchrl.cli.reporting import report
from ge_torchrl.errors import UserError

_COMPOSING: Mapping[str, Callable[[list[str], Compose], int]] = MappingProxyType(
    {"check": check, "init": init}
)
VERBS = frozenset({"evaluate", "export", "play", "report", *_COMPOSING})
"""The first words of command lines that are no runs."""


def verb_of(arguments: Sequence[str], compose: Compose) -> Callable[[list[str]], int] | None:
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
    if word not in VERBS and (meant := difflib.get_close_matches(word, VERBS, n=1)):
        raise UserError(f"{word} is unknown; expected key=value, such as seed=3, or {meant[0]}; got {word!r}")
    if composing := _COMPOSING.get(word):
        return lambda words: composing(words, compose)
    return {"evaluate": evaluate, "export": export, "play": play, "report": report}.get(word)
