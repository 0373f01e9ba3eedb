"""The tables of docs/results.md and README.md, from finished runs; the commands above the tables make the runs.

    python tests/benchmarks/results.py default             # print the tables of the default
    python tests/benchmarks/results.py default --write     # put them between their marks in these pages

A mark is a line such as `<!-- TABLE default -->`; everything up to `<!-- END default -->` is replaced.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from default_tables import default_tables, rates_tables
from rules_tables import rules_tables
from thesis_tables import published_tables, solving_tables, thesis_tables

from ge_torchrl.errors import UserError

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = (DOCS / "results.md", DOCS.parent / "README.md")
TABLES = {
    "default": default_tables,
    "rates": rates_tables,
    "solving": solving_tables,
    "thesis": thesis_tables,
    "published": published_tables,
    "rules": rules_tables,
}


def write(name: str, text: str) -> None:
    """Put a text between the marks of a table, in the page that has them."""
    pattern = re.compile(rf"(<!-- TABLE {name} -->\n).*?(<!-- END {name} -->)", flags=re.DOTALL)
    for path in PAGES:
        page = path.read_text(encoding="utf-8")
        if pattern.search(page):
            written = pattern.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)
            path.write_text(written, encoding="utf-8")
            return
    raise ValueError(f"a page must have the marks of {name}")


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description="Make tables of the pages from finished runs.")
    parser.add_argument("names", nargs="+", choices=TABLES, metavar="NAME", help=", ".join(TABLES))
    parser.add_argument(
        "--folder", type=Path, default=Path("multirun"), help="of the runs; default: multirun"
    )
    parser.add_argument("--figures", type=Path, default=DOCS / "figures", help="where figures go")
    parser.add_argument("--write", action="store_true", help="put the tables into their pages")
    options = parser.parse_args(arguments)
    for name in options.names:
        for mark, text in TABLES[name](options.folder, options.figures):
            print(f"\n{mark}\n\n{text}")
            if options.write:
                write(mark, text)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except UserError as error:
        sys.exit(f"results.py: {error}")
