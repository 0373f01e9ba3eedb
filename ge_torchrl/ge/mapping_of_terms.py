"""The mapping of grammars that have weighted sums, or values at the leaves; `ge.mapping` says what it does.

It is a kernel of its own, so that grammars without them are mapped as quickly as ever.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.ge.rule_tables import (
    ACTION,
    ANSWER,
    CHOICE,
    CONSTANT,
    END,
    FEATURE,
    IF,
    NEXT,
    ONE,
    RANGE,
    VALUE,
    Program,
    RuleTables,
)
from ge_torchrl.ge.term_buffer import Buffer, enlarged, forest_of_buffer, room_for
from ge_torchrl.trees.forest import Forest

# Room for that many splits of each individual to begin with, and for terms of each split; the buffer grows where it
# must.
_LIKELY_SPLITS: Final = 16
_LIKELY_TERMS: Final = 2


def map_with_terms(genotypes: NDArray[np.uint32], tables: RuleTables, n_readable: int) -> Forest:
    """Derive the trees of a population.

    Args:
        genotypes: [P, K] uint32, contiguous.
        tables: The compiled grammar, whose `has_terms` is true.
        n_readable: How many codons a derivation may read.

    Returns:
        The `P` trees.
    """
    n_individuals, n_values = len(genotypes), tables.grammar.n_values
    n_splits = n_individuals * _LIKELY_SPLITS
    buffer = room_for(n_splits, n_splits * _LIKELY_TERMS, n_individuals, n_values)
    longest = tables.longest_body * (n_readable + 1)
    symbols, numbers = np.empty((longest, 2), np.int32), np.empty(longest, np.float32)
    returns = np.empty(n_readable, np.int32)
    starts = np.zeros((4, n_individuals + 1), np.int64)
    mapped = 0
    while mapped < n_individuals:
        mapped = _map(
            genotypes,
            n_readable,
            tables.program,
            tables.feature_rank,
            returns,
            symbols,
            numbers,
            mapped,
            buffer,
            starts,
        )
        if mapped < n_individuals:
            buffer = enlarged(buffer, n_individuals)
    return forest_of_buffer(buffer, starts)


@compiled
def _map(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    rank: NDArray[np.int32],
    returns: NDArray[np.int32],
    symbols: NDArray[np.int32],
    numbers: NDArray[np.float32],
    mapped: int,
    buffer: Buffer,
    starts: NDArray[np.int64],
) -> int:
    """Map individuals from `mapped` on while there is room; return the first that had none.

    `starts` [4, P + 1] says where the splits, leaves, terms and leaves' terms of each begin.
    """
    for individual in range(mapped, len(codons)):
        start = starts[:, individual]
        n_symbols = _derive(codons[individual], n_readable, program, returns, symbols, numbers)
        n_splits = n_terms = 0
        for symbol in range(n_symbols):
            n_splits += int(symbols[symbol, 0] == IF)
            n_terms += int(symbols[symbol, 0] == FEATURE)
        has_room = start[0] + n_splits <= len(buffer.term_start)
        for kind in (2, 3):
            has_room &= start[kind] + n_terms <= len(buffer.feature)
        if not has_room:
            return individual
        starts[:, individual + 1] = start
        if n_symbols > 0:
            _build(symbols, numbers, rank, buffer, start, starts[:, individual + 1])
    return len(codons)


@compiled
def _derive(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    symbols: NDArray[np.int32],
    numbers: NDArray[np.float32],
) -> int:
    """Write what a genotype derives, kind and argument of each symbol and its number; return how many there are.

    A derivation that does not end has none.
    """
    read = position = at = depth = written = 0
    while True:
        symbol = at
        kind, argument = program.symbol_kind[symbol], program.symbol_argument[symbol]
        at += 1
        if kind in (CHOICE, RANGE):
            if read == n_readable:
                return 0
            position = 0 if position == len(codons) else position
            choice = codons[position] % program.symbol_choices[symbol]
            position += 1
            read += 1
            if kind == CHOICE:
                returns[depth] = at
                # Behind the last symbol of a body there is nothing to return to.
                depth += int(program.symbol_kind[at] != END)
                at = program.body_start[program.symbol_first_body[symbol] + choice]
                continue
            constant = program.range_low[argument] + np.int64(choice) * program.range_step[argument]
            numbers[written] = constant / program.range_scale[argument]
        elif kind == END:
            if depth == 0:
                return written
            depth -= 1
            at = returns[depth]
            continue
        elif kind == CONSTANT:
            numbers[written] = program.constants[argument]
        elif kind == ONE:
            numbers[written] = 1.0
        symbols[written, 0], symbols[written, 1] = kind, argument
        written += 1


@compiled
def _build(
    symbols: NDArray[np.int32],
    numbers: NDArray[np.float32],
    rank: NDArray[np.int32],
    buffer: Buffer,
    start: NDArray[np.int64],
    end: NDArray[np.int64],
) -> None:
    """Write the tree that symbols say: its splits, leaves, terms and leaves' terms from `start` on, to `end`."""
    root, nowhere, n_values = start[0], len(buffer.threshold) - 1, buffer.value.shape[1]
    split, leaf, term, leaf_term = start
    waiting = -1  # The innermost split that has no right child yet; it links to the next outer one.
    # Where the next node is a child; the root is one in the column that nobody reads.
    side, parent = 0, nowhere
    row = nowhere  # The split whose condition is said; none within a leaf.
    symbol, entry, number = 0, 0, np.float32(0.0)
    while True:
        kind, argument = symbols[symbol]
        if kind in (RANGE, CONSTANT, ONE):
            number = numbers[symbol]
        elif kind == FEATURE and row == nowhere:
            begin = buffer.leaf_term_start[leaf]
            leaf_term = _add_to_leaf(buffer, begin, leaf_term, argument, number, entry, rank)
        elif kind == FEATURE:
            buffer.feature[term], buffer.weight[term] = argument, number
            term += 1
        elif kind == VALUE:
            buffer.value[leaf, entry] = number
        elif kind in (IF, ANSWER, ACTION):
            # A tree begins, so the condition in front of it is over; its last number is the threshold.
            buffer.threshold[row] = number
            row = nowhere
        if kind == IF:
            row = split
            buffer.term_start[row] = term
            buffer.children[side, parent] = split - root
            buffer.children[1, row] = waiting
            side, parent, waiting = 0, row, split - root
            split += 1
        elif kind == ANSWER:
            buffer.leaf_term_start[leaf] = leaf_term
            buffer.value[leaf] = 0.0
            entry = 0
        elif kind == ACTION:
            buffer.action[leaf] = argument
        entry += int(kind == NEXT)
        if kind == ACTION or (kind == NEXT and entry == n_values):
            buffer.children[side, parent] = ~(leaf - start[1])
            leaf += 1
            if waiting < 0:
                break
            side, parent = 1, root + waiting
            waiting = buffer.children[1, parent]
        symbol += 1
    end[0], end[1], end[2], end[3] = split, leaf, term, leaf_term


@compiled
def _add_to_leaf(
    buffer: Buffer,
    begin: int,
    end: int,
    feature: int,
    weight: np.float32,
    entry: int,
    rank: NDArray[np.int32],
) -> int:
    """Add a term to an entry's sum in a leaf whose terms stand from `begin` to `end`; return their new end.

    The terms of a lone entry keep their order. Several entries share terms: these are ordered by feature, each weight
    stands in the first term of its feature that has none for its entry, and weights of zero are left out.
    """
    at = end
    if buffer.leaf_weight.shape[1] > 1:
        if weight == 0.0:
            return end
        for q in range(begin, end):
            if buffer.leaf_feature[q] == feature and buffer.leaf_weight[q, entry] == 0.0:
                buffer.leaf_weight[q, entry] = weight
                return end
            if rank[buffer.leaf_feature[q]] > rank[feature]:
                at = q
                break
        for q in range(end, at, -1):
            buffer.leaf_feature[q] = buffer.leaf_feature[q - 1]
            buffer.leaf_weight[q] = buffer.leaf_weight[q - 1]
    buffer.leaf_feature[at] = feature
    buffer.leaf_weight[at] = 0.0
    buffer.leaf_weight[at, entry] = weight
    return end + 1
