from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from ge_torchrl.ge.encoding import encode
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.operators import random_population
from ge_torchrl.ge.rule_tables import compile_rules

FOLDER = Path(__file__).parents[2] / "conf" / "grammar"
NAMES = {
    "cartpole": ("x x_dot theta theta_dot", "left right"),
    "acrobot": (
        "cos_theta1 sin_theta1 cos_theta2 sin_theta2 omega1 omega2",
        "torque_minus torque_zero torque_plus",
    ),
    "mountaincar": ("position velocity", "left none right"),
    "lunarlander": (
        "x y x_dot y_dot theta theta_dot left_leg right_leg",
        "none left_engine main_engine right_engine",
    ),
}
THESIS = [f"thesis/{environment}" for environment in ("cartpole", "acrobot", "mountaincar")]
FILES = [*NAMES, *THESIS, "lunarlander_one_range"]


def grammar_of(file):
    environment = file.removeprefix("thesis/").removesuffix("_one_range")
    features, actions = NAMES[environment]
    return read_grammar(OmegaConf.load(FOLDER / f"{file}.yaml").bnf, features.split(), actions.split())


def test_the_folder_holds_these_files():
    found = [path.relative_to(FOLDER).with_suffix("").as_posix() for path in FOLDER.rglob("*.yaml")]
    assert sorted(found) == sorted(FILES)


@pytest.mark.parametrize("file", FILES)
def test_a_file_names_itself_and_offers_constants_with_every_feature(file):
    text = (FOLDER / f"{file}.yaml").read_text()
    assert text.startswith("# Decision trees for ")
    # The thesis' name stays as it was when there was no other.
    name = f"{file}_per_feature" if file in NAMES else file.removeprefix("thesis/")
    assert OmegaConf.create(text).name == name
    for offered in grammar_of(file).constants:
        (constants,) = offered
        # Zero, or the one value between no contact and contact of a leg, is the threshold that physics suggests.
        assert constants.find(0.0) is not None or constants.value(0) == 0.5


@pytest.mark.parametrize(
    ("file", "n_constants", "low", "high"),
    [("cartpole", 1921, -4.8, 4.8), ("acrobot", 56541, -28.27, 28.27), ("mountaincar", 361, -1.2, 0.6)],
)
def test_the_ranges_of_the_thesis(file, n_constants, low, high):
    for (constants,) in grammar_of(f"thesis/{file}").constants:
        assert constants.count == n_constants
        assert constants.value(0) == np.float32(low)
        assert constants.value(n_constants - 1) == np.float32(high)


@pytest.mark.parametrize("file", FILES)
def test_mapped_trees_come_back_from_foreign_genotypes(file):
    tables = compile_rules(grammar_of(file))
    codons = random_population(20, 100, np.random.default_rng(0))
    forest = map_population(codons, tables)
    assert forest.valid.sum() >= 10
    for individual in np.flatnonzero(forest.valid):
        tree = forest.tree(individual)
        encoded = encode(tree, codons[individual - 1], tables)
        assert map_population(encoded[np.newaxis], tables).tree(0) == tree
