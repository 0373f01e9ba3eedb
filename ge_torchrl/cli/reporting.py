"""`report`: tables and figures of finished runs."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ge_torchrl.cli.output import form_of_tables
from ge_torchrl.cli.parser import Parser
from ge_torchrl.cli.statuses import OK
from ge_torchrl.cli.waiting import HowFar
from ge_torchrl.errors import UserError

if TYPE_CHECKING:
    from ge_torchrl.report.tables import Form


def report(arguments: list[str]) -> int:
    """Report the runs in a folder, as `report --help` tells; return the exit status."""
    parser = Parser(
        prog="ge-torchrl report",
        description="Print a table of finished runs, and write a report with figures and drawn trees, and pages to "
        "look at: report.html in the folder and in that of every run. Of a run that goes on or broke off, tell what it "
        "has found so far.",
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
    parser.add_argument("--markdown", action="store_true", help="print the tables in Markdown")
    options = parser.parse_args(arguments)

    from ge_torchrl.report.canvas import PLOTS_HINT, has_matplotlib
    from ge_torchrl.report.findings import runs_tables
    from ge_torchrl.report.html.writing import write_pages
    from ge_torchrl.report.pages import write_report
    from ge_torchrl.report.runs import gather_runs
    from ge_torchrl.report.unfinished import is_unfinished

    if is_unfinished(options.folder):
        if options.against or options.output:
            raise UserError(
                f"--against and --output tell of finished runs, so expected one; the run in {options.folder} is not"
            )
        return _told_so_far(options.folder, form_of_tables(markdown=options.markdown))
    found = gather_runs(options.folder, options.against, HowFar("runs read"))
    for line in found.left_out:
        print(f"ge-torchrl: left out: {line}", file=sys.stderr)
    print(runs_tables(found.runs, form_of_tables(markdown=options.markdown)))
    if options.output is None and not has_matplotlib():
        print(f"ge-torchrl: no report: {PLOTS_HINT}", file=sys.stderr)
    else:
        output = options.output or options.folder / "report"
        print(f"\nreport: {write_report(options.folder, options.against, output, found)}")
    own = gather_runs(options.folder) if options.against else found
    pages = write_pages(options.folder, own, HowFar("pages of runs"))
    for line in pages.failed:
        print(f"ge-torchrl: no page: {line}", file=sys.stderr)
    if pages.written is not None:
        print(f"page: {pages.written}")
    return OK


def _told_so_far(run: Path, form: "Form") -> int:
    """Tell what a run without a verdict has found so far, and write its page."""
    from ge_torchrl.report.html.writing import write_run_page
    from ge_torchrl.report.unfinished import read_unfinished, unfinished_text

    print(unfinished_text(read_unfinished(run), form))
    print(f"\npage: {write_run_page(run)}")
    return OK
