"""A plain Python function, without imports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.exports.code import (
    Words,
    bounds_of,
    chain,
    clipped_constants,
    leaf_terms,
    split_terms,
    summary,
    used_features,
)
from ge_torchrl.exports.modules import loaded
from ge_torchrl.exports.names import identifiers, printable, printably_named
from ge_torchrl.exports.numbers import float64_text, sum_text
from ge_torchrl.exports.reserved import RESERVED_IN_PYTHON
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import split_text
from ge_torchrl.trees.tree import FloatArray

_WORDS = Words("if {}:", "elif {}:", "else:", "", "# {}")
_TAKEN = {"observation", "float", "min", "max"}


def write(controller: Controller, name: str) -> bytes:
    """Return a module with the function.

    Args:
        controller: The controller.
        name: The name of the function.
    """
    names = controller.names
    lines = [
        f'"""{docstring(summary(controller))}"""',
        "",
        f"FEATURES = {texts_literal(names.features)}",
        f"UNITS = {texts_literal(names.units)}",
        f"ACTIONS = {texts_literal(names.actions)}",
        "",
        "",
        f"def {name}(observation):",
    ]
    body = _choosing(controller, name) if controller.tree.has_actions else _valuing(controller, name)
    return "\n".join([*lines, *body, ""]).encode()


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what Python answers to [B, D] observations of each function."""
    found: list[NDArray[Any]] = []
    for one, rows in zip(written, observed, strict=True):
        function = getattr(loaded(one.content), one.name)
        dtype = np.int32 if one.controller.tree.has_actions else np.float32
        with np.errstate(over="ignore"):
            found.append(np.array([function(row) for row in rows.tolist()]).astype(dtype))
    return found


def _choosing(controller: Controller, name: str) -> list[str]:
    """Return the body where leaves hold actions."""
    tree, actions = controller.tree, controller.names.actions

    def answer(leaf: int) -> list[str]:
        action = int(tree.action[leaf])
        return [f"return {action}  # {printable(actions[action])}"]

    return [
        '    """Return the number of the action for one observation, whose numbers are float32."""',
        *_read(controller, name),
        *chain(tree, _WORDS, _Condition(controller, name), answer, 1),
    ]


def _valuing(controller: Controller, name: str) -> list[str]:
    """Return the body where leaves hold values."""
    tree = controller.tree
    taken = (*_TAKEN, name.lower(), *RESERVED_IN_PYTHON)
    features = _features(controller, name)
    columns = identifiers(controller.names.actions, "action", {*taken, *(each.lower() for each in features)})
    head = '    """Return the numbers of the action for one observation, whose numbers are float32."""'
    condition = _Condition(controller, name)
    if not len(tree.leaf_feature):
        constants = clipped_constants(controller)

        def row(leaf: int) -> list[str]:
            return [f"return [{', '.join(map(float64_text, constants[leaf]))}]"]

        return [head, *_read(controller, name), *chain(tree, _WORDS, condition, row, 1)]

    def assigned(leaf: int) -> list[str]:
        return [
            f"{column} = {sum_text(leaf_terms(tree, leaf, place, features), float(tree.value[leaf, place]))}"
            for place, column in enumerate(columns)
        ]

    return [
        head,
        *_read(controller, name),
        *chain(tree, _WORDS, condition, assigned, 1),
        *_clipped(controller, columns),
        f"    return [{', '.join(columns)}]",
    ]


def _clipped(controller: Controller, columns: Sequence[str]) -> list[str]:
    lines = []
    for column, low, high in zip(columns, *bounds_of(controller.names).tolist(), strict=True):
        text = column
        # In this order of arguments a NaN stays one.
        if low > -np.inf:
            text = f"max({text}, {float64_text(low)})"
        if high < np.inf:
            text = f"min({text}, {float64_text(high)})"
        if text != column:
            lines.append(f"    {column} = {text}")
    return lines


def _read(controller: Controller, name: str) -> list[str]:
    features = _features(controller, name)
    return [
        f"    {features[place]} = float(observation[{place}])" for place in used_features(controller.tree)
    ]


def _features(controller: Controller, name: str) -> tuple[str, ...]:
    return identifiers(controller.names.features, "feature", {*_TAKEN, name.lower(), *RESERVED_IN_PYTHON})


def texts_literal(texts: Sequence[str]) -> str:
    """Return texts as Python writes a tuple of them, in double quotes."""
    quoted = ", ".join(map(_quoted, texts))
    return f"({quoted},)" if len(texts) == 1 else f"({quoted})"


def docstring(text: str) -> str:
    """Return a text that ends no docstring."""
    return text.replace("\\", "\\\\").replace('"', "'")


class _Condition:
    """Writes the condition of a split."""

    def __init__(self, controller: Controller, name: str) -> None:
        self._shown = printably_named(controller)
        self._features = _features(controller, name)

    def __call__(self, split: int) -> tuple[str, str]:
        tree = self._shown.tree
        summed = sum_text(split_terms(tree, split, self._features))
        test = f"{summed} < {float64_text(tree.threshold[split])}"
        return test, split_text(tree, self._shown.names, split)


def _quoted(text: str) -> str:
    characters = (each if each == "'" else '\\"' if each == '"' else repr(each)[1:-1] for each in text)
    return f'"{"".join(characters)}"'
