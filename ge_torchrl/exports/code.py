"""What programs in different languages share: the chain of conditions, and which numbers need float64."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.exports.names import printable
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.tree import DecisionTree, FloatArray

_INDENT = "    "
_SHORT = 90


class Words(NamedTuple):
    """How a language writes a choice.

    Attributes:
        first: The first condition, with `{}` for it.
        other: Another one, in the same chain.
        otherwise: Where none of them holds.
        end: The end of the chain; empty where there is none.
        comment: What a person is told, with `{}` for it.
    """

    first: str
    other: str
    otherwise: str
    end: str
    comment: str


def chain(
    tree: DecisionTree,
    words: Words,
    condition: Callable[[int], tuple[str, str]],
    answer: Callable[[int], Sequence[str]],
    depth: int,
) -> list[str]:
    """Return a tree as nested choices, where splits on the way right stand in one chain.

    Args:
        tree: The tree.
        words: How the language writes a choice.
        condition: Returns the condition of a split, and the same for a person.
        answer: Writes the lines of a leaf.
        depth: Of the first line.

    Returns:
        Lines, indented.
    """
    lines: list[str] = []

    def write(depth: int, text: str) -> None:
        lines.append(_INDENT * depth + text)

    # What is open: a node that begins a chain (True) or goes on with one (False), or a line.
    open_items: list[tuple[int, int | str, bool]] = [(depth, 0 if tree.num_decision_nodes else ~0, True)]
    while open_items:
        depth, node, begins = open_items.pop()
        if isinstance(node, str):
            write(depth, node)
        elif node >= 0:
            test, told = condition(node)
            test, told = (words.first if begins else words.other).format(test), words.comment.format(told)
            # What is too long for one line stands on two.
            is_short = len(test) + len(told) <= _SHORT
            write(depth, f"{test}  {told}" if is_short else test)
            if not is_short:
                write(depth + 1, told)
            open_items.append((depth, int(tree.children_right[node]), False))
            open_items.append((depth + 1, int(tree.children_left[node]), True))
        else:
            if not begins:
                write(depth, words.otherwise)
            for line in answer(~node):
                write(depth if begins else depth + 1, line)
            if not begins and words.end:
                write(depth, words.end)
    return lines


def needs_float64(tree: DecisionTree) -> bool:
    """Tell whether a tree sums anything: then its answers hang on sums in float64."""
    return not tree.is_axis_aligned or len(tree.leaf_feature) > 0


def used_features(tree: DecisionTree) -> list[int]:
    """Return the features that splits or leaves read, from the first to the last."""
    in_leaves = tree.leaf_feature[(tree.leaf_weight != 0).any(axis=1)]
    return sorted({*tree.feature.tolist(), *in_leaves.tolist()})


def split_terms(tree: DecisionTree, split: int, names: Sequence[str]) -> list[tuple[float, str]]:
    """Return the weights of a split, and the names of what they weigh."""
    terms = range(tree.term_start[split], tree.term_start[split + 1])
    return [(float(tree.weight[term]), names[tree.feature[term]]) for term in terms]


def leaf_terms(tree: DecisionTree, leaf: int, column: int, names: Sequence[str]) -> list[tuple[float, str]]:
    """Return the weights of one value of a leaf that are not 0, and the names of what they weigh."""
    terms = range(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    weights = [(float(tree.leaf_weight[term, column]), names[tree.leaf_feature[term]]) for term in terms]
    return [(weight, name) for weight, name in weights if weight != 0]


def is_one_feature(tree: DecisionTree, split: int) -> bool:
    """Tell whether a split compares one feature, of weight 1."""
    start = tree.term_start[split]
    return bool(tree.term_start[split + 1] - start == 1 and tree.weight[start] == 1)


def bounds_of(names: Names) -> FloatArray:
    """Return [2, A] the least and the greatest value of each entry of an action."""
    return np.array(names.action_bounds or [(-np.inf, np.inf)] * len(names.actions), np.float32).T


def clipped_constants(controller: Controller) -> FloatArray:
    """Return [L, A] the constants of leaves without linear terms, within the bounds of the actions."""
    low, high = bounds_of(controller.names)
    constants: FloatArray = np.clip(controller.tree.value, low, high)
    return constants


def answers_of(controller: Controller, observed: FloatArray) -> NDArray[np.int32] | FloatArray:
    """Return what a controller answers to observations: what every export has to answer.

    Args:
        controller: The controller.
        observed: [B, D] float32.

    Returns:
        [B] actions, or [B, A] values within the bounds of the actions.
    """
    answers = controller.tree.decide(observed)
    return answers if controller.tree.has_actions else np.clip(answers, *bounds_of(controller.names))


def summary(controller: Controller) -> str:
    """Return in one line what is exported."""
    tree = controller.tree
    splits = "1 split" if tree.num_decision_nodes == 1 else f"{tree.num_decision_nodes} splits"
    environment = printable(controller.names.environment)
    return f"A controller of {environment}: a decision tree with {splits}, exported by ge_torchrl."


def listed(names: Sequence[str], units: Sequence[str] = ()) -> Iterator[str]:
    """Yield a line for each name, with its number in front and its unit behind."""
    for place, name in enumerate(names):
        unit = f" [{units[place]}]" if units and units[place] else ""
        yield f"{place:>3}  {printable(name + unit)}"
