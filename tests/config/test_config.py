import dataclasses

import pytest
import yaml
from configs_for_tests import VALUES, config_with

from ge_torchrl.config import Config, check_key, template
from ge_torchrl.errors import ConfigError
from ge_torchrl.refiner_section import RefinerConfig
from ge_torchrl.sections import (
    EnvironmentConfig,
    EvaluationConfig,
    GEConfig,
    GrammarConfig,
    HallOfFameConfig,
)


def test_defaults_are_the_documented_ones():
    config = Config.from_mapping(VALUES)
    assert config == Config(
        env=EnvironmentConfig(
            id="CartPole-v1",
            features=(),
            units=(),
            actions=(),
            solved_at=None,
            lowest_fitness_excluded=None,
            route="auto",
            max_episode_steps=None,
            workers=0,
        ),
        grammar=GrammarConfig(name="tiny", bnf="<dt> ::= left | right"),
        ge=GEConfig(
            population_size=10,
            generations=3,
            genotype_length=20,
            gene_probability=0.1,
            crossover_probability=0.0,
            mutation_probability=1.0,
            tournament_size=2,
            wraps=0,
            single_choice_consumes=False,
            replacement="parent_if_better",
            elites=0,
            parsimony="none",
            parsimony_tolerance=0.0,
            stop_when_solved=False,
            max_seconds=None,
            max_env_steps=None,
        ),
        evaluation=EvaluationConfig(
            episodes=5,
            std_penalty=0.0,
            episode_seeds="fixed",
            validation_episodes=100,
            champion_candidates=10,
            test_episodes=100,
            threads=0,
        ),
        refiner=RefinerConfig(name="none"),
        hall_of_fame=HallOfFameConfig(
            enabled=False,
            episodes=200,
            keep=3,
            max_nodes=15,
            neighbours=0,
            neighbours_drawn=500,
            revisits=0,
            revisit_factor=5,
            final_keep=0,
            final_factor=20,
            final_patience=1,
            final_step=1.0,
            final_settling_episodes=0,
            migrants=0,
        ),
        seed=0,
    )


@pytest.mark.parametrize("seed", [-1, 1.5, "0", True, None])
def test_wrong_seed_is_named(seed):
    with pytest.raises(ConfigError, match=r"^seed must be an integer of at least 0"):
        Config.from_mapping({**VALUES, "seed": seed})


def test_records_are_frozen_and_comparable():
    config = Config.from_mapping(VALUES)
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.seed = 1
    assert hash(config) == hash(Config.from_mapping(VALUES))
    assert config != dataclasses.replace(config, seed=1)


def test_replace_checks_again():
    with pytest.raises(ConfigError, match=r"^seed must be"):
        dataclasses.replace(Config.from_mapping(VALUES), seed=-1)


def test_section_of_the_wrong_type_is_named():
    config = Config.from_mapping(VALUES)
    with pytest.raises(ConfigError, match=r"^ge must be a GEConfig; got 3$"):
        dataclasses.replace(config, ge=3)
    with pytest.raises(ConfigError, match=r"^ge must be a section with keys and values; got 3$"):
        Config.from_mapping({**VALUES, "ge": 3})


def test_mapping_goes_there_and_back_through_yaml():
    config = config_with("env", "features", ["x", "y"])
    text = yaml.safe_dump(config.as_mapping())
    assert Config.from_mapping(yaml.safe_load(text)) == config


@pytest.mark.parametrize("section", ["env", "grammar", "ge", "evaluation"])
def test_missing_section_is_reported_by_its_first_key(section):
    values = {name: value for name, value in VALUES.items() if name != section}
    with pytest.raises(ConfigError, match=rf"^{section}\.\w+ has no value; expected .*; got nothing$"):
        Config.from_mapping(values)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("ge.populaton_size", r"ge.populaton_size is unknown; .* such as ge.population_size; got"),
        ("evaluation.zzz", r"evaluation.zzz is unknown; .* such as evaluation.episodes, "),
        ("sed", r"sed is unknown; .* such as seed; got sed"),
        (
            "zzz",
            r"zzz is unknown; .* such as env, grammar, ge, evaluation, refiner, hall_of_fame, seed; got zzz",
        ),
        ("seed.x", "seed.x is unknown"),
        ("ge.wraps.x", "ge.wraps.x is unknown"),
        ("ge.SECTION", "ge.SECTION is unknown"),
    ],
)
def test_unknown_key_is_named_with_similar_ones(key, message):
    with pytest.raises(ConfigError, match=f"^{message}"):
        check_key(key)


def test_unknown_keys_of_a_mapping_are_refused():
    with pytest.raises(ConfigError, match=r"^ge\.zzz is unknown"):
        config_with("ge", "zzz", 1)
    with pytest.raises(ConfigError, match=r"^zzz is unknown"):
        Config.from_mapping({**VALUES, "zzz": 1})


def test_template_names_every_key_and_check_key_knows_them():
    keys = template()
    assert list(keys) == [field.name for field in dataclasses.fields(Config)]
    assert keys["ge"]["population_size"] == "???"
    assert keys["evaluation"]["validation_episodes"] == 100
    for section, values in keys.items():
        check_key(section)
        for key in values if isinstance(values, dict) else ():
            check_key(f"{section}.{key}")


@pytest.mark.parametrize("key", ["neighbours", "revisits", "final_keep", "migrants"])
@pytest.mark.parametrize(
    ("refiner", "enabled", "message"),
    [("none", True, "nothing refines trees"), ("cmaes", False, "nothing is kept")],
)
def test_exploring_that_would_silently_be_left_out_is_refused(key, refiner, enabled, message):
    values = {**VALUES, "refiner": {"name": refiner}, "hall_of_fame": {"enabled": enabled, key: 1}}
    with pytest.raises(ConfigError, match=rf"hall_of_fame\.{key} must be 0, because {message}.*; got 1"):
        Config.from_mapping(values)
    Config.from_mapping({**values, "hall_of_fame": {"enabled": enabled, key: 0}})
    Config.from_mapping({**values, "refiner": {"name": "cmaes"}, "hall_of_fame": {"enabled": True, key: 1}})
