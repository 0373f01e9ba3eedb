"""Every file of a finished run truncated, bit-flipped and deleted: no verb ever tells a wrong number of it."""

import io
import json
import random
import shutil

import pytest
from rich.console import Console
from runs_for_tests import config, run

from ge_torchrl import load
from ge_torchrl.artefacts.controllers import named_controller
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.jobs import Job, Sweep, read_job, read_sweep, write_job, write_sweep
from ge_torchrl.errors import ArtefactError, UserError
from ge_torchrl.exports.exporting import exported
from ge_torchrl.library.result import load_run
from ge_torchrl.report.evaluation import evaluate, evaluate_runs
from ge_torchrl.report.findings import runs_tables
from ge_torchrl.report.html.run_page import run_page
from ge_torchrl.report.runs import gather_runs
from ge_torchrl.run import experiment

SMALL = {
    "ge": {"generations": 4, "population_size": 10},
    "evaluation": {"episodes": 2, "validation_episodes": 5, "test_episodes": 5},
    "refiner": {"method": "cmaes", "schedule": {"every": 2}, "acceptance_episodes": 3, "min_nodes": 1},
    "polish": {"max_timesteps": 500, "every": 1, "episodes": 3},
    "archive": {"keep": 1, "episodes": 3, "neighbours": 1, "neighbours_drawn": 3, "max_nodes": 3, "final_keep": 1},
}  # fmt: skip


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("sound") / "run"
    run(config(**SMALL), path)
    return path


def resumed(path):
    return experiment.resume(path, Console(file=io.StringIO()))


VERBS = {
    "evaluate": lambda path: evaluate(path, 3, 0, "kernel", None).as_dict(),
    "evaluate the tree's file": lambda path: evaluate(
        path / "best_tree.json", 3, 0, "kernel", None
    ).as_dict(),
    "evaluate many": lambda path: evaluate_runs(path.parent, 3, 0, "kernel", None).as_dict(),
    "export": lambda path: exported(named_controller(path, None), "python", "controller", verify=False),
    "export of a size": lambda path: exported(named_controller(path, 1), "c", "controller", verify=False),
    "report": lambda path: runs_tables(gather_runs(path).runs, "markdown"),
    "page": lambda path: run_page(RunFolder(path)),
    "resume": resumed,
    "load": lambda path: (load(path), load(path / "best_tree_full.json")),
    "load_run": load_run,
}


def damages(content, draws):
    """Yield what a file may become, each with its name; None is a file that is gone."""
    yield "deleted", None
    for share in (0.5, 1):
        size = min(int(share * len(content)), len(content) - 1)
        yield f"truncated to {size} bytes", content[:size]
    for offset in (0, *(draws.randrange(len(content)) for _ in range(2)), len(content) - 1):
        bit = draws.randrange(8)
        flipped = bytes([content[offset] ^ (1 << bit)])
        yield f"bit {bit} of byte {offset} flipped", content[:offset] + flipped + content[offset + 1 :]


def told_or_found(verb, path):
    """Return what a verb finds, as text; or the error that it tells."""
    try:
        found = verb(path)
    except UserError as error:
        return error
    # A page says where its run lies, and a found run where it was found.
    return str(found).replace(str(path), "RUN")


def test_each_damage_is_told_with_its_file_or_changes_nothing(sound, tmp_path, tried):
    path, draws = tmp_path / "run", random.Random(0)  # noqa: S311
    shutil.copytree(sound, path)
    whole = {name: told_or_found(verb, path) for name, verb in VERBS.items()}
    assert not any(isinstance(found, UserError) for found in whole.values())
    files = [file for file in sorted(path.rglob("*")) if file.is_file()]
    assert len(files) >= 13
    lost, n_tried = [], 0
    for file in files:
        content = file.read_bytes()
        for damage, damaged in damages(content, draws):
            file.unlink()
            if damaged is not None:
                file.write_bytes(damaged)
            for name, verb in VERBS.items():
                n_tried += 1
                found = told_or_found(verb, path)
                is_told = isinstance(found, UserError) and file.name in str(found) and "\n" not in str(found)
                if not is_told and found != whole[name]:
                    lost.append(f"{file.name}, {damage}, {name}: {str(found)[:200]}")
            file.write_bytes(content)
    tried("damages of a finished run's files, by ten verbs", n_tried, len(lost))
    assert not lost


def test_a_tree_that_the_user_changed_is_read_outside_the_folder(sound, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(sound, path)
    tree = path / "archive" / "01.json"
    tree.write_text(tree.read_text().replace("CartPole-v1", "CartPole-v0"))
    with pytest.raises(
        ArtefactError, match=r"01\.json must be .* copy it to another folder, where it is read"
    ):
        load(tree)
    shutil.copy(tree, tmp_path / "mine.json")
    assert load(tmp_path / "mine.json").names.id == "CartPole-v0"


def test_a_folder_whose_configuration_the_user_changed_is_read_without_its_sums(sound, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(sound, path)
    config_file = path / "config.yaml"
    config_file.write_text(config_file.read_text().replace("solved_at: 475", "solved_at: 100"))
    with pytest.raises(ArtefactError, match=r"remove the keys sha256 and crc32 of summary\.json"):
        load_run(path)
    summary = json.loads((path / "summary.json").read_text())
    del summary["sha256"]
    (path / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(ArtefactError, match=r"summary\.json is damaged"):
        load_run(path)
    del summary["crc32"]
    (path / "summary.json").write_text(json.dumps(summary))
    assert load_run(path).config.env.solved_at == 100


def test_a_summary_of_somebody_elses_beside_a_tree_says_nothing_of_it(sound, tmp_path):
    shutil.copy(sound / "best_tree.json", tmp_path / "tree.json")
    for text in ("{}", "[]", "{", '{"sha256": {"tree.json": "1"}}'):
        (tmp_path / "summary.json").write_text(text)
        assert load(tmp_path / "tree.json") == load(sound)


@pytest.mark.parametrize("damaged", ['"seed=4"', '"seed=3'])
def test_what_is_damaged_of_a_sweep_is_told(damaged, tmp_path):
    job, sweep = Job(("seed=3",), "abc"), Sweep((("seed=3",),), ("-m", "seed=3"))
    write_job(tmp_path, job)
    write_sweep(tmp_path, sweep)
    assert (read_job(tmp_path), read_sweep(tmp_path)) == (job, sweep)
    for name, read in (("job.json", read_job), ("sweep.json", read_sweep)):
        path = tmp_path / name
        path.write_text(path.read_text().replace('"seed=3"', damaged, 1))
        with pytest.raises(ArtefactError, match=name):
            read(tmp_path)
