"""The mapping as the textbook says it: a recursive walk over the grammar, one term at a time."""

from __future__ import annotations

from fractions import Fraction
from itertools import zip_longest

import numpy as np

from ge_torchrl.ge.productions import (
    Action,
    Answer,
    Constants,
    Feature,
    If,
    LessThan,
    Nonterminal,
    Product,
    Shifted,
    Sum,
)
from ge_torchrl.trees.tree import DecisionTree


class OutOfCodonsError(Exception):
    """A derivation has not ended with the last codon."""


class ReferenceMapper:
    """Derives one tree; a feature is derived as its number, a sum as a list of features and weights.

    `feature_rank` orders the terms of leaves with several values.
    """

    def __init__(self, grammar, codons, wraps=0, feature_rank=()):
        self.grammar = grammar
        self.codons = [int(codon) for codon in codons] * (wraps + 1)
        self.read = 0
        self.feature_rank = feature_rank

    def tree(self):
        start = self.grammar.start
        return self.derive(Nonterminal(start.name, place=start.place))

    def choose(self, n_choices):
        if n_choices == 1:
            return 0
        if self.read == len(self.codons):
            raise OutOfCodonsError
        self.read += 1
        return self.codons[self.read - 1] % n_choices

    def derive(self, term):  # noqa: PLR0911
        match term:
            case Nonterminal(name=name):
                productions = self.grammar.rules[name].productions
                return self.derive(productions[self.choose(len(productions))])
            case Action(index=action):
                return DecisionTree.leaf(action)
            case Answer():
                return self.leaf([self.value(value) for value in term.values])
            case If():
                terms, threshold = self.derive(term.condition)
                left = self.derive(term.then)
                features, weights = zip(*terms, strict=True)
                return DecisionTree.weighted_split(
                    features, weights, threshold, left, self.derive(term.otherwise)
                )
            case LessThan():
                terms = as_sum(self.derive(term.linear))
                return terms, self.derive(term.constant)
            case Feature(index=feature):
                return feature
            case Product():
                weight = self.derive(term.weight)
                return [(self.derive(term.feature), weight)]
            case Sum():
                return [pair for part in term.parts for pair in as_sum(self.derive(part))]
            case Shifted():
                constant = self.derive(term.constant)
                return constant, as_sum(self.derive(term.linear))
            case Constants():
                value = Fraction(term.low, term.scale) + self.choose(term.count) * Fraction(
                    term.step, term.scale
                )
                return float(np.float32(float(value)))

    def value(self, term):
        """Return the constant and the terms of an entry."""
        derived = self.derive(term)
        if isinstance(derived, float):
            return derived, []
        return derived if isinstance(derived, tuple) else (0.0, as_sum(derived))

    def leaf(self, entries):
        if len(entries) == 1:
            rows = [(feature, [weight]) for feature, weight in entries[0][1]]
        else:
            rows = self.shared_rows([terms for _, terms in entries])
        return DecisionTree(
            children_left=[],
            children_right=[],
            term_start=[0],
            feature=[],
            weight=[],
            threshold=[],
            action=[],
            value=[[constant for constant, _ in entries]],
            leaf_term_start=[0, len(rows)],
            leaf_feature=[feature for feature, _ in rows],
            leaf_weight=np.reshape([weights for _, weights in rows], (len(rows), len(entries))),
        )

    def shared_rows(self, entries):
        """Entries share the rows of a feature: the first weight of each stands in the first row, and so on."""
        rows = []
        for feature in sorted(range(len(self.grammar.features)), key=lambda f: self.feature_rank[f]):
            columns = [[weight for of, weight in terms if of == feature and weight != 0] for terms in entries]
            rows += [(feature, list(row)) for row in zip_longest(*columns, fillvalue=0.0)]
        return rows


def as_sum(derived):
    return [(derived, 1.0)] if isinstance(derived, int) else derived
