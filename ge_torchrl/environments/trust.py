"""Whose code an environment is: a tree or a run of somebody else's may name a module, which runs when it is imported.

Gymnasium's own environments, and those of its wrappers that only change what is observed, done or paid, run for
everybody; so does what this package has, and what is loaded already runs no more. Wrappers that write files or open
windows, other modules, and plants, run where the user says so, or has run them before from the same place: runs
remember them in a file of the user's.
"""

from __future__ import annotations

import contextlib
import importlib.machinery
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from ge_torchrl.environments.plants.file import found
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError

_OURS = ("gymnasium", "ge_torchrl")
_GYMNASIUM = "gymnasium.wrappers"
# Of Gymnasium's wrappers; what a later version adds is not known yet.
_HARMLESS = frozenset(
    {
        "AddWhiteNoise", "AtariPreprocessing", "Autoreset", "ClipAction", "ClipReward", "DelayObservation",
        "DiscretizeAction", "DiscretizeObservation", "DtypeObservation", "FilterObservation", "FlattenObservation",
        "FrameStackObservation", "GrayscaleObservation", "MaxAndSkipObservation", "NormalizeObservation",
        "NormalizeReward", "ObstructView", "OrderEnforcing", "PassiveEnvChecker", "RecordEpisodeStatistics",
        "RepeatAction", "RescaleAction", "RescaleObservation", "ReshapeObservation", "ResizeObservation",
        "StickyAction", "TimeAwareObservation", "TimeLimit",
    }
)  # fmt: skip
_vouched: ContextVar[bool] = ContextVar("vouched", default=False)


@contextmanager
def trusting(*, vouched: bool = True) -> Iterator[None]:
    """Let whatever code trees and runs name run, for as long as this lasts, where somebody vouches for it."""
    token = _vouched.set(vouched or _vouched.get())
    try:
        yield
    finally:
        _vouched.reset(token)


def check_trusted(environment_id: str, wrappers: Sequence[str], source: Path | str) -> None:
    """Refuse code that would run though nobody has vouched for it; nothing is imported.

    Args:
        environment_id: What `gym.make` takes, or a plant, `file.py:Class`.
        wrappers: Around it, each `module:Class`, with arguments perhaps.
        source: What names them, in the message.

    Raises:
        ArtefactError: The user has not run it before.
    """
    if _vouched.get():
        return
    known = _remembered()
    foreign = [*_gymnasiums(wrappers)]
    if not _is_loaded(environment_id, wrappers):
        foreign += _foreign(environment_id, wrappers)
    unknown = [name for name, place in foreign if f"{name}\t{place}" not in known]
    if unknown:
        raise ArtefactError(
            f"{source} names code that would run here, {' and '.join(dict.fromkeys(unknown))}, and no run of yours has "
            "run it from this place before; if you know whose it is, add --trust; in Python, import it first"
        )


def remember(environment_id: str, wrappers: Sequence[str]) -> None:
    """Remember what code a user runs, for `check_trusted`; where nothing can be written, nothing is remembered."""
    run = (*_gymnasiums(wrappers), *_foreign(environment_id, wrappers))
    new = {f"{name}\t{place}" for name, place in run}
    if new := {line for line in new if "\n" not in line} - _remembered():
        with contextlib.suppress(OSError):
            _file().parent.mkdir(parents=True, exist_ok=True)
            with _file().open("a", encoding="utf-8") as file:
                file.write("".join(f"{line}\n" for line in sorted(new)))


def _foreign(environment_id: str, wrappers: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield what is named of code that is neither Gymnasium's nor ours, each with the file in which it begins."""
    if names_plant(environment_id):
        file = environment_id.rpartition(":")[0]
        with contextlib.suppress(EnvironmentFaultError):  # What is not there is told where it is made.
            yield file, str(found(file, environment_id).resolve())
    for module in _modules(environment_id, wrappers):
        package = module.partition(".")[0]
        if package not in _OURS:
            # Finding a submodule would import its package, so the package is what is known.
            spec = importlib.machinery.PathFinder.find_spec(package)
            yield package, str(Path(spec.origin).resolve()) if spec and spec.origin else "nowhere"


def _gymnasiums(wrappers: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the wrappers of Gymnasium's that may do more than change numbers, each with its arguments."""
    for wrapper in wrappers:
        name, _, arguments = wrapper.partition(" ")
        module, _, kind = name.partition(":")
        is_harmless = module == _GYMNASIUM and kind in _HARMLESS
        if module.partition(".")[0] == "gymnasium" and not is_harmless:
            # Where it writes stands in them.
            yield name, " ".join(arguments.split())


def _modules(environment_id: str, wrappers: Sequence[str]) -> Iterator[str]:
    """Yield the modules that are named."""
    if ":" in environment_id and not names_plant(environment_id):
        yield environment_id.rpartition(":")[0]
    for wrapper in wrappers:
        yield wrapper.partition(" ")[0].partition(":")[0]


def _is_loaded(environment_id: str, wrappers: Sequence[str]) -> bool:
    """Tell whether all modules that are named ran in this process already."""
    return not names_plant(environment_id) and all(
        module in sys.modules for module in _modules(environment_id, wrappers)
    )


def _file() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "ge_torchrl" / "code_run_before.txt"


def _remembered() -> set[str]:
    try:
        return set(_file().read_text(encoding="utf-8").splitlines())
    except (OSError, UnicodeDecodeError, RuntimeError):
        return set()
