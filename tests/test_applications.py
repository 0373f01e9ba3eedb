"""An application of the refiner: which trees of the population it takes, and how many."""

import itertools

import numpy as np
import pytest
from loops_for_tests import config, run_loop

from ge_torchrl.search.refinement import IMPROVED, NOT_IMPROVED
from ge_torchrl.trees.simplify import simplify_exact


def test_several_candidates_are_refined_one_after_another():
    evolved, _, refinements, refiner = run_loop(config(candidates=3), itertools.repeat((IMPROVED, 30.0)))
    assert [record.generation for record in refinements] == [4, 4, 4, 8, 8, 8, 12, 12, 12]
    for first in (0, 3, 6):
        individuals = {record.individual for record in refinements[first : first + 3]}
        assert len(individuals) == 3
    assert evolved.refinements == len(refiner.asked) == 9
    assert [record.new_best for record in refinements[4:]] == [False] * 5


def test_ctrl_c_keeps_the_candidates_already_refined():
    evolved, _, refinements, _ = run_loop(config(candidates=2), [(IMPROVED, 300.0), ("interrupt", 0.0)])
    assert evolved.stopped_by == "interrupt"
    assert (len(refinements), evolved.refinements) == (1, 1)


def test_by_its_probability_a_chosen_tree_is_refined_or_not():
    _, generations, refinements, refiner = run_loop(config(probability=0.0), [])
    assert (refinements, refiner.asked) == ([], [])
    _, without, _, _ = run_loop(config(schedule={}), [])
    assert [record.best_fitness for record in generations] == [record.best_fitness for record in without]
    some = run_loop(config(probability=0.5, candidates=6), itertools.repeat((NOT_IMPROVED, 30.0)))[2]
    assert 0 < len(some) < 18


def test_simplified_or_whole_is_a_setting():
    script = itertools.repeat((NOT_IMPROVED, 10.0))
    whole, simple = (
        [tree for tree, _ in run_loop(config(simplify=simplify, candidates=5), script)[3].asked]
        for simplify in (False, True)
    )
    bounds = (
        np.array([-4.8, -np.inf, -0.42, -np.inf], np.float32),
        np.array([4.8, np.inf, 0.42, np.inf], np.float32),
    )
    assert any(simplify_exact(tree, *bounds) != tree for tree in whole)
    assert all(simplify_exact(tree, *bounds) == tree for tree in simple)


@pytest.mark.parametrize(("probability", "chosen"), [(1.0, "best"), (0.0, "random")])
def test_by_its_probability_the_best_tree_is_chosen_or_a_random_one(probability, chosen):
    every = config(best_probability=probability, schedule={"every": 1})
    _, generations, refinements, _ = run_loop(every, itertools.repeat((NOT_IMPROVED, 30.0)))
    assert {record.chosen for record in refinements} == {chosen}
    best = [
        record.fitness_before == generations[record.generation].best_fitness
        for record in refinements
        if record.redraws == 0
    ]
    assert len(best) > 5
    assert all(best) == (chosen == "best")


def test_of_each_size_the_structures_that_were_not_refined_yet_come_first():
    settings = config(choice="each_size", candidates=4, schedule={"every": 4}, simplify=True)
    _, _, refinements, refiner = run_loop(settings, itertools.repeat((NOT_IMPROVED, 10.0)))
    assert {record.chosen for record in refinements} == {"fittest"}
    first, second = ([tree for tree, generation in refiner.asked if generation == g] for g in (4, 8))
    for trees in (first, second):
        assert len({tree.structure for tree in trees}) == len(trees) == 4
    assert len({tree.n_decision_nodes for tree in first}) > 1
    # Where a structure comes again, those that never came before went before it.
    known = {tree.structure for tree in first}
    again = [tree.structure in known for tree in second]
    assert again == sorted(again)
    assert not again[0]


@pytest.mark.parametrize("choice", ["best_or_random", "each_size"])
def test_trees_of_less_than_so_many_nodes_are_not_refined(choice):
    def sizes(min_nodes):
        settings = config(choice=choice, candidates=6, min_nodes=min_nodes)
        refiner = run_loop(settings, itertools.repeat((NOT_IMPROVED, 10.0)))[3]
        return {tree.n_decision_nodes for tree, _ in refiner.asked}

    assert min(sizes(1)) == 1
    assert min(sizes(3)) == 3
