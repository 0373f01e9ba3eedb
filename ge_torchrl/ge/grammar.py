"""Grammars of decision trees: a checked record, and the notation it is read from.

The notation is Backus-Naur form with terms of this package::

    <dt>        ::= if <condition> then <action> else <action>     # the first rule is the start
    <condition> ::= lt(position, [-1.2, 0.6] step 0.005)
                  | lt(velocity, 0)
    <action>    ::= left | right | <dt>

White space and line ends only separate, `#` starts a comment. A rule derives one kind of thing: a tree (an
action's name or `if`), a condition (`lt`), a feature's name or a constant (a number or a range). So every
derivation is a tree.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from ge_torchrl.ge.grammar_checks import check_rules
from ge_torchrl.ge.grammar_reader import read_rules
from ge_torchrl.ge.productions import Constants, Feature, Kind, LessThan, Nonterminal, Production, Rule, terms


@dataclass(frozen=True)
class Grammar:
    """A checked grammar; every derivation from its start is a decision tree.

    Attributes:
        rules: The rules by name; the first is the start.
        kinds: What each rule derives, ordered so that a rule stands after those it has as whole productions.
        features: [D] names of the features.
        actions: [A] names of the actions.
    """

    rules: Mapping[str, Rule]
    kinds: Mapping[str, Kind]
    features: tuple[str, ...]
    actions: tuple[str, ...]

    @property
    def start(self) -> Rule:
        """The rule that every derivation begins with."""
        return next(iter(self.rules.values()))

    @cached_property
    def constants(self) -> tuple[tuple[Constants, ...], ...]:
        """[D] the constants that the grammar offers with each feature, none where it never tests it."""
        offered: list[list[Constants]] = [[] for _ in self.features]
        productions = (production for rule in self.rules.values() for production in rule.productions)
        for condition in (term for production in productions for term in terms(production)):
            if isinstance(condition, LessThan):
                constants = [
                    term for term in self._alternatives(condition.constant) if isinstance(term, Constants)
                ]
                for term in self._alternatives(condition.feature):
                    if isinstance(term, Feature):
                        offered[term.index] += [new for new in constants if new not in offered[term.index]]
        return tuple(tuple(of_feature) for of_feature in offered)

    def _alternatives(self, production: Production) -> Iterator[Production]:
        pending = [production]
        while pending:
            term = pending.pop()
            if isinstance(term, Nonterminal):
                pending.extend(self.rules[term.name].productions)
            else:
                yield term


def read_grammar(text: str, features: Sequence[str], actions: Sequence[str]) -> Grammar:
    """Read and check the text of a grammar.

    Args:
        text: The rules, in the notation of this module.
        features: [D] names of the features, words of letters, digits and underscores.
        actions: [A] names of the actions, likewise.

    Returns:
        The grammar.

    Raises:
        GrammarError: The text breaks a rule of the notation; the message begins with line and column. Or a
            name cannot be a word of the text.
    """
    rules = read_rules(text, features, actions)
    return Grammar(rules, check_rules(rules), tuple(features), tuple(actions))
