"""Sweeps on many machines: each job goes to an engine, Slurm by submitit or Ray, and runs in a process of its own.

A process that dies costs its own job alone, and only what is not done is handed over.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ge_torchrl.artefacts.jobs import Words, read_job
from ge_torchrl.artefacts.texts import told_of
from ge_torchrl.cli.carrying import carry_out, on_threads
from ge_torchrl.cli.output import prepare_output
from ge_torchrl.cli.statuses import FAULT, OK
from ge_torchrl.config import Config
from ge_torchrl.environments.backend import available_cores
from ge_torchrl.errors import ConfigError

_MOST_IN_ARRAY = 1000  # Slurm allows 1,001 tasks unless its MaxArraySize says more.
_SECONDS_BETWEEN_LOOKS = 1.0
_SLURM_LOGS, _RAY_LOGS = ".submitit", ".ray"


@dataclass(frozen=True)
class Task:
    """A job of a sweep, as an engine hands it to another process.

    Attributes:
        config: Everything its run depends on.
        folder: The run's folder.
        words: What was typed for it.
    """

    config: Config
    folder: Path
    words: Words


Outcome = int | str
"""The exit status of a job, or what became of its process."""


def check_engine(engine: str) -> None:
    """Refuse an engine that is not installed, before anything is written.

    Raises:
        ConfigError: Its package is missing; the message says what to install.
    """
    _package({"slurm": "submitit"}.get(engine, engine), engine)


def run_by_engine(settings: Mapping[str, Any], tasks: Sequence[Task], folder: Path) -> int:
    """Let an engine do the jobs of a sweep that are not done, tell what becomes of each, and return the exit status.

    Args:
        settings: Those of `hydra.launcher`, with the engine's name.
        tasks: All jobs.
        folder: The sweep's; the output of the processes goes there too.

    Raises:
        ConfigError: The engine is not installed, or refuses a setting.
        ArtefactError: The folder cannot be written.
    """
    from ge_torchrl.run.jobs import is_done, record_failure

    cores = settings["cpus_per_task"]
    if type(cores) is not int or cores < 1:
        raise ConfigError(f"hydra.launcher.cpus_per_task must be a whole number of at least 1; got {cores}")
    with told_of(folder):
        folder.mkdir(parents=True, exist_ok=True)
    tasks = [Task(on_threads(one.config, cores), one.folder, one.words) for one in tasks]
    left = [one for one in tasks if not is_done(one.config, one.folder, one.words)]
    if len(left) < len(tasks):
        print(f"{len(tasks) - len(left)} of {len(tasks)} jobs done before")
    statuses = [OK]
    for task, outcome in _ENGINES[settings["engine"]](settings, left, folder) if left else ():
        if isinstance(outcome, str):
            record_failure(task.config, task.folder, task.words, outcome)
        statuses.append(FAULT if isinstance(outcome, str) else outcome)
        if statuses[-1] == OK:
            print(f"done    {task.folder}", flush=True)
        else:
            job = read_job(task.folder)
            error = (job and job.error) or outcome
            print(f"failed  {task.folder}: {error}", file=sys.stderr, flush=True)
    return FAULT if FAULT in statuses else max(statuses)


class _Work:
    """What a process does: a job, in the folder from which the sweep began."""

    def __init__(self) -> None:
        self.place = Path.cwd()

    def __call__(self, task: Task) -> int:
        os.chdir(self.place)
        prepare_output()
        return carry_out(task.config, task.folder, task.words)

    def checkpoint(self, task: Task) -> Any:
        """Return what submitit queues again where time is up, or another's job goes first: the job goes on."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self, task)


def _by_slurm(
    settings: Mapping[str, Any], tasks: Sequence[Task], folder: Path
) -> Iterator[tuple[Task, Outcome]]:
    submitit = _package("submitit", "slurm")
    own = ("engine", "cluster", "cpus_per_task", "mem_gb", "timeout_min", "max_num_timeout")
    given = {name: settings[name] for name in ("cpus_per_task", "mem_gb", "timeout_min")}
    given |= {f"slurm_{name}": value for name, value in settings.items() if name not in own and value}
    with _refusing("slurm", "hydra.launcher.cluster=local does without Slurm"):
        executor = submitit.AutoExecutor(
            folder=folder.resolve() / _SLURM_LOGS,
            cluster=settings["cluster"],
            **{f"{cluster}_max_num_timeout": settings["max_num_timeout"] for cluster in ("slurm", "local")},
        )
        executor.update_parameters(name="ge_torchrl", **given)
    print(
        f"{len(tasks)} jobs to {executor.cluster}; what they print is in {folder / _SLURM_LOGS}", flush=True
    )
    # Slurm itself keeps to array_parallelism; on this machine nobody else does.
    most, local = len(tasks), executor.cluster == "local"
    if local:
        most = max(1, min(settings["array_parallelism"], available_cores() // settings["cpus_per_task"]))
    waiting, pending = list(tasks), dict[Any, Task]()
    try:
        while waiting or pending:
            while waiting and len(pending) < most:
                batch = waiting[: min(most - len(pending), _MOST_IN_ARRAY)]
                quiet = _unheard() if local else contextlib.nullcontext()
                with _refusing("slurm", "python -m ge_torchrl status tells what is done"), quiet:
                    pending.update(zip(executor.map_array(_Work(), batch), batch, strict=True))
                del waiting[: len(batch)]
            for job in [job for job in pending if job.done()]:
                yield pending.pop(job), _outcome(job, submitit)
            time.sleep(_SECONDS_BETWEEN_LOOKS * bool(pending))
    finally:
        for job in pending:
            job.cancel(check=False)


def _outcome(job: Any, submitit: Any) -> Outcome:
    try:
        return int(job.result())
    except submitit.core.utils.UncompletedJobError:  # Or what it is a base of: a job that raised.
        why = f" ({job.state})" * (job.state != "FINISHED")  # Such as OUT_OF_MEMORY.
        return (
            f"its process ended too early{why}; what it printed is in {_SLURM_LOGS}/{job.paths.stderr.name}"
        )


def _by_ray(
    settings: Mapping[str, Any], tasks: Sequence[Task], folder: Path
) -> Iterator[tuple[Task, Outcome]]:
    ray = _package("ray", "ray")
    logs = folder.resolve() / _RAY_LOGS
    logs.mkdir(exist_ok=True)
    with _refusing("ray", "ray start --head makes a cluster on this machine"):
        ray.init(settings["address"], log_to_driver=False, logging_level="ERROR")
    try:
        # A process does one job: what one leaves behind touches no other, and no job is begun twice.
        work = ray.remote(num_cpus=settings["cpus_per_task"], max_calls=1, max_retries=0)(_printing)
        pending = {work.remote(_Work(), task, logs / f"{task.folder.name}.log"): task for task in tasks}
        print(f"{len(pending)} jobs to ray; what they print is in {folder / _RAY_LOGS}", flush=True)
        while pending:
            (job,), _ = ray.wait(list(pending), num_returns=1)
            task = pending.pop(job)
            try:
                yield task, ray.get(job)
            except ray.exceptions.RayError as error:
                yield task, f"its process ended too early ({type(error).__name__})"
    finally:
        ray.shutdown()


def _printing(work: _Work, task: Task, log: Path) -> int:
    with (
        log.open("a", encoding="utf-8") as file,
        contextlib.redirect_stdout(file),
        contextlib.redirect_stderr(file),
    ):
        return work(task)


@contextlib.contextmanager
def _unheard() -> Iterator[None]:
    """Let what processes say for themselves that are started meanwhile, as at Ctrl-C, be heard by nobody.

    A job's own output goes to its file in any case.
    """
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


_ENGINES = {"slurm": _by_slurm, "ray": _by_ray}


def _package(name: str, extra: str) -> Any:
    try:
        package = importlib.import_module(name)
    except ImportError:
        package = None
    if package is None or package.__file__ is None:  # Or a mere folder by this name, such as that of a sweep.
        raise ConfigError(
            f"hydra/launcher={extra} needs {name}; "
            f'expected it installed: pip install -c constraints.txt -e ".[{extra}]"'
        )
    return package


@contextlib.contextmanager
def _refusing(engine: str, hint: str) -> Iterator[None]:
    """Tell in one line why an engine takes no jobs, and what may help."""
    try:
        yield
    except Exception as error:
        why = " ".join(str(error).split())
        raise ConfigError(f"hydra/launcher={engine} takes no jobs: {why}; {hint}") from error
