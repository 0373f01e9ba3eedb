"""What the command line calls, without what it does."""

import types
from pathlib import Path

from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError, EnvironmentFaultError


class FakeExperiment(types.ModuleType):
    """Stands in for running and evaluating: remembers what was asked, and fails where told to."""

    def __init__(self):
        super().__init__("ge_torchrl.run.experiment")
        self.runs: list[tuple[Config, Path]] = []
        self.evaluated: list[tuple[object, ...]] = []
        self.failures: dict[int, BaseException] = {}
        self.interrupted: set[int] = set()

    def run(self, config, output_dir, _console):
        self.runs.append((config, output_dir))
        if config.seed in self.failures:
            raise self.failures[config.seed]
        return types.SimpleNamespace(
            stopped_by="interrupt" if config.seed in self.interrupted else "generations"
        )

    def is_finished(self, path):
        return (path / "summary.json").exists()

    def resume(self, _path, _console):
        return None

    def plan(self, config):
        if config.env.id.startswith("Missing"):
            raise EnvironmentFaultError(f"env.id must be an installed one; got {config.env.id}")
        return types.SimpleNamespace(config=config, spec=types.SimpleNamespace(id=config.env.id))

    def is_above_runs(self, path):
        return path.is_dir()

    def evaluate_runs(self, folder, episodes, seed, route, nodes, _told):
        self.evaluated.append((folder, episodes, seed, route, nodes))
        return types.SimpleNamespace(
            left_out=("multirun/3: broken",),
            as_dict=lambda: {"episodes": 10},
            as_text=lambda form: "| a table |" if form == "markdown" else "a table",
        )

    def evaluate(self, path, episodes, seed, route, nodes, _told):
        self.evaluated.append((path, episodes, seed, route, nodes))
        if path.name == "missing":
            raise ArtefactError("missing must be a tree's file; got none")
        return types.SimpleNamespace(as_dict=lambda: {"mean": 499.5}, as_text=lambda: "mean return 499.5")
