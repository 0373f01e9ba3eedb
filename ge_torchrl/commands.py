"""The commands beside running: testing a tree again, and reporting finished runs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from ge_torchrl.errors import UserError

# Exit statuses of the program.
OK, FAULT, USER_ERROR, INTERRUPTED = 0, 1, 2, 130


def evaluate(arguments: list[str]) -> int:
    """Test a tree, or those of many runs, on new episodes, as `evaluate --help` tells; return the exit status."""
    parser = _Parser(
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
    parser.add_argument("--episodes", type=_integer_from(1), default=1000, help="default: 1000")
    parser.add_argument(
        "--seed", type=_integer_from(0), default=10000, help="of the first episode; default: 10000"
    )
    parser.add_argument(
        "--nodes",
        metavar="N",
        type=_integer_from(0),
        help="take the tree with N decision nodes from the hall of fame of each run; default: the champion, and of "
        "many runs the whole hall of fame too",
    )
    parser.add_argument("--route", choices=("auto", "gymnasium", "compiled"), default="auto")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one line of JSON")
    form.add_argument("--markdown", action="store_true", help="print the tables of many runs in Markdown")
    options = parser.parse_args(arguments)

    from ge_torchrl import evaluation

    measures = options.episodes, options.seed, options.route, options.nodes
    if evaluation.is_above_runs(options.path):
        sweep = evaluation.evaluate_runs(options.path, *measures)
        for line in sweep.left_out:
            print(f"ge-torchrl: left out: {line}", file=sys.stderr)
        if options.json:
            print(json.dumps(sweep.as_dict()))
        else:
            print(sweep.as_markdown() if options.markdown else sweep.as_text())
        return OK
    if options.markdown:
        raise UserError(f"--markdown tells of many runs, so expected a folder above them; got {options.path}")
    summary = evaluation.evaluate(options.path, *measures)
    print(json.dumps(summary.as_dict()) if options.json else summary.as_text())
    return OK


def report(arguments: list[str]) -> int:
    """Report the runs in a folder, as `report --help` tells; return the exit status."""
    parser = _Parser(
        prog="ge-torchrl report",
        description="Print a table of finished runs, and write a report with figures and drawn trees.",
    )
    parser.add_argument(
        "folder", metavar="FOLDER", type=Path, help="a run's or sweep's folder, or any above them"
    )
    parser.add_argument(
        "--against", metavar="FOLDER", type=Path, help="of runs of other methods, such as GE alone"
    )
    parser.add_argument(
        "--output", metavar="DIR", type=Path, help="folder of the report; default: FOLDER/report"
    )
    options = parser.parse_args(arguments)

    from ge_torchrl.report.canvas import PLOTS_HINT, has_matplotlib
    from ge_torchrl.report.findings import runs_tables
    from ge_torchrl.report.sweep import gather_runs, write_report

    found = gather_runs(options.folder, options.against)
    for line in found.unreadable:
        print(f"ge-torchrl: left out: {line}", file=sys.stderr)
    print(runs_tables(found.runs))
    if options.output is None and not has_matplotlib():
        print(f"ge-torchrl: no report: {PLOTS_HINT}", file=sys.stderr)
    else:
        output = options.output or options.folder / "report"
        print(f"\nreport: {write_report(options.folder, options.against, output)}")
    return OK


class _Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; see --help")


def _integer_from(at_least: int) -> Callable[[str], int]:
    def integer(text: str) -> int:
        if not text.isdecimal() or int(text) < at_least:
            raise argparse.ArgumentTypeError(f"must be an integer of at least {at_least}; got {text}")
        return int(text)

    return integer
