"""The short list: many structures get a short polish, and the best of them are proposed."""

import numpy as np
from problems_for_tests import GOOD, POOR, Analytic, Nudge, leaf, member, problem_of, split

from ge_torchrl.refiners.protocol import Refined, TrainingRecord
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.neighbours import propose_neighbours
from ge_torchrl.search.proposals import NEIGHBOUR
from ge_torchrl.search.shortlist import SHORT_LIST, best_after_a_short_polish

ARCHIVE = Archive((member(POOR, 40.0), member(GOOD, 400.0)))


def distance_to_perfect(tree):
    """Thresholds at 0.25 are perfect; what a split tests is worth something too."""
    return 10.0 * float(tree.feature.sum()) - float(np.abs(tree.threshold - 0.25).sum())


class ToPerfect:
    """A polish that finds the perfect thresholds at once; it notes what it was asked for."""

    def __init__(self):
        self.asked = []

    def refine(self, trees, rngs, effort):
        assert len(trees) == len(rngs)
        self.asked.append((list(trees), effort))
        return [
            Refined(tree.with_parameters(np.full_like(tree.parameters, 0.25)), TrainingRecord())
            for tree in trees
        ]


def problem(polisher, **archive):
    settings = {"keep": 3, "max_nodes": 4, "neighbours": 4, "neighbours_drawn": 300, **archive}
    return problem_of(Analytic(distance_to_perfect), None, polisher, polish={"every": 1}, archive=settings)


def test_so_many_are_polished_shortly_and_the_best_of_them_proposed_as_they_then_are():
    polisher = ToPerfect()
    of = problem(polisher, short_list=8)
    proposals = propose_neighbours(of, ARCHIVE, {}, 2)
    ((listed, effort),) = polisher.asked
    assert effort.factor * effort.patience < 0.5, "a short polish costs less than half of a whole one"
    assert len({tree.structure for tree in listed}) == len(listed) == 8
    assert len(proposals) == 4
    assert {one.origin for one in proposals} == {NEIGHBOUR}
    for one in proposals:
        assert set(one.tree.parameters.tolist()) == {0.25}
        assert one.fitness == distance_to_perfect(one.tree)
    assert of.backend.purposes.count(SHORT_LIST) == 1


def test_a_tree_is_compared_with_the_kept_ones_of_its_size():
    """One split, 0.05 short of the kept one; two splits, fitter, but far behind theirs; three: none are kept."""
    small, middle = split(3, 0.2, leaf(0), leaf(1)), split(3, 0.25, split(3, 0.25, leaf(0), leaf(1)), leaf(1))
    large = split(2, 0.9, middle, leaf(0))
    still = problem(_Still())
    archive = Archive((member(POOR, 30.0), member(GOOD, 400.0)))
    chosen = best_after_a_short_polish(still, archive, [middle, small, large], 2, 3)
    assert [tree for tree, _ in chosen] == [large, small]
    assert [value for _, value in chosen] == [distance_to_perfect(large), distance_to_perfect(small)]


class _Still:
    """A polish that changes nothing."""

    def refine(self, trees, *_):
        return [Refined(tree, TrainingRecord()) for tree in trees]


def test_without_a_polish_or_a_short_list_neighbours_are_proposed_as_drawn():
    as_drawn = [one.tree for one in propose_neighbours(problem(None), ARCHIVE, {}, 2)]
    assert [one.tree for one in propose_neighbours(problem(None, short_list=12), ARCHIVE, {}, 2)] == as_drawn
    assert [
        one.tree for one in propose_neighbours(problem(ToPerfect(), short_list=0), ARCHIVE, {}, 2)
    ] == as_drawn


def test_kept_trees_are_crossed_for_it():
    """Two edits make five splits of three at the most; a crossing of two such trees makes six."""
    archive = Archive((member(_stairs(2), 30.0), member(_stairs(3), 30.0)))

    def largest(**settings):
        of = problem(_Still(), neighbours=100, max_nodes=6, **settings)
        return max(one.tree.num_decision_nodes for one in propose_neighbours(of, archive, {}, 2))

    assert largest(short_list=100) == 6
    assert largest(short_list=0) < 6


def _stairs(feature):
    """Return a tree of three splits on a feature."""
    return split(feature, -0.3, leaf(0), split(feature, 0.0, leaf(1), split(feature, 0.3, leaf(0), leaf(1))))


def test_the_generation_alone_says_what_is_chosen():
    of = problem(Nudge(Analytic(distance_to_perfect)), short_list=12)

    def trees(generation):
        return [one.tree for one in propose_neighbours(of, ARCHIVE, {}, generation)]

    fourth = trees(4)
    assert trees(3) != fourth == trees(4)
