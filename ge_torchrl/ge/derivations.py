"""Which rules derive which parts of a tree, and with how few codons."""

from __future__ import annotations

import math

from ge_torchrl.ge.productions import Kind
from ge_torchrl.ge.rule_tables import ACTION, CHOICE, CONSTANT, END, FEATURE, IF, RANGE, RuleTables
from ge_torchrl.trees.tree import DecisionTree

_NONE = -1


class Derivations:
    """The derivations of a tree, found by dynamic programming from its last node to its root.

    A node is a split or a leaf here, numbered depth first, left before right.

    Args:
        target: The tree, of axis-aligned splits and of leaves that are actions.
        tables: The compiled grammar.

    Attributes:
        n_nodes: Number of nodes.
        symbols: [S] kind and argument of every symbol.
    """

    def __init__(self, target: DecisionTree, tables: RuleTables) -> None:
        program = tables.program
        kinds, arguments = program.symbol_kind.tolist(), program.symbol_argument.tolist()
        self.symbols: list[tuple[int, int]] = list(zip(kinds, arguments, strict=True))
        self._tables = tables
        self._constants: list[float] = program.constants.tolist()
        nodes = _depth_first(target)
        self.n_nodes = len(nodes)
        self._feature = [int(target.feature[node]) if node >= 0 else _NONE for node in nodes]
        self._threshold = [float(target.threshold[node]) if node >= 0 else math.nan for node in nodes]
        self._action = [int(target.action[~node]) if node < 0 else _NONE for node in nodes]
        self._subtree_sizes = _subtree_sizes(nodes)
        self._codons_of_rule = [[math.inf] * self.n_nodes for _ in tables.rule_bodies]
        for node in reversed(range(self.n_nodes)):
            # The tables' order of rules puts those that a rule needs at the same node before it.
            for rule, bodies in enumerate(tables.rule_bodies):
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
            (kind == IF and self._feature[node] != _NONE)
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


def _depth_first(tree: DecisionTree) -> list[int]:
    """Return the splits (`>= 0`) and leaves (`~leaf`) of a tree, left before right."""
    nodes, pending = list[int](), [0 if tree.num_decision_nodes else ~0]
    while pending:
        node = pending.pop()
        nodes.append(node)
        if node >= 0:
            pending += [int(tree.children_right[node]), int(tree.children_left[node])]
    return nodes


def _subtree_sizes(nodes: list[int]) -> list[int]:
    """Return the number of nodes below and including each of the nodes, depth first."""
    sizes = [1] * len(nodes)
    complete = list[int]()  # The subtrees that have no parent yet, the leftmost last.
    for at in reversed(range(len(nodes))):
        if nodes[at] >= 0:
            sizes[at] += complete.pop() + complete.pop()
        complete.append(sizes[at])
    return sizes
