"""Variation: first populations, mutation and crossover, each for a whole population at once."""

import math

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.ge.codons import CODON_LIMIT, Codons


def random_population(population_size: int, genotype_length: int, rng: np.random.Generator) -> Codons:
    """Draw genotypes whose codons are uniform in `[0, CODON_LIMIT)`.

    Args:
        population_size: P, number of genotypes.
        genotype_length: K, number of codons of each.
        rng: Source of randomness.

    Returns:
        [P, K] int32.
    """
    return rng.integers(CODON_LIMIT, size=(population_size, genotype_length), dtype=np.int32)


def mutate_uniform(
    codons: Codons,
    parents: NDArray[np.int64],
    gene_probability: float,
    mutation_probability: float,
    rng: np.random.Generator,
) -> Codons:
    """Copy parents and mutate each copy with one probability, and of those each gene with another; all independent.

    A mutated gene is drawn anew, uniform in `[0, CODON_LIMIT)`.

    Args:
        codons: [P, K] int32.
        parents: [O] int64, the individual that each offspring is a copy of.
        gene_probability: Probability in [0, 1] that a gene of a mutated offspring is redrawn.
        mutation_probability: Probability in [0, 1] that an offspring is mutated.
        rng: Source of randomness.

    Returns:
        [O, K] int32, the offspring.
    """
    offspring = np.empty((len(parents), codons.shape[1]), np.int32)
    rate = math.inf if gene_probability == 1 else -math.log1p(-gene_probability)
    _mutate(codons, parents, rate, mutation_probability, rng, offspring)
    return offspring


@compiled
def _mutate(
    codons: Codons,
    parents: NDArray[np.int64],
    rate: float,
    mutation_probability: float,
    rng: np.random.Generator,
    offspring: Codons,
) -> None:
    """Write the mutated copies; the cost is that of the copies and of the genes that change.

    The gap between redrawn genes is geometric: `1 + floor(E / rate)`, where `E` is standard exponential and
    `rate = -log(1 - p)`, exceeds `k` with probability `exp(-k rate) = (1 - p)^k`.
    """
    genotype_length = codons.shape[1]
    for o in range(len(parents)):
        offspring[o] = codons[parents[o]]
        if rate == 0.0 or rng.random() >= mutation_probability:
            continue
        # A gap can be too large for an integer, so genes count in float64; compiled, math.floor gives an int64.
        gene = np.floor(rng.standard_exponential() / rate)
        while gene < genotype_length:
            # A double has 53 random bits: no codon is likelier than another by more than one part in four million.
            offspring[o, int(gene)] = np.int32(rng.random() * CODON_LIMIT)
            gene += 1.0 + np.floor(rng.standard_exponential() / rate)


def crossover_one_point(codons: Codons, crossover_probability: float, rng: np.random.Generator) -> Codons:
    """Let neighbours (0, 1), (2, 3), ... exchange their tails behind a random cut.

    The cut is uniform in 1 to K - 1, so that each side gives at least one codon. An odd last one stays.

    Args:
        codons: [P, K] int32.
        crossover_probability: Probability in [0, 1] that a pair is crossed.
        rng: Source of randomness.

    Returns:
        [P, K] int32, a new population.
    """
    n_pairs, genotype_length = len(codons) // 2, codons.shape[1]
    offspring = codons.copy()
    if genotype_length < 2:
        return offspring
    crossed = np.flatnonzero(rng.random(n_pairs) < crossover_probability)
    cuts = rng.integers(1, genotype_length, size=len(crossed))
    # Moving slices pair by pair is several times faster than selecting every gene through a mask.
    for pair, cut in zip(crossed.tolist(), cuts.tolist(), strict=True):
        first, second = 2 * pair, 2 * pair + 1
        offspring[first, cut:] = codons[second, cut:]
        offspring[second, cut:] = codons[first, cut:]
    return offspring
