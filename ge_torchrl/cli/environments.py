"""`check` and `init`: what there is to know of an environment before a run, and the file to begin with."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from ge_torchrl.cli.parser import Parser
from ge_torchrl.cli.statuses import OK
from ge_torchrl.cli.waiting import looked_at
from ge_torchrl.config import Config
from ge_torchrl.errors import ConfigError

Compose = Callable[[list[str]], Config]
"""Makes a configuration of the words of a command line."""


def check(arguments: list[str], compose: Compose) -> int:
    """Print what is found out about an environment, as `check --help` tells; return the exit status."""
    parser = _parser(
        "check",
        "Print what is found out about an environment: spaces, names, bounds, limit, whether seeds are obeyed, whether "
        "there is a kernel, and how fast it steps.",
    )
    config = compose(_words(parser.parse_args(arguments)))

    from ge_torchrl.run import surveying

    with looked_at(config.env.id):
        found = surveying.survey(config)
    print(found.as_text())
    return OK


def init(arguments: list[str], compose: Compose) -> int:
    """Write the file of an environment for editing, as `init --help` tells; return the exit status."""
    parser = _parser(
        "init",
        "Write the file of an environment that a run would use, its names and its grammar, for editing, and print the "
        "command that uses it.",
    )
    parser.add_argument(
        "--out", metavar="FOLDER", type=Path, default=Path("my_conf"), help="where it goes; default: my_conf"
    )
    options = parser.parse_args(arguments)
    config = compose(_words(options))

    from ge_torchrl.config.files import choices
    from ge_torchrl.run import starting_file
    from ge_torchrl.run.plan import plan

    with looked_at(config.env.id):
        planned = plan(config)
    name = starting_file.starting_name(planned.spec.id, choices("env"))
    print(f"wrote {starting_file.write_starting_file(planned, options.out, name)}; run it with")
    print(f"  {starting_file.starting_command(options.out, name)}")
    return OK


def _parser(verb: str, description: str) -> Parser:
    parser = Parser(prog=f"ge-torchrl {verb}", description=description)
    parser.add_argument(
        "environment",
        metavar="ENV",
        help="a Gymnasium id, such as LunarLander-v3, or env=NAME, or dynamics of your own, such as plant.py:Cart",
    )
    parser.add_argument(
        "settings",
        metavar="key=value",
        nargs="*",
        default=[],
        help="others that matter, such as env.kwargs.gravity=-5",
    )
    return parser


def _words(options: argparse.Namespace) -> list[str]:
    first = options.environment
    words: Sequence[str] = options.settings
    if first.endswith(".py"):
        raise ConfigError(
            f"env.dynamics must be a file and a class in it, as in env.dynamics={first}:Class; got {first!r}"
        )
    key = "env.dynamics" if ".py:" in first else "env.id"
    return [first if "=" in first else f"{key}={first}", *words]
