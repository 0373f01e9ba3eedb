"""`tune`: settings are tried by Optuna, and the best become a preset."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from ge_torchrl.cli.choices import as_meant, with_environment
from ge_torchrl.cli.output import open_console
from ge_torchrl.cli.parser import Parser, integer_from
from ge_torchrl.cli.statuses import OK
from ge_torchrl.cli.waiting import looked_at
from ge_torchrl.config import Config
from ge_torchrl.errors import ConfigError, UserError

_MOST = 100_000


def tune(arguments: list[str], compose: Callable[[list[str]], Config]) -> int:
    """Tune the settings of a run, as `tune --help` tells; return the exit status."""
    options = _parser().parse_intermixed_args(arguments)
    if options.settings and (word := next((word for word in options.settings if "=" not in word), None)):
        raise ConfigError(f"expected key=value, such as env=mountaincar; got {word!r}")
    words = with_environment(as_meant(options.settings))
    own = [] if options.config_dir is None else ["--config-dir", options.config_dir]
    config = compose([*own, *words])

    from ge_torchrl.tuning import study

    if find_spec("optuna") is None:
        raise UserError(study.INSTALL)
    study.check_keys(options.space)
    name = study.name_of_study(words, config.env.id)
    asked = study.Asked(
        config=config,
        words=tuple(words),
        config_dir=options.config_dir,
        space=tuple(options.space),
        runs=options.seeds,
        trials=options.trials,
        processes=options.processes,
    )
    folder = options.out or Path("tuning") / name
    console = open_console()
    with looked_at(config.env.id):
        task = study.begin(folder, asked, console)
    study.carry_out(folder, task, asked, name, console)
    return OK


def _parser() -> Parser:
    parser = Parser(
        prog="ge-torchrl tune",
        description="Try settings of a run by Optuna, those that stand first, and write the best as a preset. "
        "All runs have the same limit, and none sees a test. Ctrl-C, or a kill, loses the trial on its way alone: the "
        "same command goes on.",
    )
    parser.add_argument(
        "settings",
        metavar="key=value",
        nargs="*",
        default=[],
        help="the run, such as env=mountaincar ge.max_env_steps=2e7",
    )
    integer = integer_from(1, _MOST)
    parser.add_argument(
        "--trials", metavar="N", type=integer, default=50, help="trials of the whole study; default: 50"
    )
    parser.add_argument(
        "--seeds", metavar="N", type=integer, default=3, help="runs of a trial, of a seed each; default: 3"
    )
    parser.add_argument(
        "--processes",
        metavar="N",
        type=integer_from(1, 1024),
        default=1,
        help="work side by side, on a core each; default: 1",
    )
    parser.add_argument(
        "--space",
        metavar="KEY=RANGE",
        action="append",
        default=[],
        help="tune these settings alone: KEY, KEY=0.01..0.3, KEY=x4 for a factor around its value, KEY=a,b, or a YAML "
        "file of them; may be given several times",
    )
    parser.add_argument(
        "--out", metavar="FOLDER", type=Path, help="where the study lies; default: tuning/NAME"
    )
    parser.add_argument("--config-dir", metavar="FOLDER", help="a folder of choices of your own, as of a run")
    return parser
