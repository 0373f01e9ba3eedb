import dataclasses

import pytest
import yaml
from configs_for_tests import VALUES, config_with

from ge_torchrl.config import (
    ArchiveConfig,
    Config,
    EnvironmentConfig,
    EvaluationConfig,
    GEConfig,
    GrammarConfig,
    PolishConfig,
    RefinerConfig,
    StartsConfig,
    check_group,
    check_key,
    template,
)
from ge_torchrl.errors import ConfigError

PROPOSALS = ("neighbours", "revisit_factor", "migrants", "final_keep")


def test_what_is_not_given_takes_the_defaults_of_its_section():
    config = Config.from_mapping(VALUES).resolved(1e8)
    assert dataclasses.replace(
        config, evaluation=dataclasses.replace(config.evaluation, steps_per_second=None)
    ) == Config(
        env=EnvironmentConfig(id="CartPole-v1"),
        grammar=GrammarConfig(name="tiny", bnf="<dt> ::= left | right"),
        ge=GEConfig(population_size=10, generations=3, genotype_length=20, gene_probability=0.1),
        evaluation=EvaluationConfig(episodes=5),
        refiner=RefinerConfig(),
        polish=PolishConfig(),
        archive=ArchiveConfig(),
        starts=StartsConfig(max_timesteps=3_000_000),
        seed=0,
    )


@pytest.mark.parametrize(
    ("speed", "keep", "neighbours", "every", "validation", "limit"),
    [(1e8, 8, 26, 1, 5000, None), (1e6, 8, 26, 1, 5000, None), (20_123, 3, 0, 0, 200, 3_600_000)],
)
def test_what_is_left_open_follows_the_speed(speed, keep, neighbours, every, validation, limit):
    config = Config.from_mapping(VALUES).resolved(speed)
    assert (config.archive.keep, config.archive.neighbours, config.polish.every) == (keep, neighbours, every)
    assert (config.evaluation.validation_episodes, config.ge.max_env_steps) == (validation, limit)
    assert config.evaluation.episodes == 5, "what was given stays"
    assert config.evaluation.steps_per_second == float(f"{speed:.2g}")
    assert config.resolved(speed) == config
    assert config.resolved(config.evaluation.steps_per_second) == config, "as from the run's own config.yaml"
    assert Config.from_mapping(config.as_mapping()) == config


def test_trees_are_raced_where_steps_are_dear_and_there_is_an_archive_to_keep_them():
    assert Config.from_mapping(VALUES).resolved(1e8).archive.races == 0
    assert Config.from_mapping(VALUES).resolved(1e4).archive.races > 0
    assert Config.from_mapping({**VALUES, "archive": {"keep": 0}}).resolved(1e4).archive.races == 0


def test_arguments_of_the_environment_are_the_users_own_keys():
    given = {"gravity": -5, "map": ["SF", "FG"], "wind": {"power": 1.5, "on": True, "from": None}}
    config = config_with("env", "kwargs", given)
    assert config.env.kwargs == given
    assert Config.from_mapping(config.as_mapping()) == config
    assert config != config_with("env", "kwargs", {})
    assert len({config.env, config_with("env", "kwargs", {}).env}) == 2
    given["gravity"] = 3
    assert config.env.kwargs["gravity"] == -5
    check_key("env.kwargs.whatever.there.is")


@pytest.mark.parametrize("speed", [1e4, 1e8])
def test_nothing_is_proposed_where_nothing_would_come_of_it(speed):
    alone = {**VALUES, "refiner": {"method": "none"}, "polish": {"every": 0}}
    asked = {"neighbours": 3, "final_keep": 4}
    for values in ({**alone, "archive": asked}, {**VALUES, "archive": {"keep": 0, **asked}}):
        archive = Config.from_mapping(values).resolved(speed).archive
        assert [getattr(archive, name) for name in PROPOSALS] == [0, 0, 0, 0]
    polished = (
        Config.from_mapping({**alone, "polish": {"every": 1}, "archive": asked}).resolved(speed).archive
    )
    assert (polished.neighbours, polished.final_keep) == (3, 4)
    assert min(polished.revisit_factor, polished.migrants) > 0


def test_a_limit_that_was_given_stays_where_steps_are_dear():
    config = Config.from_mapping({**VALUES, "ge": {**VALUES["ge"], "max_seconds": 60}})
    assert config.resolved(1000).ge.max_env_steps is None
    config = Config.from_mapping({**VALUES, "ge": {**VALUES["ge"], "max_env_steps": 0}})
    assert config.resolved(1000).ge.max_env_steps == 0, "no limit, whatever steps cost"


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


def test_missing_section_is_reported_by_the_key_that_has_no_default():
    values = {name: value for name, value in VALUES.items() if name != "env"}
    with pytest.raises(ConfigError, match=r"^env\.id has no value; expected .*; got nothing$"):
        Config.from_mapping(values)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("ge.populaton_size", r"ge.populaton_size is unknown; .* such as ge.population_size; got"),
        ("evaluation.zzz", r"evaluation.zzz is unknown; .* such as evaluation.episodes, "),
        ("ge.popsize", r".* such as ge.population_size; got ge.popsize$"),
        ("popsize", r".* such as ge.population_size; got popsize$"),
        ("sed", r"sed is unknown; .* such as seed; got sed"),
        (
            "zzz",
            r"zzz is unknown; .* env, grammar, ge, evaluation, refiner, polish, archive, starts, seed, logger; got zzz",
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
    assert keys["env"]["id"] == "???"
    assert keys["evaluation"]["episode_seeds"] == "common"
    assert keys["evaluation"]["validation_episodes"] is None, "it follows the speed"
    assert keys["refiner"]["ppo"]["critic_hidden"] == [32, 32]
    for section, values in keys.items():
        check_key(section)
        for key in values if isinstance(values, dict) else ():
            check_key(f"{section}.{key}")


@pytest.mark.parametrize(
    ("key", "successor"),
    [
        ("hall_of_fame", "archive"),
        ("hall_of_fame.keep", "archive.keep"),
        ("hall_of_fame.enabled", "archive.keep, where 0 keeps no archive"),
        ("hall_of_fame.final_settling_episodes", "polish.settling_episodes"),
        ("refiner.cmaes", "polish"),
        ("refiner.cmaes.max_timesteps", "polish.max_timesteps"),
        ("refiner.name", "refiner.method"),
        ("refiner.ppo.source", "env.route"),
        ("refiner.ppo.scale_features", "refiner.ppo.standardise"),
        ("refiner.ppo.scale_critic", "refiner.ppo.standardise"),
        ("env.lowest_fitness_excluded", "env.lowest_return"),
    ],
)
def test_a_key_that_went_names_its_successor(key, successor):
    with pytest.raises(ConfigError, match=rf"^{key} is now {successor}; .*; got {key}$"):
        check_key(key)
    check_key(successor.partition(",")[0])


@pytest.mark.parametrize(
    "key",
    ["ge.elites", "ge.replacement", "ge.single_choice_consumes", "refiner.ppo.leaf_sd", "polish.max_seconds"],
)
def test_a_key_that_went_for_good_says_why(key):
    with pytest.raises(ConfigError, match=rf"^{key} is gone, because .*; got {key}$"):
        check_key(key)


def test_a_former_section_in_a_file_names_its_successor():
    with pytest.raises(ConfigError, match=r"^hall_of_fame is now archive"):
        Config.from_mapping({**VALUES, "hall_of_fame": {"keep": 3}})
    with pytest.raises(ConfigError, match=r"^refiner\.cmaes is now polish"):
        Config.from_mapping({**VALUES, "refiner": {"cmaes": {"moves": 3}}})


def test_a_group_of_choices_that_went_says_what_to_type():
    with pytest.raises(ConfigError, match=r"^hall_of_fame is no choice .* expected archive=none, or a key"):
        check_group("hall_of_fame")
    check_group("refiner")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"archive": {"neighbours_drawn": 2000}, "evaluation": {"episodes": 1_000_000}},
            r"evaluation\.episodes must be at most \d+ where 2000 trees .*; type evaluation\.episodes=\d+$",
        ),
        (
            {"polish": {"episodes": 1_000_000}},
            r"polish\.episodes must be at most 200000 with archive\.revisit_factor=5, .*; type polish\.episodes=200000",
        ),
        (
            {"refiner": {"ppo": {"snapshot_episodes": 50_000}}, "archive": {"final_factor": 100}},
            r"refiner\.ppo\.snapshot_episodes must be at most 10000 with archive\.final_factor=100, .*",
        ),
        ({"archive": {"final_factor": 10**7}}, r"archive\.final_factor must be at most 1000000, .*"),
    ],
)
def test_episodes_that_fit_into_no_memory_are_refused(values, message):
    with pytest.raises(ConfigError, match=f"^{message}"):
        Config.from_mapping({**VALUES, **values})


@pytest.mark.parametrize(
    ("ge", "steps"),
    [
        ({}, 1_100_000),
        ({"max_env_steps": 100_000}, 30_000),
        ({"max_seconds": 60}, 360_000),
        ({"max_env_steps": 0}, 1_100_000),
    ],
)
def test_races_of_dense_starts_have_their_part_of_what_a_run_may_take(ge, steps):
    config = Config.from_mapping({**VALUES, "ge": {**VALUES["ge"], **ge}})
    assert config.resolved(20_000).starts.max_timesteps == pytest.approx(steps, rel=0.05)
    given = dataclasses.replace(config, starts=StartsConfig(max_timesteps=7))
    assert given.resolved(20_000).starts.max_timesteps == 7


@pytest.mark.parametrize(
    ("ge", "most"),
    [
        ({}, 90_000),
        ({"max_env_steps": 50_000}, 50_000),
        ({"max_env_steps": 100_000}, 90_000),
        ({"max_env_steps": 0}, 0),
        ({"max_seconds": 9.0}, None),
    ],
)
@pytest.mark.parametrize("speed", [100, 20_000, 1e8])
def test_a_run_with_dense_starts_may_take_steps_of_its_own_whatever_the_speed(ge, most, speed):
    config = Config.from_mapping(
        {**VALUES, "ge": {**VALUES["ge"], **ge}, "starts": {"max_env_steps": 90_000}}
    )
    assert config.resolved(speed, has_sums=True).ge.max_env_steps == most
    assert config.resolved(20_000).ge.max_env_steps == (ge.get("max_env_steps") if ge else 3_600_000)
