"""The mapping: codons to decision trees, a whole population in one compiled call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.ge.codons import Codons
from ge_torchrl.ge.rule_tables import ACTION, CHOICE, CONSTANT, END, FEATURE, IF, RANGE, Program, RuleTables
from ge_torchrl.trees.forest import Forest

_LIKELY_NODES = (
    32  # Room for that many nodes for each individual to begin with; the buffer grows where it must.
)


@dataclass(frozen=True, eq=False)
class Mapping:
    """The trees of a population, and where each came from in its genotype.

    Node `j` of a tree owns the codons that were read from `first_codon[j]` until the next node's (until
    `codons_read` for the last): those of the choices that led to it and of its condition. Reading positions
    count on where reading wraps around; position `i` is codon `i % K`.

    Attributes:
        forest: The `P` trees, nodes depth first, left before right; an invalid individual has none.
        codons_read: [P] int64, how many codons were read; all that there are, wraps included, if invalid.
        first_codon: [M] int32, the reading position where each node's codons begin.
        valid: [P] bool, whether the derivation ended before the codons did.
    """

    forest: Forest
    codons_read: NDArray[np.int64]
    first_codon: NDArray[np.int32]
    valid: NDArray[np.bool_]


def map_population(codons: Codons, tables: RuleTables, wraps: int = 0) -> Mapping:
    """Derive the tree of every genotype.

    A derivation goes depth first, left to right. Where there are `n` choices, it takes number `codon % n`.

    Args:
        codons: [P, K] int32.
        tables: The compiled grammar.
        wraps: How many times reading begins anew at the first codon when a genotype is exhausted.

    Returns:
        The mapping. A derivation that is unfinished after the last wrap is invalid, which is no error.

    Source:
        M. O'Neill and C. Ryan, "Grammatical Evolution", IEEE Transactions on Evolutionary Computation 5(4),
        2001.
    """
    # Unsigned codons let the processor divide by the cheaper 32-bit instruction.
    genotypes = np.ascontiguousarray(codons, np.int32).view(np.uint32)
    n_individuals, genotype_length = genotypes.shape
    n_readable = genotype_length * (wraps + 1)
    largest_tree = tables.nodes_at_start + n_readable * tables.nodes_per_choice
    nodes = _room_for(n_individuals * _LIKELY_NODES + largest_tree)
    returns = np.empty(n_readable, np.int32)
    offsets = np.zeros(n_individuals + 1, np.int64)
    codons_read = np.empty(n_individuals, np.int64)
    mapped = 0
    while mapped < n_individuals:
        mapped = _map(
            genotypes, n_readable, tables.program, returns, mapped, largest_tree, nodes, offsets, codons_read
        )
        if mapped < n_individuals:
            nodes = _enlarged(nodes, offsets[mapped])
    written = slice(offsets[-1])
    forest = Forest(
        offsets=offsets,
        feature=nodes.feature[written].copy(),
        threshold=nodes.threshold[written].copy(),
        children_left=nodes.children_left[written].copy(),
        children_right=nodes.children_right[written].copy(),
        action=nodes.action[written].copy(),
    )
    return Mapping(forest, codons_read, nodes.first_codon[written].copy(), valid=forest.sizes > 0)


class _Nodes(NamedTuple):
    """Columns of nodes that are being written, in one buffer for the whole population."""

    feature: NDArray[np.int32]
    threshold: NDArray[np.float32]
    children_left: NDArray[np.int32]
    children_right: NDArray[np.int32]
    action: NDArray[np.int32]
    first_codon: NDArray[np.int32]


def _room_for(n_nodes: int) -> _Nodes:
    return _Nodes(
        feature=np.empty(n_nodes, np.int32),
        threshold=np.empty(n_nodes, np.float32),
        children_left=np.empty(n_nodes, np.int32),
        children_right=np.empty(n_nodes, np.int32),
        action=np.empty(n_nodes, np.int32),
        first_codon=np.empty(n_nodes, np.int32),
    )


def _enlarged(nodes: _Nodes, n_written: int) -> _Nodes:
    larger = _room_for(2 * len(nodes.feature))
    for new, old in zip(larger, nodes, strict=True):
        new[:n_written] = old[:n_written]
    return larger


@compiled
def _map(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    mapped: int,
    largest_tree: int,
    nodes: _Nodes,
    offsets: NDArray[np.int64],
    codons_read: NDArray[np.int64],
) -> int:
    """Map individuals from `mapped` on while the largest tree has room; return the first that had none."""
    for individual in range(mapped, len(codons)):
        root = offsets[individual]
        if root + largest_tree > len(nodes.feature):
            return individual
        end, read = _derive(codons[individual], n_readable, program, returns, nodes, root)
        offsets[individual + 1] = end
        codons_read[individual] = read
    return len(codons)


@compiled
def _derive(
    codons: NDArray[np.uint32],
    n_readable: int,
    program: Program,
    returns: NDArray[np.int32],
    nodes: _Nodes,
    root: int,
) -> tuple[int, int]:
    """Derive a tree into the rows from `root` on; return its end (`root` if invalid) and codons read."""
    row, at, depth, position = root, 0, 0, 0
    read = begun = 0
    waiting = -1  # The innermost decision node that has no right child yet; it links to the next outer one.
    while True:
        symbol = at
        kind, argument = program.symbol_kind[symbol], program.symbol_argument[symbol]
        at += 1
        if kind in (CHOICE, RANGE):
            if read == n_readable:
                return root, read
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
            nodes.threshold[row] = constant / program.range_scale[argument]
        elif kind == END:
            depth -= 1
            at = returns[depth]
        elif kind == IF:
            _write(nodes, row, begun, -1, row - root + 1, waiting)
            waiting = row - root
        elif kind == FEATURE:
            nodes.feature[row] = argument
        elif kind == CONSTANT:
            nodes.threshold[row] = program.constants[argument]
        elif kind == ACTION:
            _write(nodes, row, begun, argument, -1, -1)
            if waiting < 0:
                return row + 1, read
            parent = root + waiting
            waiting = nodes.children_right[parent]
            nodes.children_right[parent] = row + 1 - root
        if kind in (RANGE, CONSTANT, ACTION):
            row += 1
            begun = read


@compiled
def _write(nodes: _Nodes, row: int, first_codon: int, action: int, left: int, right: int) -> None:
    """Write a node, as yet without a feature and a threshold."""
    nodes.first_codon[row] = first_codon
    nodes.action[row] = action
    nodes.children_left[row] = left
    nodes.children_right[row] = right
    nodes.feature[row] = -1
    nodes.threshold[row] = 0
