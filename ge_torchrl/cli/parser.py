"""Reading the arguments of a command."""

import argparse
from collections.abc import Callable
from typing import NoReturn

from ge_torchrl.errors import UserError


class Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        """Raise the complaint instead of printing it."""
        raise UserError(f"{message}; see --help")


def integer_from(at_least: int) -> Callable[[str], int]:
    """Return what reads an integer of at least `at_least`."""

    def integer(text: str) -> int:
        if not text.isdecimal() or int(text) < at_least:
            raise argparse.ArgumentTypeError(f"must be an integer of at least {at_least}; got {text}")
        return int(text)

    return integer
