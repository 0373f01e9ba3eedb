"""The formats that a controller can be exported to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from numpy.typing import NDArray

from ge_torchrl.exports import (
    c,
    compiling,
    dot,
    latex,
    mermaid,
    onnx_model,
    python,
    sklearn_tree,
    st,
    st_reader,
    svg,
    text,
    tree_file,
)
from ge_torchrl.exports.reserved import (
    RESERVED_IN_C,
    RESERVED_IN_PYTHON,
    RESERVED_IN_SCIKIT_LEARN,
    RESERVED_IN_ST,
)
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import FloatArray


class Format(NamedTuple):
    """How controllers are written, and how what was written is run.

    Attributes:
        write: Returns the file of a controller under a name.
        answers: Returns what written controllers answer to observations, without asking the trees.
        is_text: Whether a terminal can show it.
        reserved: Names that a controller cannot have, in lower case.
    """

    write: Callable[[Controller, str], bytes]
    answers: Callable[[Sequence[Written], Sequence[FloatArray]], list[NDArray[Any]]]
    is_text: bool = True
    reserved: Collection[str] = frozenset()


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        "python": Format(python.write, python.answers, reserved=RESERVED_IN_PYTHON),
        "c": Format(c.write, compiling.answers, reserved=RESERVED_IN_C),
        "onnx": Format(onnx_model.write, onnx_model.answers, is_text=False),
        "sklearn": Format(sklearn_tree.write, sklearn_tree.answers, reserved=RESERVED_IN_SCIKIT_LEARN),
        "json": Format(tree_file.write, tree_file.answers),
        "dot": Format(dot.write, dot.answers),
        "mermaid": Format(mermaid.write, mermaid.answers),
        "svg": Format(svg.write, svg.answers),
        "text": Format(text.write, text.answers),
        "latex": Format(latex.write, latex.answers),
        "st": Format(st.write, st_reader.answers, reserved=RESERVED_IN_ST),
    }
)
