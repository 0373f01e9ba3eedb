"""The library composes what the command line composes, and refuses it in the same words."""

import pytest

from ge_torchrl import __main__ as command_line
from ge_torchrl.config.composing import compose
from ge_torchrl.config.files import choices
from ge_torchrl.errors import ConfigError, UserError


def typed(*words):
    return command_line._composed(list(words))


def test_files_merge_as_hydra_merges_them():
    """Every file of conf/ is read in one of these."""
    environments = choices("env")
    others = [
        {"refiner": "none"},
        {"refiner": "cmaes", "archive": "none"},
        {"refiner": "thesis", "polish": "none"},
        {"grammar": "thesis/cartpole"},
    ]
    for place, name in enumerate(name for name in environments if name != "default"):
        chosen = others[place % len(others)] if place % 2 else {}
        words = [f"{group}={choice}" for group, choice in chosen.items()]
        assert compose(name, chosen, {"seed": 3}) == typed(f"env={name}", *words, "seed=3"), name


@pytest.mark.parametrize("experiment", choices("experiment"))
def test_experiments_pin_what_they_pin(experiment):
    assert compose(None, {"experiment": experiment}, {}) == typed(f"experiment={experiment}")
    chosen = {"experiment": experiment, "refiner": "none"}
    assert compose(None, chosen, {"ge.generations": 7}) == typed(
        f"experiment={experiment}", "refiner=none", "ge.generations=7"
    )
    own = compose(None, {"experiment": experiment}, {}).env.id
    assert compose(own, {"experiment": experiment}, {}) == compose(None, {"experiment": experiment}, {})


@pytest.mark.parametrize(
    ("environment", "settings", "words"),
    [
        ("CartPole-v1", {}, ["env=cartpole"]),
        ("Acrobot-v1", {"ge.restarts": 0}, ["env=acrobot", "ge.restarts=0"]),
        ("Acrobot-v1", {"env.kwargs.gravity": 5}, ["env.id=Acrobot-v1", "env.kwargs.gravity=5"]),
        ("default", {"env.id": "Acrobot-v1"}, ["env=default", "env.id=Acrobot-v1"]),
        (None, {"env.id": "Acrobot-v1"}, ["env.id=Acrobot-v1"]),
        (None, {"env.id": "Taxi-v3", "seed": 2}, ["env.id=Taxi-v3", "seed=2"]),
        (None, {"env.dynamics": "plant.py:Cart"}, ["env.dynamics=plant.py:Cart"]),
        ("Taxi-v3", {}, ["env.id=Taxi-v3"]),
        (
            "plant.py:Cart",
            {"env.kwargs.LENGTH": 0.4},
            ["env.dynamics=plant.py:Cart", "+env.kwargs.LENGTH=0.4"],
        ),
        (None, {"refiner.ppo.lr_actor": 1e-3}, ["refiner.ppo.lr_actor=1e-3"]),
        ("cartpole", {"env.symmetry": None}, ["env=cartpole", "env.symmetry=null"]),
        ("cartpole", {"env.symmetry": {"negate": ["x"]}}, ["env=cartpole", "env.symmetry={negate: [x]}"]),
        (
            "cartpole",
            {"env.kwargs": {"sutton_barto_reward": True}, "env.kwargs.render_mode": None},
            ["env=cartpole", "env.kwargs={sutton_barto_reward: true}", "env.kwargs.render_mode=null"],
        ),
        ("flappybird", {"ge": {"generations": 3}}, ["env=flappybird", "ge.generations=3"]),
        ("cartpole", {"env.symmetry": {}}, ["env=cartpole", "env.symmetry=null"]),
    ],
)
def test_values_come_last_and_mappings_are_merged(environment, settings, words):
    assert compose(environment, {}, settings) == typed(*words)


def test_a_file_of_ones_own_is_an_environment(tmp_path):
    path = tmp_path / "switch.yaml"
    sections = "env:\n  id: Switch-v0\n  features: [angle, speed]\nrefiner:\n  ppo:\n    lr_actor: 1e-2\n"
    path.write_text(f"# @package _global_\n{sections}")
    config = compose(str(path), {"refiner": "ppo"}, {"ge.generations": 4})
    assert (config.env.id, config.env.features, config.refiner.ppo.lr_actor) == (
        "Switch-v0", ("angle", "speed"), 0.01
    )  # fmt: skip
    assert config.grammar.bnf is None
    path.write_text(sections)
    with pytest.raises(ConfigError, match="must begin with # @package _global_"):
        compose(str(path), {}, {})
    path.write_text("id: Switch-v0\nfeatures: [angle, speed]\n")
    assert compose(str(path), {}, {}).env.id == "Switch-v0"
    path.write_text("- Switch-v0\n")
    with pytest.raises(ConfigError, match="keys with values"):
        compose(str(path), {}, {})
    with pytest.raises(ConfigError, match=r"absent\.yaml must be a file of settings"):
        compose(str(tmp_path / "absent.yaml"), {}, {})


@pytest.mark.parametrize(
    ("environment", "chosen", "settings", "words"),
    [
        ("cartpole", {}, {"ge.generation": 5}, ["ge.generation=5"]),
        ("cartpole", {}, {"ge.generations": 0}, ["ge.generations=0"]),
        ("cartpole", {}, {"ge.generations": 2.5}, ["ge.generations=2.5"]),
        ("cartpole", {}, {"ge": 5}, ["ge=5"]),
        ("cartpole", {}, {"hall_of_fame.enabled": True}, ["hall_of_fame.enabled=true"]),
        ("cartpole", {}, {"evaluation.episodes": None, "ge.wraps": None}, ["ge.wraps=null"]),
        ("cartpole", {"refiner": "pppo"}, {}, ["refiner=pppo"]),
        ("cartpole", {"archive": "explored"}, {}, ["archive=explored"]),
    ],
)
def test_mistakes_are_told_in_the_words_of_the_command_line(environment, chosen, settings, words):
    with pytest.raises(UserError) as ours:
        compose(environment, chosen, settings)
    with pytest.raises(UserError) as theirs:
        typed(f"env={environment}", *words)
    assert str(ours.value) == str(theirs.value)


@pytest.mark.parametrize(
    ("environment", "chosen", "settings", "told"),
    [
        (lambda: None, {}, {}, "the id of one that is registered.*gymnasium.register"),
        (" ", {}, {}, "the id of one that is registered"),
        ("cartpole", {"refiner": 3}, {}, "refiner=3 is unknown; expected one of cmaes, none"),
        ("cartpole", {}, {3: 4}, "must be texts such as ge.generations; got 3"),
        ("cartpole", {}, [("seed", 1)], "settings must be keys with values"),
        (
            "acrobot",
            {"experiment": "thesis/cartpole"},
            {},
            "fixes the environment, CartPole-v1.*got Acrobot-v1",
        ),
        (
            None,
            {"experiment": "thesis/cartpole"},
            {"env.id": "Acrobot-v1"},
            "fixes the environment, CartPole-v1",
        ),
    ],
)
def test_mistakes_of_python_are_told_in_one_line(environment, chosen, settings, told):
    with pytest.raises(ConfigError, match=told) as error:
        compose(environment, chosen, settings)
    assert "\n" not in str(error.value)
