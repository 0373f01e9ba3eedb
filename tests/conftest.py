"""Settings of all tests, and what several of them start from."""

import logging
import signal
import sys

import pytest
from clocks_for_tests import OwnClock
from fake_experiment_for_tests import FakeExperiment
from hypothesis import settings

import ge_torchrl.report

# `nohup make test &` ignores these, in all processes that tests start too; tests are about what they do.
for _number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, signal.default_int_handler if _number == signal.SIGINT else signal.SIG_DFL)

# The first example that meets a kernel waits for its compilation: no example may have a deadline. The same examples
# every time keep a failure from coming and going. `make test` has four minutes; `make test-all` takes the second
# profile.
settings.register_profile("quick", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("thorough", deadline=None, derandomize=True, max_examples=200)
settings.load_profile("quick")


@pytest.fixture
def experiment(tmp_path, monkeypatch):
    """Stand in for running and evaluating, in an empty working directory."""
    fake = FakeExperiment()
    for name in ("run.experiment", "run.plan", "report.evaluation"):
        monkeypatch.setitem(sys.modules, f"ge_torchrl.{name}", fake)
    monkeypatch.setattr(ge_torchrl.report, "evaluation", fake, raising=False)
    monkeypatch.chdir(tmp_path)
    return fake


@pytest.fixture
def own_clock():
    """Let seconds be those of this process alone, and sleeping cost none of anyone's."""
    with OwnClock().ticking() as clock:
        yield clock


@pytest.fixture
def tried(record_property):
    """Count what a test tried and what was lost, for the end of the run: `tried("kills of runs", 20, 0)`."""

    def count(what, n_tried, n_lost):
        record_property("tried", [what, n_tried, n_lost])

    return count


def pytest_terminal_summary(terminalreporter):
    """Print what was tried, of all reports: they come from other processes too."""
    counts = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            for name, value in getattr(report, "user_properties", ()):
                if name == "tried" and report.when == "call":
                    what, n_tried, n_lost = value
                    before = counts.get(what, (0, 0))
                    counts[what] = before[0] + n_tried, before[1] + n_lost
    if counts:
        terminalreporter.section("reliability")
        for what, (n_tried, n_lost) in sorted(counts.items()):
            terminalreporter.line(f"{what}: {n_tried:,} tried, {n_lost:,} lost")


@pytest.fixture(autouse=True)
def own_log_handlers():
    """Take away what a test hung on the root logger: its stream is closed when the next one logs."""
    before = set(logging.root.handlers)
    yield
    for handler in set(logging.root.handlers) - before:
        if type(handler) is logging.StreamHandler:
            logging.root.removeHandler(handler)


@pytest.fixture(autouse=True, scope="session")
def own_state(tmp_path_factory):
    """Let runs remember in a folder of the tests what code they ran."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield
