"""Grammars and genotypes of tests: strategies, and a grammar to read by eye."""

from __future__ import annotations

import re

import numpy as np
from hypothesis import strategies as st

from ge_torchrl.ge.codons import CODON_LIMIT, Codons
from ge_torchrl.ge.grammar import Grammar, read_grammar
from ge_torchrl.ge.mapping import map_population
from ge_torchrl.ge.rule_tables import compile_rules
from ge_torchrl.trees.forest import Forest

FEATURES = ["f0", "f1"]
ACTIONS = ["a0", "a1", "a2"]

CARTPOLE = """
<dt>        ::= <if>
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(f0, <constant>) | lt(f1, <constant>)
<action>    ::= <leaf> | <if>
<leaf>      ::= a0 | a1 | a2
<constant>  ::= [-1, 1] step 0.25
"""


def cartpole_like() -> Grammar:
    """A grammar of the thesis' form, with two features and three actions."""
    return read_grammar(CARTPOLE, FEATURES, ACTIONS)


@st.composite
def grammars(draw: st.DrawFn) -> Grammar:
    """Grammars of any form: inline and nested terms, chains, single choices, recursion, all kinds of constants.

    First productions refer to later rules only, so every rule ends; whole productions too, so none is its own.
    """
    counts = {kind: draw(st.integers(1, 3)) for kind in "tcfk"}

    def reference(kind: str, after: int) -> str | None:
        later = [f"<{kind}{number}>" for number in range(after, counts[kind])]
        return draw(st.sampled_from(later)) if later and draw(st.booleans()) else None

    def constant(after: int) -> str:
        literals = ["0", "-0.5", "0.1", "[-1, 1] step 0.5", "[0.1, 0.9] step 0.2", "[0.5, 0.5] step 1"]
        return reference("k", after) or draw(st.sampled_from(literals))

    def feature(after: int) -> str:
        return reference("f", after) or draw(st.sampled_from(FEATURES))

    def condition(after: int) -> str:
        return reference("c", after) or f"lt({feature(0)}, {constant(0)})"

    def tree(after: int, inside: int, depth: int = 0) -> str:
        if found := reference("t", after):
            return found
        if depth == 2 or draw(st.booleans()):
            return draw(st.sampled_from(ACTIONS))
        return (
            f"if {condition(0)} then {tree(inside, inside, depth + 1)} else {tree(inside, inside, depth + 1)}"
        )

    lines = {}
    for kind, write in {"c": condition, "f": feature, "k": constant}.items():
        for number in range(counts[kind]):
            lines[f"{kind}{number}"] = [write(number + 1) for _ in range(draw(st.integers(1, 3)))]
    for number in range(counts["t"]):
        others = [tree(number + 1, 0) for _ in range(draw(st.integers(0, 2)))]
        lines[f"t{number}"] = [tree(number + 1, number + 1), *others]
    return read_grammar(reachable_text(lines), FEATURES, ACTIONS)


def genotypes(max_length: int = 12) -> st.SearchStrategy[Codons]:
    """Genotypes [K] of small codons, which make all choices, and large ones."""
    codon = st.integers(0, 30) | st.integers(0, CODON_LIMIT - 1)
    return st.lists(codon, min_size=1, max_size=max_length).map(lambda codons: np.array(codons, np.int32))


def reachable_text(lines: dict[str, list[str]]) -> str:
    """Return the rules that the first tree's refer to, and no others."""
    reached, pending = ["t0"], ["t0"]
    while pending:
        for name in re.findall(r"<(\w+)>", " ".join(lines[pending.pop()])):
            if name not in reached:
                reached.append(name)
                pending.append(name)
    return "\n".join(f"<{name}> ::= {' | '.join(lines[name])}" for name in reached)


def equal(one: Forest, other: Forest) -> bool:
    """Whether two forests hold the same bytes."""
    return all(
        mine.dtype == theirs.dtype and np.array_equal(mine, theirs)
        for mine, theirs in zip(one.arrays, other.arrays, strict=True)
    )


def map_alike_however_often_and_however_many(grammar: Grammar, rows: list[Codons], wraps: int) -> bool:
    """Whether the same codons give the same trees, again and one by one."""
    codons = np.stack([np.resize(row, 12) for row in rows])
    tables = compile_rules(grammar)
    forest = map_population(codons, tables, wraps)
    one_by_one = [map_population(row[np.newaxis], tables, wraps) for row in codons]
    return equal(forest, map_population(codons, tables, wraps)) and equal(
        forest, Forest.concatenate(one_by_one)
    )
