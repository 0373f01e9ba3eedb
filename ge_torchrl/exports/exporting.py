"""The law over all formats: what is exported answers as its tree does, on every observation that is tried."""

from __future__ import annotations

import numpy as np

from ge_torchrl.errors import RunFaultError, UserError
from ge_torchrl.exports.code import answers_of
from ge_torchrl.exports.extras import MissingToolError
from ge_torchrl.exports.formats import FORMATS, Format
from ge_torchrl.exports.names import is_identifier
from ge_torchrl.exports.observations import N_OBSERVATIONS, observations_of
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller

DEFAULT_NAME = "controller"


def exported(controller: Controller, to: str, name: str = DEFAULT_NAME, *, verify: bool = True) -> bytes:
    """Return a controller in another format.

    Args:
        controller: The controller.
        to: One of `FORMATS`.
        name: What it is called there: a function, a function block, a graph.
        verify: Whether to try what was written on `N_OBSERVATIONS` observations.

    Returns:
        The content of the file; texts are in UTF-8.

    Raises:
        UserError: The format cannot say what the tree says, the name is none, or what runs the format is missing.
        RunFaultError: What was written answers otherwise than the tree.
    """
    form = FORMATS[to]
    if not is_identifier(name, form.reserved):
        raise UserError(
            f"--name must be letters, digits and single underscores, a letter first, and no word that {to} keeps "
            f"for itself; got {name}"
        )
    written = Written(controller, name, form.write(controller, name))
    if verify:
        _verify(written, form, to)
    return written.content


def _verify(written: Written, form: Format, to: str) -> None:
    """Refuse an export that answers some observation in another way than its tree."""
    controller = written.controller
    observed = observations_of(controller.tree, len(controller.names.features))
    expected = answers_of(controller, observed)
    try:
        (answered,) = form.answers([written], [observed])
    except MissingToolError:
        raise
    except Exception as error:
        # Whatever reads or runs the format has its own ways to refuse it.
        said = " ".join(str(error).split())
        raise RunFaultError(f"the exported {to} cannot be run, so nothing is written: {said}") from error
    differs = (answered != expected).reshape(N_OBSERVATIONS, -1).any(axis=1)
    if differs.any():
        first = int(np.argmax(differs))
        raise RunFaultError(
            f"the exported {to} answers {differs.sum():,} of {N_OBSERVATIONS:,} observations in another way than the "
            f"tree, so nothing is written; the first is {observed[first].tolist()}: {answered[first]}, and the tree "
            f"answers {expected[first]}"
        )
