"""What each part of the default brings: it is left out, one at a time, in short runs of many seeds.

    python tests/benchmarks/ablation.py                 # all environments, 20 seeds, a quarter of an hour on two cores
    python tests/benchmarks/ablation.py --table         # the tables of runs that are there already

A short run has few generations and few neighbours, so that it shows how fast good trees are found, before all
variants have found them; on CartPole, where whole runs have them in their second generation, two of each. What is
compared is the champion's mean return on the run's 1,000 test episodes, seed by seed.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from ge_torchrl.__main__ import main
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.statistics import bootstrap_interval
from ge_torchrl.report.tables import markdown

SHORT = ["hall_of_fame.final_keep=0", "evaluation.validation_episodes=1000"]
LENGTH = {
    "cartpole": ["ge.generations=2", "hall_of_fame.neighbours=2", "hall_of_fame.neighbours_drawn=40"],
    "acrobot": ["ge.generations=8", "hall_of_fame.neighbours=10", "hall_of_fame.neighbours_drawn=200"],
    "mountaincar": ["ge.generations=8", "hall_of_fame.neighbours=10", "hall_of_fame.neighbours_drawn=200"],
}
DEFAULT = "the default"
# In each the one part is left out, or put back to what the thesis has.
VARIANTS = {
    DEFAULT: [],
    "no neighbours refined": ["hall_of_fame.neighbours=0"],
    "no kept trees refined again": ["hall_of_fame.revisits=0"],
    "no migrants": ["hall_of_fame.migrants=0"],
    "individuals not refined": ["refiner.probability=0"],
    "no write-back, nothing snapped": ["refiner.write_back=false"],
    "refined whole, not simplified": ["refiner.simplify=false"],
    "the same episodes in all generations": ["evaluation.episode_seeds=fixed"],
    "no parsimony": ["ge.parsimony=none"],
    "one range of constants": ["grammar=thesis/${env}"],
    "hall of fame only keeps": ["hall_of_fame=kept"],
    "no refinement at all (GE alone)": ["refiner=none"],
}
# Here the settings of exploring would be refused.
EXPLORE_NOTHING = ("hall of fame only keeps", "no refinement at all (GE alone)")
# Parts that one environment alone has. Short runs leave the last refinement out, so it is put back here.
ALSO = {
    "cartpole": {"with the last refinement": ["hall_of_fame.final_keep=8"]},
    "mountaincar": {
        "with the last refinement": ["hall_of_fame.final_keep=2"],
        "with the last refinement, at the nearest constants": [
            "hall_of_fame.final_keep=2",
            "hall_of_fame.final_settling_episodes=0",
        ],
    },
    "acrobot": {
        "with the last refinement": ["hall_of_fame.final_keep=4"],
        "no thresholds moved one by one": ["refiner.cmaes.moves=0"],
        "40 episodes a refinement, not 400": [
            "refiner.cmaes.episodes=40",
            "refiner.cmaes.screening_episodes=0",
        ],
    },
}
ENVIRONMENTS = tuple(LENGTH)


def run(folder: Path, environment: str, variant: str, seeds: str) -> None:
    """Run one variant of one environment."""
    overrides = [text.replace("${env}", environment) for text in _variants(environment)[variant]]
    short = [*LENGTH[environment], *SHORT]
    if variant in EXPLORE_NOTHING:
        short = [key for key in short if "hall" not in key]
    status = main(
        [
            "-m",
            "hydra/launcher=joblib",
            f"env={environment}",
            f"seed=range({seeds})",
            *short,
            *overrides,
            f"hydra.sweep.dir={folder / environment / _slug(variant)}",
        ]
    )
    if status != 0:
        sys.exit(status)


def table(folder: Path, environment: str) -> str:
    """Return the table of one environment."""
    rng = np.random.default_rng(0)
    found = {
        variant: read_runs(folder / environment / _slug(variant)).runs
        for variant in _variants(environment)
        if (folder / environment / _slug(variant)).exists()
    }
    default = {run.seed: run.summary.test_mean for run in found[DEFAULT]}
    rows = []
    for variant, runs in found.items():
        means = [run.summary.test_mean for run in runs]
        differences = [run.summary.test_mean - default[run.seed] for run in runs]
        low, high = bootstrap_interval(differences, rng)
        rows.append(
            [
                variant,
                str(len(runs)),
                f"{np.mean(means):.2f}",
                f"{min(means):.2f}",
                "" if variant == DEFAULT else f"{np.mean(differences):+.2f} ({low:+.2f} to {high:+.2f})",
                f"{np.median([run.summary.env_steps for run in runs]) / 1e6:.0f}",
            ]
        )
    head = ["left out", "runs", "mean test return", "worst", "against the default, paired", "million steps"]
    return f"**{found[DEFAULT][0].environment}**\n\n{markdown(head, rows)}"


def _variants(environment: str) -> dict[str, list[str]]:
    return VARIANTS | ALSO[environment]


def _slug(variant: str) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in variant)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("multirun/ablation"))
    parser.add_argument("--environments", nargs="+", default=ENVIRONMENTS, choices=ENVIRONMENTS)
    parser.add_argument("--seeds", default="20,40", help="first and end, as of range()")
    parser.add_argument("--table", action="store_true", help="run nothing")
    options = parser.parse_args()
    for environment in options.environments:
        for variant in () if options.table else _variants(environment):
            run(options.folder, environment, variant, options.seeds)
        print(table(options.folder, environment), flush=True)
