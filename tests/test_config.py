import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.config import Config, check_key, template
from ge_torchrl.errors import ConfigError
from ge_torchrl.refiner_section import RefinerConfig, ScheduleConfig
from ge_torchrl.sections import (
    EnvironmentConfig,
    EvaluationConfig,
    GEConfig,
    GrammarConfig,
    HallOfFameConfig,
)

VALUES: dict[str, Any] = {
    "env": {"id": "CartPole-v1"},
    "grammar": {"name": "tiny", "bnf": "<dt> ::= left | right"},
    "ge": {"population_size": 10, "generations": 3, "genotype_length": 20, "gene_probability": 0.1},
    "evaluation": {"episodes": 5},
}


def config_with(section: str, key: str, value: object) -> Config:
    return Config.from_mapping({**VALUES, section: {**VALUES[section], key: value}})


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
            migrants=0,
        ),
        seed=0,
    )


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        (
            "ge",
            "population_size",
            1,
            "ge.population_size must be an integer of at least 2, because selection compares individuals; got 1",
        ),
        ("ge", "population_size", True, "ge.population_size must be an integer .* got True"),
        ("ge", "population_size", 2.5, "ge.population_size must be an integer .* got 2.5"),
        ("ge", "population_size", "20", "ge.population_size must be an integer .* got '20'"),
        ("ge", "population_size", None, "ge.population_size must be an integer .* got null"),
        ("ge", "population_size", [1, 2], r"ge.population_size must be an integer .* got \[1, 2\]"),
        ("ge", "generations", 0, "ge.generations must be an integer of at least 1"),
        ("ge", "genotype_length", 0, "ge.genotype_length must be an integer of at least 1"),
        ("ge", "gene_probability", 1.01, "ge.gene_probability must be a number from 0 to 1.*; got 1.01"),
        (
            "ge",
            "gene_probability",
            float("nan"),
            "ge.gene_probability must be a number from 0 to 1.*; got nan",
        ),
        ("ge", "crossover_probability", -0.1, "ge.crossover_probability must be a number from 0 to 1"),
        (
            "ge",
            "mutation_probability",
            True,
            "ge.mutation_probability must be a number from 0 to 1.*; got True",
        ),
        ("ge", "tournament_size", 0, "ge.tournament_size must be an integer of at least 1"),
        ("ge", "wraps", -1, "ge.wraps must be an integer of at least 0"),
        ("ge", "single_choice_consumes", 1, "ge.single_choice_consumes must be true or false; got 1"),
        ("ge", "stop_when_solved", "yes", "ge.stop_when_solved must be true or false; got 'yes'"),
        ("ge", "replacement", "x", "ge.replacement must be one of parent_if_better, generational; got 'x'"),
        ("ge", "elites", -1, "ge.elites must be an integer of at least 0"),
        ("ge", "elites", 10, "ge.elites must be less than ge.population_size, 10, because .*; got 10"),
        ("ge", "parsimony", "some", "ge.parsimony must be one of none, lexicographic; got 'some'"),
        (
            "ge",
            "parsimony_tolerance",
            -1,
            "ge.parsimony_tolerance must be a finite number of at least 0; got -1",
        ),
        ("ge", "max_seconds", 0, "ge.max_seconds must be a finite number above 0 or null; got 0"),
        ("ge", "max_env_steps", 0, "ge.max_env_steps must be an integer of at least 1 or null"),
        ("env", "id", " ", "env.id must be a Gymnasium id such as CartPole-v1; got ' '"),
        ("env", "id", "???", "env.id has no value; expected a Gymnasium id such as CartPole-v1; got nothing"),
        ("env", "features", "x", "env.features must be a list of texts; got 'x'"),
        ("env", "features", [1], r"env.features must be a list of texts; got \[1\]"),
        ("env", "features", ["x", "x"], "env.features must be names that differ from each other"),
        ("env", "actions", ["left", ""], "env.actions must be names that differ from each other"),
        ("env", "units", ["m"], "env.units must be one unit for each feature"),
        ("env", "solved_at", float("inf"), "env.solved_at must be a finite number or null; got inf"),
        (
            "env",
            "lowest_fitness_excluded",
            "low",
            "env.lowest_fitness_excluded must be a finite number or null",
        ),
        ("env", "route", "fast", "env.route must be one of auto, gymnasium, compiled; got 'fast'"),
        ("env", "max_episode_steps", 0, "env.max_episode_steps must be an integer of at least 1 or null"),
        ("env", "workers", -1, "env.workers must be an integer of at least 0"),
        ("grammar", "bnf", "", "grammar.bnf must be rules in Backus-Naur form; got ''"),
        ("grammar", "name", 3, "grammar.name must be the name of the grammar; got 3"),
        ("evaluation", "episodes", 0, "evaluation.episodes must be an integer of at least 1"),
        (
            "evaluation",
            "episode_seeds",
            "new",
            "evaluation.episode_seeds must be one of fixed, fresh, common",
        ),
        (
            "evaluation",
            "validation_episodes",
            0,
            "evaluation.validation_episodes must be an integer of at least 1",
        ),
        (
            "evaluation",
            "champion_candidates",
            0,
            "evaluation.champion_candidates must be an integer of at least 1",
        ),
        ("evaluation", "test_episodes", 0, "evaluation.test_episodes must be an integer of at least 1"),
        ("evaluation", "std_penalty", -0.5, "evaluation.std_penalty must be a finite number of at least 0"),
        ("evaluation", "threads", -1, "evaluation.threads must be an integer of at least 0"),
    ],
)
def test_wrong_value_is_named_with_what_was_expected(section, key, value, message):
    with pytest.raises(ConfigError, match=f"^{message}"):
        config_with(section, key, value)


@pytest.mark.parametrize("seed", [-1, 1.5, "0", True, None])
def test_wrong_seed_is_named(seed):
    with pytest.raises(ConfigError, match=r"^seed must be an integer of at least 0"):
        Config.from_mapping({**VALUES, "seed": seed})


def test_ppo_is_off_where_nothing_is_said():
    assert not Config.from_mapping(VALUES).refiner.enabled
    assert Config.from_mapping({**VALUES, "refiner": {"name": "thesis"}}).refiner.enabled


@pytest.mark.parametrize(
    ("section", "key", "value", "stored"),
    [
        ("ge", "max_env_steps", 1e6, 1_000_000),
        ("ge", "population_size", np.int64(200), 200),
        ("ge", "gene_probability", 0, 0.0),
        ("ge", "gene_probability", 1, 1.0),
        ("ge", "max_seconds", 60, 60.0),
        ("env", "solved_at", np.float32(475), 475.0),
        ("env", "features", ["x", "y"], ("x", "y")),
    ],
)
def test_other_spellings_of_a_value_are_stored_as_one(section, key, value, stored):
    kept = getattr(getattr(config_with(section, key, value), section), key)
    assert kept == stored
    assert type(kept) is type(stored)


@given(st.integers(2, 10**6), st.integers(1, 10**4), st.integers(1, 10**4), st.floats(0, 1))
def test_everything_within_its_range_is_accepted(population_size, generations, genotype_length, probability):
    config = GEConfig(population_size, generations, genotype_length, probability, probability, probability)
    assert dataclasses.astuple(config)[:4] == (population_size, generations, genotype_length, probability)


def test_units_may_be_blank_and_alike_but_not_without_features():
    environment = EnvironmentConfig(id="E-v0", features=("a", "b"), units=("", ""))
    assert environment.units == ("", "")
    with pytest.raises(ConfigError, match=r"^env.units"):
        EnvironmentConfig(id="E-v0", units=("m",))


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


CONF = Path(__file__).parents[1] / "conf"


def test_schedules_of_the_thesis_apply_four_three_and_four_times():
    def applications(schedule, generations):
        return [generation for generation in range(generations) if schedule.applies_to(generation)]

    assert applications(ScheduleConfig(every=40), 200) == [40, 80, 120, 160]
    assert applications(ScheduleConfig(every=15), 50) == [15, 30, 45]
    assert applications(ScheduleConfig(generations=(50, 100, 400, 800)), 1000) == [50, 100, 400, 800]
    assert applications(ScheduleConfig(), 100) == []
    assert applications(ScheduleConfig(every=1), 3) == [1, 2], "generation 0 is random"
    assert applications(ScheduleConfig(every=5, generations=(7,)), 20) == [7], "a list has the last word"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"schedule": {"every": 0}}, "refiner.schedule.every must be an integer of at least 1"),
        (
            {"schedule": {"generations": [0]}},
            "refiner.schedule.generations must be a list of integers of at least 1",
        ),
        ({"schedule": {"generations": 50}}, "refiner.schedule.generations must be a list"),
        ({"schedule": {"often": 1}}, "refiner.schedule.often is unknown"),
        ({"schedule": 40}, "refiner.schedule must be a section"),
        (
            {"ppo": {"update_timesteps": 10, "max_timesteps": 5}},
            "refiner.ppo.update_timesteps must be at most refiner.ppo.max_timesteps, 5",
        ),
        (
            {"ppo": {"gamma": 1.5}},
            "refiner.ppo.gamma must be a number from 0 to 1, because it is a discount factor",
        ),
        ({"ppo": {"lr_actor": 0}}, "refiner.ppo.lr_actor must be a finite number above 0"),
        ({"ppo": {"leaf_sd": -0.1}}, "refiner.ppo.leaf_sd must be a finite number of at least 0"),
        ({"ppo": {"critic_hidden": [64, "b"]}}, "refiner.ppo.critic_hidden must be a list of integers"),
        ({"ppo": {"source": "replay"}}, "refiner.ppo.source must be one of auto, collector, fused"),
    ],
)
def test_settings_of_ppo_are_checked(values, message):
    with pytest.raises(ConfigError, match=message.replace(".", r"\.")):
        Config.from_mapping({**VALUES, "refiner": values})


def test_a_schedule_survives_the_way_through_yaml():
    config = Config.from_mapping(
        {**VALUES, "refiner": {"name": "thesis", "schedule": {"generations": [50, 100]}}}
    )
    assert config.refiner.schedule == ScheduleConfig(generations=(50, 100))
    assert Config.from_mapping(yaml.safe_load(yaml.safe_dump(config.as_mapping()))) == config


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"choice": "worst"}, "refiner.choice must be one of best_or_random, each_size"),
        ({"candidates": 0}, "refiner.candidates must be an integer of at least 1"),
        ({"write_back": 1}, "refiner.write_back must be true or false"),
        ({"simplify": "yes"}, "refiner.simplify must be true or false"),
        ({"probability": 1.5}, "refiner.probability must be a number from 0 to 1"),
        ({"acceptance_episodes": -1}, "refiner.acceptance_episodes must be an integer of at least 0"),
        ({"acceptance_errors": -1}, "refiner.acceptance_errors must be a finite number of at least 0"),
        ({"method": "sgd"}, "refiner.method must be one of ppo, cmaes"),
        ({"ppo": {"snapshot_episodes": -1}}, "ppo.snapshot_episodes must be an integer of at least 0"),
        ({"ppo": {"leaf_scale": 0}}, "refiner.ppo.leaf_scale must be a finite number above 0"),
        ({"ppo": {"scale_features": "no"}}, "refiner.ppo.scale_features must be true or false"),
        (
            {"ppo": {"scale_features": True, "max_timesteps": 5000, "update_timesteps": 3000}},
            "ppo.scale_features must be false where .* because the first batch of samples only measures",
        ),
        ({"ppo": {"alpha_final": 0}}, "refiner.ppo.alpha_final must be a finite number above 0 or null"),
        ({"ppo": {"lr_thresholds": 0}}, "ppo.lr_thresholds must be a finite number above 0 or null"),
        ({"ppo": {"optimizer": "sgd"}}, "refiner.ppo.optimizer must be one of rmsprop, adam"),
        ({"ppo": {"minibatch_size": 1}}, "ppo.minibatch_size must be an integer of at least 2 or null"),
        ({"ppo": {"entropy_final": -1}}, "ppo.entropy_final must be a finite number of at least 0 or null"),
        ({"ppo": 3}, "refiner.ppo must be a section"),
        ({"cmaes": {"episodes": 0}}, "refiner.cmaes.episodes must be an integer of at least 1"),
        ({"cmaes": {"max_seconds": 0}}, "refiner.cmaes.max_seconds must be a finite number above 0 or null"),
        ({"cmaes": {"max_timesteps": 0}}, "refiner.cmaes.max_timesteps must be an integer of at least 1"),
        ({"cmaes": {"first_step": 0}}, "refiner.cmaes.first_step must be a finite number above 0"),
    ],
)
def test_settings_beyond_the_thesis_are_checked(values, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_mapping({**VALUES, "refiner": values})


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("enabled", 1, "hall_of_fame.enabled must be true or false; got 1"),
        ("episodes", 0, "hall_of_fame.episodes must be an integer of at least 1"),
        ("keep", 0, "hall_of_fame.keep must be an integer of at least 1"),
        ("max_nodes", -1, "hall_of_fame.max_nodes must be an integer of at least 0"),
        ("neighbours", -1, "hall_of_fame.neighbours must be an integer of at least 0"),
        ("neighbours_drawn", 0, "hall_of_fame.neighbours_drawn must be an integer of at least 1"),
        ("revisits", -1, "hall_of_fame.revisits must be an integer of at least 0"),
        ("revisit_factor", 0, "hall_of_fame.revisit_factor must be an integer of at least 1"),
        ("final_keep", -1, "hall_of_fame.final_keep must be an integer of at least 0"),
        ("final_factor", 0, "hall_of_fame.final_factor must be an integer of at least 1"),
        ("final_step", 0, "hall_of_fame.final_step must be a finite number above 0"),
        ("final_patience", 0, "hall_of_fame.final_patience must be an integer of at least 1"),
        ("migrants", -1, "hall_of_fame.migrants must be an integer of at least 0"),
    ],
)
def test_settings_of_the_hall_of_fame_are_checked(key, value, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_mapping({**VALUES, "hall_of_fame": {key: value}})


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


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("moves", -1, "refiner.cmaes.moves must be an integer of at least 0"),
        ("screening_episodes", -1, "refiner.cmaes.screening_episodes must be an integer of at least 0"),
    ],
)
def test_settings_of_refinement_without_gradients_are_checked(key, value, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_mapping({**VALUES, "refiner": {"cmaes": {key: value}}})
