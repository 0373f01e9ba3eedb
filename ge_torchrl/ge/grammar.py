"""Grammars of decision trees: a checked record, and the notation it is read from.

The notation is Backus-Naur form with terms of this package::

    <dt>        ::= if <condition> then <action> else <action>     # the first rule is the start
    <condition> ::= lt(position, [-1.2, 0.6] step 0.005)
                  | lt(velocity, 0)
    <action>    ::= left | right | <dt>

White space and line ends only separate, `#` starts a comment. A rule derives one kind of thing: a tree (an
action's name, `act` or `if`), a condition (`lt`), a feature's name, a sum of features, or a constant (a number or a
range). So every derivation is a tree.

A condition may compare a sum with a constant. A sum is made of features, of constants times features, and of rules that
derive them, joined by `+`; a feature alone is a sum of one term::

    <condition> ::= lt(<linear>, [-1, 1] step 0.01)
    <linear>    ::= <term> | <term> + <linear>
    <term>      ::= [-4, 4] step 0.1 * x | [-2, 2] step 0.05 * theta | theta_dot

Where actions are numbers (a Box), a leaf is `act(...)` with a value for each entry of the action: a constant, a sum, or
a constant and a sum, or a rule that derives one of them::

    <leaf>  ::= act(<force>, [0, 1] step 0.1)
    <force> ::= [-2, 2] step 0.1 | [-2, 2] step 0.1 + <linear>

Constants do not stand anywhere else in a sum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from graphlib import CycleError, TopologicalSorter

from ge_torchrl.ge.grammar_checks import check_rules, told_apart
from ge_torchrl.ge.grammar_reader import read_rules
from ge_torchrl.ge.offers import ONE, EntryOffer, Offers, SplitOffer
from ge_torchrl.ge.productions import Constants, If, Kind, Nonterminal, Production, Rule, terms

# More decision nodes are not told apart: rules may double each other a thousand times.
_MANY = 10**9


@dataclass(frozen=True)
class Grammar:
    """A checked grammar; every derivation from its start is a decision tree.

    Attributes:
        rules: The rules by name; the first is the start.
        kinds: What each rule derives, ordered so that a rule stands after those it has as whole productions.
        features: [D] names of the features.
        actions: [A] names of the actions, or of the entries of a Box action.
        continuous: Whether leaves hold a value for each entry of a Box action, and not an action.
    """

    rules: Mapping[str, Rule]
    kinds: Mapping[str, Kind]
    features: tuple[str, ...]
    actions: tuple[str, ...]
    continuous: bool = False

    @property
    def start(self) -> Rule:
        """The rule that every derivation begins with."""
        return next(iter(self.rules.values()))

    @property
    def n_values(self) -> int:
        """How many values a leaf holds; 0 where it holds an action."""
        return len(self.actions) if self.continuous else 0

    @cached_property
    def split_offers(self) -> tuple[SplitOffer, ...]:
        """What each condition of the text offers."""
        return Offers(self.rules, self.kinds).splits()

    @cached_property
    def leaf_offers(self) -> tuple[tuple[EntryOffer, ...], ...]:
        """What each `act(...)` of the text offers for each entry of the action."""
        return Offers(self.rules, self.kinds).leaves()

    @cached_property
    def feature_rank(self) -> tuple[int, ...]:
        """[D] the place of each feature in the order in which the text names them in sums at leaves."""
        entries = (entry for entries in self.leaf_offers for entry in entries)
        named = list(dict.fromkeys(feature for entry in entries for feature in entry.linear.weights))
        return tuple(named.index(of) if of in named else len(named) for of in range(len(self.features)))

    @cached_property
    def constants(self) -> tuple[tuple[Constants, ...], ...]:
        """[D] the constants that the grammar compares each feature alone with, none where it does not."""
        offered: list[dict[Constants, None]] = [{} for _ in self.features]
        for offer in self.split_offers:
            for feature, weights in offer.linear.weights.items():
                if offer.linear.fewest == 1 and any(of.find(1.0) is not None for of in weights):
                    offered[feature] |= dict.fromkeys(offer.thresholds)
        return tuple(map(tuple, offered))

    @property
    def splits(self) -> str:
        """`oblique` where a condition compares a weighted feature or several of them, else `axis`."""
        sums = [offer.linear for offer in self.split_offers]
        is_weighted = any(weights != (ONE,) for linear in sums for weights in linear.weights.values())
        return "oblique" if is_weighted or any(linear.most > 1 for linear in sums) else "axis"

    @property
    def leaves(self) -> str:
        """`action`, or `linear` where a value may be a sum, or else `constant`."""
        if not self.continuous:
            return "action"
        is_linear = any(entry.added for entries in self.leaf_offers for entry in entries)
        return "linear" if is_linear else "constant"

    @cached_property
    def most_splits(self) -> float:
        """Decision nodes of the largest tree that it derives; infinite where trees hold trees of the same rule."""
        # A tree that holds a tree holds a split between them: a rule that derives only another one is no circle.
        trees = {name for name, kind in self.kinds.items() if kind is Kind.TREE}
        inside = {name: trees.intersection(_named_by(self.rules[name])) for name in trees}
        most = dict.fromkeys(self.rules, 0)
        try:
            for name in TopologicalSorter(inside).static_order():
                most[name] = min(_MANY, max(_splits_of(of, most) for of in self.rules[name].productions))
        except CycleError:
            return math.inf
        return most[self.start.name]

    @property
    def has_sums(self) -> bool:
        """Whether it weighs features, in splits or in leaves."""
        return self.splits == "oblique" or self.leaves == "linear"


def _named_by(rule: Rule) -> Iterator[str]:
    inside = (term for production in rule.productions for term in terms(production))
    return (term.name for term in inside if isinstance(term, Nonterminal))


def _splits_of(production: Production, most: Mapping[str, int]) -> int:
    inside = list(terms(production))
    named = (most[term.name] for term in inside if isinstance(term, Nonterminal))
    return sum(isinstance(term, If) for term in inside) + sum(named)


def read_grammar(
    text: str, features: Sequence[str], actions: Sequence[str], *, continuous: bool = False
) -> Grammar:
    """Read and check the text of a grammar.

    Args:
        text: The rules, in the notation of this module.
        features: [D] names of the features, words of letters, digits and underscores.
        actions: [A] names of the actions, likewise.
        continuous: Whether these are the entries of a Box action; then they may be any names.

    Returns:
        The grammar.

    Raises:
        GrammarError: The text breaks a rule of the notation; the message begins with line and column. Or a
            name cannot be a word of the text.
    """
    rules = told_apart(read_rules(text, features, actions, continuous=continuous))
    return Grammar(rules, check_rules(rules), tuple(features), tuple(actions), continuous)
