import pytest

from ge_torchrl.report.thesis.published import PUBLISHED

SWEEPS = list(PUBLISHED.values())


@pytest.mark.parametrize("sweep", SWEEPS, ids=list(PUBLISHED))
def test_the_solved_runs_of_the_text_are_those_of_the_table(sweep):
    assert sum(sweep.is_solved(run) for run in sweep.runs) == sweep.solved


@pytest.mark.parametrize("sweep", SWEEPS, ids=list(PUBLISHED))
def test_ten_runs_of_seeds_0_to_9_whose_metric_is_that_of_a_whole_number_of_decisions(sweep):
    assert [run.seed for run in sweep.runs] == list(range(10))
    for run in sweep.runs:
        decisions = run.complexity_M / 17.8
        assert decisions == pytest.approx(round(decisions))
        assert 1 <= decisions <= 6


def test_numbers_as_printed():
    cartpole, acrobot, mountaincar = (
        PUBLISHED[name] for name in ("CartPole-v1", "Acrobot-v1", "MountainCar-v0")
    )
    assert [sweep.table for sweep in (cartpole, acrobot, mountaincar)] == ["4.3", "4.6", "4.9"]
    assert [sweep.solved for sweep in (cartpole, acrobot, mountaincar)] == [9, 10, 5]
    second, last = cartpole.runs[1], mountaincar.runs[-1]
    assert (second.number, second.train_fitness, second.test_mean, second.complexity_M) == (
        2,
        234.8,
        199.71,
        35.6,
    )
    assert (last.train_fitness, last.test_mean, last.complexity_M) == (-104.3, -111.75, 106.8)
    # Sums over the columns, added up by hand, find any other slip.
    assert sum(run.train_fitness for run in cartpole.runs) == pytest.approx(4734.8)
    assert sum(run.test_mean for run in cartpole.runs) == pytest.approx(4651.66)
    assert sum(run.train_fitness for run in acrobot.runs) == pytest.approx(-792.8)
    assert sum(run.test_mean for run in acrobot.runs) == pytest.approx(-852.36)
    assert sum(run.train_fitness for run in mountaincar.runs) == pytest.approx(-1078.49)
    assert sum(run.test_mean for run in mountaincar.runs) == pytest.approx(-1101.88)
    assert [(s.refinements_improved, s.refinements) for s in SWEEPS] == [(29, 40), (None, 30), (12, 39)]


def test_run_of_a_seed():
    assert PUBLISHED["CartPole-v1"].run_of_seed(3).number == 4
    assert PUBLISHED["CartPole-v1"].run_of_seed(10) is None
