"""What the choices and keys of a command line compose to."""

import json
from pathlib import Path

import pytest

from ge_torchrl import __main__ as command_line
from ge_torchrl.__main__ import main
from ge_torchrl.ge.grammar import read_grammar

THESIS = ("cartpole", "acrobot", "mountaincar")
GOLDEN = Path(__file__).parent.parent / "golden" / "thesis_presets.json"


def config_of(experiment, *arguments):
    assert main(arguments) == 0
    return experiment.runs[-1][0]


def proposals(config):
    """Return what is proposed from the archive where steps are nearly free."""
    archive = config.resolved(1e8).archive
    return archive.neighbours, archive.revisit_factor, archive.migrants, archive.final_keep


def test_run_takes_choices_and_keys(experiment):
    config = config_of(experiment, "env=mountaincar", "seed=3", "ge.generations=50")
    assert (config.env.id, config.seed, config.ge.generations) == ("MountainCar-v0", 3, 50)
    assert config.ge.genotype_length == 256
    assert config.polish.settling_episodes == 10_000, "the environment brings its settings along"
    assert config.grammar.name == "mountaincar_per_feature"


def test_a_grammar_can_be_chosen_apart_from_the_environment(experiment):
    config = config_of(experiment, "env=cartpole", "grammar=thesis/cartpole")
    assert (config.env.id, config.ge.generations, config.grammar.name) == ("CartPole-v1", 25, "cartpole")


@pytest.mark.parametrize("name", THESIS)
def test_the_thesis_stays_what_it_was_whatever_becomes_of_the_defaults(experiment, name):
    thesis = config_of(experiment, f"experiment=thesis/{name}").as_mapping()
    golden = json.loads(GOLDEN.read_text())[name]
    # What an archive or a polish would be like has no effect where there is none.
    for section in ("archive", "polish"):
        thesis[section] = {key: thesis[section][key] for key in golden[section]}
    assert (thesis["env"].pop("kwargs"), thesis["env"].pop("wrappers")) == ({}, [])
    del thesis["env"]["step_seconds"]
    # A mirror ties the numbers of sums, and this grammar has none; its rules say what kind of tree it derives.
    del thesis["env"]["symmetry"]
    assert (thesis["grammar"].pop("splits"), thesis["grammar"].pop("leaves")) == (None, None)
    grammar = read_grammar(thesis["grammar"]["bnf"], thesis["env"]["features"], thesis["env"]["actions"])
    assert (grammar.splits, grammar.leaves) == ("axis", "action"), "nothing starts dense"
    del thesis["starts"]
    assert thesis.pop("logger") == "none"
    assert thesis["refiner"]["ppo"].pop("trees_together") is None
    assert thesis == golden


@pytest.mark.parametrize("name", THESIS)
def test_the_thesis_refiner_takes_the_table_of_its_environment(experiment, name):
    refiner = config_of(experiment, f"env={name}", "refiner=thesis").as_mapping()["refiner"]
    assert refiner["ppo"].pop("trees_together") is None
    assert refiner == json.loads(GOLDEN.read_text())[name]["refiner"]


@pytest.mark.parametrize(
    ("refiner", "method", "polishes", "proposes"),
    [
        ("ppo", "ppo", True, (26, 5, 20, 8)),
        ("cmaes", "cmaes", False, (26, 5, 20, 8)),
        ("thesis", "ppo", False, (0, 0, 0, 0)),
        ("none", "none", False, (0, 0, 0, 0)),
    ],
)
def test_a_refiner_brings_along_what_goes_with_it(experiment, refiner, method, polishes, proposes):
    config = config_of(experiment, f"refiner={refiner}")
    assert (config.refiner.method, config.polish.enabled) == (method, polishes)
    assert config.archive.enabled, "it keeps trees, whatever goes on from them"
    assert proposals(config) == proposes
    alone = config_of(experiment, f"refiner={refiner}", "archive=none", "polish=none")
    assert not alone.archive.enabled
    assert not alone.polish.enabled
    assert config_of(experiment, f"refiner={refiner}", "env=acrobot").env.id == "Acrobot-v1"


@pytest.mark.parametrize("refiner", ["none", "ppo"])
def test_an_experiment_can_be_compared_with_another_refiner(experiment, refiner):
    config = config_of(experiment, "experiment=thesis/acrobot", f"refiner={refiner}")
    assert (config.refiner.method, config.ge.generations, config.archive.keep) == (refiner, 50, 0)


def test_a_sweep_compares_with_and_without_archive_and_polish(experiment):
    assert main(["-m", "archive.keep=8,0", "polish.every=1,0", "env=acrobot"]) == 0
    switched = [(config.archive.enabled, config.polish.enabled) for config, _ in experiment.runs]
    assert switched == [(True, True), (True, False), (False, True), (False, False)]
    assert [proposals(config)[3] for config, _ in experiment.runs] == [4, 4, 0, 0]
    assert proposals(config_of(experiment, "archive=none", "env=acrobot")) == (0, 0, 0, 0)


def test_command_line_has_the_last_word_over_an_experiment(experiment):
    config = config_of(experiment, "experiment=thesis/acrobot", "ge.generations=7", "seed=9")
    assert (config.env.id, config.ge.generations, config.seed) == ("Acrobot-v1", 7, 9)


@pytest.mark.parametrize(
    "word", ["~env.symmetry", "env.symmetry=null", "env.symmetry={}", "++env.symmetry={ }"]
)
@pytest.mark.parametrize("environment", ["env=cartpole", "env.dynamics=plant.py:Cart"])
def test_a_mirror_can_be_done_without(experiment, environment, word):
    assert config_of(experiment, environment, word).env.symmetry is None
    assert config_of(experiment, environment).env.symmetry is not None
    assert config_of(experiment, environment, "env.symmetry.negate=[x]").env.symmetry["negate"] == ["x"]


def test_every_environment_composes(experiment):
    names = {path.stem for path in (command_line.CONF / "env").glob("*.yaml")} - {"default"}
    assert set(THESIS) < names
    for name in names:
        grammar = config_of(experiment, f"env={name}").grammar
        assert grammar.name == ("own" if grammar.bnf is None else f"{name}_per_feature")


@pytest.mark.parametrize("plus", ["", "+", "++"])
def test_arguments_and_wrappers_of_the_environment_come_from_the_command_line(experiment, plus):
    config = config_of(
        experiment,
        f"{plus}env.kwargs.gravity=-5",
        f"{plus}env.kwargs.wind.power=1.5",
        """env.wrappers=[gymnasium.wrappers:FlattenObservation,"gymnasium.wrappers:DiscretizeAction {bins: 7}"]""",
    )
    assert config.env.kwargs == {"gravity": -5, "wind": {"power": 1.5}}
    assert config.env.wrappers == (
        "gymnasium.wrappers:FlattenObservation",
        "gymnasium.wrappers:DiscretizeAction {bins: 7}",
    )


def test_any_environment_runs_with_a_grammar_on_the_command_line(experiment):
    grammar = "<dt> ::= if lt(x0, [-1, 1] step 0.1) then a0 else a1"
    config = config_of(experiment, "env=default", "env.id=Mine-v0", f'grammar.bnf="{grammar}"')
    assert (config.env.id, config.env.features, config.grammar.bnf) == ("Mine-v0", (), grammar)


OWN = """\
# @package _global_
env:
  id: Mine-v0
  features: [height]
grammar:
  name: mine
  bnf: <dt> ::= left | right
ge:
  generations: 7
archive:
  neighbours: 3
refiner:
  schedule:
    every: 9
"""


@pytest.fixture
def own_folder(tmp_path):
    folder = tmp_path / "it's mine"
    (folder / "env").mkdir(parents=True)
    (folder / "env" / "mine.yaml").write_text(OWN)
    return folder


def test_own_environment_is_one_file_in_a_folder_of_the_user(experiment, own_folder):
    config = config_of(experiment, "--config-dir", str(own_folder), "env=mine")
    assert (config.env.id, config.grammar.name, config.ge.generations) == ("Mine-v0", "mine", 7)
    assert (config.archive.neighbours, config.refiner.schedule.every) == (3, 9)
    assert config.archive.keep is None, "what the file does not say is as anywhere"
    alone = config_of(experiment, "--config-dir", str(own_folder), "env=mine", "refiner=none")
    assert proposals(alone) == (0, 0, 0, 0)


@pytest.mark.usefixtures("experiment")
def test_own_environment_without_its_first_line_is_told(own_folder, capsys):
    (own_folder / "env" / "mine.yaml").write_text(OWN.partition("\n")[2])
    assert main(["--config-dir", str(own_folder), "env=mine"]) == 2
    assert "must begin with # @package _global_" in capsys.readouterr().err


@pytest.mark.usefixtures("experiment")
def test_configuration_is_shown_with_its_values(capsys):
    assert main(["refiner=thesis", "env=acrobot", "--cfg", "job"]) == 0
    assert "max_timesteps: 150000" in capsys.readouterr().out
