"""Neighbours of kept trees: new structures, fit ones first, and trees of the grammar."""

import numpy as np
import pytest
from forests_for_tests import simplify_one
from problems_for_tests import (
    BAD,
    GOOD,
    POOR,
    Analytic,
    Noting,
    contender,
    leaf,
    member,
    problem_of,
)

from ge_torchrl.ge.encoding import can_derive
from ge_torchrl.refiners.protocol import FIRST
from ge_torchrl.search.archive import Archive, offer
from ge_torchrl.search.fitness import measure, training_seeds
from ge_torchrl.search.neighbours import NEIGHBOURS, propose_neighbours
from ge_torchrl.search.proposals import (
    NEIGHBOUR,
    in_turns,
)
from ge_torchrl.trees.forest import Forest


def archive_of(*members):
    return Archive(tuple(sorted(members, key=lambda one: one.tree.num_decision_nodes)))


class TestNeighbours:
    ARCHIVE = archive_of(member(GOOD, 400.0), member(POOR, 40.0))

    @staticmethod
    def problem(backend=None, **archive):
        settings = {"keep": 3, "max_nodes": 3, "neighbours": 8, **archive}
        return problem_of(backend or Analytic(lambda tree: float(tree.threshold.sum())), archive=settings)

    def test_they_are_of_structures_not_tried_before_each_once(self):
        problem, tried = self.problem(neighbours=5), {}
        for generation in range(4):
            proposals = propose_neighbours(problem, self.ARCHIVE, tried, generation)
            structures = [one.tree.structure for one in proposals]
            assert 0 < len(structures) <= 5
            assert len(set(structures)) == len(structures)
            assert not set(structures) & set(tried)
            assert {1, 2, 3} >= {one.tree.num_decision_nodes for one in proposals}
            assert {(one.origin, one.individual, one.effort) for one in proposals} == {
                (NEIGHBOUR, None, FIRST)
            }
            tried.update(dict.fromkeys(structures, 1))

    def test_they_are_trees_of_the_grammar_and_simplified(self):
        """The grammar tests the pole alone, never the cart; and its root is a test."""
        problem = self.problem(neighbours=30, neighbours_drawn=200)
        proposals = propose_neighbours(problem, self.ARCHIVE, {}, 2)
        for one in proposals:
            assert can_derive(one.tree, problem.tables)
            assert simplify_one(one.tree, *problem.backend.bounds) == one.tree
        assert {int(feature) for one in proposals for feature in one.tree.feature} == {2, 3}

    def test_so_many_are_drawn_and_measured_on_the_generations_episodes(self):
        for drawn in (1, 37):
            backend = Analytic(lambda _: 1.0)
            problem = self.problem(backend, neighbours=5, neighbours_drawn=drawn)
            proposals = propose_neighbours(problem, self.ARCHIVE, {}, 2)
            assert len(proposals) <= min(5, drawn)
            ((n_trees, _),) = backend.batches
            assert 0 < n_trees <= drawn
            assert backend.purposes == [NEIGHBOURS]
            assert backend.episodes == [tuple(training_seeds(problem.config, 2).tolist())]

    def test_of_each_size_the_fittest_goes_first_and_fitness_is_told(self):
        problem = self.problem(neighbours=30)
        proposals = propose_neighbours(problem, self.ARCHIVE, {}, 2)
        for one in proposals:
            seeds = training_seeds(problem.config, 2)
            (fitness,) = measure(problem.backend, Forest.stack([one.tree]), seeds, "test")
            assert one.fitness == fitness
        sizes = np.array([one.tree.num_decision_nodes for one in proposals])
        order = in_turns(np.array([one.fitness for one in proposals]), sizes)
        assert order.tolist() == list(range(len(proposals)))

    def test_the_generation_alone_says_what_is_drawn(self):
        def trees(problem, generation):
            return [one.tree for one in propose_neighbours(problem, self.ARCHIVE, {}, generation)]

        problem = self.problem()
        fourth = trees(problem, 4)
        assert trees(problem, 3) != fourth == trees(problem, 4)

    @pytest.mark.parametrize(
        ("archive", "settings"),
        [(Archive(), {}), (ARCHIVE, {"neighbours": 0}), (ARCHIVE, {"max_nodes": 0})],
    )
    def test_without_kept_trees_or_room_there_are_none(self, archive, settings):
        assert propose_neighbours(self.problem(**settings), archive, {}, 2) == []

    def test_from_a_tree_of_a_useless_structure_others_are_reached(self, opened):
        """It moves the cart away from under the pole, wherever its thresholds are."""
        problem = problem_of(
            Noting(opened), archive={"keep": 3, "max_nodes": 3, "neighbours": 20, "neighbours_drawn": 60}
        )
        archive = offer(problem, Archive(), [contender(BAD)])
        fitness = [one.fitness for g in range(3) for one in propose_neighbours(problem, archive, {}, g)]
        assert max(fitness) > 20 > archive.members[0].archive_fitness


def test_a_grammar_of_leaves_alone_gives_no_neighbours(opened):
    problem = problem_of(
        opened, grammar={"bnf": "<dt> ::= left | right"}, archive={"keep": 8, "neighbours": 4}
    )
    kept = Archive((member(leaf(0)), member(leaf(1))))
    assert propose_neighbours(problem, kept, {}, generation=1) == []
