"""`resume`: a run that was killed or interrupted, or that broke off, goes on to its end."""

from pathlib import Path

from ge_torchrl.cli.output import open_console
from ge_torchrl.cli.parser import Parser
from ge_torchrl.cli.statuses import OK


def resume(arguments: list[str]) -> int:
    """Go on with a run, as `resume --help` tells; return the exit status."""
    parser = Parser(
        prog="ge-torchrl resume",
        description="Go on with a run that was killed or interrupted, or that broke off, in its folder. "
        "It ends as if it had been left alone.",
    )
    parser.add_argument("path", metavar="RUN", type=Path, help="the run's folder")
    path = parser.parse_args(arguments).path

    from ge_torchrl.run.experiment import resume as go_on

    if go_on(path, open_console()) is None:
        print(f"the run in {path} has come to its end: there is nothing to go on with")
    return OK
