"""The command line's own check of a run's words, without the run."""

from collections.abc import Sequence

from hydra._internal.utils import get_args_parser

from ge_torchrl import __main__ as command_line
from ge_torchrl.cli.parser import options_of_run


def check_composes(words: Sequence[str]) -> None:
    """Compose and check every configuration that these words name.

    Args:
        words: Flags and overrides, as they are typed after `python -m ge_torchrl`.

    Raises:
        ConfigError: What would be told to the user.
    """
    command_line._prepare_hydra()
    command_line._check(options_of_run(get_args_parser(), list(words)))
