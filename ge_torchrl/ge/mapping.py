"""The mapping: codons to decision trees, a whole population in one compiled call."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.mapping_of_terms import map_with_terms
from ge_torchrl.ge.rule_tables import ACTION, CHOICE, CONSTANT, END, FEATURE, IF, RANGE, Program, RuleTables
from ge_torchrl.trees.forest import Forest

# Room for that many splits of each individual to begin with; the buffer grows where it must.
_LIKELY_SPLITS: Final = 16


def map_population(codons: Codons, tables: RuleTables, wraps: int = 0) -> Forest:
    """Derive the tree of every genotype.

    A derivation goes depth first, left to right. Where there are `n` choices, it takes number `codon % n`; where
    there is one, it reads no codon. A sum's terms keep the order in which they are derived. Where a leaf has several
    values, their sums share terms, one for each feature or more where a sum names it again, in the order in which the
    grammar's text names the features; weights of zero are left out there.

    Args:
        codons: [P, K] int32.
        tables: The compiled grammar.
        wraps: How many times reading begins anew at the first codon when a genotype is exhausted.

    Returns:
        The `P` trees. A derivation that is unfinished after the last wrap is invalid, which is no error: that
        individual has no tree.

    Source:
        M. O'Neill and C. Ryan, "Grammatical Evolution", IEEE Transactions on Evolutionary Computation 5(4),
        2001.
    """
    # Unsigned codons let the processor divide by the cheaper 32-bit instruction.
    genotypes = np.ascontiguousarray(codons, np.int32).view(np.uint32)
    n_individuals, genotype_length = genotypes.shape
    n_readable = genotype_length * (wraps + 1)
    if tables.has_terms:
        return map_with_terms(genotypes, tables, n_readable)
    largest_tree = tables.splits_at_start + n_readable * tables.splits_per_choice
    buffer = _room_for(n_individuals * _LIKELY_SPLITS + largest_tree, n_individuals)
    returns = np.empty(n_readable, np.int32)
    split_start = np.zeros(n_individuals + 1, np.int64)
    leaf_start = np.zeros(n_individuals + 1, np.int64)
    mapped = 0
    while mapped < n_individuals:
        mapped = _map(
            genotypes,
            n_readable,
            tables.program,
            returns,
            mapped,
            largest_tree,
            buffer,
            split_start,
            leaf_start,
        )
        if mapped < n_individuals:
            buffer = _enlarged(buffer, int(split_start[mapped]), n_individuals)
    n_splits = split_start[-1]
    return Forest.axis_aligned(
        split_start=split_start,
        leaf_start=leaf_start,
        feature=buffer.feature[:n_splits].copy(),
        threshold=buffer.threshold[:n_splits].copy(),
        children_left=buffer.children[0, :n_splits].copy(),
        children_right=buffer.children[1, :n_splits].copy(),
        action=buffer.action[: leaf_start[-1]].copy(),
    )


class _Buffer(NamedTuple):
    """Where the trees of a population are written: room for `M` splits and for their leaves.

    Attributes:
        feature: [M] int32.
        threshold: [M] float32.
        children: [2, M + 1] int32, left and right; nobody reads the last column.
        action: [M + P] int32: a tree of `m` splits has `m + 1` leaves.
    """

    feature: NDArray[np.int32]
    threshold: NDArray[np.float32]
    children: NDArray[np.int32]
    action: NDArray[np.int32]


def _room_for(n_splits: int, n_individuals: int) -> _Buffer:
    return _Buffer(
        feature=np.empty(n_splits, np.int32),
        threshold=np.empty(n_splits, np.float32),
        children=np.empty((2, n_splits + 1), np.int32),
        action=np.empty(n_splits + n_individuals, np.int32),
    )


def _enlarged(buffer: _Buffer, n_written: int, n_individuals: int) -> _Buffer:
    larger = _room_for(2 * len(buffer.feature), n_individuals)
    larger.feature[:n_written] = buffer.feature[:n_written]
    larger.threshold[:n_written] = buffer.threshold[:n_written]
    larger.children[:, :n_written] = buffer.children[:, :n_written]
    larger.action[: len(buffer.action)] = buffer.action
    return larger


@compiled
def _map(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    mapped: int,
    largest_tree: int,
    buffer: _Buffer,
    split_start: NDArray[np.int64],
    leaf_start: NDArray[np.int64],
) -> int:
    """Map individuals from `mapped` on while the largest tree has room; return the first that had none."""
    for individual in range(mapped, len(codons)):
        root, leaf = split_start[individual], leaf_start[individual]
        if root + largest_tree > len(buffer.feature):
            return individual
        n_splits, n_leaves = _derive(codons[individual], n_readable, program, returns, buffer, root, leaf)
        split_start[individual + 1] = root + n_splits
        leaf_start[individual + 1] = leaf + n_leaves
    return len(codons)


@compiled
def _derive(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    buffer: _Buffer,
    root: int,
    first_leaf: int,
) -> tuple[int, int]:
    """Derive a tree, its splits from row `root` on and its leaves from `first_leaf` on; return their numbers.

    An invalid tree has none of either.
    """
    splits = leaves = read = position = at = depth = 0
    waiting = -1  # The innermost split that has no right child yet; it links to the next outer one.
    # Where the next node is a child; the root is one in the column that nobody reads.
    side, parent = 0, len(buffer.feature)
    row = root
    while True:
        symbol = at
        kind, argument = program.symbol_kind[symbol], program.symbol_argument[symbol]
        at += 1
        if kind in (CHOICE, RANGE):
            if read == n_readable:
                return 0, 0
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
            buffer.threshold[row] = constant / program.range_scale[argument]
        elif kind == END:
            depth -= 1
            at = returns[depth]
        elif kind == IF:
            row = root + splits
            buffer.children[side, parent] = splits
            buffer.children[1, row] = waiting
            side, parent, waiting = 0, row, splits
            splits += 1
        elif kind == FEATURE:
            buffer.feature[row] = argument
        elif kind == CONSTANT:
            buffer.threshold[row] = program.constants[argument]
        elif kind == ACTION:
            buffer.children[side, parent] = ~leaves
            buffer.action[first_leaf + leaves] = argument
            leaves += 1
            if waiting < 0:
                return splits, leaves
            side, parent = 1, root + waiting
            waiting = buffer.children[1, parent]
