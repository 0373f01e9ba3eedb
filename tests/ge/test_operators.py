import math

import numpy as np
import pytest

from ge_torchrl.ge.codons import CODON_LIMIT
from ge_torchrl.ge.operators import crossover_one_point, mutate_uniform, random_population


def rng(seed=0):
    return np.random.default_rng(seed)


def assert_binomial(successes, n_trials, probability):
    """Within six standard deviations: a correct operator fails for one seed in 500 million."""
    deviation = math.sqrt(n_trials * probability * (1 - probability))
    assert abs(successes - n_trials * probability) <= 6 * deviation


def test_random_codons_are_uniform_below_the_limit():
    codons = random_population(400, 500, rng())
    assert codons.shape == (400, 500)
    assert codons.dtype == np.int32
    assert codons.min() >= 0
    assert codons.max() < CODON_LIMIT
    for eighth in np.bincount(codons.ravel() // (CODON_LIMIT // 8 + 1), minlength=8):
        assert_binomial(eighth, codons.size, 1 / 8)


# No fresh codon is -1: every redrawn gene shows.
@pytest.mark.parametrize("gene_probability", [0.001, 0.05, 0.5, 0.97])
@pytest.mark.parametrize("mutation_probability", [0.3, 1])
def test_genes_are_redrawn_at_the_given_rates(gene_probability, mutation_probability):
    codons = np.full((2000, 100), -1, np.int32)
    redrawn = (
        mutate_uniform(codons, np.arange(len(codons)), gene_probability, mutation_probability, rng()) >= 0
    )
    rows = redrawn.any(axis=1)
    assert_binomial(rows.sum(), 2000, mutation_probability * (1 - (1 - gene_probability) ** 100))
    if mutation_probability == 1:
        assert_binomial(redrawn.sum(), redrawn.size, gene_probability)
        for half in (redrawn[:, :50], redrawn[:, 50:], redrawn[:1000], redrawn[1000:]):
            assert_binomial(half.sum(), half.size, gene_probability)
        both = redrawn[:, 1:] & redrawn[:, :-1]
        # Neighbours overlap, so that pairs are taken at every other gene: those are independent.
        assert_binomial(both[:, ::2].sum(), both[:, ::2].size, gene_probability**2)


def test_the_first_and_the_last_gene_are_as_likely_as_others():
    redrawn = mutate_uniform(np.full((1, 2), -1, np.int32), np.zeros(1, int), 0.5, 1, rng()) >= 0
    counts = np.zeros(4, int)
    generator = rng(1)
    for _ in range(4000):
        redrawn = mutate_uniform(np.full((1, 2), -1, np.int32), np.zeros(1, int), 0.5, 1, generator)[0] >= 0
        counts[2 * redrawn[0] + redrawn[1]] += 1
    for count in counts:
        assert_binomial(count, 4000, 0.25)


def test_probability_zero_changes_nothing_and_one_changes_all():
    codons = np.full((5, 7), -1, np.int32)
    for gene, individual in [(0, 1), (1, 0), (0, 0), (5e-324, 1)]:
        unchanged = mutate_uniform(codons, np.arange(len(codons)), gene, individual, rng())
        assert (unchanged == -1).all()
        assert unchanged is not codons
    assert (mutate_uniform(codons, np.arange(len(codons)), 1, 1, rng()) >= 0).all()
    assert (codons == -1).all()


@pytest.mark.parametrize("gene_probability", [1e-19, 1e-30, 5e-324])
def test_gaps_between_redrawn_genes_may_be_larger_than_any_integer(gene_probability):
    codons = np.full((50, 7), -1, np.int32)
    assert (mutate_uniform(codons, np.arange(50), gene_probability, 1, rng()) == -1).all()


def test_an_unmutated_individual_stays_whole():
    redrawn = mutate_uniform(np.full((500, 20), -1, np.int32), np.arange(500), 1, 0.4, rng()) >= 0
    assert (redrawn.all(axis=1) == redrawn.any(axis=1)).all()
    assert_binomial(redrawn.all(axis=1).sum(), 500, 0.4)


def test_one_gene_mutates():
    redrawn = mutate_uniform(np.full((3000, 1), -1, np.int32), np.arange(3000), 0.3, 1, rng()) >= 0
    assert_binomial(redrawn.sum(), 3000, 0.3)


def test_same_seed_same_offspring():
    codons = random_population(20, 30, rng())
    for operator in (
        lambda g: mutate_uniform(codons, np.arange(len(codons)), 0.2, 0.8, g),
        lambda g: crossover_one_point(codons, 0.5, g),
    ):
        np.testing.assert_array_equal(operator(rng(3)), operator(rng(3)))


def test_crossover_exchanges_tails_of_neighbours():
    length = 8
    codons = np.repeat(np.arange(4001, dtype=np.int32)[:, np.newaxis], length, axis=1)
    offspring = crossover_one_point(codons, 1, rng())
    partner = (codons[:-1, 0] ^ 1)[:, np.newaxis]
    foreign = offspring[:-1] == partner
    assert (foreign | (offspring[:-1] == codons[:-1])).all()
    cuts = length - foreign.sum(axis=1)
    np.testing.assert_array_equal(foreign, np.arange(length) >= cuts[:, np.newaxis])
    np.testing.assert_array_equal(cuts[::2], cuts[1::2])
    counts = np.bincount(cuts[::2], minlength=length + 1)
    assert counts[0] == counts[length] == 0
    for count in counts[1:length]:
        assert_binomial(count, 2000, 1 / 7)
    np.testing.assert_array_equal(offspring[-1], codons[-1])


def test_pairs_cross_at_the_given_rate():
    codons = random_population(4000, 10, rng())
    crossed = (crossover_one_point(codons, 0.3, rng(1)) != codons).any(axis=1)
    np.testing.assert_array_equal(crossed[::2], crossed[1::2])
    assert_binomial(crossed[::2].sum(), 2000, 0.3)
    np.testing.assert_array_equal(crossover_one_point(codons, 0, rng()), codons)


@pytest.mark.parametrize("shape", [(1, 5), (4, 1), (2, 2)])
def test_crossover_of_small_populations(shape):
    codons = random_population(*shape, rng())
    offspring = crossover_one_point(codons, 1, rng())
    np.testing.assert_array_equal(np.sort(offspring, axis=0), np.sort(codons, axis=0))
    assert offspring is not codons
    assert (offspring != codons).any() == (shape == (2, 2))


def test_offspring_are_copies_of_their_parents():
    codons = random_population(6, 50, rng())
    parents = np.array([5, 5, 0])
    np.testing.assert_array_equal(mutate_uniform(codons, parents, 0, 1, rng()), codons[parents])
    offspring = mutate_uniform(codons, parents, 0.1, 1, rng())
    assert ((offspring == codons[parents]).mean(axis=1) > 0.7).all()
