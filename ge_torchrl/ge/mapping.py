"""The mapping: codons to decision trees, a whole population in one compiled call."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.ge.buffers import Buffer, Sums, enlarged, forest_of_buffer, room_for
from ge_torchrl.ge.codons import Codons
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
    Room,
    RuleTables,
)
from ge_torchrl.trees.forest import Forest


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
    room = tables.largest_tree(n_readable)
    buffer, sums = room_for(n_individuals, room, tables)
    returns = np.empty(n_readable, np.int32)
    starts = np.zeros((4, n_individuals + 1), np.int64)
    mapped = 0
    while mapped < n_individuals:
        mapped = _map(genotypes, n_readable, tables.program, returns, mapped, room, buffer, sums, starts)
        if mapped < n_individuals:
            buffer, sums = enlarged(buffer, sums)
    return forest_of_buffer(buffer, sums, starts)


@compiled
def _map(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    mapped: int,
    room: Room,
    buffer: Buffer,
    sums: Sums | None,
    starts: NDArray[np.int64],
) -> int:
    """Map individuals from `mapped` on while the largest tree has room; return the first that had none.

    `starts` [4, P + 1] says where the splits, leaves, terms and leaves' terms of each begin.
    """
    for individual in range(mapped, len(codons)):
        split, leaf, term, leaf_term = starts[:, individual]
        has_room = split + room.splits < len(buffer.threshold) and term + room.terms <= len(buffer.feature)
        if sums is not None:
            has_room = has_room and leaf_term + room.terms <= len(sums.leaf_feature)
        if not has_room:
            return individual
        end = _derive(
            codons[individual], n_readable, program, returns, buffer, sums, split, leaf, term, leaf_term
        )
        starts[0, individual + 1], starts[1, individual + 1] = end[0], end[1]
        starts[2, individual + 1], starts[3, individual + 1] = end[2], end[3]
    return len(codons)


@compiled
def _derive(  # noqa: C901, PLR0912, PLR0915 (one loop over the kinds of symbols: all of them share its numbers)
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    buffer: Buffer,
    sums: Sums | None,
    root: int,
    first_leaf: int,
    first_term: int,
    first_leaf_term: int,
) -> tuple[int, int, int, int]:
    """Derive a tree and write its splits, leaves, terms and leaves' terms from these rows on; return where they end.

    A derivation that does not end leaves nothing. Where there are no `sums`, every branch that asks for them is left
    out when this is compiled, so that grammars without them are mapped as quickly as if there were none.
    """
    read = position = at = depth = entry = 0
    split, leaf, term, leaf_term = root, first_leaf, first_term, first_leaf_term
    nowhere = len(buffer.threshold) - 1
    waiting = -1  # The innermost split that has no right child yet; it links to the next outer one.
    # Where the next node is a child; the root is one in the column that nobody reads.
    side, parent = 0, nowhere
    row = nowhere  # The split whose condition is said; none within a leaf.
    number = np.float32(1.0)
    while True:
        symbol = at
        kind, argument = program.symbol_kind[symbol], program.symbol_argument[symbol]
        at += 1
        is_over = False
        if kind in (CHOICE, RANGE):
            if read == n_readable:
                return root, first_leaf, first_term, first_leaf_term
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
            number = np.float32(constant / program.range_scale[argument])
        elif kind == END:
            depth -= 1
            at = returns[depth]
        elif kind == IF:
            # A tree begins, so the condition in front of it is over; its last number is the threshold.
            buffer.threshold[row] = number
            row = split
            if sums is not None:
                sums.term_start[row] = term
            buffer.children[side, parent] = split - root
            buffer.children[1, row] = waiting
            side, parent, waiting = 0, row, split - root
            split += 1
        elif kind == FEATURE:
            if sums is not None and row == nowhere:
                leaf_term = _add_to_leaf(sums, leaf, leaf_term, argument, number, entry)
            else:
                buffer.feature[term] = argument
                if sums is not None:
                    sums.weight[term] = number
                term += 1
        elif kind == ACTION:
            buffer.threshold[row] = number
            row = nowhere
            buffer.action[leaf] = argument
            is_over = True
        elif kind == CONSTANT:
            number = program.constants[argument]
        elif sums is not None:
            if kind == ONE:
                number = np.float32(1.0)
            elif kind == ANSWER:
                buffer.threshold[row] = number
                row = nowhere
                sums.leaf_term_start[leaf] = leaf_term
                sums.value[leaf] = 0.0
                entry = 0
            elif kind == VALUE:
                sums.value[leaf, entry] = number
            elif kind == NEXT:
                entry += 1
                is_over = entry == sums.value.shape[1]
        if is_over:
            buffer.children[side, parent] = ~(leaf - first_leaf)
            leaf += 1
            if waiting < 0:
                return split, leaf, term, leaf_term
            side, parent = 1, root + waiting
            waiting = buffer.children[1, parent]


@compiled
def _add_to_leaf(
    sums: Sums,
    leaf: int,
    end: int,
    feature: int,
    weight: np.float32,
    entry: int,
) -> int:
    """Add a term to an entry's sum in the last leaf, whose terms reach to `end`; return their new end.

    The terms of a lone entry keep their order. Several entries share terms: these are ordered by feature, each weight
    stands in the first term of its feature that has none for its entry, and weights of zero are left out.
    """
    at = end
    if sums.leaf_weight.shape[1] > 1:
        if weight == 0.0:
            return end
        for q in range(sums.leaf_term_start[leaf], end):
            if sums.leaf_feature[q] == feature and sums.leaf_weight[q, entry] == 0.0:
                sums.leaf_weight[q, entry] = weight
                return end
            if sums.rank[sums.leaf_feature[q]] > sums.rank[feature]:
                at = q
                break
        for q in range(end, at, -1):
            sums.leaf_feature[q] = sums.leaf_feature[q - 1]
            sums.leaf_weight[q] = sums.leaf_weight[q - 1]
    sums.leaf_feature[at] = feature
    sums.leaf_weight[at] = 0.0
    sums.leaf_weight[at, entry] = weight
    return end + 1
