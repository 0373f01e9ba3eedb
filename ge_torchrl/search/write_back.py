"""Write-back: a refined tree takes its source's place in the population, so that evolution goes on from it.

Thresholds that a gradient found lie between the constants of the grammar. A genotype can only hold the snapped tree,
so it is the snapped tree that is measured and that has to be better than the source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.encoding import encode
from ge_torchrl.search.evolution import Evolution, Generation
from ge_torchrl.trees.decision_tree import DecisionTree


@dataclass(frozen=True, eq=False)
class WriteBack:
    """What became of a refined tree in the population.

    Attributes:
        generation: The generation after it: the very same one where nothing was written.
        tree: The snapped tree, as the edited genotype maps to it; None where no genotype holds the tree.
        env_steps: Environment steps of measuring it.
    """

    generation: Generation
    tree: DecisionTree | None
    env_steps: int


def write_back(
    evolution: Evolution, generation: Generation, individual: int, refined: DecisionTree
) -> WriteBack:
    """Put a refined tree in the place of its source if, snapped to the grammar's constants, it is the fitter one.

    The codons are the source's own, edited where the refined tree differs (law 2), so whatever else the genotype
    carries is inherited on. Fitness is measured on the training episodes of this generation.

    Args:
        evolution: Maps and measures.
        generation: The generation that the source stands in.
        individual: The source's index in the population.
        refined: The refined tree.
    """
    source = generation.codons[individual]
    try:
        codons = encode(refined, source, evolution.tables, evolution.settings.wraps)
    except UnencodableTreeError:
        return WriteBack(generation, None, 0)
    tree = evolution.map(codons[None]).forest.tree(0)
    generation, env_steps = evolution.with_places_taken(generation, np.array([individual]), codons[None])
    return WriteBack(generation, tree, env_steps)
