"""A function block in Structured Text of IEC 61131-3, for a PLC."""

from __future__ import annotations

import numpy as np

from ge_torchrl.exports.code import (
    Words,
    bounds_of,
    chain,
    clipped_constants,
    is_one_feature,
    leaf_terms,
    split_terms,
    summary,
    used_features,
)
from ge_torchrl.exports.names import identifiers, printably_named
from ge_torchrl.exports.numbers import float32_text, float64_text, sum_text
from ge_torchrl.exports.reserved import RESERVED_IN_ST
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.text import split_text

_WORDS = Words("IF {} THEN", "ELSIF {} THEN", "ELSE", "END_IF;", "(* {} *)")
DECISION = "decision"
_LREAL = "LREAL#"


def write(controller: Controller, name: str) -> bytes:
    """Return the function block.

    Args:
        controller: The controller.
        name: The name of the block.
    """
    controller = printably_named(controller)
    block = _Block(controller, name)
    tree = controller.tree
    body = chain(tree, _WORDS, block.condition, block.answer, 0)
    lines = [
        f"FUNCTION_BLOCK {name}",
        f"(* {_commented(summary(controller))} *)",
        *block.inputs(),
        *block.outputs(),
        *block.temporary(),
        "",
        *body,
        *block.clipped(),
        "",
        "END_FUNCTION_BLOCK",
        "",
    ]
    return "\n".join(lines).encode()


class _Block:
    """The parts of the block."""

    def __init__(self, controller: Controller, name: str) -> None:
        self._controller, self._tree, self._names = controller, controller.tree, controller.names
        taken = {*RESERVED_IN_ST, DECISION, name.lower()}
        self._inputs = identifiers(self._names.features, "feature", taken)
        self._outputs = identifiers(self._names.actions, "action", {*taken, *map(str.lower, self._inputs)})
        taken |= {*map(str.lower, self._inputs), *map(str.lower, self._outputs)}
        is_linear = len(self._tree.leaf_feature) > 0
        sums = [f"{output}_sum" for output in self._outputs if is_linear]
        self._sums = identifiers(sums, "action", taken)
        self._wide = [f"REAL_TO_LREAL({feature})" for feature in self._inputs]

    def inputs(self) -> list[str]:
        used = used_features(self._tree)
        if not used:
            return []
        declared = []
        for place in used:
            unit = f" [{self._names.units[place]}]" if self._names.units[place] else ""
            told = _commented(f"observation {place}: {self._names.features[place]}{unit}")
            declared.append(f"    {self._inputs[place]} : REAL; (* {told} *)")
        return ["VAR_INPUT", *declared, "END_VAR"]

    def outputs(self) -> list[str]:
        if self._tree.has_actions:
            meanings = [f"{place}: {name}" for place, name in enumerate(self._names.actions)]
            declared = [f"    {DECISION} : INT; (* {_commented(', '.join(meanings))} *)"]
        else:
            declared = [
                f"    {output} : REAL; (* {_commented(name)} *)"
                for output, name in zip(self._outputs, self._names.actions, strict=True)
            ]
        return ["VAR_OUTPUT", *declared, "END_VAR"]

    def temporary(self) -> list[str]:
        declared = [f"    {total} : LREAL;" for total in self._sums]
        return ["VAR_TEMP", *declared, "END_VAR"] if declared else []

    def condition(self, split: int) -> tuple[str, str]:
        told = _commented(split_text(self._tree, self._names, split))
        threshold = self._tree.threshold[split]
        if is_one_feature(self._tree, split):
            feature = self._inputs[self._tree.feature[self._tree.term_start[split]]]
            return f"{feature} < {_real(threshold)}", told
        summed = sum_text(split_terms(self._tree, split, self._wide), typed=_LREAL)
        return f"{summed} < {_lreal(threshold)}", told

    def answer(self, leaf: int) -> list[str]:
        if self._tree.has_actions:
            action = int(self._tree.action[leaf])
            return [f"{DECISION} := {action}; (* {_commented(self._names.actions[action])} *)"]
        return [self._assigned(leaf, place) for place in range(len(self._outputs))]

    def _assigned(self, leaf: int, place: int) -> str:
        if not self._sums:
            return f"{self._outputs[place]} := {_real(clipped_constants(self._controller)[leaf, place])};"
        terms = leaf_terms(self._tree, leaf, place, self._wide)
        text = sum_text(terms, float(self._tree.value[leaf, place]), typed=_LREAL)
        return f"{self._sums[place]} := {text};"

    def clipped(self) -> list[str]:
        """Return what follows the choice where leaves are linear: sums become outputs, within the bounds."""
        lines = []
        bounds = zip(self._sums, *bounds_of(self._names).tolist(), strict=True) if self._sums else ()
        for place, (total, low, high) in enumerate(bounds):
            for sign, bound in (("<", low), (">", high)):
                if np.isfinite(bound):
                    limit = _lreal(bound)
                    lines += [f"IF {total} {sign} {limit} THEN", f"    {total} := {limit};", "END_IF;"]
            lines.append(f"{self._outputs[place]} := LREAL_TO_REAL({total});")
        return lines


def _real(number: float) -> str:
    return f"REAL#{float32_text(number)}"


def _lreal(number: float) -> str:
    return _LREAL + float64_text(number)


def _commented(text: str) -> str:
    """Return a text that ends no comment and begins none."""
    return text.replace("*)", "* )").replace("(*", "( *")
