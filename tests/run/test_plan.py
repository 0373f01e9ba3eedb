import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import pytest
from environments_for_tests import CountdownEnv, EndlessEnv, StillEnv, UnseededEnv, register
from problems_for_tests import BNF, FEATURES, config_of

from ge_torchrl.config import Config
from ge_torchrl.errors import ConfigError, EnvironmentFaultError, GrammarError
from ge_torchrl.run.plan import plan


def test_a_plan_knows_the_environment_and_its_grammar():
    config = config_of()
    planned = plan(config)
    assert planned.config is config
    assert (planned.spec.id, planned.spec.names.features, planned.spec.solved_at) == (
        "CartPole-v1",
        FEATURES,
        475,
    )
    assert planned.tables.grammar.constants[2]
    assert not planned.tables.grammar.constants[0]


@pytest.mark.parametrize(
    ("changes", "error", "told"),
    [
        ({"env": {"id": "NoSuchThing-v0"}}, EnvironmentFaultError, "NoSuchThing"),
        (
            {"env": {"id": "FrozenLake-v1", "features": (), "units": (), "actions": ()}},
            EnvironmentFaultError,
            "flat Box",
        ),
        ({"env": {"features": ("x", "y"), "units": ("", "")}}, EnvironmentFaultError, "4 features"),
        (
            {"env": {"features": ("x", "y", "z")}},
            EnvironmentFaultError,
            r"^env\.features must name the 4 features",
        ),
        ({"env": {"units": ("m",)}}, EnvironmentFaultError, r"^env\.units must name the 4 units"),
        ({"grammar": {"bnf": "\n<if> := nothing"}}, GrammarError, r"^grammar\.bnf, line 2"),
        ({"grammar": {"bnf": BNF.replace("theta_dot", "omega")}}, GrammarError, "omega"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(changes, error, told):
    with pytest.raises(error, match=told) as raised:
        plan(config_of(**changes))
    assert "\n" not in str(raised.value)


@pytest.fixture
def countdown():
    gym.register("Countdown-v0", entry_point=CountdownEnv)
    yield {"id": "Countdown-v0", "features": (), "units": (), "actions": ()}
    del gym.registry["Countdown-v0"]


def test_a_kernel_is_refused_where_there_is_none(countdown):
    grammar = {"bnf": "<a> ::= if lt(x0, [-1, 1] step 0.5) then a0 else a1"}
    assert plan(config_of(env=countdown, grammar=grammar)).spec.first_action == 5
    with pytest.raises(EnvironmentFaultError, match=r"env\.route=kernel"):
        plan(config_of(env={**countdown, "route": "kernel"}, grammar=grammar))
    plan(config_of(env={"route": "kernel"}))


def any_environment(environment_id, **settings):
    return config_of(
        env={"id": environment_id, "features": (), "units": (), "actions": (), **settings},
        grammar={"bnf": None},
    )


@pytest.mark.parametrize("environment_id", ["CartPole-v1", "MountainCar-v0"])
def test_a_grammar_is_made_where_none_is_given_and_the_configuration_holds_it(environment_id):
    planned = plan(any_environment(environment_id))
    assert planned.config.grammar.name == "generated"
    again = plan(planned.config)
    assert again.config is planned.config
    assert again.tables.grammar == planned.tables.grammar
    assert plan(any_environment(environment_id)).config == planned.config


def test_an_environment_without_a_limit_gets_one_and_a_word_about_it():
    planned = plan(any_environment(register(EndlessEnv)))
    assert planned.config.env.max_episode_steps == planned.spec.names.max_episode_steps == 1000
    (note,) = planned.notes
    assert note == (
        "TestEndlessEnv-v0 sets no episode limit: its episodes are truncated after 1000 steps "
        "(env.max_episode_steps sets another limit)."
    )
    given = plan(any_environment(register(EndlessEnv), max_episode_steps=70))
    assert (given.spec.max_episode_steps, given.notes) == (70, ())


def test_an_environment_that_ignores_its_seeds_is_told():
    (note,) = plan(any_environment(register(UnseededEnv), max_episode_steps=50)).notes
    assert note.startswith("TestUnseededEnv-v0 ignores reset(seed=...)")


def test_an_old_version_beside_a_newer_one_is_told_once_and_in_our_words():
    for version in (0, 1):
        gym.register(f"Renewed-v{version}", CountdownEnv, max_episode_steps=10)
    # Gymnasium's own warning would be an error here.
    with warnings.catch_warnings():
        notes = plan(any_environment("Renewed-v0")).notes
        n_filters = len(warnings.filters)
        assert plan(any_environment("Renewed-v0")).notes == notes
        assert len(warnings.filters) == n_filters
    assert notes == ("Renewed-v0 is an old version of this environment; the newest is env.id=Renewed-v1.",)
    assert plan(any_environment("Renewed-v1")).notes == ()


def test_a_wrapper_that_carries_state_is_told_and_not_the_environment():
    wrapper = "gymnasium.wrappers:NormalizeObservation"
    (note,) = plan(any_environment("CartPole-v1", wrappers=(wrapper,))).notes
    assert note.startswith(
        f"env.wrappers: {wrapper} carries state from one episode to the next in CartPole-v1: the same seed gives"
    )


def test_a_mirror_that_the_environment_does_not_have_is_refused_with_figures():
    mirror = {"negate": list(FEATURES), "actions": {"left": "right"}}
    assert plan(config_of(env={"symmetry": mirror})).mirror is not None
    with pytest.raises(
        ConfigError, match=r"^env\.symmetry does not hold: .* type env\.symmetry=null to do without$"
    ) as raised:
        plan(config_of(env={"symmetry": {**mirror, "negate": FEATURES[:3]}}))
    assert "\n" not in str(raised.value)


def test_a_mirror_that_a_plant_declares_is_done_without_where_settings_say_so(monkeypatch):
    monkeypatch.chdir(Path(__file__).resolve().parents[2])
    env = {"id": "docs/examples/plant.py:Cart", "features": (), "units": (), "actions": (), "solved_at": None}
    config = config_of(env=env, grammar={"bnf": None})
    planned = plan(config)
    assert planned.mirror is not None
    assert "negate" in planned.config.env.symmetry
    without = plan(replace(config, env=replace(config.env, symmetry=None)))
    assert without.mirror is None
    again = Config.from_mapping(without.config.as_mapping())
    assert plan(again).mirror is None, "what a run's config.yaml holds does without, too"


def test_a_feature_that_does_not_vary_is_not_tested():
    bnf = plan(any_environment(register(StillEnv))).config.grammar.bnf
    assert "lt(x0, " in bnf
    assert "lt(x1, " not in bnf


@pytest.mark.parametrize(
    ("asked", "splits", "leaves", "is_made"),
    [
        ({}, "axis", "action", False),
        ({"splits": "axis"}, "axis", "action", False),
        ({"splits": "oblique"}, "oblique", "action", True),
        ({"bnf": None, "splits": "oblique", "leaves": "action"}, "oblique", "action", True),
    ],
)
def test_the_grammar_is_of_the_kind_that_is_asked_for(asked, splits, leaves, is_made):
    planned = plan(config_of(grammar=asked))
    assert (planned.tables.grammar.splits, planned.tables.grammar.leaves) == (splits, leaves)
    assert (planned.config.grammar.bnf != BNF) == is_made
    again = plan(planned.config)
    assert again.config.grammar == planned.config.grammar, (
        "what a run's config.yaml holds makes the same grammar"
    )


@pytest.mark.parametrize(
    ("asked", "leaves"), [(None, "linear"), ("linear", "linear"), ("constant", "constant")]
)
def test_an_environment_of_box_actions_gets_leaves_of_values(asked, leaves):
    env = {"id": "Pendulum-v1", "features": (), "units": (), "actions": (), "solved_at": None}
    planned = plan(config_of(env=env, grammar={"bnf": None, "leaves": asked}))
    assert (planned.tables.grammar.splits, planned.tables.grammar.leaves) == ("axis", leaves)


def test_leaves_that_the_actions_do_not_fit_are_refused():
    with pytest.raises(GrammarError, match=r"grammar\.leaves"):
        plan(config_of(grammar={"leaves": "linear"}))
