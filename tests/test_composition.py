"""What the choices and keys of a command line compose to."""

import json
from pathlib import Path

import pytest

from ge_torchrl import __main__ as command_line
from ge_torchrl.__main__ import main

THESIS = ("cartpole", "acrobot", "mountaincar")
GOLDEN = Path(__file__).parent / "golden" / "thesis_presets.json"


def config_of(experiment, *arguments):
    assert main(arguments) == 0
    return experiment.runs[-1][0]


def test_run_takes_choices_and_keys(experiment):
    config = config_of(experiment, "env=mountaincar", "seed=3", "ge.generations=50")
    assert (config.env.id, config.seed, config.ge.generations) == ("MountainCar-v0", 3, 50)
    assert config.ge.genotype_length == 256, "the environment brings its settings along"
    assert config.grammar.name == "mountaincar_per_feature"


def test_groups_can_be_chosen_apart_from_the_environment(experiment):
    config = config_of(experiment, "ge=mountaincar", "grammar=thesis/cartpole")
    assert config.env.id == "CartPole-v1"
    assert (config.ge.generations, config.grammar.name) == (120, "cartpole")


@pytest.mark.parametrize("name", THESIS)
def test_the_thesis_stays_what_it_was_whatever_becomes_of_the_defaults(experiment, name):
    thesis = config_of(experiment, f"experiment=thesis/{name}").as_mapping()
    assert thesis == json.loads(GOLDEN.read_text())[name]


@pytest.mark.parametrize(
    ("refiner", "method", "neighbours", "migrants"),
    [("none", None, 0, 0), ("thesis", "ppo", 0, 0), ("ppo", "ppo", 1, 20), ("cmaes", "cmaes", 26, 20)],
)
def test_what_a_refinement_costs_decides_how_much_is_explored(
    experiment, refiner, method, neighbours, migrants
):
    config = config_of(experiment, f"refiner={refiner}")
    assert config.refiner.enabled == (method is not None)
    assert method in (None, config.refiner.method)
    assert config.hall_of_fame.enabled
    assert (config.hall_of_fame.neighbours, config.hall_of_fame.migrants) == (neighbours, migrants)
    assert not config_of(experiment, f"refiner={refiner}", "hall_of_fame=none").hall_of_fame.enabled


def test_an_environment_without_a_kernel_gets_smaller_budgets(experiment):
    fast, slow = (config_of(experiment, f"env={name}") for name in ("acrobot", "lunarlander"))
    assert fast.hall_of_fame.neighbours > slow.hall_of_fame.neighbours > 0
    assert fast.hall_of_fame.episodes > slow.hall_of_fame.episodes
    assert fast.refiner.cmaes.max_timesteps > slow.refiner.cmaes.max_timesteps
    assert slow.refiner.schedule.every > fast.refiner.schedule.every == 1
    fast, slow = (config_of(experiment, f"env={name}", "refiner=ppo") for name in ("acrobot", "lunarlander"))
    assert fast.refiner.acceptance_episodes > slow.refiner.acceptance_episodes > 0
    assert fast.refiner.ppo.snapshot_episodes > slow.refiner.ppo.snapshot_episodes > 0


def test_command_line_has_the_last_word_over_an_experiment(experiment):
    config = config_of(experiment, "experiment=thesis/acrobot", "ge.generations=7", "seed=9")
    assert (config.env.id, config.ge.generations, config.seed) == ("Acrobot-v1", 7, 9)


def test_every_environment_composes(experiment):
    names = [path.stem for path in (command_line._CONF / "env").glob("*.yaml")]
    assert set(THESIS) < set(names)
    for name in names:
        assert config_of(experiment, f"env={name}").grammar.name == f"{name}_per_feature"


def test_own_choices_come_from_a_folder_of_the_user(experiment, tmp_path):
    folder = tmp_path / "it's mine"
    (folder / "env").mkdir(parents=True)
    (folder / "env" / "mine.yaml").write_text("id: Mine-v0\n")
    choices = ["env=mine", "ge=cartpole", "grammar=cartpole", "evaluation=cartpole"]
    config = config_of(experiment, "--config-dir", str(folder), *choices)
    assert config.env.id == "Mine-v0"
