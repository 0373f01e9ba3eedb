"""The grammars of the configuration: one with each environment, and those of the thesis."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from ge_torchrl.ge.encoding import encode
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules

FOLDER = Path(__file__).parents[2] / "conf"
ENVIRONMENTS = ["acrobot", "cartpole", "lunarlander", "mountaincar"]
THESIS = ["acrobot", "cartpole", "mountaincar"]


def grammar_of(environment, section=None):
    """Read a grammar with the names of its environment: the environment's own, or that of a section."""
    whole = OmegaConf.load(FOLDER / f"env/{environment}.yaml")
    return read_grammar((section or whole.grammar).bnf, whole.env.features, whole.env.actions)


def thesis(environment):
    return OmegaConf.load(FOLDER / f"grammar/thesis/{environment}.yaml")


GRAMMARS = [grammar_of(environment) for environment in ENVIRONMENTS]
GRAMMARS += [grammar_of(environment, thesis(environment)) for environment in THESIS]


def test_these_files_have_a_grammar():
    with_grammar = [path.stem for path in (FOLDER / "env").glob("*.yaml") if "bnf:" in path.read_text()]
    assert sorted(with_grammar) == ENVIRONMENTS
    files = (FOLDER / "grammar").rglob("*.yaml")
    assert sorted(path.relative_to(FOLDER / "grammar").as_posix() for path in files) == [
        f"thesis/{name}.yaml" for name in THESIS
    ]


def test_a_grammar_names_itself():
    for environment in ENVIRONMENTS:
        own = OmegaConf.load(FOLDER / f"env/{environment}.yaml").grammar
        assert own.name == f"{environment}_per_feature"
    for environment in THESIS:
        # The thesis' name stays as it was when there was no other.
        assert thesis(environment).name == environment


@pytest.mark.parametrize("grammar", GRAMMARS)
def test_a_grammar_offers_constants_with_every_feature(grammar):
    for (constants,) in grammar.constants:
        # Zero, or the one value between no contact and contact of a leg, is the threshold that physics suggests.
        assert constants.find(0.0) is not None or constants.value(0) == 0.5


@pytest.mark.parametrize(
    ("environment", "n_constants", "low", "high"),
    [("cartpole", 1921, -4.8, 4.8), ("acrobot", 56541, -28.27, 28.27), ("mountaincar", 361, -1.2, 0.6)],
)
def test_the_ranges_of_the_thesis(environment, n_constants, low, high):
    for (constants,) in grammar_of(environment, thesis(environment)).constants:
        assert constants.count == n_constants
        assert constants.value(0) == np.float32(low)
        assert constants.value(n_constants - 1) == np.float32(high)


@pytest.mark.parametrize("grammar", GRAMMARS)
def test_mapped_trees_come_back_from_foreign_genotypes(grammar):
    tables = compile_rules(grammar)
    codons = random_population(20, 100, np.random.default_rng(0))
    forest = map_population(codons, tables)
    assert forest.valid.sum() >= 10
    for individual in np.flatnonzero(forest.valid):
        tree = forest.tree(individual)
        encoded = encode(tree, codons[individual - 1], tables)
        assert map_population(encoded[np.newaxis], tables).tree(0) == tree
