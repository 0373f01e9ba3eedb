"""Grammars for environments that bring none: readable text, made of what the features are in play."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, NamedTuple

import numpy as np

from ge_torchrl.errors import GrammarError
from ge_torchrl.ge.grammar import Grammar, read_grammar
from ge_torchrl.ge.steps import (
    FINEST_STEP,
    FLOAT32,
    LEAST_STEPS,
    decimal,
    has_room,
    inner_range,
    nice,
    range_text,
)

Range = tuple[float, float]

UNBOUNDED_ACTION: Final = 1.0
"""An entry of an action that has no bound on a side ends this far from the other one, or from zero."""

_LEAST_STEPS_OF_WEIGHTS: Final = 100
# Features are taken to stay within this.
_FARTHEST: Final = 1e12
# A linear leaf may go from one bound of the action to the other within a tenth of what a feature moves.
_STEEPNESS: Final = 10.0


class Chosen(NamedTuple):
    """The grammar of a run.

    Attributes:
        grammar: The grammar.
        text: Its rules.
        is_generated: Whether the text was made here, and is not the user's or the environment's own.
    """

    grammar: Grammar
    text: str
    is_generated: bool


def choose_grammar(
    bnf: str | None,
    splits: str | None,
    leaves: str | None,
    features: Sequence[str],
    actions: Sequence[str],
    action_bounds: Sequence[Range],
    ranges: Callable[[], Sequence[Range]],
    binary: Callable[[], Collection[str]] = tuple,
) -> Chosen:
    """Return the grammar that settings ask for: the given one where it is of the kind asked for, else a generated one.

    Args:
        bnf: The given rules, or none.
        splits: `axis` or `oblique`; None takes what the given rules have, else `axis`.
        leaves: `action`, `constant` or `linear`; None takes what the given rules have, else `action` where actions are
            discrete and `linear` where they are not.
        features: [D] names of the features.
        actions: [A] names of the actions, or of the entries of a Box action.
        action_bounds: [A] the bounds of a Box action's entries; empty where actions are discrete.
        ranges: Returns [D] what values each feature takes in play; only called where a grammar is generated.
        binary: Returns the names of features that take only 0 and 1; likewise.

    Raises:
        GrammarError: The given rules break a rule of the notation, or there are no such leaves in the environment.
    """
    continuous = len(action_bounds) > 0
    check_leaves(leaves, continuous=continuous)
    if bnf is not None:
        try:
            given = read_grammar(bnf, features, actions, continuous=continuous)
        except GrammarError as error:
            raise GrammarError(f"grammar.bnf, {error}") from error
        if splits in (None, given.splits) and leaves in (None, given.leaves):
            return Chosen(given, bnf, is_generated=False)
    leaves = leaves or ("linear" if continuous else "action")
    text = grammar_text(features, actions, ranges(), splits or "axis", leaves, action_bounds, binary=binary())
    return Chosen(read_grammar(text, features, actions, continuous=continuous), text, is_generated=True)


def check_leaves(leaves: str | None, *, continuous: bool) -> None:
    """Refuse leaves that an environment's actions cannot be.

    Raises:
        GrammarError: Actions are discrete and leaves are not, or the other way round.
    """
    if leaves is None or (leaves == "action") != continuous:
        return
    raise GrammarError(
        f"grammar.leaves must be {'constant or linear' if continuous else 'action'}, since the actions of this "
        f"environment are {'numbers' if continuous else 'discrete'}; got {leaves!r}; type grammar.leaves=null"
    )


def grammar_text(
    features: Sequence[str],
    actions: Sequence[str],
    ranges: Sequence[Range],
    splits: str,
    leaves: str,
    action_bounds: Sequence[Range] = (),
    *,
    binary: Collection[str] = (),
) -> str:
    """Return the rules of a grammar for an environment.

    Steps are 1, 2 or 5 times a power of ten, some hundred to a range, and ranges begin and end at multiples of them. A
    feature that does not vary is left out, since no test on it tells anything.

    Args:
        features: [D] names of the features.
        actions: [A] names of the actions, or of the entries of a Box action.
        ranges: [D] the lowest and the highest value that each feature takes in play.
        splits: `axis` compares one feature with a constant, `oblique` a weighted sum of two or more as well.
        leaves: `action` where actions are discrete; else `constant`, a number for each entry of the action, or
            `linear`, numbers to which a weighted sum of features may be added.
        action_bounds: [A] the bounds of a Box action's entries. Where one is infinite, `UNBOUNDED_ACTION` says what is
            taken.
        binary: Names of features that take only 0 and 1; they are compared with 0.5.

    Raises:
        GrammarError: A range is not finite or ends before it begins, or there are not as many as names.
    """
    _check(features, actions, ranges, action_bounds if leaves != "action" else [(0.0, 0.0)] * len(actions))
    varying = [
        found
        for name, (low, high) in zip(features, ranges, strict=True)
        if (found := _feature(name, low, high))
    ]
    rules: dict[str, list[str]] = {}
    is_linear = leaves == "linear" and len(varying) > 0
    if not varying:
        rules["dt"] = ["<leaf>"]
    elif is_linear:
        # One linear law alone may be enough.
        rules["dt"] = ["<leaf>", "if <condition> then <dt> else <dt>"]
    else:
        rules["dt"] = ["<if>"]
        rules["if"] = ["if <condition> then <action> else <action>"]
    if varying:
        _add_conditions(rules, varying, splits, binary)
        if not is_linear:
            rules["action"] = ["<leaf>", "<if>"]
    if leaves == "action":
        rules["leaf"] = list(actions)
    else:
        _add_values(
            rules, actions, [_bounded(*bounds) for bounds in action_bounds], varying if is_linear else []
        )
    return _written(rules)


def _check(
    features: Sequence[str], actions: Sequence[str], ranges: Sequence[Range], bounds: Sequence[Range]
) -> None:
    for what, names, pairs in (("feature", features, ranges), ("entry of the action", actions, bounds)):
        if len(names) != len(pairs):
            raise GrammarError(f"a grammar needs a range for each {what}, {len(names)}; got {len(pairs)}")
        for name, (low, high) in zip(names, pairs, strict=True):
            is_number = low <= high and (what != "feature" or (math.isfinite(low) and math.isfinite(high)))
            if not is_number:
                raise GrammarError(
                    f"the range of {what} {name} must be two numbers, the lower one first, so that constants lie "
                    f"in it; got {low}, {high}"
                )


@dataclass(frozen=True)
class _Feature:
    name: str
    low: float
    high: float
    step: Fraction

    @property
    def spread(self) -> float:
        """How far the feature moves to either side of its middle."""
        return (self.high - self.low) / 2

    @property
    def farthest(self) -> float:
        return max(abs(self.low), abs(self.high))


def _feature(name: str, low: float, high: float) -> _Feature | None:
    """Return a feature with its step; None where it does not vary by more than can be written."""
    low, high = (min(max(end, -_FARTHEST), _FARTHEST) for end in (low, high))
    step = nice((high - low) / LEAST_STEPS, at_least=max(abs(low), abs(high)) * FLOAT32)
    # Such a step can be wider than a narrow range that is far from zero.
    return _Feature(name, low, high, step) if step >= FINEST_STEP and high - low > step else None


def _add_conditions(
    rules: dict[str, list[str]], varying: list[_Feature], splits: str, binary: Collection[str]
) -> None:
    tests = [
        f"lt({of.name}, {'0.5' if of.name in binary else range_text(of.low, of.high, of.step)})"
        for of in varying
    ]
    if splits == "axis" or len(varying) < 2:
        rules["condition"] = tests
        return
    rules["condition"] = ["<single>", "<oblique>"]
    rules["single"] = tests
    # The sum's unit: most weights are near 1 then, and so is what a term adds to the sum.
    unit = 10.0 ** round(float(np.median([math.log10(of.spread) for of in varying])))
    weights = [nice(unit / of.spread * 1.000001) for of in varying]
    reach = 2 * max(float(weight) * of.farthest for weight, of in zip(weights, varying, strict=True))
    step = nice(min(reach, 4 * unit) / LEAST_STEPS, at_least=reach * FLOAT32)
    rules["oblique"] = [f"lt(<sum>, {range_text(-reach, reach, step)})"]
    rules["sum"] = ["<term> + <term>", "<term> + <sum>"]
    rules["term"] = [f"{_weights(weight)} * {of.name}" for weight, of in zip(weights, varying, strict=True)]


def _weights(weight: Fraction) -> str:
    step = decimal(weight / _LEAST_STEPS_OF_WEIGHTS)
    return f"[{decimal(-weight)}, {decimal(weight)}] step {step}"


def _bounded(low: float, high: float) -> Range:
    if math.isinf(low):
        low = -UNBOUNDED_ACTION if math.isinf(high) else high - 2 * UNBOUNDED_ACTION
    return (low, low + 2 * UNBOUNDED_ACTION) if math.isinf(high) else (low, high)


def _add_values(
    rules: dict[str, list[str]], entries: Sequence[str], bounds: Sequence[Range], varying: list[_Feature]
) -> None:
    arguments = []
    for number, (entry, (low, high)) in enumerate(zip(entries, bounds, strict=True)):
        # A hyphen keeps these rules apart from all others.
        name = entry if re.fullmatch(r"\w+", entry, re.ASCII) else f"entry{number}"
        constants = inner_range(low, high)
        middle, reach = (low + high) / 2, _STEEPNESS * (high - low) / 2
        weights = {of.name: nice(reach / of.spread) for of in varying} if has_room(low, high) else {}
        # What is smaller than can be written has no effect that a person could read.
        weights = {
            of: weight for of, weight in weights.items() if weight / _LEAST_STEPS_OF_WEIGHTS >= FINEST_STEP
        }
        if not weights:
            arguments.append(constants)
            continue
        arguments.append(f"<{name}-value>")
        step = nice(2 * reach / LEAST_STEPS, at_least=abs(middle) * FLOAT32)
        shift = range_text(middle - reach, middle + reach, step)
        rules[f"{name}-value"] = [constants, f"{shift} + <{name}-sum>"]
        rules[f"{name}-sum"] = [f"<{name}-term>", f"<{name}-term> + <{name}-sum>"]
        rules[f"{name}-term"] = [f"{_weights(weight)} * {of}" for of, weight in weights.items()]
    rules["leaf"] = [f"act({', '.join(arguments)})"]


def _written(rules: dict[str, list[str]]) -> str:
    """Return the text of rules, the names in one column and, where they are long, a production a line."""
    width = max(map(len, rules)) + 2
    lines = []
    for name, productions in rules.items():
        head = f"{f'<{name}>':{width}} ::= "
        is_short = sum(map(len, productions)) + 3 * len(productions) <= 80
        joint = " | " if is_short else "\n" + " " * (width + 3) + "| "
        lines.append(head + joint.join(productions))
    return "\n".join(lines) + "\n"
