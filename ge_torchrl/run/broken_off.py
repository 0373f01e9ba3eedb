"""What a run leaves that did not come to its end."""

from __future__ import annotations

import traceback
from contextlib import suppress

from ge_torchrl.artefacts.checkpoints import has_checkpoints
from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError, RunFaultError, UserError
from ge_torchrl.run.recording import write_untested
from ge_torchrl.search.conclusion import contenders_of, train_fitness_of
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Names


def save_trees(problem: Problem, names: Names, artefacts: Artefacts, state: SearchState) -> bool:
    """Save the best tree so far and the kept ones, and tell whether there are any.

    Args:
        problem: What is searched.
        names: Of its features and actions.
        artefacts: Takes the trees.
        state: A state of the search.

    Raises:
        ArtefactError: They cannot be written.
    """
    contenders = contenders_of(problem, state)
    if contenders:
        write_untested(problem.config, names, artefacts, max(contenders, key=train_fitness_of), state.archive)
    return bool(contenders)


def save_what_there_is(
    problem: Problem,
    names: Names,
    artefacts: Artefacts,
    state: SearchState | None,
    *,
    may_go_on: bool = True,
) -> str:
    """Save the best tree so far and the kept ones where that can be, and return what to say of them.

    Args:
        problem: What is searched.
        names: Of its features and actions.
        artefacts: Takes the trees.
        state: The last state; None before the first generation.
        may_go_on: Whether the run can come to another end where it goes on.
    """
    try:
        if state is None or not save_trees(problem, names, artefacts, state):
            return "no tree was there yet"
        saved = f"the best tree so far is in {artefacts}, untested"
    except ArtefactError:
        saved = f"the best tree of an earlier generation is in {artefacts}, untested"
    if may_go_on and artefacts.path is not None and has_checkpoints(artefacts.path):
        return f"{saved}; ge-torchrl resume {artefacts} goes on"
    return saved


def told_of_fault(fault: Exception, found: str, artefacts: Artefacts) -> Exception:
    """Return the error that says in one line what broke a run off.

    Args:
        fault: What did.
        found: What there is to say of its trees.
        artefacts: Takes the details where no user can mend it, or where the user's own code raised.
    """
    is_raised = isinstance(fault, EnvironmentFaultError) and fault.__cause__ is not None
    if isinstance(fault, UserError) and not is_raised:
        return type(fault)(" ".join(f"{fault}; {found}".splitlines()))
    details = _details(fault, artefacts)
    if isinstance(fault, UserError):
        return type(fault)(" ".join(f"{fault}; {found}{details}".splitlines()))
    text = " ".join(f"{type(fault).__name__}: {fault}".split())
    return RunFaultError(f"the run broke off ({text}); {found}{details}")


def _details(fault: Exception, artefacts: Artefacts) -> str:
    """Leave the whole traceback, and return what to say of that."""
    with suppress(ArtefactError):
        return artefacts.write_traceback("".join(traceback.format_exception(fault)))
    return ""
