"""Time and memory of large populations, genotypes, tests and reports, as docs/limits.md tells them.

python tests/benchmarks/scale.py                    # all; minutes
python tests/benchmarks/scale.py population report  # some
python tests/benchmarks/scale.py report 100 300     # one, at other sizes

A row tells seconds of a processor, in which others' work on the same cores does not count, and the largest memory of
the process. Kernels are compiled beforehand.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ge_torchrl.artefacts.folder import RunFolder

ROOT = Path(__file__).resolve().parents[2]
QUICK_TREE = ROOT / "docs" / "trees" / "cartpole_two_decisions.json"
PROGRAM = [sys.executable, "-m", "ge_torchrl"]
SMALL = [
    "env=cartpole",
    "refiner=none",
    "ge.generations=3",
    "evaluation.steps_per_second=1e8",
    "evaluation.validation_episodes=100",
    "archive.episodes=50",
]


def population(size: int, folder: Path) -> list[str]:
    """Return a run with so many individuals."""
    return [*SMALL, f"ge.population_size={size}", f"hydra.run.dir={folder / str(size)}"]


def genotype(size: int, folder: Path) -> list[str]:
    """Return a run with so many codons in a genotype, of 200 individuals."""
    return [
        *SMALL,
        "ge.population_size=200",
        f"ge.genotype_length={size}",
        f"hydra.run.dir={folder / str(size)}",
    ]


def evaluate(size: int, _: Path) -> list[str]:
    """Return a test of a small tree on so many episodes."""
    return ["evaluate", str(QUICK_TREE), f"--episodes={size}"]


def report(size: int, folder: Path) -> list[str]:
    """Return the report of so many runs: copies of one with other seeds."""
    first = folder / "first"
    if not first.exists():
        subprocess.run([*PROGRAM, *population(60, folder)], check=True, stdout=subprocess.DEVNULL)
        (folder / "60").rename(first)
    sweep = folder / str(size)
    for seed in range(size):
        _copy(RunFolder(first), sweep / f"{seed}_seed={seed}", seed)
    return ["report", str(sweep)]


def _copy(run: RunFolder, path: Path, seed: int) -> None:
    """Copy a finished run under another seed, and with another mean in its test."""
    shutil.copytree(run.path, path, ignore=shutil.ignore_patterns("report.html"))
    config = path / "config.yaml"
    config.write_text(re.sub(r"(?m)^seed: 0$", f"seed: {seed}", config.read_text()))
    summary = run.read_summary()
    RunFolder(path).write_summary(replace(summary, seed=seed, test_mean=summary.test_mean + seed % 97))


CASES: dict[str, tuple[Callable[[int, Path], list[str]], tuple[int, ...]]] = {
    "population": (population, (200, 2_000, 20_000)),
    "genotype": (genotype, (1_000, 10_000, 100_000)),
    "evaluate": (evaluate, (10_000, 100_000, 1_000_000)),
    "report": (report, (30, 300, 3_000)),
}


def measured(words: Sequence[str], output: Path) -> tuple[float, float]:
    """Run the program; return seconds of a processor, and the largest memory in MB."""
    with output.open("w") as told:
        process = subprocess.Popen([*PROGRAM, *words], stdout=told, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(output.read_text())
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000


def main(words: Sequence[str]) -> None:
    """Measure the cases that are named, or all."""
    sizes = tuple(int(word) for word in words if word.isdigit())
    print("| what | size | processor s | MB |\n| --- | ---: | ---: | ---: |", flush=True)
    with tempfile.TemporaryDirectory() as there:
        for name in [word for word in words if not word.isdigit()] or CASES:
            case, usual = CASES[name]
            folder = Path(there) / name
            folder.mkdir()
            for size in sizes or usual:
                seconds, memory = measured(case(size, folder), folder / "output")
                print(f"| {name} | {size:,} | {seconds:.1f} | {memory:,.0f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
