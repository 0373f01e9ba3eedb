"""ge_torchrl: interpretable decision-tree policies by grammatical evolution and PPO.

    >>> import ge_torchrl as ge
    >>> result = ge.evolve("CartPole-v1", seed=1)  # doctest: +SKIP
    >>> result.controllers[2]([0.0, 0.1, 0.02, -0.3])  # doctest: +SKIP
    1

`docs/library.md` tells the rest. What a name needs is loaded when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ge_torchrl.version import __version__

if TYPE_CHECKING:
    from ge_torchrl.errors import UserError as UserError
    from ge_torchrl.library.controller import Controller as Controller
    from ge_torchrl.library.controller import load as load
    from ge_torchrl.library.evaluating import Evaluation as Evaluation
    from ge_torchrl.library.evaluating import evaluate as evaluate
    from ge_torchrl.library.evolving import evolve as evolve
    from ge_torchrl.library.generation import Generation as Generation
    from ge_torchrl.library.refining import Refinement as Refinement
    from ge_torchrl.library.refining import refine as refine
    from ge_torchrl.library.result import Result as Result
    from ge_torchrl.library.result import load_run as load_run

_HOMES = {
    "Controller": "library.controller",
    "Evaluation": "library.evaluating",
    "Generation": "library.generation",
    "Refinement": "library.refining",
    "Result": "library.result",
    "UserError": "errors",
    "evaluate": "library.evaluating",
    "evolve": "library.evolving",
    "load": "library.controller",
    "load_run": "library.result",
    "refine": "library.refining",
}
__all__ = ["__version__", *_HOMES]  # noqa: PLE0604 (texts all)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
