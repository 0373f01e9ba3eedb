"""`resume`: a run that was killed or interrupted, or that broke off, goes on to its end."""

from pathlib import Path

from ge_torchrl.cli.output import open_console
from ge_torchrl.cli.parser import Parser, add_trust
from ge_torchrl.cli.statuses import OK


def resume(arguments: list[str]) -> int:
    """Go on with a run, as `resume --help` tells; return the exit status."""
    parser = Parser(
        prog="ge-torchrl resume",
        description="Go on with a run that was killed or interrupted, or that broke off, in its folder. "
        "It ends as if it had been left alone.",
    )
    parser.add_argument("path", metavar="RUN", type=Path, help="the run's folder")
    add_trust(parser)
    options = parser.parse_args(arguments)

    from ge_torchrl.environments.trust import trusting
    from ge_torchrl.run.experiment import resume as go_on

    with trusting(vouched=options.trust):
        summary = go_on(options.path, open_console())
    if summary is None:
        print(f"the run in {options.path} has come to its end: there is nothing to go on with")
    return OK
