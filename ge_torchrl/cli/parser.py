"""Reading the arguments of a command."""

import argparse
import math
from collections.abc import Callable
from typing import NoReturn

from ge_torchrl.errors import UserError


class Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        """Raise the complaint instead of printing it."""
        raise UserError(f"{message}; see --help")


def integer_from(at_least: int, at_most: int | None = None) -> Callable[[str], int]:
    """Return what reads an integer of at least `at_least`, and of at most `at_most` where that is given."""
    allowed = f"of at least {at_least}" if at_most is None else f"from {at_least} to {at_most}"

    def integer(text: str) -> int:
        if not text.isdecimal() or not at_least <= int(text) <= (at_most or math.inf):
            raise argparse.ArgumentTypeError(f"must be an integer {allowed}; got {text}")
        return int(text)

    return integer
