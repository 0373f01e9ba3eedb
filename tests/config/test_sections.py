import dataclasses

import numpy as np
import pytest
from configs_for_tests import VALUES, config_with
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.config import Config, EnvironmentConfig, EvaluationConfig, GEConfig
from ge_torchrl.errors import ConfigError


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        (
            "ge",
            "population_size",
            1,
            "ge.population_size must be an integer of at least 2 or null, because selection compares .*; got 1",
        ),
        ("ge", "population_size", True, "ge.population_size must be an integer .* got true"),
        ("ge", "population_size", 2.5, "ge.population_size must be an integer .* got 2.5"),
        ("ge", "population_size", "20", "ge.population_size must be an integer .* got '20'"),
        ("ge", "generations", None, "ge.generations must be an integer .* got null"),
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
            "ge.mutation_probability must be a number from 0 to 1.*; got true",
        ),
        ("ge", "tournament_size", 0, "ge.tournament_size must be an integer of at least 1"),
        ("ge", "wraps", -1, "ge.wraps must be an integer of at least 0"),
        (
            "ge",
            "tournament_size",
            11,
            "ge.tournament_size must be at most ge.population_size, 10, because .*; got 11; type ge.tournament_size=10",
        ),
        (
            "ge",
            "population_size",
            2_000_000_000,
            r"ge.population_size must be at most 107374182 with ge.genotype_length=20, because .*; got 2000000000",
        ),
        (
            "ge",
            "genotype_length",
            1e10,
            r"ge.genotype_length must be an integer of at least 1, .*; it may be at most 10000000",
        ),
        ("ge", "stop_when_solved", "yes", "ge.stop_when_solved must be true or false; got 'yes'"),
        ("ge", "parsimony", "some", "ge.parsimony must be one of lexicographic, none; got 'some'"),
        ("ge", "max_seconds", 0, "ge.max_seconds must be a finite number above 0 or null; got 0"),
        ("ge", "max_env_steps", -1, "ge.max_env_steps must be an integer of at least 0 or null"),
        ("env", "id", " ", "env.id must be a Gymnasium id such as CartPole-v1; got ' '"),
        ("env", "id", "???", "env.id has no value; expected a Gymnasium id such as CartPole-v1; got nothing"),
        ("env", "features", "x", "env.features must be a list of names that differ .*; got 'x'"),
        ("env", "features", [1], r"env.features must be a list of names .*; got \[1\]"),
        ("env", "features", ("a", "a"), r"env.features must be a list of names .*; got \['a', 'a'\]"),
        ("env", "units", [1], r"env.units must be a list of texts; got \[1\]"),
        ("env", "features", ["x", "x"], "env.features must be a list of names that differ from each other"),
        ("env", "actions", ["left", ""], "env.actions must be a list of names that differ from each other"),
        ("env", "kwargs", 3, "env.kwargs must be keys with values, such as {gravity: -5}; got 3"),
        ("env", "kwargs", {"g": float("nan")}, "env.kwargs must be keys with values"),
        ("env", "kwargs", {"g": {1: 2}}, "env.kwargs must be keys with values"),
        ("env", "kwargs", {"g": "???"}, "env.kwargs must be keys with values"),
        ("env", "wrappers", "gymnasium.wrappers:ClipAction", "env.wrappers must be a list of texts"),
        ("env", "solved_at", float("inf"), "env.solved_at must be a finite number or null; got inf"),
        (
            "env",
            "lowest_return",
            "low",
            "env.lowest_return must be a finite number or null",
        ),
        ("env", "route", "fast", "env.route must be one of auto, kernel, gymnasium; got 'fast'"),
        (
            "env",
            "route",
            "compiled",
            "env.route must be one of .*; got 'compiled'; compiled is now called kernel",
        ),
        ("env", "max_episode_steps", 0, "env.max_episode_steps must be an integer of at least 1 or null"),
        ("env", "workers", -1, "env.workers must be an integer from 0 to 1024"),
        ("grammar", "bnf", "", "grammar.bnf must be rules in Backus-Naur form or null; got ''"),
        ("grammar", "name", 3, "grammar.name must be the name of the grammar; got 3"),
        ("evaluation", "episodes", 0, "evaluation.episodes must be an integer from 1 to 1000000"),
        (
            "evaluation",
            "episode_seeds",
            "new",
            "evaluation.episode_seeds must be one of common, fixed, fresh",
        ),
        (
            "evaluation",
            "validation_episodes",
            0,
            "evaluation.validation_episodes must be an integer from 1 to 1000000",
        ),
        ("evaluation", "test_episodes", 0, "evaluation.test_episodes must be an integer from 1 to 1000000"),
        (
            "evaluation",
            "test_episodes",
            2e13,
            "evaluation.test_episodes must be .* 1000000 .*memory.*; got 2",
        ),
        ("evaluation", "std_penalty", -0.5, "evaluation.std_penalty must be a finite number of at least 0"),
        (
            "evaluation",
            "steps_per_second",
            0,
            "evaluation.steps_per_second must be a finite number above 0 or null",
        ),
        ("evaluation", "threads", -1, "evaluation.threads must be an integer from 0 to 1024"),
    ],
)
def test_wrong_value_is_named_with_what_was_expected(section, key, value, message):
    with pytest.raises(ConfigError, match=f"^{message}"):
        config_with(section, key, value)


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


@given(st.integers(2, 10**5), st.integers(1, 10**4), st.integers(1, 10**4), st.floats(0, 1))
def test_everything_within_its_range_is_accepted(population_size, generations, genotype_length, probability):
    config = GEConfig(
        population_size,
        generations,
        genotype_length,
        gene_probability=probability,
        crossover_probability=probability,
        mutation_probability=probability,
    )
    assert dataclasses.astuple(config)[:4] == (population_size, generations, genotype_length, probability)


def test_units_may_be_blank_and_alike():
    environment = EnvironmentConfig(id="E-v0", features=("a", "b"), units=("", ""))
    assert environment.units == ("", "")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("episodes", 0, "archive.episodes must be an integer from 1 to 1000000"),
        (
            "keep",
            -1,
            "archive.keep must be an integer of at least 0 or null, because it counts trees; 0 keeps no archive",
        ),
        ("max_nodes", -1, "archive.max_nodes must be an integer of at least 0"),
        ("neighbours", -1, "archive.neighbours must be an integer of at least 0"),
        ("neighbours_drawn", 0, "archive.neighbours_drawn must be an integer of at least 1"),
        ("revisit_factor", -1, "archive.revisit_factor must be an integer of at least 0"),
        ("final_keep", -1, "archive.final_keep must be an integer of at least 0"),
        ("final_factor", 0, "archive.final_factor must be an integer of at least 1"),
        ("final_step", 0, "archive.final_step must be a finite number above 0"),
        ("final_patience", 0, "archive.final_patience must be an integer of at least 1"),
        ("migrants", -1, "archive.migrants must be an integer of at least 0"),
    ],
)
def test_settings_of_the_archive_are_checked(key, value, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_mapping({**VALUES, "archive": {key: value}})


@pytest.mark.parametrize(
    ("section", "key"), [(EvaluationConfig, "evaluation.threads"), (EnvironmentConfig, "env.workers")]
)
def test_threads_and_processes_are_as_many_as_the_largest_machines_have_cores(section, key):
    name, given = key.partition(".")[2], {"id": "E-v0"} if section is EnvironmentConfig else {}
    assert getattr(section(**given, **{name: 1024}), name) == 1024
    with pytest.raises(ConfigError, match=rf"^{key} must be an integer from 0 to 1024, because it counts"):
        section(**given, **{name: 1025})
