"""A generation of grammatical evolution as a function of the one before."""

import itertools
from contextlib import closing

import numpy as np
import pytest
from forests_for_tests import simplify_one
from problems_for_tests import Analytic, Noting, cartpole, config_of, problem_of

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.ge.grammar import read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.search.fitness import WORST_FITNESS, fitness_of, measure, training_seeds
from ge_torchrl.search.population import TRAINING, first_population, newcomers, next_population
from ge_torchrl.search.problem import Problem
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree


@pytest.fixture(scope="module")
def backend():
    backend = cartpole()
    yield backend
    backend.close()


def fixed(backend, seed=0, evaluation=(), **ge):
    sections = {"population_size": 30, "genotype_length": 30, **ge}
    return problem_of(
        backend,
        seed=seed,
        ge=sections,
        evaluation={"episode_seeds": "fixed", "episodes": 5, **dict(evaluation)},
    )


def generations(problem, n):
    evolved = [first_population(problem)]
    for generation in range(1, n):
        evolved.append(next_population(problem, evolved[-1].population, generation))
    return evolved


def populations(problem, n):
    return [evolved.population for evolved in generations(problem, n)]


def assert_same(one, two):
    np.testing.assert_array_equal(one.codons, two.codons)
    np.testing.assert_array_equal(one.fitness, two.fitness)
    for ours, theirs in zip(one.forest.arrays, two.forest.arrays, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_same_seed_gives_the_same_generations_on_any_number_of_threads(backend):
    """Law 6."""
    two_threads = cartpole(threads=2)
    for one, two in zip(populations(fixed(backend), 6), populations(fixed(two_threads), 6), strict=True):
        assert_same(one, two)
    two_threads.close()
    assert not np.array_equal(populations(fixed(backend, seed=1), 1)[0].codons, one.codons)


@pytest.mark.parametrize("mode", ["common", "fixed", "fresh"])
def test_what_a_generation_draws_does_not_depend_on_what_others_drew(backend, mode):
    problem = fixed(backend, evaluation={"episode_seeds": mode})
    first, *_, fifth = populations(problem, 6)
    before = populations(problem, 5)[-1]
    assert_same(next_population(problem, before, 5).population, fifth)
    # Another number of a generation is another draw, from the same parents.
    assert not np.array_equal(next_population(problem, before, 6).population.codons, fifth.codons)
    assert_same(first_population(problem).population, first)


def test_fitness_on_fixed_episodes_never_falls(backend):
    evolved = populations(fixed(backend), 10)
    for before, after in itertools.pairwise(evolved):
        assert (after.fitness >= before.fitness).all()
    assert evolved[-1].fitness.max() > evolved[0].fitness.max()


@pytest.mark.parametrize("mode", ["common", "fixed"])
def test_fitness_and_trees_are_those_of_the_genotypes(backend, mode):
    problem = fixed(backend, evaluation={"episode_seeds": mode, "std_penalty": 1.0})
    last = populations(problem, 5)[-1]
    full = map_population(last.codons, problem.tables)
    returns = backend.evaluate(full, training_seeds(problem.config, 4), "test").returns
    np.testing.assert_allclose(fitness_of(returns, 1.0), last.fitness)
    assert (full.valid == last.forest.valid).all()
    for individual in np.flatnonzero(full.valid):
        simple = simplify_one(full.tree(individual), *backend.bounds)
        assert last.forest.tree(individual) == simple
        assert last.sizes[individual] == simple.num_decision_nodes


def test_an_individual_changes_only_with_a_better_fitness(backend):
    before, after = populations(fixed(backend, parsimony="none"), 2)
    changed = (before.codons != after.codons).any(axis=1)
    assert changed.any()
    assert (after.fitness[changed] > before.fitness[changed]).all()
    np.testing.assert_array_equal(after.fitness[~changed], before.fitness[~changed])


def test_short_genotypes_are_invalid_counted_and_worst(backend):
    evolved = first_population(fixed(backend, genotype_length=2))
    assert evolved.invalid == evolved.born == 30
    assert (evolved.population.fitness == WORST_FITNESS).all()
    assert (evolved.population.sizes == 0).all()
    after = next_population(fixed(backend, genotype_length=2), evolved.population, 1)
    assert (after.population.fitness == WORST_FITNESS).all(), "nobody to select is no fault"


@pytest.mark.parametrize(("mode", "n_batches"), [("fixed", 1), ("fresh", 1), ("common", 2)])
def test_parents_are_measured_again_only_on_common_episodes(backend, mode, n_batches):
    noting = Noting(backend)
    problem = fixed(noting, evaluation={"episode_seeds": mode})
    population = populations(problem, 1)[0]
    noting.batches.clear()
    next_population(problem, population, 1)
    assert noting.batches == [(30, TRAINING)] * n_batches


def test_crossover_mixes_two_parents(backend):
    problem = fixed(backend, crossover_probability=1.0, mutation_probability=0.0)
    before, after = populations(problem, 2)
    changed = (before.codons != after.codons).any(axis=1)
    assert changed.any()
    for child in after.codons[changed]:
        # Without mutation every codon of an offspring is some parent's codon at the same place.
        assert (before.codons == child).any(axis=0).all()
        assert not (before.codons == child).all(axis=1).any()


def test_parsimony_shrinks_trees_where_fitness_has_no_preference():
    same_for_all = Analytic(lambda _: 1.0)
    first, *_, last = populations(fixed(same_for_all, parsimony="lexicographic"), 20)
    valid = np.isfinite(first.fitness)
    assert (last.sizes[valid] <= first.sizes[valid]).all()
    assert last.sizes.mean() < 0.5 * first.sizes.mean()
    first, *_, last = populations(fixed(same_for_all, parsimony="none"), 20)
    np.testing.assert_array_equal(last.sizes[valid], first.sizes[valid])


def test_lexicographic_parsimony_never_gives_fitness_for_size(backend):
    for before, after in itertools.pairwise(populations(fixed(backend, parsimony="lexicographic"), 8)):
        assert (after.fitness >= before.fitness).all()
        equal = (after.fitness == before.fitness) & np.isfinite(before.fitness)
        assert (after.sizes[equal] <= before.sizes[equal]).all()


def test_newcomers_are_measured_as_the_generation_is(backend):
    problem = fixed(backend, evaluation={"episode_seeds": "common"})
    last = populations(problem, 4)[-1]
    some = np.array([3, 17, 3])
    assert_same(newcomers(problem, last.codons[some], 3), last.take(some))


def test_places_are_taken_by_those_who_are_given_them_and_nothing_is_written_to(backend):
    before = populations(fixed(backend), 3)[-1]
    codons, fitness = before.codons.copy(), before.fitness.copy()
    slots, by = np.array([7, 2]), before.take(np.array([before.best, 5]))
    after = before.with_places_taken(slots, by)
    assert_same(after.take(slots), by)
    others = np.setdiff1d(np.arange(30), slots)
    assert_same(after.take(others), before.take(others))
    np.testing.assert_array_equal(before.codons, codons)
    np.testing.assert_array_equal(before.fitness, fitness)
    assert before.with_places_taken(slots[:0], by.take(slots[:0])) is before


def test_of_a_first_population_under_a_limit_what_was_measured_is_there():
    backend = Analytic(lambda tree: float(tree.num_leaves))
    problem = fixed(backend, population_size=80)
    whole = first_population(problem).population
    needed = backend.steps.total()
    backend.steps.clear()
    backend.limit = Limit(max_env_steps=needed // 2)
    part = first_population(problem).population
    np.testing.assert_array_equal(part.codons, whole.codons)
    measured = np.isfinite(part.fitness)
    assert 20 <= measured.sum() < np.isfinite(whole.fitness).sum()
    np.testing.assert_array_equal(part.fitness[measured], whole.fitness[measured])


def test_a_limit_before_any_tree_is_measured_is_told():
    backend = Analytic(lambda _: 1.0)
    backend.limit = Limit(max_env_steps=1)
    with pytest.raises(LimitReachedError):
        first_population(fixed(backend))


def test_measuring_is_one_scale_for_parents_and_offspring(backend):
    problem = fixed(backend, evaluation={"std_penalty": 0.5, "episode_seeds": "common"})
    last = populations(problem, 3)[-1]
    forest = Forest.stack([last.forest.tree(last.best)])
    fitness = measure(backend, forest, training_seeds(problem.config, 2), "test", 0.5)
    assert fitness[0] == last.fitness[last.best]


@pytest.mark.parametrize(
    ("torques", "first"),
    [("act([-2, 2] step 0.5)", [0.0]), ("act([1, 2] step 0.5)", [1.0]), ("act([1, 2] step 0.5 * x0)", None)],
)
def test_one_does_nothing_at_first_where_actions_are_numbers(torques, first):
    bnf = f"<dt> ::= {torques} | if lt(x2, [-1, 1] step 0.5) then <dt> else <dt>"
    tables = compile_rules(read_grammar(bnf, ["x0", "x1", "x2"], ["a0"], continuous=True))
    with closing(KernelBackend(describe("Pendulum-v1"), 1)) as backend:
        problem = Problem(config_of(), tables, backend, refiner=None, polisher=None)
        population = first_population(problem).population
    assert (population.forest.tree(0) == DecisionTree.value_leaf(first or [0.0])) == (first is not None)
