"""Reading the arguments of a command."""

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ge_torchrl.checks import did_you_mean
from ge_torchrl.errors import UserError
from ge_torchrl.printing import shortened

_MOST_DIGITS = 20


class Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        """Raise the complaint instead of printing it."""
        raise UserError(f"{message}; see --help")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read the arguments; of one that is unknown the nearest flag is named."""
        options, rest = self.parse_known_args(args, namespace)
        if rest:
            meant = did_you_mean(rest[0], flags_of(self))
            self.error(f"unrecognized arguments: {' '.join(rest)}{meant}")
        return options

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            # Formats are short words, of which half a letter in common tells.
            error.message += did_you_mean(str(value), map(str, action.choices or ()), cutoff=0.5)
            raise


def flags_of(parser: argparse.ArgumentParser) -> list[str]:
    """Return the flags that a parser knows, as they are typed."""
    return [flag for action in parser._actions for flag in action.option_strings]  # noqa: SLF001 (it tells nobody)


def options_of_run(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> argparse.Namespace:
    """Read the command line of a run.

    Args:
        parser: Knows the flags, and collects all key=value that stand together.
        arguments: The command line.

    Raises:
        UserError: A flag is unknown or misused, or a key=value stands apart from the others.
    """
    parser.exit_on_error = False
    try:
        options, rest = parser.parse_known_args(arguments)
    except argparse.ArgumentError as error:
        raise UserError(f"{error}; see --help") from error
    for argument in rest:
        if argument.startswith("-"):
            meant = did_you_mean(argument.partition("=")[0], flags_of(parser))
            raise UserError(f"{argument} is an unknown flag; expected one that --help names{meant}")
        together = "expected all key=value together, before or after the flags"
        raise UserError(f"{argument} stands apart; {together}")
    return options


def integer_from(at_least: int, at_most: int | None = None) -> Callable[[str], int]:
    """Return what reads an integer of at least `at_least`, and of at most `at_most` where that is given."""
    allowed = f"of at least {at_least}" if at_most is None else f"from {at_least} to {at_most}"

    def integer(text: str) -> int:
        # No number of use has more digits, and Python refuses thousands of them.
        is_short = text.isdecimal() and len(text) <= _MOST_DIGITS
        if not is_short or not at_least <= int(text) <= (at_most or math.inf):
            raise argparse.ArgumentTypeError(f"must be an integer {allowed}; got {shortened(text)}")
        return int(text)

    return integer


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Let a user vouch for the code that a tree or a run names."""
    parser.add_argument(
        "--trust",
        action="store_true",
        help="run the modules and plants that the tree or the run names; else only what runs of yours have run before",
    )


def add_controller(parser: argparse.ArgumentParser, metavar: str) -> None:
    """Let a command take one controller: a tree's file or a run's folder, and which tree of the run's archive."""
    parser.add_argument("path", metavar=metavar, type=Path, help="a tree's file, or a run's folder")
    parser.add_argument(
        "--nodes",
        metavar="N",
        type=integer_from(0),
        help="take the tree with N decision nodes from the archive of the run; default: the champion",
    )
