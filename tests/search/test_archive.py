"""The archive: what is measured, what is kept, what is known of it."""

import zlib

import numpy as np
import pytest
from forests_for_tests import simplify_one
from hypothesis import given
from hypothesis import strategies as st
from problems_for_tests import (
    GOOD,
    GOOD_WITH_DEAD_BRANCH,
    POOR,
    POOR_MOVED,
    POORER,
    Analytic,
    contender,
    leaf,
    problem_of,
    split,
)

from ge_torchrl.search.archive import ARCHIVE, Archive, digest, leaders, offer, prune_all
from ge_torchrl.search.fitness import archive_seeds, fitness_of
from ge_torchrl.search.population import Population
from ge_torchrl.trees.forest import Forest


def keeping(backend, evaluation=(), **archive):
    return problem_of(backend, archive={"keep": 3, **archive}, evaluation=dict(evaluation))


def offered(problem, *offers):
    archive = Archive()
    for trees in offers:
        archive = offer(problem, archive, [contender(tree) for tree in trees])
    return archive


def trees(archive):
    return [member.tree for member in archive.members]


def fitness_on_archive(problem, some):
    returns = problem.backend.evaluate(Forest.stack(some), archive_seeds(problem.config), "test").returns
    return fitness_of(returns, problem.config.evaluation.std_penalty)


def test_no_tree_is_measured_twice_and_new_ones_in_one_batch(backend):
    problem = keeping(backend)
    archive = offered(problem, [POOR, GOOD, POOR], [GOOD, leaf(0), POOR], [GOOD])
    assert backend.batches == [(2, ARCHIVE), (1, ARCHIVE)]
    assert {tuple(seeds) for seeds in backend.seeds} == {tuple(archive_seeds(problem.config).tolist())}
    assert trees(archive) == [leaf(0), POOR, GOOD]


def test_visits_are_counted_while_measuring(backend):
    """Playing the episodes once more for them would count their steps twice."""
    problem = keeping(backend)
    before = backend.steps[ARCHIVE]
    offered(problem, [GOOD_WITH_DEAD_BRANCH])
    made = backend.steps[ARCHIVE] - before
    outcomes = backend.evaluate(Forest.stack([GOOD]), archive_seeds(problem.config), "test")
    assert made == outcomes.env_steps


def test_an_offer_leaves_the_archive_before_as_it_was(backend):
    problem = keeping(backend, keep=1)
    before = offered(problem, [POORER])
    after = offer(problem, before, [contender(POOR)])
    assert (trees(before), trees(after)) == ([POORER], [POOR])
    assert digest(POOR) in after.offered - before.offered
    assert offer(problem, after, [contender(POORER), contender(POOR)]) is after
    assert offer(problem, after, []) is after


def test_without_an_archive_nothing_is_measured_or_kept(backend):
    empty = Archive()
    assert offer(keeping(backend, keep=0), empty, [contender(GOOD)]) is empty
    assert backend.batches == []


def test_trees_are_told_apart_by_what_they_do_not_by_dead_splits(backend):
    unreachable = split(0, 99.0, POOR, leaf(0))
    assert trees(offered(keeping(backend, max_nodes=1), [unreachable, POOR])) == [POOR]
    assert backend.batches == [(1, ARCHIVE)]


def test_the_best_by_the_archive_stay_whatever_their_fitness(backend):
    problem = keeping(backend, keep=1)
    archive = Archive()
    for tree, fitness in ((POORER, 500.0), (POOR, 1.0), (POORER, 500.0)):
        archive = offer(problem, archive, [contender(tree, fitness)])
    assert trees(archive) == [POOR]
    assert archive.members[0].train_fitness == 1.0
    assert trees(offered(keeping(backend, keep=2), [POORER, POOR])) == [POOR, POORER]


def test_of_trees_of_one_structure_the_best_stays(backend):
    problem = keeping(backend)
    means = fitness_on_archive(problem, [POOR, POOR_MOVED])
    assert means[0] != means[1]
    best = [POOR, POOR_MOVED][int(np.argmax(means))]
    for order in ([POOR, POOR_MOVED], [POOR_MOVED, POOR]):
        archive = offered(problem, *([tree] for tree in order))
        assert trees(archive) == [best]
        assert archive.members[0].archive_fitness == means.max()


def test_members_are_kept_and_told_on_the_scale_of_fitness(backend):
    problem = keeping(backend, evaluation={"std_penalty": 2.0})
    archive = offered(problem, [GOOD, POOR, POORER])
    fitness = fitness_on_archive(problem, trees(archive))
    assert [member.archive_fitness for member in archive.members] == fitness.tolist()


def test_what_no_episode_visits_is_pruned_before_the_size_is_counted(backend):
    archive = offered(keeping(backend, max_nodes=2), [GOOD_WITH_DEAD_BRANCH])
    assert trees(archive) == [GOOD]
    assert {digest(GOOD), digest(GOOD_WITH_DEAD_BRANCH)} <= archive.offered


def test_trees_far_beyond_the_largest_size_are_not_even_measured(backend):
    problem = keeping(backend, max_nodes=1)
    assert offered(problem, [GOOD_WITH_DEAD_BRANCH]).members == ()
    assert backend.batches == []
    assert offered(problem, [GOOD]).members == ()
    assert backend.batches == [(1, ARCHIVE)], "it might have been pruned to one decision node"


def test_members_saw_what_they_act_on_and_it_depends_on_the_tree_alone(backend):
    problem = keeping(backend, neighbours=4)
    together = offered(problem, [POOR, GOOD])
    apart = offered(problem, [GOOD], [POOR_MOVED], [POOR])
    for member in together.members:
        assert member.observed.shape == (100, 4), "no polish: steps are dear here"
        assert member.observed.dtype == np.float32
    (of_good,) = (member.observed for member in apart.members if member.tree == GOOD)
    np.testing.assert_array_equal(together.of_size(2)[0].observed, of_good)


def test_where_no_neighbours_are_drawn_nothing_is_observed(backend):
    steps = backend.counted[ARCHIVE]
    archive = offered(keeping(backend), [POOR])
    assert archive.members[0].observed.shape == (0, 4)
    lengths = backend.evaluate(Forest.stack([POOR]), np.array(backend.seeds[0]), "test").lengths
    assert backend.counted[ARCHIVE] - steps == lengths.sum()


def test_who_is_asked_for_one_size_gets_the_best_first(backend):
    archive = offered(keeping(backend), [POORER, POOR, GOOD])
    assert [member.tree for member in archive.of_size(1)] == [POOR, POORER]
    assert archive.of_size(0) == []


def test_pruning_needs_visits_and_takes_each_tree_its_own():
    visits = np.array([0, 5, 1, 1, 0])
    assert prune_all([POOR, GOOD], visits) == [leaf(1), split(3, 0.2290, leaf(0), leaf(1))]
    with pytest.raises(ValueError, match="visits=True"):
        prune_all([POOR], None)


@given(
    st.lists(
        st.tuples(st.sampled_from([-np.inf, 0.0, 1.0, 2.0]), st.integers(0, 4)), min_size=1, max_size=20
    ),
    st.integers(0, 4),
)
def test_of_each_size_the_first_of_the_fittest_leads(individuals, max_nodes):
    fitness, sizes = (np.array(column) for column in zip(*individuals, strict=True))
    population = Population(
        codons=np.zeros((len(sizes), 1), np.int32),
        # The number of an individual is the threshold of its splits.
        forest=Forest.stack([_chain(size, number) for number, size in enumerate(sizes)]),
        fitness=fitness.astype(float),
    )
    expected = {}
    for index, (value, size) in enumerate(individuals):
        is_better = size not in expected or value > fitness[expected[size]]
        if size <= max_nodes and np.isfinite(value) and is_better:
            expected[size] = index
    found = leaders(population, max_nodes)
    assert [one.tree for one in found] == [
        population.forest.tree(expected[size]) for size in sorted(expected)
    ]
    assert [one.fitness for one in found] == [fitness[expected[size]] for size in sorted(expected)]
    assert {one.origin for one in found} <= {"population"}


def _chain(size, threshold):
    tree = leaf(0)
    for _ in range(size):
        tree = split(0, threshold, leaf(1), tree)
    return tree


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


def by_chance(tree):
    return float(zlib.crc32(tree.structure + tree.parameters.tobytes()) % 50)


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
    problem = keeping(Analytic(by_chance), keep=keep, max_nodes=2)
    archive, best = Archive(), {}
    for some in offers:
        archive = offer(problem, archive, [contender(tree) for tree in some])
        for tree in some:
            simple = simplify_one(tree, *problem.backend.bounds)
            of_size = best.setdefault(simple.num_decision_nodes, {})
            of_size[simple.structure] = max(of_size.get(simple.structure, 0.0), by_chance(simple))
        structures = [member.tree.structure for member in archive.members]
        assert len(structures) == len(set(structures))
        kept = [(member.tree.num_decision_nodes, member.archive_fitness) for member in archive.members]
        assert kept == [
            (size, mean) for size in sorted(best) for mean in sorted(best[size].values(), reverse=True)[:keep]
        ]
