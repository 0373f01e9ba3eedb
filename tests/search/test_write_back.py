"""A refined tree takes its source's place in the population, or leaves everything as it is."""

import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.encoding import snap
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.fitness import TrainingEpisodes, measure
from ge_torchrl.search.write_back import write_back
from ge_torchrl.sections import GEConfig
from ge_torchrl.seeding import stream
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

GRAMMAR = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(theta, <constant>) | lt(theta_dot, <constant>)
<action>    ::= left | right | <if>
<constant>  ::= [-0.5, 0.5] step 0.01
"""
leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
# It pushes the cart away from where the pole falls.
BAD = split(2, 0.0, leaf(1), leaf(0))
TESTS_POSITION = split(0, 0.0, leaf(0), leaf(1))


@pytest.fixture(scope="module")
def evolution():
    names, actions = ("x", "x_dot", "theta", "theta_dot"), ("left", "right")
    route = open_route(describe("CartPole-v1", names, ("",) * 4, actions), threads=1)
    yield Evolution(
        GEConfig(population_size=20, generations=3, genotype_length=30, gene_probability=0.1),
        compile_rules(read_grammar(GRAMMAR, names, actions), single_choice_consumes=False),
        route,
        TrainingEpisodes("fixed", 5, stream(0, "training episodes")),
        stream(0, "evolution"),
    )
    route.close()


def test_a_fitter_tree_replaces_its_source_and_nobody_else(evolution):
    before = evolution.first()
    codons, fitness = before.codons.copy(), before.fitness.copy()
    written = write_back(evolution, before, 7, GOOD)
    after, others = written.generation, np.arange(20) != 7
    np.testing.assert_array_equal(after.codons[others], codons[others])
    np.testing.assert_array_equal(after.fitness[others], fitness[others])
    snapped = snap(GOOD, evolution.tables.grammar)
    assert evolution.map(after.codons).forest.tree(7) == written.tree == snapped != GOOD
    measured = measure(evolution.route, Forest.stack([snapped]), before.seeds)
    assert (after.fitness[7], written.env_steps) == (measured.fitness[0], measured.env_steps)
    assert after.fitness[7] > fitness[7]
    np.testing.assert_array_equal(before.codons, codons, "the generation before is not written to")
    np.testing.assert_array_equal(before.fitness, fitness)


def test_the_next_generation_descends_from_what_was_written(evolution):
    written = write_back(evolution, evolution.first(), 7, GOOD).generation
    after = evolution.after(written)
    assert after.fitness[7] >= written.fitness[7]


@pytest.mark.parametrize("worse", [BAD, GOOD])
def test_a_tree_that_is_not_fitter_once_snapped_changes_nothing(evolution, worse):
    good = write_back(evolution, evolution.first(), 7, GOOD).generation
    written = write_back(evolution, good, 7, worse)
    assert written.generation is good
    assert written.tree is not None


def test_a_tree_that_the_grammar_cannot_derive_changes_nothing(evolution):
    before = evolution.first()
    written = write_back(evolution, before, 7, TESTS_POSITION)
    assert (written.generation, written.tree, written.env_steps) == (before, None, 0)
