import itertools
from dataclasses import replace

import numpy as np
import pytest

from ge_torchrl.environments.choose import open_route
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.search.evolution import Evolution
from ge_torchrl.search.fitness import WORST_FITNESS, TrainingEpisodes, measure
from ge_torchrl.sections import GEConfig
from ge_torchrl.seeding import stream
from ge_torchrl.trees.simplify import simplify_exact

GRAMMAR = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(theta, <constant>) | lt(theta_dot, <constant>)
<action>    ::= left | right | <if>
<constant>  ::= [-0.5, 0.5] step 0.01
"""
SETTINGS = GEConfig(population_size=30, generations=10, genotype_length=30, gene_probability=0.1)


@pytest.fixture(scope="module")
def route():
    route = open_route(
        describe("CartPole-v1", ("x", "x_dot", "theta", "theta_dot"), ("", "", "", ""), ("left", "right")),
        threads=2,
    )
    yield route
    route.close()


def evolution(route, seed=0, mode="fixed", **changes):
    labels = route.spec.labels
    grammar = read_grammar(GRAMMAR, labels.features, labels.actions)
    return Evolution(
        replace(SETTINGS, **changes),
        compile_rules(grammar, single_choice_consumes=False),
        route,
        TrainingEpisodes(mode, 5, stream(seed, "training episodes")),
        stream(seed, "evolution"),
    )


def take(evolved, n):
    return list(itertools.islice(evolved.generations(), n))


def test_the_same_seed_gives_the_same_generations(route):
    for one, two in zip(take(evolution(route), 6), take(evolution(route), 6), strict=True):
        np.testing.assert_array_equal(one.codons, two.codons)
        np.testing.assert_array_equal(one.fitness, two.fitness)
        assert one.env_steps == two.env_steps
    assert not np.array_equal(take(evolution(route, seed=1), 1)[0].codons, one.codons)


def test_fitness_on_fixed_episodes_never_falls(route):
    generations = take(evolution(route), 10)
    for before, after in itertools.pairwise(generations):
        assert (after.fitness >= before.fitness).all()
    assert generations[-1].fitness.max() > generations[0].fitness.max()


def test_fitness_is_what_the_genotypes_trees_earn(route):
    evolved = evolution(route)
    last = take(evolved, 5)[-1]
    forest = map_population(last.codons, evolved.tables).forest
    np.testing.assert_array_equal(
        measure(route, forest, evolved.episodes.next_generation()).fitness, last.fitness
    )


def test_an_individual_changes_only_with_a_better_fitness(route):
    before, after = take(evolution(route), 2)
    changed = (before.codons != after.codons).any(axis=1)
    assert changed.any()
    assert (after.fitness[changed] > before.fitness[changed]).all()
    np.testing.assert_array_equal(after.fitness[~changed], before.fitness[~changed])


def test_short_genotypes_are_invalid_counted_and_worst(route):
    first = take(evolution(route, genotype_length=2), 1)[0]
    assert first.n_invalid == first.n_born == 30
    assert (first.fitness == WORST_FITNESS).all()


def test_parents_are_measured_again_only_on_common_episodes(route):
    fixed, common = take(evolution(route), 3)[-1], take(evolution(route, mode="common"), 3)[-1]
    evolved = evolution(route, mode="common")
    seeds = []
    original = evolved.episodes.next_generation
    evolved.episodes.next_generation = lambda: seeds.append(original()) or seeds[-1]
    last = take(evolved, 3)[-1]
    np.testing.assert_array_equal(last.fitness, common.fitness)
    forest = evolved.map(last.codons).forest
    np.testing.assert_array_equal(measure(route, forest, seeds[-1]).fitness, last.fitness)
    assert common.env_steps > fixed.env_steps


def test_generational_replacement_keeps_the_elite(route):
    before, after = take(evolution(route, replacement="generational", elites=3), 2)
    best = np.argsort(-before.fitness, kind="stable")[:3]
    np.testing.assert_array_equal(after.codons[:3], before.codons[best])
    assert len(after.codons) == 30


def test_without_elites_all_parents_go(route):
    before, after = take(evolution(route, replacement="generational", gene_probability=1.0), 2)
    assert not (before.codons[:, None] == after.codons[None]).all(axis=2).any()


def test_crossover_mixes_two_parents(route):
    before, after = take(
        evolution(
            route,
            replacement="generational",
            crossover_probability=1.0,
            mutation_probability=0.0,
            genotype_length=30,
        ),
        2,
    )
    # Without mutation every codon of an offspring is some parent's codon at the same place.
    for child in after.codons:
        assert (before.codons == child).any(axis=0).all()
    assert not (before.codons[:, None] == after.codons[None]).all(axis=2).any(axis=0).all()


def test_elites_keep_their_places(route):
    generations = take(evolution(route, elites=5), 6)
    for before, after in itertools.pairwise(generations):
        best = np.argsort(-before.fitness, kind="stable")[:5]
        np.testing.assert_array_equal(after.codons[best], before.codons[best])


def test_sizes_are_those_of_the_simplified_trees(route):
    evolved = evolution(route)
    last = take(evolved, 5)[-1]
    forest = evolved.map(last.codons).forest
    sizes = [
        simplify_exact(forest.tree(p), route.spec.low, route.spec.high).n_decision_nodes
        if forest.sizes[p]
        else 0
        for p in range(len(forest))
    ]
    assert last.decision_nodes.tolist() == sizes


def test_parsimony_shrinks_trees_where_fitness_has_no_preference(route):
    # A tolerance beyond every difference of returns leaves nothing but size to select by.
    first, *_, last = take(evolution(route, parsimony="lexicographic", parsimony_tolerance=1000.0), 20)
    valid = np.isfinite(first.fitness)
    assert (last.decision_nodes[valid] <= first.decision_nodes[valid]).all()
    assert last.decision_nodes.mean() < 1 < take(evolution(route), 20)[-1].decision_nodes.mean()


def test_lexicographic_parsimony_never_gives_fitness_for_size(route):
    generations = take(evolution(route, parsimony="lexicographic"), 8)
    for before, after in itertools.pairwise(generations):
        assert (after.fitness >= before.fitness).all()
        equal = after.fitness == before.fitness
        assert (after.decision_nodes[equal] <= before.decision_nodes[equal]).all()


def test_a_penalty_on_the_spread_is_in_the_fitness_of_every_generation(route):
    evolved = replace(evolution(route), std_penalty=1.0)
    last = take(evolved, 4)[-1]
    outcomes = route.evaluate(evolved.map(last.codons).forest, evolved.episodes.next_generation())
    valid = np.isfinite(last.fitness)
    expected = outcomes.returns.mean(axis=1) - outcomes.returns.std(axis=1)
    np.testing.assert_allclose(last.fitness[valid], expected[valid])


def test_places_are_taken_by_fitter_genotypes_alone(route):
    evolved = evolution(route)
    before = take(evolved, 3)[-1]
    best, (worst, second_worst) = before.best, np.argsort(before.fitness, kind="stable")[:2]
    codons, fitness, sizes = before.codons.copy(), before.fitness.copy(), before.decision_nodes.copy()
    slots, newcomers = np.array([second_worst, best, worst]), codons[[best, worst, best]]
    after, env_steps = evolved.with_places_taken(before, slots, newcomers)
    assert env_steps == measure(route, evolved.map(newcomers).forest, before.seeds).env_steps
    for slot in (second_worst, worst):
        np.testing.assert_array_equal(after.codons[slot], codons[best])
        assert (after.fitness[slot], after.decision_nodes[slot]) == (fitness[best], sizes[best])
    others = ~np.isin(np.arange(30), [worst, second_worst])
    for name, old in (("codons", codons), ("fitness", fitness), ("decision_nodes", sizes)):
        np.testing.assert_array_equal(getattr(after, name)[others], old[others])
        np.testing.assert_array_equal(getattr(before, name), old, "the generation before is not written to")


def test_where_nobody_gives_way_it_is_the_very_same_generation(route):
    evolved = evolution(route)
    before = evolved.first()
    after, env_steps = evolved.with_places_taken(before, np.arange(30), before.codons)
    assert after is before, "as fit is not fitter"
    assert env_steps == before.env_steps
