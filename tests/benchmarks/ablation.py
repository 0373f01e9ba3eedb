"""What each part of the default brings: it is left out, one at a time, in short runs of many seeds.

    python tests/benchmarks/ablation.py                 # all environments, 20 seeds: an hour on two cores
    python tests/benchmarks/ablation.py --table         # the tables of runs that are there already
    python tests/benchmarks/ablation.py --commands      # the command of every row; nothing is run

A short run has few generations and few neighbours, so that it shows how fast good trees are found, before all
variants have found them; on CartPole, where whole runs have them in their second generation, two of each. The refiner
is due in every generation. What is compared is the champion's mean return on the run's 1,000 test episodes, seed by
seed.
"""

import argparse
import shlex
import sys
from pathlib import Path

import numpy as np

from ge_torchrl.__main__ import main
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.statistics import bootstrap_interval
from ge_torchrl.report.tables import Table

SHORT = ("archive.final_keep=0", "evaluation.validation_episodes=1000", "refiner.schedule.every=1")
EIGHT = ("ge.generations=8", "archive.neighbours=10", "archive.neighbours_drawn=200")
LENGTH = {
    "cartpole": ("ge.generations=2", "archive.neighbours=2", "archive.neighbours_drawn=40"),
    "acrobot": EIGHT,
    "mountaincar": EIGHT,
}
QUICK = (
    "ge.population_size=20",
    "ge.generations=2",
    "refiner.ppo.max_timesteps=2000",
    "polish.max_timesteps=5000",
    "evaluation.validation_episodes=20",
    "evaluation.test_episodes=50",
)
DEFAULT = "the default"
KEEPS = ("archive.neighbours=0", "archive.revisit_factor=0", "archive.migrants=0")
# In each the one part is left out, or put back to what the thesis has.
VARIANTS = {
    DEFAULT: (),
    "no PPO, the polish alone": ("refiner.method=none",),
    "no polish, PPO alone": ("polish=none",),
    "local search in PPO's place (refiner=cmaes)": ("refiner=cmaes",),
    "straight-through splits": ("refiner.ppo.straight_through=true",),
    "no neighbours refined": ("archive.neighbours=0",),
    "no kept trees refined again": ("archive.revisit_factor=0",),
    "no migrants": ("archive.migrants=0",),
    # No individual has so many decision nodes.
    "individuals not refined": ("refiner.min_nodes=1000",),
    "no write-back, nothing snapped or simplified": ("refiner.write_back=false",),
    "the same episodes in all generations": ("evaluation.episode_seeds=fixed",),
    "no parsimony": ("ge.parsimony=none",),
    "one range of constants": ("grammar=thesis/{environment}",),
    "the archive only keeps": KEEPS,
    "no archive": ("archive=none",),
    "nothing refined (GE alone)": ("refiner=none",),
}
# Parts that one environment alone has. Short runs leave the last refinement out, so it is put back here.
ALSO = {
    "cartpole": {"with the last refinement": ("archive.final_keep=8",)},
    "mountaincar": {
        "with the last refinement": ("archive.final_keep=2",),
        "with the last refinement, at the nearest constants": (
            "archive.final_keep=2",
            "polish.settling_episodes=0",
        ),
    },
    "acrobot": {
        "with the last refinement": ("archive.final_keep=4",),
        "no numbers moved one by one": ("polish.moves=0",),
        "40 episodes a polish, not 400": ("polish.episodes=40",),
    },
}
ENVIRONMENTS = tuple(LENGTH)


def command(options: argparse.Namespace, environment: str, variant: str) -> list[str]:
    """The command line, without `python -m ge_torchrl`, of one variant in one environment."""
    short = (*LENGTH[environment], *SHORT, *(QUICK if options.quick else ()))
    settings = {_key(text): text for text in short}
    # The last word on a key is the only one.
    for text in _variants(environment)[variant]:
        settings[_key(text)] = text.format(environment=environment)
    launcher = [] if options.quick else ["hydra/launcher=joblib"]
    folder = _folder(options, environment, variant)
    return [
        "-m", *launcher, f"env={environment}", f"seed=range({options.seeds})", *settings.values(),
        f"hydra.sweep.dir={folder}",
    ]  # fmt: skip


def table(options: argparse.Namespace, environment: str) -> str:
    """The table of one environment in Markdown."""
    rng = np.random.default_rng(0)
    found = {
        variant: read_runs(_folder(options, environment, variant)).runs
        for variant in _variants(environment)
        if _folder(options, environment, variant).exists()
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
                f"{np.median([run.summary.wall_seconds for run in runs]):.0f}",
            ]
        )
    head = (
        "left out",
        "runs",
        "mean test return",
        "worst",
        "against the default, paired",
        "million steps",
        "s",
    )
    return f"**{found[DEFAULT][0].environment}**\n\n{Table.of(head, rows).markdown()}\n"


def _key(setting: str) -> str:
    return setting.partition("=")[0]


def _variants(environment: str) -> dict[str, tuple[str, ...]]:
    return VARIANTS | ALSO[environment]


def _folder(options: argparse.Namespace, environment: str, variant: str) -> Path:
    slug = "".join(letter if letter.isalnum() else "-" for letter in variant)
    return options.folder / environment / slug


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--folder", type=Path, help="where the runs are (default: multirun/ablation, or ablation-quick)"
    )
    parser.add_argument("--environments", nargs="+", choices=ENVIRONMENTS, help="(default: all)")
    parser.add_argument("--seeds", help="first and end, as of range() (default: 20,40)")
    parser.add_argument("--table", action="store_true", help="run nothing")
    parser.add_argument("--commands", action="store_true", help="print the command of every row")
    parser.add_argument("--quick", action="store_true", help="tiny runs of CartPole: does it run at all?")
    options = parser.parse_args()
    options.folder = options.folder or Path(
        "multirun/ablation-quick" if options.quick else "multirun/ablation"
    )
    options.environments = options.environments or (("cartpole",) if options.quick else ENVIRONMENTS)
    options.seeds = options.seeds or ("20,22" if options.quick else "20,40")
    for environment in options.environments:
        for variant in () if options.table else _variants(environment):
            arguments = command(options, environment, variant)
            if options.commands:
                print(f"# {variant}\npython -m ge_torchrl {shlex.join(arguments)}")
            elif (status := main(arguments)) != 0:
                sys.exit(status)
        if not options.commands:
            print(table(options, environment), flush=True)
