"""The command line without Hydra. The commands beside running: each reads its arguments, calls one room, and prints."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from ge_torchrl.cli.evaluating import evaluate
from ge_torchrl.cli.reporting import report
from ge_torchrl.errors import UserError

VERBS: Mapping[str, Callable[[list[str]], int]] = MappingProxyType({"evaluate": evaluate, "report": report})
"""By the first word of the command line; each takes the others and returns the exit status."""


def verb_of(arguments: Sequence[str]) -> Callable[[list[str]], int] | None:
    """Return the command that the first word names; None where the words are those of a run.

    Raises:
        UserError: The word is nearly that of a command.
    """
    word = arguments[0] if arguments else ""
    if word not in VERBS and (meant := difflib.get_close_matches(word, VERBS, n=1)):
        raise UserError(f"{word} is unknown; expected key=value, such as seed=3, or {meant[0]}; got {word!r}")
    return VERBS.get(word)
