import zlib
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs_for_tests import config

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.route import Outcomes
from ge_torchrl.environments.spec import describe
from ge_torchrl.leader import validation_seeds
from ge_torchrl.search.champion import POPULATION, REFINEMENT, Contender, choose_champion
from ge_torchrl.search.hall_of_fame import HallOfFame, leaders_by_size, open_hall_of_fame
from ge_torchrl.seeding import EPISODE_SEEDS
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify_exact

leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
# It acts as GOOD wherever an episode comes by, but no bound of an observation says so.
GOOD_WITH_DEAD_BRANCH = split(
    2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), split(3, -99.0, leaf(0), leaf(1))
)
POOR = split(3, 0.0, leaf(0), leaf(1))
# Of another structure.
POORER = split(2, 0.02, leaf(0), leaf(1))
# Of the structure of POOR.
POOR_MOVED = split(3, 0.3, leaf(0), leaf(1))
# Of the size of GOOD, of another structure, and now and then as good.
LUCKY = split(3, 0.229, split(2, 0.02, leaf(0), leaf(1)), leaf(1))
ARCHIVE, VALIDATION = np.arange(30), np.arange(1000, 1050)


class CountingRoute:
    """A true route that notes how many trees each batch had."""

    def __init__(self, route):
        self.route, self.spec, self.batches, self.seeds = route, route.spec, [], None

    def evaluate(self, forest, seeds):
        self.batches.append(len(forest))
        self.seeds = seeds
        return self.route.evaluate(forest, seeds)

    def count_visits(self, tree, seeds):
        return self.route.count_visits(tree, seeds)


@pytest.fixture(scope="module")
def opened():
    route = open_route(describe("CartPole-v1"), threads=1)
    yield route
    route.close()


@pytest.fixture
def route(opened):
    return CountingRoute(opened)


def contender(tree, fitness=1.0, origin=POPULATION):
    return Contender(tree, fitness, origin)


def trees(hall):
    return [member.tree for member in hall.members]


def champion_of(route, tree, hall=()):
    return choose_champion(route, [contender(tree)], 1, VALIDATION, hall)


def test_no_tree_is_measured_twice_and_new_ones_in_one_batch(route):
    hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=5)
    hall.offer([contender(POOR), contender(GOOD), contender(POOR)])
    hall.offer([contender(GOOD), contender(leaf(0)), contender(POOR)])
    hall.offer([contender(GOOD)])
    assert route.batches == [2, 1]
    assert trees(hall) == [leaf(0), POOR, GOOD]
    # Each is measured once, and its visits are counted once.
    assert hall.env_steps == 2 * route.evaluate(Forest.stack(trees(hall)), ARCHIVE).env_steps


def test_trees_are_told_apart_by_what_they_do_not_by_dead_splits(route):
    hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=1)
    unreachable = split(0, 99.0, POOR, leaf(0))
    hall.offer([contender(unreachable), contender(POOR)])
    assert trees(hall) == [POOR]


def test_the_best_by_the_archive_stay_whatever_their_fitness(route):
    hall = HallOfFame(route, ARCHIVE, keep=1, max_nodes=5)
    hall.offer([contender(POORER, 500.0)])
    hall.offer([contender(POOR, 1.0)])
    hall.offer([contender(POORER, 500.0)])
    assert trees(hall) == [POOR]
    both = HallOfFame(route, ARCHIVE, keep=2, max_nodes=5)
    both.offer([contender(POORER), contender(POOR)])
    assert trees(both) == [POOR, POORER]


def test_of_trees_of_one_structure_the_best_stays(route):
    means = route.evaluate(Forest.stack([POOR, POOR_MOVED]), ARCHIVE).returns.mean(axis=1)
    assert means[0] != means[1]
    best = [POOR, POOR_MOVED][int(np.argmax(means))]
    for order in ([POOR, POOR_MOVED], [POOR_MOVED, POOR]):
        hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=5)
        for tree in order:
            hall.offer([contender(tree)])
        assert trees(hall) == [best]
        assert hall.mean_of(hall.members[0]) == means.max()


def test_what_no_episode_visits_is_pruned_before_the_size_is_counted(route):
    hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=2)
    hall.offer([contender(GOOD_WITH_DEAD_BRANCH)])
    assert trees(hall) == [GOOD]


def test_trees_far_beyond_the_largest_size_are_not_even_measured(route):
    hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=1)
    hall.offer([contender(GOOD_WITH_DEAD_BRANCH)])
    assert (route.batches, hall.members) == ([], [])
    hall.offer([contender(GOOD)])
    assert (route.batches, hall.members) == ([1], []), "it might have been pruned to one decision node"


def test_leaders_of_a_generation_are_mapped_only_when_they_are_new(route):
    hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=5)
    mapped = []

    def to_trees(codons):
        mapped.append(codons[:, 0].tolist())
        return SimpleNamespace(forest=Forest.stack([[leaf(0), POOR, GOOD, POORER][c] for c in codons[:, 0]]))

    def offer(codons, fitness, sizes):
        values = {"fitness": np.array(fitness), "decision_nodes": np.array(sizes)}
        hall.offer_leaders(SimpleNamespace(codons=np.array(codons)[:, np.newaxis], **values), to_trees)

    offer([1, 2, 3], [40.0, 500.0, 9.0], [1, 2, 1])
    offer([1, 2, 3], [40.0, 500.0, 9.0], [1, 2, 1])
    offer([0, 2, 3], [9.0, 500.0, 9.0], [0, 2, 1])
    assert mapped == [[1, 2], [0, 3]]
    assert trees(hall) == [leaf(0), POOR, POORER, GOOD]
    assert [member.fitness for member in hall.members] == [9.0, 40.0, 9.0, 500.0]


def test_winners_are_sorted_by_their_pruned_size(route):
    hall = HallOfFame(route, ARCHIVE, keep=3, max_nodes=5)
    hall.offer([contender(GOOD_WITH_DEAD_BRANCH, origin=REFINEMENT), contender(POOR), contender(POORER)])
    assert [tree.n_decision_nodes for tree in trees(hall)] == [1, 1, 2]
    winners = hall.choose_winners(champion_of(route, POOR), VALIDATION).by_size
    assert [(winner.tree, winner.origin) for winner in winners] == [(POOR, POPULATION), (GOOD, REFINEMENT)]


def test_validation_chooses_among_the_trees_of_one_size(route):
    # On an archive of a single episode both are as good, and of these the first that was offered leads.
    both = Forest.stack([GOOD, LUCKY])
    returns = route.evaluate(both, np.arange(300)).returns
    hall = HallOfFame(route, np.flatnonzero(returns[1] >= returns[0])[:1], keep=2, max_nodes=5)
    hall.offer([contender(LUCKY), contender(GOOD)])
    assert trees(hall) == [LUCKY, GOOD]
    (winner,) = hall.choose_winners(champion_of(route, LUCKY), VALIDATION).by_size
    assert winner.tree == GOOD
    assert winner.validation_mean == route.evaluate(both, VALIDATION).returns[0].mean()


def test_the_hall_of_fame_can_give_the_champion_and_the_champion_is_always_in_it(route):
    hall = HallOfFame(route, ARCHIVE, keep=1, max_nodes=2)
    hall.offer([contender(GOOD, 3.0)])
    champion = champion_of(route, POOR, hall.members)
    assert (champion.pruned, champion.train_fitness) == (GOOD, 3.0)
    # This one is too large to be offered, and of the same worth as a smaller one.
    small = HallOfFame(route, ARCHIVE, keep=1, max_nodes=1)
    winners = small.choose_winners(champion_of(route, GOOD_WITH_DEAD_BRANCH), VALIDATION).by_size
    assert [(winner.tree, winner.archive_mean) for winner in winners] == [(GOOD, None)]


@given(
    st.lists(
        st.tuples(st.sampled_from([-np.inf, 0.0, 1.0, 2.0]), st.integers(0, 4)), min_size=1, max_size=20
    ),
    st.integers(0, 4),
)
def test_of_each_size_the_first_of_the_fittest_leads(individuals, max_nodes):
    fitness, sizes = (np.array(column) for column in zip(*individuals, strict=True))
    leaders = leaders_by_size(fitness, sizes, max_nodes)
    expected = {}
    for index, (value, size) in enumerate(individuals):
        if (
            size <= max_nodes
            and np.isfinite(value)
            and (size not in expected or value > fitness[expected[size]])
        ):
            expected[size] = index
    assert leaders.tolist() == [expected[size] for size in sorted(expected)]


class ScriptedRoute:
    """Gives every tree the same return for ever, as if by chance, and visits all of its nodes."""

    spec = describe("CartPole-v1")

    @staticmethod
    def return_of(tree):
        return float(zlib.crc32(tree.structure + tree.threshold.tobytes()) % 50)

    def evaluate(self, forest, seeds):
        returns = [self.return_of(forest.tree(i)) for i in range(len(forest))]
        shape = (len(forest), len(seeds))
        return Outcomes(np.tile(returns, (len(seeds), 1)).T, np.ones(shape, np.int64))

    def count_visits(self, tree, seeds):
        return np.full(tree.n_nodes, len(seeds))


def simple(tree):
    return simplify_exact(tree, ScriptedRoute.spec.low, ScriptedRoute.spec.high)


LEAVES = [leaf(0), leaf(1)]
ONES = [
    split(f, value, a, b) for f in range(2) for value in (-0.5, 0.1, 0.5) for a, b in (LEAVES, LEAVES[::-1])
]
TWOS = [
    split(f, 0.3, *children)
    for f in range(2)
    for one in ONES
    for answer in LEAVES
    for children in ((one, answer), (answer, one))
]


# Of each size many, so that no size has room for all of them.
@given(
    st.lists(
        st.lists(
            st.sampled_from(LEAVES) | st.sampled_from(ONES) | st.sampled_from(TWOS), min_size=3, max_size=12
        ),
        min_size=2,
        max_size=6,
    ),
    st.integers(1, 3),
)
def test_the_best_of_every_structure_and_of_these_the_best_of_every_size_are_kept(offers, keep):
    """Whatever is offered when."""
    hall = HallOfFame(ScriptedRoute(), np.arange(2), keep=keep, max_nodes=2)
    best = {}
    for offered in offers:
        hall.offer([contender(tree) for tree in offered])
        for tree in map(simple, offered):
            if tree.n_decision_nodes <= 2:
                of_size = best.setdefault(tree.n_decision_nodes, {})
                of_size[tree.structure] = max(of_size.get(tree.structure, 0.0), ScriptedRoute.return_of(tree))
        members = hall.members
        structures = [member.tree.structure for member in members]
        assert len(structures) == len(set(structures))
        kept = [(member.tree.n_decision_nodes, hall.mean_of(member)) for member in members]
        assert kept == [
            (size, mean) for size in sorted(best) for mean in sorted(best[size].values(), reverse=True)[:keep]
        ]


def test_the_settings_of_a_run_say_how_many_episodes_trees_and_nodes(route):
    settings = {"enabled": True, "episodes": 7, "keep": 1, "max_nodes": 1}
    hall = open_hall_of_fame(config(hall_of_fame=settings), route)
    assert hall.max_nodes == 1
    hall.offer([contender(GOOD), contender(POOR), contender(POORER)])
    assert len(hall.members) == 1
    assert (route.batches, len(route.seeds)) == ([3], 7)
    assert all(seed in EPISODE_SEEDS["validation"] for seed in route.seeds.tolist())
    assert not set(route.seeds) & set(validation_seeds(config()))
    assert open_hall_of_fame(config(hall_of_fame={**settings, "enabled": False}), route) is None
