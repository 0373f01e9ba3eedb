"""Who waits is told how far it is: not at once, ever more rarely, and never more than a minute apart."""

import pytest

from ge_torchrl.cli import waiting
from ge_torchrl.cli.waiting import HowFar


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(waiting.time, "perf_counter", lambda: now[0])
    return now


def told_at(how_far, clock, capsys, seconds, in_all=1000):
    """Return the seconds at which something was said, one thing a second done."""
    said, began = [], clock[0]
    for second in range(1, seconds + 1):
        clock[0] = began + second
        how_far(second, in_all)
        if told := capsys.readouterr().err:
            said.append((second, told))
    return said


def test_what_is_quick_is_done_without_a_word(clock, capsys):
    assert told_at(HowFar("episodes"), clock, capsys, 1) == []
    how_far = HowFar("episodes")
    clock[0] = 100.0
    how_far(10, 10)
    assert capsys.readouterr().err == ""


def test_it_is_told_ever_more_rarely_and_once_a_minute_at_least(clock, capsys):
    said = told_at(HowFar("episodes"), clock, capsys, 400)
    assert [second for second, _ in said] == [2, 4, 8, 16, 32, 64, 124, 184, 244, 304, 364]
    assert said[0][1] == "ge-torchrl: 2 of 1,000 episodes\n"
    assert said[2][1] == "ge-torchrl: 8 of 1,000 episodes, 16 min 32 s left\n"


def test_a_second_task_is_reckoned_by_itself(clock, capsys):
    how_far = HowFar("runs read")
    told_at(how_far, clock, capsys, 100, in_all=100)
    said = told_at(how_far, clock, capsys, 10, in_all=100)
    assert said[-1] == (9, "ge-torchrl: 9 of 100 runs read, 1 min 31 s left\n")
