"""What happens in a run, told to a tracker by TorchRL's loggers; one that fails is left out, and the run goes on."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ge_torchrl.artefacts.records import GenerationRecord, Summary
from ge_torchrl.config import Config

_logger = logging.getLogger(__name__)

# What wandb and mlflow call all runs of this program together, where the user names nothing else.
_PROJECT = "ge_torchrl"
_HINTS = {"mlflow": '; pip install -e ".[mlflow]"'}
_HINT = '; pip install -c constraints.txt -e ".[trackers]"'


class Tracker:
    """Tells a logger of generations and of the verdict, until it fails.

    Args:
        name: What the user calls the logger.
        opening: Opens a `torchrl.record.loggers.Logger`; None where there is nobody to tell.
    """

    def __init__(self, name: str, opening: Callable[[], Any] | None) -> None:
        self._name = name
        self._logger: Any = None
        if opening is not None:
            with self._left_out_where_it_fails():
                self._logger = opening()

    def settings(self, config: Config) -> None:
        """Tell of the configuration, a value a key."""
        if self._logger is not None:
            with self._left_out_where_it_fails():
                self._logger.log_hparams(dict(_flat(config.as_mapping())))

    def generation(self, record: GenerationRecord, kept: Mapping[int, float]) -> None:
        """Tell of a generation.

        Args:
            record: Its line of the history.
            kept: The fitness of the best kept tree of each number of decision nodes.
        """
        told = {
            "fitness/best": record.best,
            "fitness/median": record.median_fitness,
            "fitness/mean": record.mean_fitness,
            "search/env_steps": record.env_steps,
            "search/seconds": record.elapsed_seconds,
            "search/refined": record.refined,
            "search/polished": record.polished,
            **{f"kept/{nodes:02}_nodes": fitness for nodes, fitness in kept.items()},
        }
        self._tell(told, record.generation)

    def verdict(self, summary: Summary) -> None:
        """Tell of what validation and test said of the champion."""
        told = {
            "champion/test_mean": summary.test_mean,
            "champion/test_std": summary.test_std,
            "champion/validation_mean": summary.validation_mean,
            "champion/decision_nodes": summary.decision_nodes,
            "champion/complexity_M": summary.complexity_M,
        }
        self._tell(told, summary.generations - 1)

    def close(self) -> None:
        """Let the logger end."""
        if self._logger is None:
            return
        with self._left_out_where_it_fails():
            self._logger.close()
            if self._name == "mlflow":
                import mlflow

                mlflow.end_run()

    def _tell(self, told: Mapping[str, float | None], step: int) -> None:
        if self._logger is not None:
            with self._left_out_where_it_fails():
                known = {name: float(value) for name, value in told.items() if value is not None}
                self._logger.log_metrics(known, step=step)

    @contextmanager
    def _left_out_where_it_fails(self) -> Iterator[None]:
        try:
            yield
        except Exception as fault:  # noqa: BLE001 (whatever it is, the run is worth more)
            self._logger = None
            hint = _HINTS.get(self._name, _HINT) if isinstance(fault, ImportError) else ""
            told = " ".join(f"{type(fault).__name__}: {fault}".split())
            _logger.warning(
                "logger=%s failed and is left out, and the run goes on (%s)%s", self._name, told, hint
            )


@contextmanager
def tracking(config: Config, folder: Path | None, run: str) -> Iterator[Tracker]:
    """Open the tracker that a configuration names, for the time of a run.

    Args:
        config: The configuration, its budgets resolved.
        folder: The run's folder, where a tracker that writes files does so; None where there is none.
        run: What the run is called.
    """
    name = config.logger
    tracker = Tracker(name, None if name == "none" or folder is None else lambda: _open(name, folder, run))
    tracker.settings(config)
    try:
        yield tracker
    finally:
        tracker.close()


def _open(name: str, folder: Path, run: str) -> Any:
    # torch comes with them, and takes seconds.
    from torchrl.record import loggers

    match name:
        case "tensorboard":
            return loggers.TensorboardLogger(exp_name=name, log_dir=str(folder))
        case "csv":
            return loggers.CSVLogger(exp_name=name, log_dir=str(folder))
        case "wandb":
            project = os.environ.get("WANDB_PROJECT", _PROJECT)
            return loggers.WandbLogger(
                exp_name=run, save_dir=str(folder), project=project, log_env_packages=False
            )
        case _:
            uri = os.environ.get("MLFLOW_TRACKING_URI")
            if uri is None:
                # MLflow 3 wants to be asked for plain files; its database would be another dependency.
                os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")
                uri = (folder / name).resolve().as_uri()
            return loggers.MLFlowLogger(
                exp_name=os.environ.get("MLFLOW_EXPERIMENT_NAME", _PROJECT), tracking_uri=uri
            )


def _flat(values: Mapping[str, Any], section: str = "") -> Iterator[tuple[str, str | float]]:
    """Yield each value under its key; what is neither text nor number as text."""
    for name, value in values.items():
        key = f"{section}.{name}" if section else name
        if isinstance(value, Mapping) and value:
            yield from _flat(value, key)
        elif key != "grammar.bnf":  # Longer than trackers allow; it is in config.yaml.
            yield key, value if isinstance(value, str | int | float) else str(value)
