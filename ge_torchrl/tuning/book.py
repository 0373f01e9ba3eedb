"""The trials in a folder: Optuna's journal, which several processes write and any of them may be killed at."""

from __future__ import annotations

import os
import secrets
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from ge_torchrl.artefacts.locks import Lock, in_turn, is_locked
from ge_torchrl.artefacts.texts import told_of
from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.seeding import stream
from ge_torchrl.tuning.task import Task

if TYPE_CHECKING:
    from optuna import Study, Trial
    from optuna.trial import FrozenTrial

JOURNAL = "journal.log"
INSTALL = 'tune needs Optuna; expected it installed: pip install -c constraints.txt -e ".[tune]"'
_WORKERS, _TURN = ".workers", ".turn"
# A trial whose process died is begun again so often: it may be what kills it.
_MOST_ATTEMPTS = 3
# Random trials that the sampler begins with, the untuned one among them.
_RANDOM_TRIALS = 10

# What is noted of a trial.
UNTUNED, RETURNS, NODES, FAULT, REPLACES, ATTEMPT = (
    "untuned",
    "returns",
    "nodes",
    "fault",
    "replaces",
    "attempt",
)
WORKER = "worker"


def open_study(folder: Path) -> Study:
    """Return the study in a folder, for reading and writing.

    Raises:
        UserError: Optuna is not installed.
        ArtefactError: The journal cannot be read or written.
    """
    try:
        import optuna
    except ImportError as error:
        raise UserError(INSTALL) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    # Its lock is a link, which leads nowhere from another folder unless the path is whole.
    path = folder.resolve() / JOURNAL
    try:
        with told_of(path):
            return optuna.create_study(
                storage=JournalStorage(JournalFileBackend(str(path))),
                study_name="tuning",
                direction="maximize",
                load_if_exists=True,
                # The better half goes on: a third of the first run, then whole runs: one, two, four ...
                pruner=optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=2),
            )
    except (ValueError, KeyError) as error:
        raise ArtefactError(
            f"{path} must be a journal of Optuna, as tune writes it; it cannot be read ({error})"
        ) from error


def forget_failed(folder: Path) -> bool:
    """Take away the trials of a study that has found nothing and that no process works at; tell whether that was so.

    Raises:
        UserError: Optuna is not installed.
        ArtefactError: The journal cannot be read.
    """
    if not (folder / JOURNAL).exists():
        return True
    with in_turn(folder / _TURN):
        if any(is_locked(worker) for worker in _workers(folder)):
            return False
        if any(trial.user_attrs.get(RETURNS) for trial in open_study(folder).get_trials(deepcopy=False)):
            return False
        (folder / JOURNAL).unlink()
    return True


def is_given_up(trial: FrozenTrial) -> bool:
    """Tell whether a trial died and another one stands for it, so that it does not count."""
    is_dead = trial.state.name == "FAIL" and FAULT not in trial.user_attrs
    return is_dead and _attempt(trial) < _MOST_ATTEMPTS


def _attempt(trial: FrozenTrial) -> int:
    return int(trial.user_attrs.get(ATTEMPT, 1))


class Book:
    """The trials in a folder, open for one process, until `close`.

    Args:
        folder: It is there, and holds the task.
        task: What is asked.

    Raises:
        UserError: Optuna is not installed.
        ArtefactError: The folder cannot be written.
    """

    def __init__(self, folder: Path, task: Task) -> None:
        self._folder, self._task = folder, task
        self._name = f"{os.getpid()}-{secrets.token_hex(4)}"
        own = folder / _WORKERS / self._name
        with in_turn(folder / _TURN):
            if not any(is_locked(other) for other in _workers(folder)):
                _mend(folder)
            with told_of(own):
                own.mkdir(parents=True)
            self._lock = Lock(own)
            self.study = open_study(folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let other processes know that this one carries out no trial any more."""
        self._lock.release()
        with suppress(OSError):
            (self._folder / _WORKERS / self._name).rmdir()

    def next_trial(self, total: int, dead: Callable[[int], None] = lambda _number: None) -> Trial | None:
        """Return a trial to carry out, or None where so many are begun; one whose process died comes again.

        Args:
            total: Trials of the whole study.
            dead: Is told the number of each trial whose process died.

        Raises:
            UserError: The settings as they stand cannot run, so that there is nothing to compare others with.
        """
        with in_turn(self._folder / _TURN):
            for number in self._give_up_dead():
                dead(number)
            trials = self.study.get_trials(deepcopy=False)
            begun = [trial for trial in trials if not is_given_up(trial)]
            _check_untuned(begun)
            is_waiting = any(trial.state.name == "WAITING" for trial in begun)
            if not is_waiting and len(begun) >= total:
                return None
            if not begun:
                self.study.enqueue_trial(self._untuned(), user_attrs={UNTUNED: True})
            # A study that goes on samples as one that was left alone.
            self.study.sampler = self._sampler(len(begun))
            with _quietly():
                trial = self.study.ask()
                trial.set_user_attr(WORKER, self._name)
                self._choose_values(trial)
            return trial

    def _give_up_dead(self) -> list[int]:
        """Give up trials whose process died, put them down once more, and return their numbers."""
        from optuna.trial import TrialState

        dead = [
            trial
            for trial in self.study.get_trials(deepcopy=False, states=[TrialState.RUNNING])
            if not self._lives(trial.user_attrs.get(WORKER))
        ]
        replaced = {trial.user_attrs.get(REPLACES) for trial in self.study.get_trials(deepcopy=False)}
        for trial in dead:
            attempt, is_untuned = _attempt(trial), trial.user_attrs.get(UNTUNED, False)
            if attempt < _MOST_ATTEMPTS and trial.number not in replaced:
                kept = (UNTUNED, RETURNS, NODES)
                noted = {key: value for key, value in trial.user_attrs.items() if key in kept}
                params = self._untuned() if is_untuned else trial.params
                noted |= {REPLACES: trial.number, ATTEMPT: attempt + 1}
                self.study.enqueue_trial(params, user_attrs=noted)
            self.study.tell(trial.number, state=TrialState.FAIL)
        return [trial.number for trial in dead]

    def should_end(self, trial: Trial, value: float, step: int) -> bool:
        """Note what a trial returned so far, and tell whether it is worth no more runs; the untuned one always is.

        Args:
            trial: The trial.
            value: Mean return.
            step: Where it stands; the same for all trials.
        """
        trial.report(value, step)
        return bool(trial.should_prune()) and not trial.user_attrs.get(UNTUNED, False)

    def _lives(self, worker: object) -> bool:
        # One's own trials have ended when one looks for another.
        return (
            isinstance(worker, str) and worker != self._name and is_locked(self._folder / _WORKERS / worker)
        )

    def _untuned(self) -> dict[str, Any]:
        return {one.key: one.untuned for one in self._task.space if one.holds_untuned}

    def _sampler(self, number: int) -> Any:
        import optuna

        seed = int(stream(self._task.config.seed, f"tuning, trial {number}").integers(1 << 32))
        return optuna.samplers.TPESampler(seed=seed, n_startup_trials=_RANDOM_TRIALS)

    def _choose_values(self, trial: Trial) -> None:
        is_untuned = trial.user_attrs.get(UNTUNED, False)
        for one in self._task.space:
            if is_untuned and not one.holds_untuned:
                continue
            if one.low is None or one.high is None:
                trial.suggest_categorical(one.key, one.choices)
            elif one.is_integer:
                trial.suggest_int(one.key, int(one.low), int(one.high), log=one.is_log)
            else:
                trial.suggest_float(one.key, one.low, one.high, log=one.is_log)


def _check_untuned(trials: Iterable[FrozenTrial]) -> None:
    for trial in trials:
        if trial.user_attrs.get(UNTUNED) and trial.state.name == "FAIL":
            fault = trial.user_attrs.get(FAULT, "its process died again and again")
            raise UserError(f"nothing is tuned where the settings as they stand cannot run: {fault}")


def _workers(folder: Path) -> Iterator[Path]:
    with suppress(OSError):
        yield from (folder / _WORKERS).iterdir()


@contextmanager
def _quietly() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _mend(folder: Path) -> None:
    """Take away what processes left that were killed while they wrote: half a line, and a lock.

    Optuna reads no journal with half a line within, and waits half a minute for such a lock.
    """
    path = folder / JOURNAL
    with suppress(FileNotFoundError):
        path.with_name(f"{JOURNAL}.lock").unlink()
    if not path.exists():
        return
    with told_of(path), path.open("rb+") as file:
        content = file.read()
        if not content.endswith(b"\n"):
            file.truncate(content.rfind(b"\n") + 1)
