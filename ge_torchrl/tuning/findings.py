"""What the trials of a study say: which did best, beside the settings as they stand, and which settings mattered."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ge_torchrl.tuning.book import ATTEMPT, FAULT, NODES, RETURNS, UNTUNED, is_given_up, open_study
from ge_torchrl.tuning.space import Value
from ge_torchrl.tuning.task import Task

if TYPE_CHECKING:
    from optuna.trial import FrozenTrial

COMPLETE, ENDED, FAILED, OPEN = "complete", "ended early", "failed", "not finished"
_STATES = {"COMPLETE": COMPLETE, "PRUNED": ENDED, "FAIL": FAILED}
# Of fewer trials nothing can be said of single settings.
_LEAST_TRIALS = 12
# What good trials have in common is read from so many at least.
_GOOD_TRIALS = 5


@dataclass(frozen=True)
class Tried:
    """A trial.

    Attributes:
        number: As Optuna counts.
        state: `COMPLETE`, `ENDED`, `FAILED` or `OPEN`.
        returns: Of each of its runs.
        reached: The last that is known of it, where it ended early: on its first run that is the archive's mean.
        nodes: Decision nodes of each run's champion.
        values: Its settings, by their keys.
        is_untuned: Whether these are the settings as they stand.
        fault: What failed.
    """

    number: int
    state: str
    returns: tuple[float, ...]
    reached: float | None
    nodes: tuple[int, ...]
    values: Mapping[str, Value]
    is_untuned: bool = False
    fault: str = ""

    @property
    def value(self) -> float | None:
        """Mean return of its runs, or what is known of its first one; None for nothing."""
        return sum(self.returns) / len(self.returns) if self.returns else self.reached


@dataclass(frozen=True)
class Findings:
    """What the trials say.

    Attributes:
        task: What was asked.
        tried: The trials in their order; those that were begun again stand once.
        begun_again: How many died and were begun again.
        importances: Each setting's share in what made first runs good, from large to small; none of few trials.
    """

    task: Task
    tried: tuple[Tried, ...]
    begun_again: int
    importances: Mapping[str, float]

    @property
    def untuned(self) -> Tried | None:
        """The trial of the settings as they stand; None where it has not ended."""
        return next((one for one in self.tried if one.is_untuned and one.state == COMPLETE), None)

    @property
    def best(self) -> Tried | None:
        """The best of the trials that came to their end, the untuned one among them."""
        ended = [one for one in self.tried if one.state == COMPLETE]
        return max(ended, key=lambda one: (one.value or 0.0, one.is_untuned), default=None)

    @property
    def is_better(self) -> bool:
        """Whether a trial did better than the settings as they stand."""
        return self.best is not None and self.untuned is not None and not self.best.is_untuned

    def count(self, state: str) -> int:
        """Return how many trials are in a state."""
        return sum(one.state == state for one in self.tried)


def findings_of(folder: Path, task: Task) -> Findings:
    """Read what the trials in a folder say.

    Raises:
        UserError: Optuna is not installed.
        ArtefactError: The journal cannot be read.
    """
    trials = open_study(folder).get_trials(deepcopy=False)
    counted = [trial for trial in trials if not is_given_up(trial)]
    tried = tuple(_tried(trial, task) for trial in counted)
    return Findings(task, tried, len(trials) - len(counted), _importances(counted, task))


def _tried(trial: FrozenTrial, task: Task) -> Tried:
    noted = trial.user_attrs
    fault = noted.get(FAULT, "") or (
        f"its process died {noted[ATTEMPT]} times" if trial.state.name == "FAIL" else ""
    )
    return Tried(
        number=trial.number,
        state=_STATES.get(trial.state.name, OPEN),
        returns=tuple(map(float, noted.get(RETURNS, ()))),
        reached=trial.intermediate_values[trial.last_step] if trial.last_step is not None else None,
        nodes=tuple(map(int, noted.get(NODES, ()))),
        values=task.rounded(trial.params),
        is_untuned=bool(noted.get(UNTUNED, False)),
        fault=str(fault),
    )


def _importances(trials: Sequence[FrozenTrial], task: Task) -> dict[str, float]:
    """Return PED-ANOVA's shares, over the first runs: all trials but the poorest have one, and few have them all."""
    import optuna

    keys = {one.key for one in task.space}
    compared = [trial for trial in trials if trial.user_attrs.get(RETURNS) and trial.params.keys() == keys]
    firsts = {float(trial.user_attrs[RETURNS][0]) for trial in compared}
    if len(compared) < _LEAST_TRIALS or len(firsts) < 2:
        return {}
    with warnings.catch_warnings():
        # The evaluator is new to Optuna; fANOVA would need scikit-learn.
        warnings.simplefilter("ignore")
        study = optuna.create_study(direction="maximize")
        for trial in compared:
            study.add_trial(
                optuna.create_trial(
                    params=trial.params,
                    distributions=trial.distributions,
                    value=float(trial.user_attrs[RETURNS][0]),
                )
            )
        quantile = max(0.1, _GOOD_TRIALS / len(compared))
        evaluator = optuna.importance.PedAnovaImportanceEvaluator(target_quantile=quantile)
        return dict(optuna.importance.get_param_importances(study, evaluator=evaluator))
