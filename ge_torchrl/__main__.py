"""The command line, and the only file that knows Hydra: compose -> frozen `Config` -> `run`.

Whatever the user mistyped is found by composing every job of the command line in advance, so it is told in
one line before Hydra makes a folder.
"""

from ge_torchrl.interrupts import ignore_interrupts, interrupt_again, leave_quietly, leave_soon

if __name__ == "__main__":
    leave_quietly()  # Until main takes over.

import argparse
import os
import secrets
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf._utils import get_omega_conf_dumper
from omegaconf.errors import OmegaConfBaseException

from ge_torchrl.artefacts.jobs import Sweep
from ge_torchrl.cli import RUN, as_asked, verb_of
from ge_torchrl.cli.carrying import carry_out, on_threads
from ge_torchrl.cli.choices import (
    as_meant,
    check_file,
    config_from,
    folder_from,
    searched,
    with_environment,
    words_of,
)
from ge_torchrl.cli.jobs import FOLDERS, Engine, Job, check_override, jobs_of
from ge_torchrl.cli.output import is_output_closed, prepare_output, tell
from ge_torchrl.cli.parser import options_of_run
from ge_torchrl.cli.process import seen_by_others
from ge_torchrl.cli.statuses import FAULT, INTERRUPTED, OK, OUTPUT_CLOSED, USER_ERROR, JobFailedError
from ge_torchrl.cli.sweeps import announce, begin, page_of_sweep
from ge_torchrl.cli.waiting import looked_at
from ge_torchrl.cli.words import folder_told, one_line, represented, shortened, unreadable
from ge_torchrl.config import MAPPINGS, Config, template
from ge_torchrl.config.files import CONF, of_the_thesis, unknown_choice
from ge_torchrl.errors import ConfigError, RunFaultError, UserError
from ge_torchrl.version import __version__

_VERSION_BASE = "1.3"
_FULL_ERROR = {"HYDRA_FULL_ERROR": "1"}  # Hydra raises its exceptions instead of printing them.


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`, by default that of the process, and return its exit status.

    The status is 0 for success, 2 where the user can mend it, 1 for a fault of the program, 130 after an
    interrupt, 141 where nobody reads the output any more.
    """
    arguments = as_asked(list(sys.argv[1:] if argv is None else argv))
    try:
        interrupt_again()
        prepare_output()
        if arguments[:1] == [RUN]:
            status = _run(arguments[1:])
        else:
            verb = verb_of(arguments, _composed)
            status = verb(arguments[1:]) if verb else _run(arguments)
        sys.stdout.flush()
    except (UserError, RunFaultError) as error:
        return tell(error)
    except KeyboardInterrupt as pressed:
        ignore_interrupts()
        if not pressed.args:
            print("ge-torchrl: interrupted before there was a result", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        if is_output_closed():
            return OUTPUT_CLOSED
        raise
    finally:
        ignore_interrupts()
    return status


def _run(arguments: list[str]) -> int:
    if "--version" in arguments:
        print(f"ge_torchrl {__version__}")
        return OK
    _prepare_hydra()
    options = options_of_run(get_args_parser(), arguments)
    typed, options.overrides = options.overrides, as_meant(options.overrides)
    if options.config_name is None and options.config_path is None:
        options.overrides = with_environment(options.overrides)
    arguments = [*(word for word in arguments if word not in typed), *options.overrides]
    jobs = _check(options)
    if options.multirun:
        announce(Sweep(tuple(job.words for job in jobs), tuple(arguments)))
    if jobs and (engine := jobs[0].engine):
        return _by_engine(engine, jobs)
    statuses, process = list[int](), os.getpid()

    def job(values: DictConfig) -> None:
        statuses.append(status := _job(values))
        if status != OK and os.getpid() != process:
            # A launcher's own process cannot reach the list above; Hydra carries the error over at the end.
            raise JobFailedError(status)
        if status == OUTPUT_CLOSED:
            raise SystemExit(status)  # Nobody would read of the other jobs either.

    if options.cfg == "job":
        # A value that follows from others is shown as what it is, not as how it follows.
        arguments = ["--resolve", *arguments]
    launch = hydra.main(version_base=_VERSION_BASE, config_path=str(CONF), config_name="config")(job)
    with (
        page_of_sweep(),
        seen_by_others(arguments, _FULL_ERROR),
        _in_our_words(),
        folder_told(FOLDERS[options.multirun]),
    ):
        try:
            launch()
        except JobFailedError as failed:
            statuses.append(failed.status)
        except SystemExit as leaving:
            # Hydra leaves so after --help and the like, and after messages of its own.
            if leaving.code != OUTPUT_CLOSED:
                statuses.append(USER_ERROR if leaving.code else OK)
    return FAULT if FAULT in statuses else max(statuses, default=OK)


def _job(values: DictConfig) -> int:
    """Run one job and return its status; a failure is told, so the other jobs of a sweep go on."""
    prepare_output()  # A launcher's own process has not been through main.
    config, context = _config_from(values), HydraConfig.get()
    if "joblib" in str(context.launcher.get("_target_")):
        config = on_threads(config, 1)
    words = tuple(context.overrides.task) if context.mode == RunMode.MULTIRUN else None
    return carry_out(config, Path(context.runtime.output_dir), words)


def _composed(words: list[str]) -> Config:
    """Return the configuration of one run that these words would begin."""
    _prepare_hydra()
    options = options_of_run(get_args_parser(), with_environment(as_meant(words)))
    (job,) = _jobs(options)
    return job.config


def _check(options: argparse.Namespace) -> Sequence[Job]:
    """Compose and validate every job of the command line, and return them; nothing is written."""
    if options.shell_completion or options.hydra_help:
        return ()
    jobs = _jobs(options)
    if options.cfg or options.help or options.info:
        return ()
    from ge_torchrl.run.plan import plan

    # The jobs of a sweep mostly share environment and grammar, which are made real once.
    for config in {(one.config.env, one.config.grammar, one.config.ge): one.config for one in jobs}.values():
        with looked_at(config.env.id):
            plan(config)
    return jobs


def _jobs(options: argparse.Namespace) -> list[Job]:
    """Return every job of the command line; its words are those that are not Hydra's own."""
    conf = folder_from(options.config_path)
    sweep = options.multirun or "hydra.mode=MULTIRUN" in options.overrides
    with _in_our_words(), hydra.initialize_config_dir(str(conf), version_base=_VERSION_BASE):
        loader = GlobalHydra.instance().config_loader()
        overrides = OverridesParser.create(config_loader=loader).parse_overrides(options.overrides)
        for override in overrides:
            check_override(override, sweep=sweep)
        config_name = options.config_name or "config"
        check_file(conf, config_name)
        also_in = searched(options.config_dir, config_name)

        def composed(job: Iterable[str]) -> DictConfig:
            return hydra.compose(config_name, overrides=[*job, *also_in], return_hydra_config=True)

        jobs = []
        for number, job in enumerate(jobs_of(overrides, sweep=sweep)):
            values = composed(job)
            _check_experiment(job, composed)
            words = tuple(word for word in job if not word.lstrip("+~").startswith("hydra"))
            engine = _engine_of(values, number) if sweep else None
            with open_dict(values):
                del values["hydra"]
            jobs.append(Job(words, _config_from(values), engine))
    return jobs


def _engine_of(values: DictConfig, number: int) -> Engine | None:
    if "engine" not in values.hydra.launcher:
        return None
    if not str(values.hydra.sweeper.get("_target_")).endswith(".BasicSweeper"):
        raise ConfigError(
            f"hydra/sweeper must be basic, because all jobs go to {values.hydra.launcher.engine} at once; got another"
        )
    with open_dict(values):
        values.hydra.job.num = number
    HydraConfig.instance().set_config(values)
    settings: Any = OmegaConf.to_container(values.hydra.launcher, resolve=True)
    return Engine(settings, Path(values.hydra.sweep.dir), str(values.hydra.sweep.subdir))


def _by_engine(engine: Engine, jobs: Sequence[Job]) -> int:
    from ge_torchrl.cli.engines import Task, check_engine, run_by_engine

    check_engine(engine.settings["engine"])
    begin(engine.sweep)
    tasks = [Task(job.config, engine.sweep / job.engine.run, job.words) for job in jobs if job.engine]
    with page_of_sweep():
        return run_by_engine(engine.settings, tasks, engine.sweep)


def _check_experiment(job: Sequence[str], composed: Callable[[Iterable[str]], DictConfig]) -> None:
    """Refuse another environment beside an experiment that fixes its own; `composed` composes overrides of a job."""
    experiments, environments = (words_of(job, keys) for keys in (("experiment",), ("env", "env.id")))
    if not (experiments and environments):
        return
    fixed, asked = (
        OmegaConf.select(composed(word for word in job if word not in left_out), "env.id")
        for left_out in (environments, experiments)
    )
    if fixed != asked:
        raise ConfigError(
            f"{experiments[0]} fixes the environment, {fixed}, so expected no other one; got {' '.join(environments)}"
        )


def _config_from(values: DictConfig) -> Config:
    return config_from(OmegaConf.to_container(values, resolve=True))


def _prepare_hydra() -> None:
    """Store the keys with their defaults, and register what names the folders of runs."""

    def unique_token() -> str:
        return secrets.token_hex(4)

    # A plain mapping, no typed schema: then one place, config/, judges types and words the errors.
    node = OmegaConf.create(template())
    for key in MAPPINGS:
        # Hydra asks for a + before a key that is not there; within these all keys are the user's own.
        OmegaConf.set_struct(OmegaConf.select(node, key), value=False)
    ConfigStore.instance().store(name="template", node=node)
    dumper = get_omega_conf_dumper()
    dumper.add_representer(str, represented)
    OmegaConf.register_new_resolver("unique_token", unique_token, use_cache=True, replace=True)
    OmegaConf.register_new_resolver("shortened", shortened, replace=True)
    OmegaConf.register_new_resolver("thesis", _of_the_thesis, replace=True)


def _of_the_thesis(cartpole: Any, acrobot: Any, mountaincar: Any, *, _root_: DictConfig) -> Any:
    """Choose among the values of the thesis' three environments; any other environment takes the first."""
    value = of_the_thesis(OmegaConf.select(_root_, "env.id"), (cartpole, acrobot, mountaincar))
    return OmegaConf.create(value) if isinstance(value, list) else value


@contextmanager
def _in_our_words() -> Iterator[None]:
    """Turn what Hydra and the file system have to say into one line."""
    try:
        yield
    except BrokenPipeError:
        raise
    except BrokenExecutor as broken:
        raise RunFaultError(
            "a process of the sweep died, perhaps for want of memory, and joblib ended the others with it; "
            "the same command with the sweep's folder (hydra.sweep.dir=...) goes on"
        ) from broken
    except MissingConfigException as error:
        group, _, choice = (error.missing_cfg_file or "").partition("/")
        if group == "hydra":
            group, _, choice = (error.missing_cfg_file or "").rpartition("/")
        if not choice:
            raise ConfigError(one_line(error)) from error
        raise unknown_choice(group, choice, error.options or ()) from error
    except OverrideParseException as error:
        raise ConfigError(unreadable(error.override)) from error
    except (HydraException, OmegaConfBaseException, OSError, ValueError, RecursionError) as error:
        raise ConfigError(one_line(error)) from error


if __name__ == "__main__":
    sys.exit(leave_soon(main()))
