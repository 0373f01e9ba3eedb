"""The search that goes on from the hall of fame: which neighbours, what is offered, who migrates."""

from dataclasses import replace

import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.encoding import can_derive, snap
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.records import TrainingRecord
from ge_torchrl.search.champion import NEIGHBOUR, POPULATION, Contender
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.exploration import Explorer
from ge_torchrl.search.fitness import TrainingEpisodes
from ge_torchrl.search.hall_of_fame import HallOfFame
from ge_torchrl.search.refinement import FIRST, Effort, Tuned
from ge_torchrl.sections import GEConfig, HallOfFameConfig
from ge_torchrl.seeding import stream
from ge_torchrl.trees.decision_tree import DecisionTree

GRAMMAR = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(theta, <constant>) | lt(theta_dot, <constant>)
<action>    ::= left | right | <if>
<constant>  ::= [-0.5, 0.5] step 0.01
"""
NAMES, ACTIONS = ("x", "x_dot", "theta", "theta_dot"), ("left", "right")
leaf, split = DecisionTree.leaf, DecisionTree.split
GOOD = split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1))
POOR = split(3, 0.1, leaf(0), leaf(1))


class Moves:
    """Moves every threshold by a little, and notes what it was asked."""

    def __init__(self):
        self.asked = []

    def tune(self, trees, rngs, effort=FIRST):
        assert len(rngs) == len(trees)
        self.asked.append((list(trees), effort))
        return [
            Tuned(
                replace(tree, threshold=np.where(tree.is_leaf, 0, tree.threshold + 0.003)),
                TrainingRecord(),
                7,
            )
            for tree in trees
        ]


class CountingRoute:
    """A true route that counts every step in the environment, and notes how many trees each batch had."""

    def __init__(self, route):
        self.route, self.spec, self.env_steps, self.batches = route, route.spec, 0, []

    def evaluate(self, forest, seeds):
        outcomes = self.route.evaluate(forest, seeds)
        self.env_steps += outcomes.env_steps
        self.batches.append(len(forest))
        return outcomes

    def count_visits(self, tree, seeds):
        visits = self.route.count_visits(tree, seeds)
        self.env_steps += int(visits[0])
        return visits

    def observe(self, tree, n_steps, rng):
        self.env_steps += n_steps
        return self.route.observe(tree, n_steps, rng)


@pytest.fixture(scope="module")
def evolution():
    route = open_route(describe("CartPole-v1", NAMES, ("",) * 4, ACTIONS), threads=1)
    yield Evolution(
        GEConfig(population_size=20, generations=3, genotype_length=30, gene_probability=0.1),
        compile_rules(read_grammar(GRAMMAR, NAMES, ACTIONS), single_choice_consumes=False),
        route,
        TrainingEpisodes("fixed", 5, stream(0, "training episodes")),
        stream(0, "evolution"),
    )
    route.close()


@pytest.fixture
def hall(evolution):
    hall = HallOfFame(evolution.route, np.arange(20), keep=3, max_nodes=3)
    hall.offer([Contender(GOOD, 400.0, POPULATION), Contender(POOR, 40.0, POPULATION)])
    return hall


def explorer(evolution, hall, *, snaps=False, **config):
    refiner = Moves()
    settings = HallOfFameConfig(enabled=True, neighbours_drawn=60, **config)
    return Explorer(settings, evolution, hall, refiner, 0, snaps=snaps), refiner


def test_neighbours_are_of_structures_not_tried_before_each_once(evolution, hall):
    explores, refiner = explorer(evolution, hall, neighbours=5)
    generation = evolution.first()
    for index in range(4):
        explored = explores.explore(replace(generation, index=index))
        assert explored.generation.codons is generation.codons
        assert explored.refined == len(refiner.asked[-1][0]) <= 5
    tried = [tree.structure for trees, _ in refiner.asked for tree in trees]
    assert len(tried) == len(set(tried)) > 5
    assert all(1 <= tree.n_decision_nodes <= 3 for trees, _ in refiner.asked for tree in trees)
    assert all(effort == FIRST for _, effort in refiner.asked)


def test_neighbours_are_trees_of_the_grammar(evolution, hall):
    """It tests the pole alone, never the cart."""
    explores, refiner = explorer(evolution, hall, neighbours=30)
    explores.explore(evolution.first())
    ((trees, _),) = refiner.asked
    assert trees
    assert all(can_derive(tree, evolution.tables) for tree in trees)
    assert {int(feature) for tree in trees for feature in tree.feature} == {-1, 2, 3}


def test_what_is_refined_is_offered(evolution, hall):
    explores, _ = explorer(evolution, hall, neighbours=8)
    before = hall.env_steps
    explored = explores.explore(evolution.first())
    assert any(member.origin == NEIGHBOUR for member in hall.members)
    assert hall.env_steps > before
    assert explored.env_steps > 8 * 7


def test_so_many_neighbours_are_drawn_and_measured(evolution):
    route = CountingRoute(evolution.route)
    hall = HallOfFame(route, np.arange(20), keep=3, max_nodes=3)
    hall.offer([Contender(GOOD, 400.0, POPULATION)])
    counted = replace(evolution, route=route)
    for drawn in (1, 37):
        settings = HallOfFameConfig(enabled=True, neighbours=5, neighbours_drawn=drawn)
        refined = (
            Explorer(settings, counted, hall, Moves(), 0, snaps=False).explore(evolution.first()).refined
        )
        assert refined <= min(5, drawn)
        assert drawn in route.batches


def test_from_a_tree_of_a_useless_structure_others_are_reached(evolution):
    """It moves the cart away from under the pole, wherever its threshold is."""
    useless = split(2, 0.0, leaf(1), leaf(0))
    for neighbours in (0, 20):
        hall = HallOfFame(evolution.route, np.arange(20), keep=3, max_nodes=3)
        hall.offer([Contender(useless, 9.0, POPULATION)])
        explores, _ = explorer(evolution, hall, neighbours=neighbours)
        for index in range(3):
            explores.explore(replace(evolution.first(), index=index))
        best = max(hall.mean_of(member) for member in hall.members)
        assert (len(hall.members) > 1) == (best > 20) == (neighbours > 0)


@pytest.mark.parametrize(
    "settings",
    [{"neighbours": 8}, {"revisits": 2}, {"migrants": 6}, {"neighbours": 3, "revisits": 1, "migrants": 3}],
)
def test_every_step_is_counted_once_here_or_by_the_hall_of_fame(evolution, settings):
    route = CountingRoute(evolution.route)
    hall = HallOfFame(route, np.arange(20), keep=3, max_nodes=3)
    hall.offer([Contender(GOOD, 400.0, POPULATION), Contender(POOR, 40.0, POPULATION)])
    explores, refiner = explorer(replace(evolution, route=route), hall, final_keep=1, **settings)
    explored = explores.explore(evolution.first())
    again = explores.explore(replace(explored.generation, index=1)).env_steps
    at_the_end = explores.finish(np.arange(5))
    # The refiner says that it took 7 steps for each tree.
    claimed = 7 * sum(len(trees) for trees, _ in refiner.asked)
    assert explored.env_steps + again + at_the_end + hall.env_steps == route.env_steps + claimed


def test_observing_counts_even_where_no_neighbour_is_new(evolution):
    route = CountingRoute(evolution.route)
    hall = HallOfFame(route, np.arange(20), keep=3, max_nodes=0)
    hall.offer([Contender(leaf(0), 9.0, POPULATION)])
    explores, _ = explorer(replace(evolution, route=route), hall, neighbours=3)
    explored = explores.explore(evolution.first())
    assert explored.refined == 0
    assert explored.env_steps + hall.env_steps == route.env_steps


@pytest.mark.parametrize("snaps", [True, False])
def test_snapped_or_not(evolution, hall, snaps):
    explores, _ = explorer(evolution, hall, neighbours=8, snaps=snaps)
    explores.explore(evolution.first())
    offered = [member.tree for member in hall.members if member.origin == NEIGHBOUR]
    assert offered
    assert all((snap(tree, evolution.tables.grammar) == tree) == snaps for tree in offered)


def test_kept_trees_are_refined_again_with_a_larger_budget(evolution, hall):
    explores, refiner = explorer(evolution, hall, revisits=2, revisit_factor=4)
    explored = explores.explore(evolution.first())
    ((trees, effort),) = refiner.asked
    assert (set(trees), effort, explored.refined) == ({GOOD, POOR}, Effort(4), 2)


def test_at_the_end_the_best_of_each_size_are_refined_once_more(evolution, hall):
    of_another_structure = split(2, 0.1, leaf(0), leaf(1))
    hall.offer([Contender(of_another_structure, 9.0, POPULATION)])
    ones = [member.tree for member in hall.members if member.tree.n_decision_nodes == 1]
    assert len(ones) == 2
    explores, refiner = explorer(
        evolution, hall, final_keep=1, final_factor=3, final_patience=2, final_step=0.1
    )
    hall.offer([Contender(leaf(0), 9.0, POPULATION)])
    assert explores.finish(np.arange(5)) >= 2 * 7
    ((trees, effort),) = refiner.asked
    assert set(trees) == {GOOD, ones[0]}, "a lone leaf has nothing to refine"
    assert effort == Effort(3, 2, 0.1)
    explores, refiner = explorer(evolution, hall)
    assert (explores.finish(np.arange(5)), refiner.asked) == (0, [])


@pytest.mark.parametrize(("snaps", "episodes"), [(True, 40), (True, 0), (False, 40)])
def test_at_the_end_snapped_thresholds_are_moved_to_better_constants_near_by(evolution, snaps, episodes):
    route = CountingRoute(evolution.route)
    hall = HallOfFame(route, np.arange(20), keep=3, max_nodes=3)
    hall.offer([Contender(POOR, 40.0, POPULATION)])
    settles = {"final_keep": 1, "final_settling_episodes": episodes}
    explores, _ = explorer(replace(evolution, route=route), hall, snaps=snaps, **settles)
    at_the_end = explores.finish(np.arange(5))
    # The refiner claims 7 steps that the route does not see.
    assert at_the_end + hall.env_steps == route.env_steps + 7
    # All trees that differ in the one threshold by up to four constants are tried.
    assert (6 in route.batches) == (snaps and episodes > 0)


def test_migrants_take_the_places_of_the_least_fit_and_never_of_fitter_ones(evolution, hall):
    generation = evolution.first()
    least = np.argsort(generation.fitness, kind="stable")[:6]
    explores, _ = explorer(evolution, hall, migrants=6)
    after = explores.explore(generation).generation
    changed = np.flatnonzero((after.codons != generation.codons).any(axis=1))
    assert set(changed) <= set(least)
    assert len(changed) > 0
    assert (after.fitness[changed] > generation.fitness[changed]).all()
    for slot in changed:
        tree = evolution.map(after.codons[slot][np.newaxis]).forest.tree(0)
        assert tree in [snap(member.tree, evolution.tables.grammar) for member in hall.members]
        assert after.decision_nodes[slot] == tree.n_decision_nodes
    again = replace(after, fitness=np.full(20, 501.0))
    assert explores.explore(again).generation is again, "nobody gives way to a less fit migrant"


def test_an_empty_hall_and_settings_of_nothing_do_nothing(evolution, hall):
    generation = evolution.first()
    empty = HallOfFame(evolution.route, np.arange(20), keep=3, max_nodes=3)
    for of in (empty, hall):
        settings = {"neighbours": 3, "migrants": 3} if of is empty else {}
        explores, refiner = explorer(evolution, of, **settings)
        explored = explores.explore(generation)
        assert (explored.generation, explored.refined, explored.env_steps) == (generation, 0, 0)
        assert refiner.asked == []


def test_the_same_seed_explores_the_same(evolution):
    found = []
    for _ in range(2):
        hall = HallOfFame(evolution.route, np.arange(20), keep=3, max_nodes=3)
        hall.offer([Contender(GOOD, 400.0, POPULATION)])
        generation = replace(evolution.first(), seeds=np.arange(5))
        explorer(evolution, hall, neighbours=5, revisits=1)[0].explore(generation)
        found.append([member.tree for member in hall.members])
    assert found[0] == found[1]
