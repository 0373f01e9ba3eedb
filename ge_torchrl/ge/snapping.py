"""Trees on a grammar's constants: the nearest ones to a tree's numbers, and those near by."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import UnencodableTreeError
from ge_torchrl.ge.grammar import Grammar
from ge_torchrl.ge.offers import EntryOffer, SplitOffer, nearest_in
from ge_torchrl.ge.productions import Constants
from ge_torchrl.trees.tree import DecisionTree

NEAR: Final = (-4, -2, -1, 1, 2, 4)
"""How many constants away the constants are that `constants_near` takes, in both directions."""

_Terms = list[tuple[int, float]]


@dataclass(frozen=True)
class _Fit:
    """A sum on the constants of one place of the grammar.

    Attributes:
        error: How far its numbers moved, together.
        terms: Its terms, features and weights.
        constant: Its threshold, or what is added to it.
    """

    error: float
    terms: _Terms
    constant: float


def snap(tree: DecisionTree, grammar: Grammar) -> DecisionTree:
    """Round each number to the nearest constant that the grammar offers at its place and with its feature.

    Of two equally near constants the lower is taken. Where the grammar has several conditions, or several `act`, for a
    sum, it goes to the one whose constants are nearest to all its numbers together. A lone feature without a weight
    stays so where the grammar compares it; else its threshold is scaled with the weight that it gets. So is a sum as a
    whole where weights are larger than all that the grammar offers. A snapped tree stays as it is.

    Where leaves hold several values, their terms are put in the order of the mapping, terms of weight zero are left
    out, and so are those of a feature that the grammar does not offer for an entry.

    Args:
        tree: The tree.
        grammar: The grammar.

    Returns:
        The snapped tree.

    Raises:
        UnencodableTreeError: The grammar has no place for a sum of the tree, or derives no trees of its kind.
    """
    _check_kind(tree, grammar)
    arrays = tree.arrays
    weight, threshold = arrays.weight.copy(), arrays.threshold.copy()
    for split in range(tree.num_decision_nodes):
        fit = _snapped_split(tree, grammar, split)
        weight[tree.term_start[split] : tree.term_start[split + 1]] = [weight for _, weight in fit.terms]
        threshold[split] = fit.constant
    arrays = arrays._replace(weight=weight, threshold=threshold)
    if tree.has_actions:
        return DecisionTree.unchecked(arrays)
    rows, value, starts = _Rows(), np.empty_like(arrays.value), [0]
    for leaf in range(tree.num_leaves):
        fits = _snapped_leaf(tree, grammar, leaf)
        value[leaf] = [fit.constant for fit in fits]
        rows += _rows([fit.terms for fit in fits], grammar)
        starts.append(len(rows))
    return DecisionTree.unchecked(
        arrays._replace(
            value=value,
            leaf_term_start=np.array(starts, np.int32),
            leaf_feature=np.array([feature for feature, _ in rows], np.int32),
            leaf_weight=np.array([weights for _, weights in rows], np.float32).reshape(-1, value.shape[1]),
        )
    )


_Rows = list[tuple[int, tuple[float, ...]]]


def _rows(entries: list[_Terms], grammar: Grammar) -> _Rows:
    """Return the terms of a leaf as the mapping writes them: features and their weights for each entry."""
    if len(entries) == 1:
        return [(feature, (weight,)) for feature, weight in entries[0]]
    rows: _Rows = []
    for feature in sorted(
        {feature for terms in entries for feature, _ in terms}, key=grammar.feature_rank.__getitem__
    ):
        columns = [[weight for of, weight in terms if of == feature] for terms in entries]
        rows += ((feature, row) for row in zip_longest(*columns, fillvalue=0.0))
    return rows


def _check_kind(tree: DecisionTree, grammar: Grammar) -> None:
    if tree.value.shape[1] == grammar.n_values:
        return
    kinds = [
        "an action" if n == 0 else f"{n} value{'s' * (n > 1)}"
        for n in (grammar.n_values, tree.value.shape[1])
    ]
    raise UnencodableTreeError(
        f"a leaf holds {kinds[0]} in a tree of the grammar, and {kinds[1]} in this one"
    )


def _snapped_split(tree: DecisionTree, grammar: Grammar, split: int) -> _Fit:
    terms = _terms_of_split(tree, split)
    fits = [fit for offer in grammar.split_offers if (fit := _fit_split(offer, terms, tree.threshold[split]))]
    if not fits:
        names = " + ".join(
            grammar.features[feature] if feature < len(grammar.features) else f"number {feature}"
            for feature, _ in terms
        )
        what = "feature" if len(terms) == 1 else "the sum"
        raise UnencodableTreeError(
            f"split {split} tests {what} {names}, which no condition of the grammar does"
        )
    # A lone feature without a weight is easier to read, and kernels are quicker.
    is_lone = len(terms) == 1
    return min(fits, key=lambda fit: (is_lone and fit.terms != terms, fit.error, fit.constant, fit.terms))


def _terms_of_split(tree: DecisionTree, split: int) -> _Terms:
    terms = slice(tree.term_start[split], tree.term_start[split + 1])
    return list(zip(tree.feature[terms].tolist(), tree.weight[terms].tolist(), strict=True))


def _fit_split(offer: SplitOffer, terms: _Terms, threshold: float) -> _Fit | None:
    offered = offer.linear.weights
    if not offer.linear.fewest <= len(terms) <= offer.linear.most or any(
        of not in offered for of, _ in terms
    ):
        return None
    wanted = float(threshold)
    if len(terms) > 1:
        factor = min(_factor(offered[of], weight) for of, weight in terms)
        if factor < 1:
            terms, wanted = [(of, weight * factor) for of, weight in terms], wanted * factor
    snapped = [(of, nearest_in(offered[of], weight)) for of, weight in terms]
    if len(terms) == 1 and terms[0][1] * snapped[0][1] > 0:
        wanted *= snapped[0][1] / terms[0][1]
    constant = nearest_in(offer.thresholds, wanted)
    return _Fit(_distance(terms, snapped) + abs(constant - wanted), snapped, constant)


def _factor(offered: Sequence[Constants], weight: float) -> float:
    """Return what brings a weight that is larger than all offered ones down to the largest, 1 for any other."""
    largest = max(
        (constants.value(constants.nearest(weight)) for constants in offered), key=lambda of: of * weight
    )
    return largest / weight if 0 < largest * weight < weight * weight else 1.0


def _distance(terms: _Terms, snapped: _Terms) -> float:
    return sum(abs(before - after) for (_, before), (_, after) in zip(terms, snapped, strict=True))


def _snapped_leaf(tree: DecisionTree, grammar: Grammar, leaf: int) -> list[_Fit]:
    entries = _entries_of_leaf(tree, leaf)
    fitted = [
        [
            fit
            for offer, entry in zip(offers, entries, strict=True)
            if (fit := _fit_entry(offer, *entry, len(entries) > 1))
        ]
        for offers in grammar.leaf_offers
    ]
    whole = [fits for fits in fitted if len(fits) == len(entries)]
    if not whole:
        raise UnencodableTreeError(
            f"the values of leaf {leaf} are of a form that no `act` of the grammar has"
        )
    return min(whole, key=lambda fits: sum(fit.error for fit in fits))


def _entries_of_leaf(tree: DecisionTree, leaf: int) -> list[tuple[_Terms, float]]:
    terms = slice(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    features, weights = tree.leaf_feature[terms].tolist(), tree.leaf_weight[terms].T.tolist()
    return [
        (list(zip(features, weights[entry], strict=True)), value)
        for entry, value in enumerate(tree.value[leaf].tolist())
    ]


def _fit_entry(offer: EntryOffer, terms: _Terms, value: float, shared: bool) -> _Fit | None:
    """Return an entry on the constants of an argument of `act`; entries that share terms may leave some out."""
    offered = offer.linear.weights
    if shared:
        terms = [(of, weight) for of, weight in terms if weight != 0]
    elif any(of not in offered for of, _ in terms) or (
        terms and not offer.linear.fewest <= len(terms) <= offer.linear.most
    ):
        return None
    snapped = [(of, nearest_in(offered[of], weight) if of in offered else 0.0) for of, weight in terms]
    error = _distance(terms, snapped)
    if shared:
        snapped = [(of, weight) for of, weight in snapped if weight != 0]
    constants = _constants(offer, has_terms=bool(snapped), shared=shared)
    if not constants:
        return None
    constant = nearest_in(constants, value)
    return _Fit(error + abs(constant - value), snapped, constant)


def _constants(offer: EntryOffer, *, has_terms: bool, shared: bool) -> tuple[Constants, ...]:
    if has_terms:
        return offer.added
    return offer.alone + offer.added if shared and offer.may_vanish else offer.alone


def constants_near(
    tree: DecisionTree, grammar: Grammar, strides: Sequence[int] = NEAR
) -> NDArray[np.float32]:
    """Return what the tree's parameters become when one of them moves by a few of the grammar's constants.

    Args:
        tree: A snapped tree; a sum that is none of the grammar does not move.
        grammar: The grammar.
        strides: By how many constants of its range a number moves.

    Returns:
        [R, N] float32, the parameters of `R` trees that each differ from the tree in one; `R` is 0 where none can move.
    """
    moved = []
    # Where entries of an action share terms, a weight of 0 says that an entry has none: none becomes 0.
    shared = len(tree.parameters) - (tree.leaf_weight.size if grammar.n_values > 1 else 0)
    for place, offered in enumerate(_offered(tree, grammar)):
        number = float(tree.parameters[place])
        # A step can be finer than float32, so that a neighbour is the same number.
        unmoved = {number, 0.0} if place >= shared else {number}
        for constants in dict.fromkeys(offered):
            index = constants.find(number)
            if index is None:
                continue
            for at in (index + stride for stride in strides):
                if 0 <= at < constants.count and constants.value(at) not in unmoved:
                    parameters = tree.parameters.copy()
                    parameters[place] = constants.value(at)
                    moved.append(parameters)
    return np.array(moved, np.float32).reshape(len(moved), len(tree.parameters))


def _offered(tree: DecisionTree, grammar: Grammar) -> list[list[Constants]]:
    """Return what the grammar offers for each parameter, in their order."""
    thresholds: list[list[Constants]] = []
    weights: list[list[Constants]] = []
    for split in range(tree.num_decision_nodes):
        terms, threshold = _terms_of_split(tree, split), tree.threshold[split]
        offers = [
            offer
            for offer in grammar.split_offers
            if (fit := _fit_split(offer, terms, threshold)) is not None and fit.error == 0
        ]
        thresholds.append([one for offer in offers for one in offer.thresholds])
        if len(terms) > 1:
            weights += ([one for offer in offers for one in offer.linear.weights[of]] for of, _ in terms)
    return [*thresholds, *weights, *_offered_at_leaves(tree, grammar)]


def _offered_at_leaves(tree: DecisionTree, grammar: Grammar) -> Iterable[list[Constants]]:
    if tree.has_actions:
        return []
    values: list[list[Constants]] = []
    weights: list[list[Constants]] = []
    shared = tree.value.shape[1] > 1
    for leaf in range(tree.num_leaves):
        entries = _entries_of_leaf(tree, leaf)
        exact = [offers for offers in grammar.leaf_offers if _is_exact(offers, entries)]
        for entry, (terms, _) in enumerate(entries):
            has_terms = any(not shared or weight != 0 for _, weight in terms)
            values.append(
                [
                    one
                    for offers in exact
                    for one in _constants(offers[entry], has_terms=has_terms, shared=shared)
                ]
            )
        for term in range(len(entries[0][0])):
            for entry, (terms, _) in enumerate(entries):
                of, weight = terms[term]
                # A term that an entry does not have stays away: it would change the order of the others.
                moves = exact if not shared or weight != 0 else []
                weights.append([one for offers in moves for one in offers[entry].linear.weights.get(of, ())])
    return [*values, *weights]


def _is_exact(offers: Sequence[EntryOffer], entries: list[tuple[_Terms, float]]) -> bool:
    if len(offers) != len(entries):
        return False
    fits = [_fit_entry(offer, *entry, len(entries) > 1) for offer, entry in zip(offers, entries, strict=True)]
    return all(fit is not None and fit.error == 0 for fit in fits)
