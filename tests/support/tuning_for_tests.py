"""Studies whose runs are made up: an objective that is a function of the settings, in a thousandth of a second."""

from dataclasses import replace

import numpy as np
from configs_for_tests import VALUES
from rich.console import Console

from ge_torchrl.config import Config
from ge_torchrl.tuning import objective
from ge_torchrl.tuning.objective import EndedEarlyError, Outcome
from ge_torchrl.tuning.space import space_of
from ge_torchrl.tuning.task import Task, write_task
from ge_torchrl.tuning.work import work

SPACE = ("ge.gene_probability=0.01..0.5", "ge.tournament_size=2..8", "ge.parsimony")


def small_task(*, runs=2, texts=SPACE, **changed):
    env = {"id": "CartPole-v1", "actions": ["left", "right"]}
    bnf = "<dt> ::= if lt(x2, [-0.2, 0.2] step 0.01) then <dt> else <dt> | left | right"
    grammar = {"name": "tiny", "bnf": bnf}
    config = Config.from_mapping({**VALUES, "env": env, "grammar": grammar}).resolved(1e8)
    config = replace(config, ge=replace(config.ge, max_env_steps=100_000), **changed)
    return Task(config, space_of(texts, config, ()), runs, ("env=cartpole", "ge.generations=3"))


def made_up(config):
    """The return of a run: best with few mutations and tournaments of 5, a little otherwise with another seed."""
    noise = np.random.default_rng(config.seed).normal(0, 0.5)
    return 100 - 80 * abs(config.ge.gene_probability - 0.05) - 4 * abs(config.ge.tournament_size - 5) + noise


class MadeUp:
    """Stands in for runs, remembers them, and fails or is killed where told to."""

    def __init__(self, monkeypatch):
        self.runs = []
        self.raises = {}
        monkeypatch.setattr(objective, "outcome_of", self)

    def __call__(self, config, ends):
        self.runs.append((config.ge.gene_probability, config.ge.tournament_size, config.seed))
        if error := self.raises.get(len(self.runs)):
            raise error
        value = made_up(config)
        if ends(value - 1):
            raise EndedEarlyError
        return Outcome(value, config.ge.tournament_size, 100_000)


def made_up_study(folder, task, trials):
    """Carry out a study, its runs made up; return what was printed."""
    folder.mkdir(exist_ok=True)
    if not (folder / "tuning.json").exists():
        write_task(folder, task)
    console = Console(record=True, quiet=False, file=open_null(), width=200)
    work(folder, trials, 1, console)
    return console.export_text()


def open_null():
    import io

    return io.StringIO()
