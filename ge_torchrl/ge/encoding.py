"""Write-back: a tree into a genotype, the inverse of the mapping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.codons import CODON_LIMIT, Codons
from ge_torchrl.ge.derivations import Derivations
from ge_torchrl.ge.grammar import Grammar
from ge_torchrl.ge.rule_tables import ACTION, CHOICE, CONSTANT, END, RANGE, RuleTables
from ge_torchrl.trees.decision_tree import DecisionTree, IntArray


def snap(tree: DecisionTree, grammar: Grammar) -> DecisionTree:
    """Round each threshold to the nearest constant that the grammar offers with the node's feature.

    The nodes are numbered depth first, as the mapping numbers them. Of two equally near constants the lower
    is taken; a snapped tree stays as it is.

    Args:
        tree: The tree.
        grammar: The grammar.

    Returns:
        The snapped tree.

    Raises:
        UnencodableTreeError: The grammar never tests a feature of the tree.
    """
    tree = _depth_first(tree)
    threshold = np.zeros(tree.n_nodes, np.float32)
    for node in np.flatnonzero(~tree.is_leaf):
        feature, wanted = int(tree.feature[node]), float(tree.threshold[node])
        offered = grammar.constants[feature] if feature < len(grammar.features) else ()
        if not offered:
            name = grammar.features[feature] if feature < len(grammar.features) else f"number {feature}"
            raise UnencodableTreeError(
                f"node {node} tests feature {name}, which no condition of the grammar does"
            )
        nearest = (constants.value(constants.nearest(wanted)) for constants in offered)
        threshold[node] = min(nearest, key=lambda value: (abs(value - wanted), value))
    return replace(tree, threshold=threshold)


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
            f"no derivation from <{tables.grammar.start.name}> gives this tree of {target.n_nodes} nodes"
        )
    if needed > readable:
        raise UnencodableTreeError(
            f"the tree needs at least {needed:.0f} codons; the genotype of {len(codons)} gives {readable} "
            f"with {wraps} wraps"
        )
    genotype = _Genotype(codons)
    spare = readable - needed
    node, at, returns = 0, 0, list[int]()
    while node < target.n_nodes:
        kind, argument = derivations.symbols[at]
        at += 1
        if kind == CHOICE:
            bodies = derivations.bodies[argument]
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


def _depth_first(tree: DecisionTree) -> DecisionTree:
    order, pending = [], [0]
    while pending:
        node = pending.pop()
        order.append(node)
        if not tree.is_leaf[node]:
            pending += [int(tree.children_right[node]), int(tree.children_left[node])]
    number = np.empty(tree.n_nodes, np.int32)
    number[order] = np.arange(tree.n_nodes)

    def renumbered(children: IntArray) -> IntArray:
        ordered = children[order]
        return np.where(ordered == DecisionTree.NO_CHILD, DecisionTree.NO_CHILD, number[ordered])

    return DecisionTree(
        feature=tree.feature[order],
        threshold=tree.threshold[order],
        children_left=renumbered(tree.children_left),
        children_right=renumbered(tree.children_right),
        action=tree.action[order],
    )
