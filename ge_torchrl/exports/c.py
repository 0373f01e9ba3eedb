"""A C99 function without allocation."""

from __future__ import annotations

import numpy as np

from ge_torchrl.exports.code import (
    Words,
    bounds_of,
    chain,
    clipped_constants,
    leaf_terms,
    listed,
    needs_float64,
    split_terms,
    summary,
    used_features,
)
from ge_torchrl.exports.names import identifiers, printably_named
from ge_torchrl.exports.numbers import float32_text, float64_text, sum_text
from ge_torchrl.exports.reserved import RESERVED_IN_C
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import split_text

_WORDS = Words("if ({}) {{", "}} else if ({}) {{", "} else {", "}", "/* {} */")
_TAKEN = frozenset({"observation", "action"})
_CHECKS = """\
#include <float.h>
#if FLT_MANT_DIG != 24 || DBL_MANT_DIG != 53
#error "This controller adds in IEEE 754 double: with avr-gcc, compile with -mdouble=64"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD == 2
#error "This controller rounds every sum to double: on 32-bit x86, compile with -msse2 -mfpmath=sse"
#endif
"""


def write(controller: Controller, name: str) -> bytes:
    """Return a source file with the function.

    Args:
        controller: The controller.
        name: The name of the function.
    """
    controller = printably_named(controller)
    tree, names = controller.tree, controller.names
    written = _Function(controller, name)
    head = [
        f"/* {_commented(summary(controller))}",
        " *",
        f" * {written.declaration};",
        " *",
        " * observation, float32 as the environment gives it:",
        *(f" * {_commented(line)}" for line in listed(names.features, names.units)),
        f" * {'the action that is returned' if tree.has_actions else 'action, which is written'}:",
        *(f" * {_commented(line)}" for line in listed(names.actions)),
        " */",
    ]
    checks = _CHECKS.splitlines() if needs_float64(tree) else []
    lines = [*head, *checks, f"{written.declaration}", "{", *written.body(), "}", ""]
    return "\n".join(lines).encode()


class _Function:
    """The parts of the function."""

    def __init__(self, controller: Controller, name: str) -> None:
        self._controller, self._name = controller, name
        self._tree, self._names = controller.tree, controller.names
        # Where nothing is summed, float alone is exact, and a small processor needs no more.
        self._is_double = needs_float64(self._tree)
        self._is_linear = len(self._tree.leaf_feature) > 0
        taken = {*RESERVED_IN_C, *_TAKEN, name.lower()}
        self._features = identifiers(self._names.features, "feature", taken)
        self._columns = identifiers(
            self._names.actions, "action", {*taken, *(each.lower() for each in self._features)}
        )

    @property
    def declaration(self) -> str:
        observation = f"const float observation[{len(self._names.features)}]"
        if self._tree.has_actions:
            return f"int {self._name}({observation})"
        return f"void {self._name}({observation}, float action[{len(self._names.actions)}])"

    def body(self) -> list[str]:
        kind = "double" if self._is_double else "float"
        used = used_features(self._tree)
        read = [f"    const {kind} {self._features[place]} = observation[{place}];" for place in used]
        # A lone leaf reads nothing.
        if not used:
            read.append("    (void)observation;")
        answered = chain(self._tree, _WORDS, self._condition, self._answer, 1)
        if self._tree.has_actions:
            return ["    int action;", *read, *answered, "    return action;"]
        if not self._is_linear:
            return [*read, *answered]
        return [*(f"    double {column};" for column in self._columns), *read, *answered, *self._clipped()]

    def _condition(self, split: int) -> tuple[str, str]:
        number = float(self._tree.threshold[split])
        threshold = float64_text(number) if self._is_double else f"{float32_text(number)}f"
        summed = sum_text(split_terms(self._tree, split, self._features))
        return f"{summed} < {threshold}", _commented(split_text(self._tree, self._names, split))

    def _answer(self, leaf: int) -> list[str]:
        tree = self._tree
        if tree.has_actions:
            action = int(tree.action[leaf])
            return [f"action = {action};  /* {_commented(self._names.actions[action])} */"]
        if not self._is_linear:
            return [
                f"action[{place}] = {float32_text(value)}f;  /* {_commented(name)} */"
                for place, (value, name) in enumerate(
                    zip(clipped_constants(self._controller)[leaf], self._names.actions, strict=True)
                )
            ]
        return [
            f"{column} = {sum_text(leaf_terms(tree, leaf, place, self._features), float(tree.value[leaf, place]))};"
            for place, column in enumerate(self._columns)
        ]

    def _clipped(self) -> list[str]:
        lines = []
        bounds = zip(self._columns, *bounds_of(self._names).tolist(), strict=True)
        for place, (column, low, high) in enumerate(bounds):
            for sign, bound in (("<", low), (">", high)):
                if np.isfinite(bound):
                    limit = float64_text(bound)
                    lines += [f"    if ({column} {sign} {limit}) {{", f"        {column} = {limit};", "    }"]
            lines.append(f"    action[{place}] = (float){column};")
        return lines


def _commented(text: str) -> str:
    """Return a text that ends no comment and begins none."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("??/", "? ? /")
