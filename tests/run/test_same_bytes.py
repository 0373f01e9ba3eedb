"""Law 6, and what docs/same_bytes.md promises: the same configuration and seed give the same bytes."""

import pytest
from same_bytes import CHANGES, NO_AVX2, SWEEP, Change, in_order, is_same, runs, words

from ge_torchrl.__main__ import main

KERNEL = ("env.route=kernel", "refiner=none,ppo")
OTHER_SETTING = Change({"PYTHONHASHSEED": "1", "OMP_NUM_THREADS": "1"}, ("evaluation.threads=2",))
# Without PPO: Python would have to compile all of torch for -O.
OLD_PROCESSOR = Change(
    {**NO_AVX2, "OPENBLAS_CORETYPE": "Nehalem", "ATEN_CPU_CAPABILITY": "default"}, flags=("-O",)
)
OLD_PROCESSORS = [
    name for name in CHANGES if name.startswith(("numba", "numpy", "blas", "torch", "mkl", "glibc"))
]
OTHERS = [name for name in CHANGES if name not in OLD_PROCESSORS]


@pytest.fixture(scope="module")
def evolution_and_ppo(tmp_path_factory):
    """Runs of this process, whose hashes are those of chance, on one thread."""
    folder = tmp_path_factory.mktemp("before")
    assert main(words(folder, Change(words=("evaluation.threads=1",)), KERNEL)) == 0
    return in_order(folder)


def test_hashes_threads_and_working_directory_change_no_byte(evolution_and_ppo, tmp_path):
    after = runs(tmp_path / "after", OTHER_SETTING, KERNEL)
    assert len(after) == len(evolution_and_ppo) == 2
    assert all(map(is_same, evolution_and_ppo, after))


def test_evolution_with_kernels_is_the_same_on_an_older_processor_and_optimised(evolution_and_ppo, tmp_path):
    (after,) = runs(tmp_path / "after", OLD_PROCESSOR, ("env.route=kernel", "refiner=none"))
    assert is_same(evolution_and_ppo[0], after)


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    return runs(tmp_path_factory.mktemp("before") / "runs", Change(words=("evaluation.threads=1",)))


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_on_one_machine_every_kind_of_run_is_the_same(everything, tmp_path, name):
    after = runs(tmp_path / "after", CHANGES[name], SWEEP)
    assert [is_same(*both) for both in zip(everything, after, strict=True)] == [True] * 6


@pytest.mark.slow
@pytest.mark.parametrize("name", OLD_PROCESSORS)
def test_evolution_is_the_same_on_every_processor(everything, tmp_path, name):
    after = runs(tmp_path / "after", CHANGES[name], ("env.route=kernel,gymnasium", "refiner=none"))
    assert all(map(is_same, (everything[0], everything[3]), after))
