import gymnasium as gym
import pytest
from environments_for_tests import CountdownEnv
from problems_for_tests import BNF, FEATURES, config_of

from ge_torchrl.errors import EnvironmentFaultError, GrammarError
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
            {"env": {"id": "Pendulum-v1", "features": (), "units": (), "actions": ()}},
            EnvironmentFaultError,
            "Discrete",
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
