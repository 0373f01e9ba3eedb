"""Which rules derive which parts of a tree, and with how few codons."""

from __future__ import annotations

import math

import numpy as np

from ge_torchrl.ge.productions import Kind
from ge_torchrl.ge.rule_tables import ACTION, CHOICE, CONSTANT, END, FEATURE, IF, RANGE, RuleTables
from ge_torchrl.trees.decision_tree import DecisionTree


class Derivations:
    """The derivations of a tree, found by dynamic programming from its last node to its root.

    Attributes:
        symbols: [S] kind and argument of every symbol.
        bodies: [R] for each rule the symbols that its bodies begin at.
    """

    def __init__(self, target: DecisionTree, tables: RuleTables) -> None:
        program = tables.program
        kinds, arguments = program.symbol_kind.tolist(), program.symbol_argument.tolist()
        starts, n_bodies = program.body_start.tolist(), program.rule_choices.tolist()
        self.symbols: list[tuple[int, int]] = list(zip(kinds, arguments, strict=True))
        self.bodies: list[list[int]] = [
            starts[first : first + n] for first, n in zip(program.rule_first_body, n_bodies, strict=True)
        ]
        self._tables = tables
        self._feature: list[int] = target.feature.tolist()
        self._threshold: list[float] = target.threshold.tolist()
        self._action: list[int] = target.action.tolist()
        self._constants: list[float] = program.constants.tolist()
        self._subtree_sizes = _subtree_sizes(target)
        self._codons_of_rule = [[math.inf] * target.n_nodes for _ in self.bodies]
        for node in reversed(range(target.n_nodes)):
            # The tables' order of rules puts those that a rule needs at the same node before it.
            for rule, bodies in enumerate(self.bodies):
                self._codons_of_rule[rule][node] = 1 + min(self.codons_of_body(body, node) for body in bodies)

    def constants_at(self, constants: int, node: int, codon: int) -> list[int]:
        """Return which choice of a range gives a node's threshold: the codon's own where it does."""
        values, threshold = self._tables.ranges[constants], self._threshold[node]
        if values.value(codon % values.count) == threshold:
            return [codon % values.count]
        index = values.find(threshold)
        return [] if index is None else [index]

    def codons_of_body(self, at: int, node: int) -> float:
        """Return the fewest codons with which the body from symbol `at` on derives what begins at a node.

        Infinity where it cannot. What begins there is the subtree, its condition, feature or constant.
        """
        codons = 0.0
        while True:
            kind, argument = self.symbols[at]
            at += 1
            if kind == END:
                return codons
            codons += self._codons_of_symbol(kind, argument, node)
            if codons == math.inf:
                return codons
            node += self._nodes_of_symbol(kind, argument, node)

    def _codons_of_symbol(self, kind: int, argument: int, node: int) -> float:
        if kind == CHOICE:
            return self._codons_of_rule[argument][node]
        if kind == RANGE:
            return math.inf if self._tables.ranges[argument].find(self._threshold[node]) is None else 1
        fits = (
            (kind == IF and self._feature[node] != DecisionTree.NO_FEATURE)
            or (kind == FEATURE and self._feature[node] == argument)
            or (kind == CONSTANT and self._threshold[node] == self._constants[argument])
            or (kind == ACTION and self._action[node] == argument)
        )
        return 0 if fits else math.inf

    def _nodes_of_symbol(self, kind: int, argument: int, node: int) -> int:
        """Return how many nodes, counted depth first, are complete after a symbol that begins at a node."""
        if kind != CHOICE:
            return int(kind in (CONSTANT, RANGE, ACTION))
        derived = self._tables.rule_kinds[argument]
        return self._subtree_sizes[node] if derived is Kind.TREE else int(derived is not Kind.FEATURE)


def _subtree_sizes(tree: DecisionTree) -> list[int]:
    """Return the number of nodes below and including each node of a tree numbered depth first."""
    sizes = [1] * tree.n_nodes
    for node in reversed(np.flatnonzero(~tree.is_leaf).tolist()):
        sizes[node] += sizes[tree.children_left[node]] + sizes[tree.children_right[node]]
    return sizes
