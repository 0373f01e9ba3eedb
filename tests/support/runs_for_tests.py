"""Whole runs on a small scale."""

import io
import json

from rich.console import Console

from ge_torchrl.artefacts.lines import CHECKSUM
from ge_torchrl.artefacts.records import CLOCK_FIELDS
from ge_torchrl.artefacts.sums import SUMS
from ge_torchrl.config import Config

# What they say of the clock counts in sums too.
_CLOCK = CLOCK_FIELDS | {CHECKSUM, SUMS}
BNF = """
<if>        ::= if <condition> then <action> else <action>
<condition> ::= lt(theta, <constant>) | lt(theta_dot, <constant>)
<action>    ::= left | right | <if>
<constant>  ::= [-0.5, 0.5] step 0.01
"""


def config(seed=0, **sections):
    """Grammatical evolution alone, and an archive that only keeps; `sections` change keys of theirs."""
    values = {
        "env": {
            "id": "CartPole-v1",
            "features": ["x", "x_dot", "theta", "theta_dot"],
            "units": ["m", "m/s", "rad", "rad/s"],
            "actions": ["left", "right"],
            "solved_at": 475,
        },
        "grammar": {"name": "test", "bnf": BNF},
        "ge": {"population_size": 40, "generations": 15, "genotype_length": 40, "gene_probability": 0.1},
        "evaluation": {
            "episodes": 5,
            "validation_episodes": 30,
            "test_episodes": 20,
            "steps_per_second": 1e8,
        },
        "refiner": {"method": "none"},
        "polish": {"every": 0},
        "archive": {"neighbours": 0, "revisit_factor": 0, "migrants": 0, "final_keep": 0, "episodes": 50},
        "seed": seed,
    }
    for name, changes in sections.items():
        values[name] = {**values.get(name, {}), **changes}
    return Config.from_mapping(values)


def run(config, folder):
    """Run an experiment; return its summary and what it printed."""
    from ge_torchrl.run.experiment import run as run_experiment

    output = io.StringIO()
    summary = run_experiment(config, folder, Console(file=output, width=200))
    return summary, output.getvalue()


def without_clock(path):
    """Return the records of a file without what the clock says."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return [{key: value for key, value in line.items() if key not in _CLOCK} for line in lines]


def assert_same_bytes(one, two, but=("config.yaml", "report.html")):
    """Assert that two folders hold the same run, clock aside."""
    names = {path.relative_to(one) for path in one.rglob("*") if path.is_file()}
    others = {path.relative_to(two) for path in two.rglob("*") if path.is_file()}
    assert names == others, names ^ others
    for name in names:
        if name.suffix == ".jsonl":
            assert without_clock(one / name) == without_clock(two / name), name
        elif name.name == "summary.json":
            assert still(one / name) == still(two / name)
        elif name.name not in but:
            assert (one / name).read_bytes() == (two / name).read_bytes(), name


def still(path):
    """Return a summary without what the clock says."""
    values = json.loads(path.read_text())
    return {key: value for key, value in values.items() if key not in _CLOCK}


def assert_untested(folder):
    """Assert that the best tree and the archive are there, and that nothing is said of a test."""
    history = folder.read_history()
    controller = folder.read_best_tree()
    assert controller.provenance["test_mean"] is None
    assert controller.provenance["train_fitness"] >= history[-1].best_fitness
    records = folder.read_archive()
    assert records
    for record in records:
        assert (record.validation_mean, record.test_mean) == (None, None)
        assert (
            folder.read_archive_tree(record.decision_nodes).tree.num_decision_nodes == record.decision_nodes
        )
    assert not (folder.path / "summary.json").exists()
