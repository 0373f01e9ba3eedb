import numpy as np
import pytest

import ge_torchrl as ge
from ge_torchrl.report.evaluation import evaluate

CARTPOLE = "docs/trees/cartpole_two_decisions.json"


def test_it_measures_what_the_command_line_measures(request):
    path = request.config.rootpath / CARTPOLE
    measured = ge.evaluate(ge.load(path), episodes=30, seed=7)
    assert measured.summary == evaluate(path, 30, 7) == ge.evaluate(path, episodes=30, seed=7).summary
    assert measured.returns.shape == (30,)
    assert measured.mean == measured.returns.mean()


def test_the_interval_holds_the_mean(result):
    measured = ge.evaluate(result.controllers[1], episodes=50)
    low, high = measured.interval
    margin = 1.96 * measured.returns.std() / np.sqrt(50)
    assert (low, high) == pytest.approx((measured.mean - margin, measured.mean + margin), rel=1e-4)
    assert f"95 % interval of the mean: {low:.3f} to {high:.3f}" in repr(measured)
    assert measured._repr_markdown_().startswith("```text\nCartPole-v1: mean return")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"episodes": 0}, "episodes must be an integer from 1 to 1000000, .* got 0"),
        ({"seed": -1}, "seed must be an integer of at least 0"),
        ({"route": "fast"}, "route must be one of auto, kernel, gymnasium; got 'fast'"),
    ],
)
def test_mistakes_are_told_in_one_line(result, options, told):
    with pytest.raises(ge.UserError, match=told):
        ge.evaluate(result.champion, **options)


@pytest.mark.parametrize(
    ("controller", "options", "told"),
    [
        (3, {}, "controller must be a controller, such as result.champion gives, or the path of one; got 3"),
        ("absent.json", {}, "expected a tree's file or a run's folder; there is none at absent.json"),
        (CARTPOLE, {"episode": 3}, r"episode is no argument of evaluate, .*did you mean episodes\?$"),
    ],
)
def test_what_is_no_controller_is_told(controller, options, told):
    with pytest.raises(ge.UserError, match=told):
        ge.evaluate(controller, **options)
