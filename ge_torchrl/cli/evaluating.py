"""`evaluate`: a tree, or those of many runs, on new episodes."""

import argparse
import json
import sys
from pathlib import Path

from ge_torchrl.checks import MOST_EPISODES, MOST_SEED
from ge_torchrl.cli.output import form_of_tables
from ge_torchrl.cli.parser import Parser, add_trust, integer_from
from ge_torchrl.cli.statuses import OK
from ge_torchrl.cli.waiting import HowFar
from ge_torchrl.errors import UserError


def evaluate(arguments: list[str]) -> int:
    """Test a tree, or those of many runs, as `evaluate --help` tells; return the exit status."""
    options = _parser().parse_args(arguments)

    from ge_torchrl.environments.trust import trusting

    with trusting(vouched=options.trust):
        return _told(options)


def _told(options: argparse.Namespace) -> int:
    from ge_torchrl.report import evaluation

    measures = options.episodes, options.seed, options.route, options.nodes, HowFar("episodes")
    if evaluation.is_above_runs(options.path):
        sweep = evaluation.evaluate_runs(options.path, *measures)
        for line in sweep.left_out:
            print(f"ge-torchrl: left out: {line}", file=sys.stderr)
        if options.json:
            print(json.dumps(sweep.as_dict()))
        else:
            print(sweep.as_text(form_of_tables(markdown=options.markdown)))
        return OK
    if options.markdown:
        raise UserError(f"--markdown tells of many runs, so expected a folder above them; got {options.path}")
    summary = evaluation.evaluate(options.path, *measures)
    print(json.dumps(summary.as_dict()) if options.json else summary.as_text())
    return OK


def _parser() -> Parser:
    parser = Parser(
        prog="ge-torchrl evaluate",
        description="Measure a tree on episodes that no run has seen, or the trees of all runs in a folder on the "
        "same ones.",
    )
    parser.add_argument(
        "path",
        metavar="TREE_OR_RUN",
        type=Path,
        help="a tree's file, a run's folder, or a folder with finished runs at any depth",
    )
    parser.add_argument("--episodes", type=integer_from(1, MOST_EPISODES), default=1000, help="default: 1000")
    parser.add_argument(
        "--seed", type=integer_from(0, MOST_SEED), default=10000, help="of the first episode; default: 10000"
    )
    parser.add_argument(
        "--nodes",
        metavar="N",
        type=integer_from(0),
        help="take the tree with N decision nodes from the archive of each run; default: the champion, and of many "
        "runs the whole archive too",
    )
    add_trust(parser)
    parser.add_argument("--route", choices=("auto", "kernel", "gymnasium"), default="auto")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one line of JSON")
    form.add_argument("--markdown", action="store_true", help="print the tables of many runs in Markdown")
    return parser
