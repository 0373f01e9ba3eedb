"""A call of an environment that does not come back is one line, with its place; no process outlives it."""

import gc
import logging
import os
import time
from dataclasses import replace

import hanging_environments as hanging
import numpy as np
import pytest
from environments_for_tests import register

from ge_torchrl.environments import hangs, worker_faults
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.vector_env import VectorEnvironment
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

FOREST = Forest.stack([DecisionTree.leaf(0)])
TOLD = r"must return from every call within 0\.3 s, as env\.step_seconds sets it; one has not"


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(hangs, "_LOOK_SECONDS", 0.05)
    monkeypatch.setattr(hangs, "GRACE_SECONDS", 0.3)
    monkeypatch.setattr(worker_faults, "GRACE_SECONDS", 0.3)


def hung(kind, seconds=0.3):
    return replace(describe(register(kind)), step_seconds=seconds)


def played(backend, seeds=(1, hanging.HANGS_IN)):
    return backend.evaluate(FOREST, np.array(seeds), "fitness")


@pytest.mark.parametrize(
    ("kind", "step", "action"),
    [
        (hanging.HangingEnv, 1, r", action 0 \(a0\)"),
        (hanging.TwistingEnv, 1, r", action 0 \(a0\)"),
        (hanging.HangingInResetEnv, 0, ""),
    ],
)
def test_a_call_that_does_not_come_back_is_told_with_its_place_and_later_ones_go_on(
    open_gymnasium, kind, step, action
):
    backend = open_gymnasium(hung(kind))
    with pytest.raises(
        EnvironmentFaultError, match=rf"{TOLD}; episode seed 9999, step {step}{action}$"
    ) as caught:
        played(backend)
    assert "\n" not in str(caught.value)
    assert played(backend, [1, 2]).env_steps == 6


def test_an_environment_that_is_not_made_is_told(open_gymnasium):
    with pytest.raises(EnvironmentFaultError, match=TOLD):
        open_gymnasium(hung(hanging.HangingAsItIsMadeEnv))


def test_an_environment_that_does_not_close_is_told_and_left(open_gymnasium, caplog):
    backend = open_gymnasium(hung(hanging.HangingAtTheEndEnv))
    backend.close()
    assert "must return from every call within 0.3 s" in caplog.text


def test_where_nothing_interrupts_it_that_is_said_and_who_comes_back_late_goes_on(open_gymnasium, caplog):
    backend = open_gymnasium(hung(hanging.DeafEnv))
    with caplog.at_level(logging.WARNING):
        assert played(backend).env_steps == 6
    (told,) = caplog.messages
    assert told.endswith("step 1, action 0 (a0), and cannot be interrupted")
    time.sleep(0.2)
    assert not backend._runner.border.is_hung


def test_who_is_closed_is_watched_no_more_and_the_thread_ends(open_gymnasium):
    backend = open_gymnasium(hung(hanging.HangingEnv))
    assert hangs._Watch.thread.is_alive()
    thread = hangs._Watch.thread
    backend.close()
    gc.collect()
    thread.join(10)
    assert not thread.is_alive()
    assert hangs._Watch.thread is None


def test_slow_calls_are_none_that_hang(open_gymnasium):
    backend = open_gymnasium(hung(hanging.DeafEnv, 5.0))
    assert played(backend).env_steps == 6


def test_ctrl_c_is_no_hang(open_gymnasium, monkeypatch):
    def pressed(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(hanging.HangingEnv, "hang", pressed)
    with pytest.raises(KeyboardInterrupt):
        played(open_gymnasium(hung(hanging.HangingEnv)))


def are_gone(processes):
    for _ in range(50):
        if not any(os.path.exists(f"/proc/{process}") for process in processes):  # noqa: PTH110
            return True
        time.sleep(0.1)
    return False


@pytest.fixture
def workers_hang(monkeypatch):
    monkeypatch.setenv("TEST_ENVIRONMENT_LIVES_IN", str(os.getpid()))

    def by(how):
        monkeypatch.setenv("TEST_HANGS_BY", how)

    return by


def test_workers_that_hang_are_told_and_none_outlives_it(workers_hang, monkeypatch):
    monkeypatch.setattr("ge_torchrl.environments.gymnasium_workers._STOP_SECONDS", 0.5)
    workers_hang("Python")
    backend = GymnasiumBackend(hung(hanging.ElsewhereEnv, 1.0), 2)
    try:
        with pytest.raises(EnvironmentFaultError, match=r"within 1 s.*; episode seed \d, step 1, action 0"):
            played(backend, range(4))
        processes = list(backend._pool._pool._processes)
    finally:
        backend.close()
    assert are_gone(processes)


def test_compiled_code_that_keeps_the_interpreter_in_a_worker_is_told_and_killed(workers_hang, monkeypatch):
    monkeypatch.setattr("ge_torchrl.environments.gymnasium_workers._STOP_SECONDS", 0.5)
    workers_hang("the interpreter's lock")
    backend = GymnasiumBackend(hung(hanging.ElsewhereEnv, 2.0), 2)
    try:
        with pytest.raises(EnvironmentFaultError, match=r"within 2 s.*in compiled code of a worker process"):
            played(backend, range(4))
        processes = list(backend._pool._pool._processes)
    finally:
        backend.close()
    assert are_gone(processes)


def test_copies_that_step_in_another_process_are_told_too(workers_hang):
    workers_hang("compiled code")
    copies = VectorEnvironment(hung(hanging.ElsewhereEnv, 1.0), [np.random.default_rng(n) for n in (0, 1)], 2)
    try:
        copies.reset()
        copies.step(np.zeros(2, np.int64))
        with pytest.raises(EnvironmentFaultError, match=r"within 1 s.*; episode seed \d+, step 1, action 0"):
            copies.step(np.zeros(2, np.int64))
        process = copies._others[0]._process.pid
    finally:
        copies.close()
    assert are_gone([process])
