"""What a grammar has to derive that derives a tree: its words, in the order of derivation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from ge_torchrl.ge.productions import Kind
from ge_torchrl.ge.rule_tables import ACTION, ANSWER, FEATURE, IF, NEXT, RuleTables
from ge_torchrl.trees.tree import DecisionTree

NUMBER: Final = -1
"""A number: a weight, a threshold, or what is added to a leaf's sum."""
OVER: Final = -2
"""The sentence is over."""
OUTSIDE: Final = -1
"""No entry of a leaf's values."""

_TREES = (Kind.TREE,)
_AXIS_CONDITION = (Kind.FEATURE, Kind.CONDITION)


@dataclass(frozen=True)
class Sentence:
    """The words of a tree.

    A split is `IF`, its terms and its threshold; a leaf is an `ACTION`, or `ANSWER` and its entries. A term is its
    weight and its feature; an entry is a number, the terms that are added to it, and `NEXT`.

    Attributes:
        words: Kind of each word, that of a symbol of `rule_tables` or `NUMBER`, and its argument; the last is `OVER`.
        numbers: The number of each word that is one.
        kinds: What begins at each word.
        may_add_zeros: Where terms of weight zero may stand in between, which the tree does not have.
        entries: Which entry of a leaf's values each word belongs to; `OUTSIDE` where to none.
    """

    words: list[tuple[int, int]] = field(default_factory=list)
    numbers: list[float] = field(default_factory=list)
    kinds: list[tuple[Kind, ...]] = field(default_factory=list)
    may_add_zeros: list[bool] = field(default_factory=list)
    entries: list[int] = field(default_factory=list)

    def kinds_at(self, position: int) -> tuple[Kind, ...]:
        """Return what may begin at a word, parts before the wholes that they begin."""
        return self.kinds[position]

    def add(
        self,
        kind: int,
        argument: int = 0,
        number: float = 0.0,
        begins: tuple[Kind, ...] = (),
        *,
        may_add_zeros: bool = False,
        entry: int = OUTSIDE,
    ) -> None:
        """Append a word."""
        self.words.append((kind, argument))
        self.numbers.append(number)
        self.kinds.append(begins)
        self.may_add_zeros.append(may_add_zeros)
        self.entries.append(entry)


def said_by(tree: DecisionTree, tables: RuleTables) -> Sentence:
    """Return the sentence of a tree, in the words of a compiled grammar.

    Args:
        tree: A snapped tree.
        tables: The compiled grammar. Without `has_terms`, a condition is a feature and its threshold.
    """
    sentence = Sentence()
    features, weights = tree.feature.tolist(), tree.weight.tolist()
    starts, thresholds = tree.term_start.tolist(), tree.threshold.tolist()
    for node in _depth_first(tree):
        if node < 0:
            _add_leaf(sentence, tree, ~node)
            continue
        sentence.add(IF, begins=_TREES)
        if not tables.has_terms:
            sentence.add(FEATURE, features[starts[node]], begins=_AXIS_CONDITION)
        else:
            terms = range(starts[node], starts[node + 1])
            for term in terms:
                first = (Kind.CONDITION,) if term == terms[0] else ()
                sentence.add(NUMBER, number=weights[term], begins=(Kind.CONSTANT, Kind.SUM, *first))
                sentence.add(FEATURE, features[term], begins=(Kind.FEATURE,))
        sentence.add(NUMBER, number=thresholds[node], begins=(Kind.CONSTANT,))
    sentence.add(OVER)
    return sentence


def _add_leaf(sentence: Sentence, tree: DecisionTree, leaf: int) -> None:
    if tree.has_actions:
        sentence.add(ACTION, int(tree.action[leaf]), begins=_TREES)
        return
    sentence.add(ANSWER, begins=_TREES)
    shared = tree.value.shape[1] > 1
    terms = slice(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    features, weights = tree.leaf_feature[terms].tolist(), tree.leaf_weight[terms].T.tolist()
    for entry, value in enumerate(tree.value[leaf].tolist()):
        sentence.add(NUMBER, number=value, begins=(Kind.CONSTANT, Kind.VALUE), entry=entry)
        for feature, weight in zip(features, weights[entry], strict=True):
            if shared and weight == 0:
                continue
            begins: tuple[Kind, ...] = (Kind.CONSTANT, Kind.SUM)
            sentence.add(NUMBER, number=weight, begins=begins, may_add_zeros=shared, entry=entry)
            sentence.add(FEATURE, feature, begins=(Kind.FEATURE,), entry=entry)
        begins = (Kind.CONSTANT, Kind.SUM) if shared else ()
        sentence.add(NEXT, begins=begins, may_add_zeros=shared, entry=entry)


def _depth_first(tree: DecisionTree) -> Iterator[int]:
    """Yield the splits (`>= 0`) and leaves (`~leaf`) of a tree, left before right."""
    left, right = tree.children_left.tolist(), tree.children_right.tolist()
    pending = [0 if left else ~0]
    while pending:
        node = pending.pop()
        yield node
        if node >= 0:
            pending += [right[node], left[node]]
