"""What is found becomes a preset that the printed command runs."""

import shlex
from dataclasses import replace

import pytest

from ge_torchrl import __main__ as command_line
from ge_torchrl.cli.choices import as_meant, with_environment
from ge_torchrl.tuning.preset import (
    comparing_commands,
    name_of_study,
    preset_command,
    preset_path,
    write_preset,
)
from ge_torchrl.tuning.space import space_of
from ge_torchrl.tuning.task import Task

VALUES = {"ge.gene_probability": 1e-05, "ge.parsimony": "none", "ge.tournament_size": 7}


def task_of(*words):
    words = with_environment(as_meant(list(words)))
    config = command_line._composed(words)
    ge = replace(config.ge, max_env_steps=config.ge.max_env_steps or 1000)
    config = replace(config, ge=ge)
    return Task(config, space_of(tuple(VALUES), config.resolved(1e8), ()), 3, tuple(words))


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["env=mountaincar"],
        ["env=acrobot", "refiner=none", "polish=none", "archive=none", "ge.max_env_steps=5e5"],
        ["env.id=MountainCar-v0", "ge.max_seconds=3", "seed=4"],
        ["env=cartpole", "env.symmetry={}", "env.kwargs.gravity=-5", "grammar.bnf=null"],
        ["experiment=thesis/cartpole", "ge.generations=5"],
    ],
    ids=" ".join,
)
def test_the_printed_command_composes_what_was_tried(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    task, folder = task_of(*words), tmp_path / "a study"
    write_preset(preset_path(folder, task, "x"), task, VALUES, ["Trial 3: 1.5 over 3 runs"])
    typed = shlex.split(preset_command(folder, task, "x"))
    assert typed[:3] == ["python", "-m", "ge_torchrl"]
    composed = command_line._composed(typed[3:])
    assert composed == replace(task.with_values(VALUES), seed=0)


def test_both_commands_of_the_comparison_have_the_same_limit_and_seeds(tmp_path):
    task = task_of("env=mountaincar", "seed=3")
    tuned, untuned = comparing_commands(tmp_path, task, "mountaincar", "range(5,6)")
    assert untuned == "python -m ge_torchrl -m env=mountaincar ge.max_env_steps=1000 seed='range(5,6)'"
    assert tuned.endswith("experiment=tuned_mountaincar seed='range(5,6)'")


def test_a_folder_of_choices_that_was_typed_takes_the_preset(tmp_path):
    task = replace(task_of("env=mountaincar"), config_dir="my_conf")
    assert preset_path(tmp_path, task, "x").as_posix() == "my_conf/experiment/tuned_x.yaml"
    assert (
        preset_command(tmp_path, task, "x") == "python -m ge_torchrl --config-dir my_conf experiment=tuned_x"
    )


@pytest.mark.parametrize(
    ("words", "environment", "name"),
    [
        (["env=mountaincar"], "MountainCar-v0", "mountaincar"),
        (["env=default", "env.id=LunarLander-v3"], "LunarLander-v3", "lunarlander_v3"),
        (["experiment=thesis/cartpole"], "CartPole-v1", "thesis_cartpole"),
        (["env=default", "env.dynamics=docs/plant.py:Cart"], "docs/plant.py:Cart", "docs_plant_py_cart"),
        ([], "CartPole-v1", "cartpole_v1"),
    ],
)
def test_a_study_is_called_by_its_environment(words, environment, name):
    assert name_of_study(words, environment) == name
