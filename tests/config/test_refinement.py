import pytest
import yaml
from configs_for_tests import VALUES

from ge_torchrl.config import Config, PolishConfig, ScheduleConfig
from ge_torchrl.errors import ConfigError


def test_ppo_refines_and_local_search_polishes_where_nothing_is_said():
    config = Config.from_mapping(VALUES)
    assert config.refiner.enabled
    assert (config.refiner.method, config.resolved(1e8).refiner.schedule.every) == ("ppo", 10)
    assert config.resolved(1e4).refiner.schedule.every == 3, "where steps are dear a run has few generations"
    assert config.polish.enabled
    assert not Config.from_mapping({**VALUES, "refiner": {"method": "none"}}).refiner.enabled
    assert not PolishConfig(every=0).enabled


def test_polish_has_a_schedule_of_its_own():
    assert [generation for generation in range(7) if PolishConfig(every=3).applies_to(generation)] == [3, 6]
    assert not any(map(PolishConfig(every=0).applies_to, range(7)))


def test_schedules_of_the_thesis_apply_four_three_and_four_times():
    def applications(schedule, generations):
        return [generation for generation in range(generations) if schedule.applies_to(generation)]

    assert applications(ScheduleConfig(every=40), 200) == [40, 80, 120, 160]
    assert applications(ScheduleConfig(every=15), 50) == [15, 30, 45]
    assert applications(ScheduleConfig(generations=(50, 100, 400, 800)), 1000) == [50, 100, 400, 800]
    assert applications(ScheduleConfig(every=0), 100) == []
    assert applications(ScheduleConfig(every=1), 3) == [1, 2], "generation 0 is random"
    assert applications(ScheduleConfig(every=5, generations=(7,)), 20) == [7], "a list has the last word"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"schedule": {"every": -1}}, "refiner.schedule.every must be an integer of at least 0"),
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
        ({"ppo": {"entropy_coeff": -0.1}}, "refiner.ppo.entropy_coeff must be a finite number of at least 0"),
        ({"ppo": {"critic_hidden": [64, "b"]}}, "refiner.ppo.critic_hidden must be a list of integers"),
        ({"ppo": {"straight_through": 1}}, "refiner.ppo.straight_through must be true or false"),
    ],
)
def test_settings_of_ppo_are_checked(values, message):
    with pytest.raises(ConfigError, match=message.replace(".", r"\.")):
        Config.from_mapping({**VALUES, "refiner": values})


def test_a_schedule_survives_the_way_through_yaml():
    config = Config.from_mapping({**VALUES, "refiner": {"schedule": {"generations": [50, 100]}}})
    assert config.refiner.schedule.generations == (50, 100)
    assert Config.from_mapping(config.as_mapping()) == config
    assert Config.from_mapping(yaml.safe_load(yaml.safe_dump(config.as_mapping()))) == config


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"choice": "worst"}, "refiner.choice must be one of each_size, best_or_random"),
        ({"min_nodes": 0}, "refiner.min_nodes must be an integer of at least 1"),
        ({"candidates": 0}, "refiner.candidates must be an integer of at least 1"),
        ({"write_back": 1}, "refiner.write_back must be true or false"),
        ({"acceptance_episodes": -1}, "refiner.acceptance_episodes must be an integer from 0 to 1000000"),
        ({"method": "sgd"}, "refiner.method must be one of ppo, cmaes, none"),
        ({"ppo": {"snapshot_episodes": -1}}, "ppo.snapshot_episodes must be an integer from 0 to 1000000"),
        ({"ppo": {"leaf_logit": 0}}, "refiner.ppo.leaf_logit must be a finite number above 0 or null"),
        ({"ppo": {"standardise": "no"}}, "refiner.ppo.standardise must be true or false"),
        (
            {"ppo": {"max_timesteps": 5000, "update_timesteps": 3000}},
            "ppo.standardise must be false where .* because the first batch .*; type refiner.ppo.standardise=false",
        ),
        ({"ppo": {"optimizer": "sgd"}}, "refiner.ppo.optimizer must be one of adam, rmsprop"),
        ({"ppo": {"minibatch_size": 1}}, "ppo.minibatch_size must be an integer of at least 2 or null"),
        ({"ppo": {"entropy_final": -1}}, "ppo.entropy_final must be a finite number of at least 0 or null"),
        ({"ppo": 3}, "refiner.ppo must be a section"),
    ],
)
def test_settings_beyond_the_thesis_are_checked(values, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_mapping({**VALUES, "refiner": values})


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("every", -1, "polish.every must be an integer of at least 0 or null"),
        ("max_timesteps", 0, "polish.max_timesteps must be an integer of at least 1"),
        ("episodes", 0, "polish.episodes must be an integer from 1 to 1000000"),
        ("moves", -1, "polish.moves must be an integer of at least 0"),
        ("first_step", 0, "polish.first_step must be a finite number above 0"),
        ("settling_episodes", -1, "polish.settling_episodes must be an integer from 0 to 1000000"),
    ],
)
def test_settings_of_the_polish_are_checked(key, value, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_mapping({**VALUES, "polish": {key: value}})
