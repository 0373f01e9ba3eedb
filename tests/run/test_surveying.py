"""What is found out about an environment, and the file to begin with."""

import pytest
import yaml
from environments_for_tests import BreakoutEnv, EndlessEnv, UnseededEnv, register
from problems_for_tests import config_of

from ge_torchrl.config import Config
from ge_torchrl.errors import ArtefactError, GrammarError
from ge_torchrl.run.plan import plan
from ge_torchrl.run.starting_file import starting_name, write_starting_file
from ge_torchrl.run.surveying import survey


def bare(environment_id, **settings):
    env = {"id": environment_id, "features": (), "units": (), "actions": (), "solved_at": None, **settings}
    return config_of(env=env, grammar={"bnf": None})


def test_a_survey_tells_spaces_names_limit_and_routes():
    found = survey(bare("MountainCar-v0", features=("position", "velocity"), units=("m", "m/s")))
    assert found.agrees
    assert found.obeys_seeds
    assert found.speeds.keys() == {"Gymnasium in one process", "kernel"}
    text = found.as_text()
    for line in (
        "MountainCar-v0",
        "observation   2 numbers",
        "action        one of 3: a0, a1, a2",
        "limit         200 steps",
        "solved at     a mean return of -110",
        "seeds         obeyed: the same seed gives the same episode",
        "bounds        kept in 3000 steps",
        "kernel        used",
    ):
        assert line in text.splitlines()
    rows = [line.split() for line in text.splitlines()]
    (velocity,) = (row for row in rows if row[:1] == ["velocity"])
    assert velocity[1:5] == ["m/s", "-0.07", "to", "0.07"]
    assert velocity[-3:] == ["-0.07", "to", "0.07"]


def test_a_survey_tells_what_is_not_as_it_should_be():
    text = survey(bare(register(UnseededEnv), max_episode_steps=60)).as_text()
    assert "seeds         ignored" in text
    assert "kernel        none for this environment as it is" in text
    text = survey(bare(register(EndlessEnv))).as_text()
    assert "limit         none of its own; an episode did not end; a run takes 1000 steps" in text
    text = survey(bare(register(BreakoutEnv))).as_text()
    assert "bounds        untrue: x1" in text


def test_a_survey_tells_which_wrapper_carries_state():
    wrapper = "gymnasium.wrappers:NormalizeReward"
    text = survey(bare("Pendulum-v1", wrappers=(wrapper,))).as_text()
    told = f"seeds         not obeyed: env.wrappers: {wrapper} carries state from one episode to the next"
    assert told in text.splitlines()


def test_one_number_is_one():
    text = survey(bare("Pendulum-v1")).as_text()
    assert "action        1 number: a0 from -2 to 2" in text.splitlines()


@pytest.mark.parametrize(
    ("negated", "said"),
    [
        (["x0", "x1", "x2", "x3"], "mirror        holds: "),
        (["x2", "x3"], "mirror        does not hold: in the mirror of (x0 = "),
    ],
)
def test_a_survey_tells_of_a_declared_mirror(negated, said):
    text = survey(bare("CartPole-v1", symmetry={"negate": negated, "actions": {"a0": "a1"}})).as_text()
    assert any(line.startswith(said) for line in text.splitlines())


@pytest.mark.parametrize("look", [survey, plan])
@pytest.mark.parametrize(
    ("features", "actions", "told"),
    [
        (("θ", "v"), ("l", "r"), "mine.py:Mine.features: a name stands in the grammar's text, .*; got 'θ'"),
        (("x", "v"), ("go left", "r"), "mine.py:Mine.actions: a name stands in .*; got 'go left'"),
        (("x", "v"), ("x", "r"), "mine.py:Mine: names of features and actions must differ .*'x' comes twice"),
    ],
)
def test_names_that_no_grammar_can_have_are_told_by_check_and_run(
    tmp_path, monkeypatch, look, features, actions, told
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        f"class Mine:\n    features, actions = {features}, {actions}\n"
        "    start, max_episode_steps = [(-1, 1), 0.0], 9\n"
        "    def step(state, action):\n        return state, 1.0, False\n"
    )
    with pytest.raises(GrammarError, match=rf"^{told}$"):
        look(bare("mine.py:Mine"))
    given = {"features": ("x y", "v"), "actions": ("l", "r")}
    with pytest.raises(GrammarError, match=r"^env\.features: a name stands in .*; got 'x y'$"):
        look(bare("mine.py:Mine", **given))


def test_a_survey_tells_arguments_and_wrappers():
    settings = {"kwargs": {"goal_velocity": 0.05}, "wrappers": ("environments_for_tests:DoubledReward",)}
    text = survey(bare("MountainCar-v0", **settings)).as_text()
    assert "arguments     goal_velocity=0.05" in text
    assert "wrappers      environments_for_tests:DoubledReward" in text
    assert "kernel        none" in text


@pytest.mark.parametrize(
    ("environment_id", "taken", "name"),
    [
        ("LunarLander-v3", (), "lunarlander"),
        ("LunarLander-v3", ("lunarlander",), "my_lunarlander"),
        ("ale_py:ALE/Pong-v5", ("pong",), "ale_pong"),
        ("Thing", (), "thing"),
    ],
)
def test_the_file_is_called_as_the_environment(environment_id, taken, name):
    assert starting_name(environment_id, taken) == name


def test_the_file_holds_what_a_run_would_take(tmp_path):
    planned = plan(bare("MountainCar-v0", kwargs={"goal_velocity": 0.05}, max_episode_steps=300))
    path = write_starting_file(planned, tmp_path, "hill")
    assert path == tmp_path / "env" / "hill.yaml"
    text = path.read_text()
    assert text.startswith("# @package _global_\n")
    assert f"--config-dir {tmp_path} env=hill" in text
    values = yaml.safe_load(text)
    again = plan(Config.from_mapping(values))
    assert again.spec.names == planned.spec.names
    assert again.spec.solved_at == -110
    assert again.tables.grammar == planned.tables.grammar
    with pytest.raises(ArtefactError, match="is there already"):
        write_starting_file(planned, tmp_path, "hill")


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtefactError, match="cannot write the file"):
        write_starting_file(plan(config_of()), tmp_path / "file", "hill")
