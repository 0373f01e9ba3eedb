"""All tables of bad inputs, counted: python tests/hostile/campaign.py; with -v each that is not taken as it should."""

import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(_HERE), str(_HERE.parent / "support")]

import hostile_configurations  # noqa: E402 (the path comes first)
import hostile_environments  # noqa: E402
import hostile_folders  # noqa: E402
import hostile_trees  # noqa: E402
from hostile_verdicts import judged  # noqa: E402

_TABLES = {
    "configurations": hostile_configurations,
    "folders of runs": hostile_folders,
    "files of trees": hostile_trees,
    "environments": hostile_environments,
}


def main() -> None:
    """Print a row for each kind of input: how many there are, and what becomes of those that are not taken well."""
    rows = []
    for kind, table in _TABLES.items():
        wrong, n = Counter(), 0
        with tempfile.TemporaryDirectory() as folder:
            for case in table.cases(Path(folder)):
                verdict, n = judged(case.act), n + 1
                if verdict.kind != case.expected:
                    wrong[verdict.kind] += 1
                    if "-v" in sys.argv:
                        print(f"{kind}: {case.name}: {verdict.kind}: {verdict.told[:200]!r}", file=sys.stderr)
        told = ", ".join(f"{count} {name}" for name, count in wrong.most_common()) or "none"
        rows.append(f"{kind:16} {n:6,}   not as they should: {told}")
    # Some environments write to standard output.
    print("\n" + "\n".join(rows), file=sys.stderr)
    sys.exit(os.EX_OK if all(row.endswith("none") for row in rows) else 1)


if __name__ == "__main__":
    main()
