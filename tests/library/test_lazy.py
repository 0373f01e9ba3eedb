"""What a name needs is loaded when it is first used, and nothing before."""

import subprocess
import sys

import pytest

import ge_torchrl

HEAVY = (
    "torch",
    "torchrl",
    "tensordict",
    "numba",
    "numpy",
    "gymnasium",
    "hydra",
    "omegaconf",
    "matplotlib",
    "rich",
)


def loaded_after(text):
    told = f"{text}\nimport sys\nprint(*(name for name in {HEAVY!r} if name in sys.modules))"
    return set(subprocess.check_output([sys.executable, "-c", told], text=True).split())


def test_the_import_loads_nothing_heavy():
    assert loaded_after("import ge_torchrl as ge; dir(ge); ge.UserError") == set()


def test_names_load_neither_torch_nor_hydra():
    assert not loaded_after("import ge_torchrl as ge; ge.evolve, ge.refine, ge.evaluate, ge.load") & {
        "torch", "torchrl", "tensordict", "hydra", "omegaconf", "matplotlib"
    }  # fmt: skip


def test_all_names_are_there_and_no_other():
    for name in ge_torchrl.__all__:
        assert getattr(ge_torchrl, name)
        assert name in dir(ge_torchrl)
    with pytest.raises(AttributeError, match="evolves"):
        ge_torchrl.evolves  # noqa: B018 (the look-up is what is tried)
