"""Two sweeps beside each other, seed by seed: are runs of the first better than those of the second?

    python tests/benchmarks/tuned.py multirun/tuned multirun/untuned

Runs of equal seeds are tested on the same episodes. It prints median and quartiles of the champions' mean test returns,
how often which one is better, and the probability of that by the sign test, if neither were.
"""

import argparse
import math
from pathlib import Path

import numpy as np

from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.tables import Table


def sign_test(wins: int, losses: int) -> float:
    """Return the two-sided probability of a split at least as uneven, if either were as likely."""
    n, few = wins + losses, min(wins, losses)
    return min(1.0, 2 * sum(math.comb(n, k) for k in range(few + 1)) / 2**n)


def compared(first: Path, second: Path) -> str:
    """Return the comparison as text.

    Args:
        first: A folder of runs, of a seed each.
        second: Another one, of the same seeds.
    """
    sides = [{run.seed: run.summary for run in read_runs(folder).runs} for folder in (first, second)]
    seeds = sorted(sides[0].keys() & sides[1].keys())
    returns = np.array([[side[seed].test_mean for seed in seeds] for side in sides])
    rows = []
    for folder, side, values in zip((first, second), sides, returns, strict=True):
        low, median, high = np.percentile(values, (25, 50, 75))
        nodes = np.median([side[seed].decision_nodes for seed in seeds])
        seconds = np.median([side[seed].wall_seconds for seed in seeds])
        rows.append(
            (folder.name, f"{median:.2f}", f"{low:.2f} to {high:.2f}", f"{values.min():.2f} to {values.max():.2f}",
             f"{nodes:g}", f"{seconds:.1f}")
        )  # fmt: skip
    table = Table.of(("runs", "median", "quartiles", "range", "median nodes", "median s"), rows)
    wins, losses = int((returns[0] > returns[1]).sum()), int((returns[0] < returns[1]).sum())
    gain = np.median(returns[0] - returns[1])
    told = (
        f"of {len(seeds)} seeds the first is better in {wins} and worse in {losses}, by {gain:.2f} in the median; "
        f"sign test p = {sign_test(wins, losses):.2g}"
    )
    return f"{table.markdown()}\n\n{told}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    options = parser.parse_args()
    print(compared(options.first, options.second))
