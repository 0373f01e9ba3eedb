"""Which runs stay the same, byte for byte, where processor, threads, launcher and the like are not.

python tests/support/same_bytes.py             # all changes, as the table of docs/same_bytes.md has them; minutes
python tests/support/same_bytes.py numpy blas  # those alone whose name has one of these words

Libraries are told to act as on older processors; their names for these are of 64-bit Intel and AMD processors.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from runs_for_tests import assert_same_bytes

ROOT = Path(__file__).resolve().parents[2]
# Three kinds of run on two routes, each tiny. Budgets follow a given speed, so the clock has no say.
SWEEP = ["env.route=kernel,gymnasium", "refiner=none,cmaes,ppo"]
KINDS = [
    f"{route}, {search}"
    for route in ("kernel", "Gymnasium")
    for search in ("evolution", "with local search", "with PPO")
]
SMALL = [
    "seed=3",
    "polish=none",
    "ge.generations=3",
    "ge.population_size=30",
    "evaluation.steps_per_second=1e8",
    "evaluation.episodes=5",
    "evaluation.validation_episodes=20",
    "evaluation.test_episodes=20",
    "archive.keep=2",
    "archive.episodes=20",
    "archive.neighbours=1",
    "archive.final_keep=0",
    "archive.revisit_factor=0",
    "polish.max_timesteps=5000",
    "polish.episodes=8",
    "polish.moves=4",
    "refiner.schedule.every=1",
    "refiner.measuring_episodes=5",
    "refiner.acceptance_episodes=20",
    "refiner.ppo.max_timesteps=1000",
    "refiner.ppo.update_timesteps=250",
    "refiner.ppo.snapshot_episodes=5",
]


# They tell what was typed; what follows from it is compared.
_NOT_COMPARED = ("config.yaml", "job.json", "report.html")


class Change(NamedTuple):
    """What differs between two runs that are compared.

    Attributes:
        variables: Of the environment of the process.
        words: Of the command line.
        flags: Of Python.
    """

    variables: dict[str, str] = {}  # noqa: RUF012, never changed
    words: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()


NO_AVX512 = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"}
NO_AVX2 = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL"}
BEFORE = Change({"PYTHONHASHSEED": "0"}, ("evaluation.threads=1", "env.workers=1"))
CHANGES = {
    "again": Change(),
    "hash seed": Change({"PYTHONHASHSEED": "1"}),
    "python -O": Change(flags=("-O",)),
    "threads and workers": Change(words=("evaluation.threads=2", "env.workers=2")),
    "OMP_NUM_THREADS=1": Change({"OMP_NUM_THREADS": "1"}),
    "OMP_NUM_THREADS=2": Change({"OMP_NUM_THREADS": "2"}),
    "joblib launcher": Change(words=("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")),
    "numba for any x86-64": Change({"NUMBA_CPU_NAME": "generic"}),
    "numpy without AVX-512": Change(NO_AVX512),
    "numpy without AVX2": Change(NO_AVX2),
    "blas of Haswell": Change({"OPENBLAS_CORETYPE": "Haswell"}),
    "blas of Nehalem": Change({"OPENBLAS_CORETYPE": "Nehalem"}),
    "torch without AVX-512": Change({"ATEN_CPU_CAPABILITY": "avx2"}),
    "torch without AVX2": Change({"ATEN_CPU_CAPABILITY": "default"}),
    "mkl of any processor": Change({"MKL_CBWR": "COMPATIBLE"}),
    "glibc without FMA": Change({"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"}),
}
"""What is changed, by name; every change has a working directory of its own too."""


def words(folder: Path, change: Change, sweep: Sequence[str] = SWEEP) -> list[str]:
    """Return what is typed for a small sweep.

    Args:
        folder: Its runs go to a folder in there.
        change: What is changed.
        sweep: What is varied in the sweep.
    """
    places = [f"hydra.sweep.dir={folder / 'runs'}", "hydra.sweep.subdir=${hydra:job.num}"]
    return ["-m", *SMALL, *change.words, *sweep, *places]


def runs(folder: Path, change: Change, sweep: Sequence[str] = SWEEP) -> list[Path]:
    """Run a small sweep in a process of its own and a new working directory; return the folders of its runs."""
    folder.mkdir(parents=True)
    command = [sys.executable, *change.flags, "-m", "ge_torchrl", *words(folder, change, sweep)]
    variables = os.environ | {"PYTHONPATH": str(ROOT), **change.variables}
    subprocess.run(command, cwd=folder, env=variables, check=True, stdout=subprocess.DEVNULL)
    return in_order(folder)


def in_order(folder: Path) -> list[Path]:
    """Return the folders of the runs of a sweep, in the order of its jobs."""
    found = (folder / "runs").glob("*/summary.json")
    return sorted((path.parent for path in found), key=lambda path: int(path.name))


def is_same(one: Path, other: Path) -> bool:
    """Tell whether two folders hold the same run, clock aside."""
    try:
        assert_same_bytes(one, other, but=_NOT_COMPARED)
    except AssertionError:
        return False
    return True


def main(wanted: list[str]) -> None:
    """Print a row for each change."""
    with tempfile.TemporaryDirectory() as there:
        before = runs(Path(there) / "before", BEFORE)
        print("| changed |", " | ".join(KINDS), "|")
        print("| --- |", " | ".join(["---"] * len(KINDS)), "|", flush=True)
        for number, (name, change) in enumerate(CHANGES.items()):
            if wanted and not any(word in name for word in wanted):
                continue
            after = runs(Path(there) / str(number), change)
            told = ["same" if is_same(*both) else "differs" for both in zip(before, after, strict=True)]
            print(f"| {name} |", " | ".join(told), "|", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
