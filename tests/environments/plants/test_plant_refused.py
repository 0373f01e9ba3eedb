"""Whatever is missing or wrong in a user's file is told in one line."""

import pytest
from plants_for_tests import GOOD, text_of

from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError

BY_DERIVATIVE = {
    **{name: value for name, value in GOOD.items() if name != "step"},
    "derivative": "lambda state, action: (state[1], 0.0)",
    "dt": "0.1",
    "reward": "lambda state, action: 1.0",
}


def refusal(folder, text, name="Mine"):
    (folder / "mine.py").write_text(text)
    with pytest.raises(EnvironmentFaultError) as caught:
        describe(f"mine.py:{name}")
    told = str(caught.value)
    assert "\n" not in told
    return told


@pytest.mark.parametrize("name", GOOD)
def test_what_is_missing_is_named(folder, name):
    values = {other: value for other, value in GOOD.items() if other != name}
    told = refusal(folder, text_of(values))
    assert told.startswith("mine.py:Mine")
    assert name in told


@pytest.mark.parametrize("name", ["dt", "reward"])
def test_what_a_derivative_needs_is_named(folder, name):
    values = {other: value for other, value in BY_DERIVATIVE.items() if other != name}
    assert refusal(folder, text_of(values)).startswith(f"mine.py:Mine.{name} is missing; expected features")


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"solvd_at": "3"}, "mine.py:Mine.solvd_at is unknown; expected solved_at"),
        ({"derivative": "lambda s, a: s"}, "must have a step, or else a derivative with dt and reward; got both"),
        ({"dt": "0.1"}, "Mine.dt goes with a derivative; expected a step alone"),
        ({"features": '("x",)'}, "Mine.features must name the 2 entries of the state that start has"),
        ({"features": '("x", "x")'}, "Mine.features must differ, since a tree is read by them; got x twice"),
        ({"features": '"xv"'}, "Mine.features must be names with units"),
        ({"actions": "[1, 2]"}, "Mine.actions must be names of choices"),
        ({"actions": '{"force": (1, 1)}'}, "Mine.actions must be names of choices"),
        ({"actions": '{"a": 1.0, "b": (0, 1)}'}, "Mine.actions must be names of choices"),
        ({"start": "[(1, -1), 0.0]"}, "Mine.start must hold for each entry of the state the bounds"),
        ({"start": "[]"}, "Mine.start must hold"),
        ({"max_episode_steps": "0"}, "Mine.max_episode_steps must be a number of steps; got 0"),
        ({"solved_at": '"a lot"'}, "Mine.solved_at must be a number or None; got 'a lot'"),
        ({"symmetry": "[1]"}, "Mine.symmetry must be as in env.symmetry"),
        ({"step": "3"}, "Mine.step must be a function; got 3"),
        ({"step": "lambda self, s, a: (s, 1.0, False)"}, "Mine.step must take (state, action); got (self, s, a)"),
        ({"observe": "lambda: 1"}, "Mine.observe must take (state); got ()"),
        ({"observe": "lambda s: s[0]"}, "observe must return a tuple of 2 numbers, as there are features; got float"),
        (
            {"features": '["x"]', "observe": "lambda s: s[0]"},
            "observe must return a tuple of one number, (x,), as there are features; got float",
        ),
        ({"step": "lambda s, a: (s, 1.0)"}, "step must return state, reward, terminated, where state is a tuple of 2"),
        ({"step": "lambda s, a: ((s[0], s[1], s[0]), 1.0, False)"}, "got ((float, float, float), float, bool)"),
        ({"step": "lambda s, a: (np.array(s), 1.0, False)"}, "got (array(float, 1d, C), float, bool)"),
        ({"step": "lambda s, a: (s, 'much', False)"}, "got ((float, float), str, bool)"),
        ({"step": "lambda s, a: (s, none, False)"}, "must be code that numba compiles, for ((float, float), int)"),
        ({"step": "lambda s, a: ((s[0] + 'm', s[1]), 1.0, False)"}, "add(float64, Literal[str](m)) (line 7)"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_what_came(folder, values, told):
    assert told in refusal(folder, text_of(GOOD | values))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"dt": "0"}, "Mine.dt must be a time above 0, in seconds; got 0"),
        ({"integrator": '"rk45"'}, 'Mine.integrator must be "rk4" or "euler"; got \'rk45\''),
        (
            {"derivative": "lambda s, a: s[0]"},
            "derivative must return a tuple of 2 numbers, as start has entries",
        ),
        ({"reward": "lambda s, a: s"}, "reward must return one number; got (float, float)"),
        ({"terminated": "lambda s: None"}, "terminated must return True or False; got none"),
    ],
)
def test_what_is_wrong_with_a_derivative_is_told(folder, values, told):
    assert told in refusal(folder, text_of(BY_DERIVATIVE | values))


@pytest.mark.parametrize(
    ("text", "name", "told"),
    [
        ("class Mine:\n    x = = 3\n", "Mine", "must be Python; mine.py, line 2: invalid syntax"),
        ("import nothing_of_this_name\n", "Mine", 'raised ModuleNotFoundError("No module named'),
        (text_of(GOOD), "Yours", "must name a class; got no such name; the file has Mine"),
        ("x = 3\n", "x", "must name a class; got 3; the file has no plant"),
        ("raise SystemExit\n", "Mine", "raised SystemExit() when mine.py was read"),
    ],
)
def test_a_file_that_cannot_be_read_is_told(folder, text, name, told):
    assert told in refusal(folder, text, name)


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ("return state, math.sinus(1.0), False", "AttributeError: module 'math' has no attribute 'sinus'"),
        ("import numpy\n    return state, 1.0, False", "imports go to the top of the file (line 4)"),
        (
            "from math import sin\n    return state, sin(1.0), False",
            "imports go to the top of the file (line 4)",
        ),
        ("global K\n    K += 1\n    return state, 1.0, False", "(STORE_GLOBAL) found (line 5)"),
        ("with open('a') as a:\n        return state, 1.0, False", "construct is not supported"),
    ],
)
def test_what_numba_cannot_even_read_is_told(folder, body, told):
    step = f"import math\nK = 1\ndef step_of_mine(state, action):\n    {body}\n"
    expected = f"mine.py:Mine.step must be code that numba compiles, for ((float, float), int); {told}"
    said = refusal(folder, step + text_of(GOOD | {"step": "step_of_mine"}))
    assert said.startswith(expected.partition(";")[0])
    assert said.endswith(told)


@pytest.mark.parametrize(
    "step",
    ["((s[0] + np.random.normal(), s[1]), 1.0, False)", "(s, np.random.random(), False)"],
)
def test_a_step_that_draws_is_refused_with_figures(folder, step):
    (folder / "mine.py").write_text(text_of(GOOD | {"step": f"lambda s, a: {step}"}))
    spec = describe("mine.py:Mine")
    with pytest.raises(EnvironmentFaultError) as caught:
        open_backend(spec, threads=1)
    told = str(caught.value)
    assert told.startswith("env.dynamics=mine.py:Mine must step alike")
    assert "from seed 0" in told
    assert "in the kernel and" in told
    assert "draw random numbers in start" in told


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"step": "lambda s, a: ((s[0] / 0.0, s[1]), 1.0, False)"}, "infinite or no number"),
        ({"step": "lambda s, a: (s, np.nan, False)"}, "reward nan"),
        ({"observe": "lambda s: (s[0], np.log(-1.0))"}, "what is observed of the first state"),
    ],
)
def test_what_is_no_number_at_once_is_told_at_the_start(folder, values, told):
    (folder / "mine.py").write_text(text_of(GOOD | values))
    spec = describe("mine.py:Mine")
    with pytest.raises(EnvironmentFaultError, match=told):
        open_backend(spec, threads=1)
