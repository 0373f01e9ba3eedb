"""The command line without Hydra. The commands beside running: each reads its arguments, calls one room, and prints."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NoReturn

from ge_torchrl.checks import did_you_mean
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
from ge_torchrl.cli.tuning import tune
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
    {"check": check, "init": init, "tune": tune}
)
VERBS = frozenset({*_PLAIN, *_COMPOSING})
"""The first words of command lines that are no runs."""
HELP = "help"
"""The word that asks for what --help says, of a command that may follow."""


def as_asked(arguments: Sequence[str]) -> list[str]:
    """Return a command line with --help where the first word asks for help: `help export` is `export --help`."""
    if not arguments or arguments[0] != HELP:
        return list(arguments)
    return [*(word for word in arguments[1:2] if word != HELP), "--help"]


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
    known = {*VERBS, RUN, HELP}
    if word.isalpha() and word not in known and (meant := did_you_mean(word, sorted(known))):
        raise UserError(
            f"{word} is unknown; expected a command, or key=value, such as seed=3; got {word!r}{meant}"
        )
    if composing := _COMPOSING.get(word):
        return lambda words: composing(words, compose)
    return _PLAIN.get(word)


def complete_words(arguments: Sequence[str]) -> int:
    """Answer a shell that asks at TAB; see `completing.complete`."""

    def nothing(_: list[str]) -> NoReturn:
        raise UserError("a shell asks for words alone")

    verbs = {name: verb_of([name], nothing) or _run for name in (*VERBS, RUN, HELP)}
    return complete(arguments, verbs)


def _run(_: list[str]) -> int:
    return OK
