"""Write-back: a tree becomes one of the grammar's constants, and then a genotype; the inverse of the mapping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import CODON_LIMIT, Codons
from ge_torchrl.ge.derivations import Derivations
from ge_torchrl.ge.grammar import Grammar
from ge_torchrl.ge.rule_tables import ACTION, CHOICE, CONSTANT, END, RANGE, RuleTables
from ge_torchrl.trees.tree import DecisionTree

NEAR: Final = (-4, -2, -1, 1, 2, 4)
"""How many constants away the constants are that `constants_near` takes, in both directions."""


def snap(tree: DecisionTree, grammar: Grammar) -> DecisionTree:
    """Round each threshold to the nearest constant that the grammar offers with the split's feature.

    Of two equally near constants the lower is taken; a snapped tree stays as it is.

    Args:
        tree: The tree.
        grammar: The grammar.

    Returns:
        The snapped tree.

    Raises:
        UnencodableTreeError: The grammar never tests a feature of the tree, or derives no trees of its kind.
    """
    _check_kind(tree)
    threshold = np.empty(tree.num_decision_nodes, np.float32)
    for split in range(tree.num_decision_nodes):
        feature, wanted = int(tree.feature[split]), float(tree.threshold[split])
        offered = grammar.constants[feature] if feature < len(grammar.features) else ()
        if not offered:
            name = grammar.features[feature] if feature < len(grammar.features) else f"number {feature}"
            raise UnencodableTreeError(
                f"split {split} tests feature {name}, which no condition of the grammar does"
            )
        nearest = (constants.value(constants.nearest(wanted)) for constants in offered)
        threshold[split] = min(nearest, key=lambda value: (abs(value - wanted), value))
    return tree.with_parameters(threshold)


def constants_near(
    tree: DecisionTree, grammar: Grammar, strides: Sequence[int] = NEAR
) -> NDArray[np.float32]:
    """Return what the tree's parameters become when one of them moves by a few of the grammar's constants.

    Args:
        tree: A snapped tree; a threshold that is no constant of the grammar does not move.
        grammar: The grammar.
        strides: By how many constants of its range a threshold moves.

    Returns:
        [R, N] float32, the parameters of `R` trees that each differ from the tree in one; `R` is 0 where none can move.
    """
    moved = []
    for split in range(tree.num_decision_nodes):
        feature, threshold = int(tree.feature[split]), float(tree.threshold[split])
        for constants in grammar.constants[feature]:
            index = constants.find(threshold)
            if index is None:
                continue
            for at in (index + stride for stride in strides):
                # A step can be finer than float32, so that a neighbour is the same number.
                if 0 <= at < constants.count and constants.value(at) != threshold:
                    parameters = tree.parameters.copy()
                    parameters[split] = constants.value(at)
                    moved.append(parameters)
    return np.array(moved, np.float32).reshape(len(moved), len(tree.parameters))


def encode(tree: DecisionTree, codons: Codons, tables: RuleTables, wraps: int = 0) -> Codons:
    """Edit a genotype so that it maps to the snapped tree: `map(encode(tree, codons)) == snap(tree)`.

    Where the current codon makes a choice that leads to the tree, it stays. Else it becomes
    `codon - codon % n + choice`, the way back from `codon % n`. Codons that the mapping does not read stay.
    Where reading wraps around, a codon has to serve every choice that reads it; those made first are not
    reconsidered.

    Args:
        tree: The tree.
        codons: [K] int32, the genotype to edit.
        tables: The compiled grammar.
        wraps: How many times the mapping may wrap.

    Returns:
        [K] int32, a new genotype.

    Raises:
        UnencodableTreeError: The grammar cannot derive the tree, the genotype is too short for it, or
            wrapping makes one codon serve two choices that exclude each other.
    """
    target = snap(tree, tables.grammar)
    derivations = Derivations(target, tables)
    needed, readable = derivations.codons_of_body(0, 0), len(codons) * (wraps + 1)
    if needed == math.inf:
        raise UnencodableTreeError(
            f"no derivation from <{tables.grammar.start.name}> gives this tree of {_number_of_splits(target)}"
        )
    if needed > readable:
        raise UnencodableTreeError(
            f"the tree needs at least {needed:.0f} codons; the genotype of {len(codons)} gives {readable} "
            f"with {wraps} wraps"
        )
    genotype = _Genotype(codons)
    spare = readable - needed
    node, at, returns = 0, 0, list[int]()
    while node < derivations.n_nodes:
        kind, argument = derivations.symbols[at]
        at += 1
        if kind == CHOICE:
            bodies = tables.rule_bodies[argument]
            costs = [derivations.codons_of_body(body, node) for body in bodies]
            longer = [cost - min(costs) for cost in costs]
            possible = [choice for choice in range(len(bodies)) if longer[choice] <= spare]
            choice = genotype.choose(len(bodies), sorted(possible, key=longer.__getitem__))
            spare -= longer[choice]
            returns.append(at)
            at = bodies[choice]
        elif kind == RANGE:
            genotype.choose(
                tables.ranges[argument].count, derivations.constants_at(argument, node, genotype.codon)
            )
        elif kind == END:
            at = returns.pop()
        if kind in (CONSTANT, RANGE, ACTION):
            node += 1
    return genotype.codons


def can_derive(tree: DecisionTree, tables: RuleTables) -> bool:
    """Tell whether a grammar derives a tree, once it is snapped to the grammar's constants.

    Args:
        tree: The tree.
        tables: The compiled grammar.
    """
    try:
        target = snap(tree, tables.grammar)
    except UnencodableTreeError:
        return False
    return Derivations(target, tables).codons_of_body(0, 0) < math.inf


class _Genotype:
    """A genotype that is edited while it is read."""

    def __init__(self, codons: Codons) -> None:
        self.codons = codons.copy()
        self._position = 0
        # An earlier choice among n leaves a codon free to change by multiples of n only.
        self._moduli = [1] * len(codons)

    @property
    def codon(self) -> int:
        """The codon to be read next."""
        return int(self.codons[self._position])

    def choose(self, n_choices: int, wanted: Sequence[int]) -> int:
        """Read a codon and make the first of the wanted choices that it can, its own before all others."""
        codon, modulus = self.codon, self._moduli[self._position]
        for choice in sorted(wanted, key=lambda choice: choice != codon % n_choices):
            changed = _change_codon(codon, modulus, n_choices, choice)
            if changed is not None:
                self.codons[self._position] = changed
                self._moduli[self._position] = math.lcm(modulus, n_choices)
                self._position = (self._position + 1) % len(self.codons)
                return choice
        raise UnencodableTreeError(
            f"codon {self._position} is read again after a wrap and cannot make both choices; "
            "a longer genotype could"
        )


def _change_codon(codon: int, modulus: int, n_choices: int, choice: int) -> int | None:
    """Return a codon near this one that makes a choice and leaves the same remainder by `modulus`.

    Both congruences together fix the remainder by `lcm(modulus, n_choices)` (Chinese remainder theorem); None
    where they exclude each other or leave no codon below the limit.
    """
    common, period = math.gcd(modulus, n_choices), math.lcm(modulus, n_choices)
    if (choice - codon) % common:
        return None
    steps = (choice - codon) // common * pow(modulus // common, -1, n_choices // common)
    changed = codon - codon % period + (codon + modulus * steps) % period
    if changed >= CODON_LIMIT:
        changed -= period
    return changed if changed >= 0 else None


def _check_kind(tree: DecisionTree) -> None:
    if not (tree.is_axis_aligned and tree.has_actions):
        raise UnencodableTreeError(
            "a grammar derives trees that test one feature at a time and whose leaves are actions; "
            "this tree has weighted splits or leaves of other kinds"
        )


def _number_of_splits(tree: DecisionTree) -> str:
    number = tree.num_decision_nodes
    return f"{number} decision node{'s' * (number != 1)}"
