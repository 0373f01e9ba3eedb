"""A run as a call."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.memory import Artefacts, RunMemory
from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.checks import refuse
from ge_torchrl.config import Config
from ge_torchrl.config.composing import compose
from ge_torchrl.errors import ConfigError, UserError
from ge_torchrl.library.controller import Controller
from ge_torchrl.library.generation import Callback, Generation, stops
from ge_torchrl.library.keywords import keywords_told
from ge_torchrl.library.result import Result, controllers_of
from ge_torchrl.library.showing import console_for
from ge_torchrl.run.episodes import write_page_of_run
from ge_torchrl.run.experiment import carry_out
from ge_torchrl.search.state import SearchState
from ge_torchrl.trees.controller import Names


@keywords_told
def evolve(
    environment: str | None = None,
    *,
    seed: int = 0,
    refiner: str | None = None,
    polish: str | None = None,
    archive: str | None = None,
    grammar: str | None = None,
    experiment: str | None = None,
    settings: Mapping[str, Any] | None = None,
    callback: Callback | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Result:
    """Look for small decision trees that control an environment, as `python -m ge_torchrl` does.

    The same settings and seed give the same trees as on the command line. Ctrl-C, or interrupting a notebook's kernel,
    returns what was found so far, tested; a second time it raises `KeyboardInterrupt`.

    >>> import ge_torchrl as ge
    >>> result = ge.evolve("CartPole-v1", seed=1, refiner="none", settings={"ge.generations": 3})
    >>> sorted(result.controllers) == list(result.controllers)
    True
    >>> ge.evolve("CartPole-v1", settings={"ge.generations": 0})
    Traceback (most recent call last):
    ge_torchrl.errors.ConfigError: ge.generations must be an integer of at least 1, because ...; got 0

    Args:
        environment: A Gymnasium id, which takes its file of conf/env where there is one; or the name of such a file,
            such as "cartpole"; or the path of a file of one's own, as `init` writes it; or dynamics of one's own, such
            as "plant.py:Cart". None takes the environment of the experiment, or the default.
        seed: All randomness follows from it.
        refiner: What refines trees: "ppo" by default, "cmaes", "none" or "thesis".
        polish: "none" does without the polish.
        archive: "none" keeps the champion alone.
        grammar: Another grammar than the environment's, such as "thesis/cartpole".
        experiment: Settings that are pinned, such as "thesis/cartpole".
        settings: Any others by their keys, as `docs/settings.md` lists them: `{"ge.generations": 50}`.
        callback: Is told of each generation; where it returns True, the search ends there.
        out: Folder for the files of the run, with none in it yet; None leaves no files.
        progress: Whether a terminal or a notebook shows how far the run is. Anything else is shown nothing.

    Raises:
        UserError: A value is not allowed, or the environment failed.
        RunFaultError: The run broke off by a fault of the program.

    What breaks a run off carries what was found by then, untested, as `error.champion` and `error.controllers`; what
    `callback` raises and a second `KeyboardInterrupt` carry it too.
    """
    chosen = {
        "refiner": refiner,
        "polish": polish,
        "archive": archive,
        "grammar": grammar,
        "experiment": experiment,
    }
    config = compose(environment, chosen, {"seed": seed, **(settings or {})})
    if out is None and config.logger != "none":
        raise ConfigError(
            f"logger={config.logger} writes beside the files of a run, so expected out, a folder; got none"
        )
    watching = _Watching(callback)

    kept: list[Artefacts] = []

    def keep(decided: Config) -> Artefacts:
        kept.append(RunMemory(decided) if out is None else RunFolder.create(Path(out), decided, key="out"))
        return kept[0]

    try:
        console = console_for(progress=progress)
        finished = carry_out(config, keep, console, watching)
    except BaseException as error:
        fault = watching.fault if isinstance(error, Exception) and watching.fault is not None else error
        for artefacts in kept:
            _give(fault, artefacts)
        if fault is not error:
            raise fault from None
        raise
    if out is not None:
        write_page_of_run(Path(out), console)
    return Result.of(finished.artefacts)


def _give(error: BaseException, artefacts: Artefacts) -> None:
    """Let an error carry what a run had found."""
    found: dict[str, Any] = {"champion": None, "controllers": {}}
    with suppress(UserError):
        found["champion"] = Controller.of(artefacts.read_best_tree())
        found["controllers"] = controllers_of(artefacts)
    with suppress(AttributeError):  # One of somebody else's may take no attributes.
        for name, value in found.items():
            setattr(error, name, value)


class _Watching:
    """Tells a callback of generations; what it raises is its own, and leaves the run as it came."""

    def __init__(self, callback: Callback | None) -> None:
        if callback is not None and not callable(callback):
            refuse("callback", callback, "a function of a generation, or None")
        self._callback = callback
        self.fault: Exception | None = None

    def __call__(self, record: GenerationRecord, state: SearchState, names: Names) -> bool:
        if self._callback is None:
            return False
        try:
            return stops(self._callback(Generation.of(record, names, state)))
        except Exception as fault:
            self.fault = fault
            raise
