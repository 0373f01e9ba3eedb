"""What a run leaves that did not come to its end."""

from __future__ import annotations

import traceback

from ge_torchrl.artefacts.memory import Artefacts
from ge_torchrl.errors import RunFaultError, UserError
from ge_torchrl.run.recording import write_untested
from ge_torchrl.search.conclusion import contenders_of, train_fitness_of
from ge_torchrl.search.problem import Problem
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Names


def save_what_there_is(
    problem: Problem, names: Names, artefacts: Artefacts, state: SearchState | None
) -> str:
    """Save the best tree so far and the kept ones, and return what to say of them.

    Args:
        problem: What is searched.
        names: Of its features and actions.
        artefacts: Takes the trees.
        state: The last state; None before the first generation.
    """
    if state is None or not (contenders := contenders_of(problem, state)):
        return "no tree was there yet"
    best = max(contenders, key=train_fitness_of)
    write_untested(problem.config, names, artefacts, best, state.archive)
    return f"the best tree so far is in {artefacts}, untested"


def told_of_fault(fault: Exception, found: str, artefacts: Artefacts) -> Exception:
    """Return the error that says in one line what broke a run off.

    Args:
        fault: What did.
        found: What there is to say of its trees.
        artefacts: Takes the details where no user can mend it.
    """
    if isinstance(fault, UserError):
        return type(fault)(" ".join(f"{fault}; {found}".splitlines()))
    details = artefacts.write_traceback("".join(traceback.format_exception(fault)))
    text = " ".join(f"{type(fault).__name__}: {fault}".split())
    return RunFaultError(f"the run broke off ({text}); {found}{details}")
