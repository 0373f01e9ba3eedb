"""Worker processes change nothing but the time, and are counted, limited and mended like one."""

import os
import subprocess
import sys
import time

import faulty_environments as faulty
import numpy as np
import pytest
from environments_for_tests import (
    ClosingEnv,
    SlowEnv,
    WalkEnv,
    register,
)
from gymnasium_for_tests import LEFT_OF_THE_MIDDLE, TREES, plain_gymnasium

from ge_torchrl.environments import backend as backend_module
from ge_torchrl.environments import gymnasium_backend
from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


def test_processes_change_nothing_and_a_fault_in_one_leaves_them_usable(open_gymnasium):
    described = describe(register(faulty.LateNaNEnv))
    alone, together = open_gymnasium(described, workers=1), open_gymnasium(described, workers=2)
    trees = Forest.stack(
        [LEFT_OF_THE_MIDDLE, leaf(0), split(0, 2.5, split(1, 0.5, leaf(0), leaf(1)), leaf(0))]
    )
    for _ in range(2):
        ours = together.evaluate(trees, np.arange(50), "fitness", visits=True)
        theirs = alone.evaluate(trees, np.arange(50), "fitness", visits=True)
        np.testing.assert_array_equal(ours.returns, theirs.returns)
        np.testing.assert_array_equal(ours.lengths, theirs.lengths)
        np.testing.assert_array_equal(ours.leaf_visits, theirs.leaf_visits)
        assert together.steps == alone.steps
        with pytest.raises(EnvironmentFaultError, match=r"NaN.*; episode seed 9999, step 2, action"):
            together.evaluate(Forest.stack([leaf(0), leaf(1)]), np.array([9999, 9999, 9999]), "faults")
        del together.steps["faults"]
    rngs = [[np.random.default_rng(r) for r in range(4)] for _ in range(2)]
    four = trees.take([0, 1, 2, 0]).trees()
    seen = [
        backend.observe(four, 90, own, "refinement")
        for backend, own in zip((together, alone), rngs, strict=True)
    ]
    np.testing.assert_array_equal(*seen)
    assert together.steps == alone.steps
    assert (together.processes, alone.processes) == (2, 1)


def test_whether_processes_paid_is_known_afterwards(open_gymnasium, monkeypatch):
    monkeypatch.setattr(gymnasium_backend, "available_cores", lambda: 2)
    backend = open_gymnasium(WalkEnv, workers=0)
    assert (backend._workers_for(100, 1.0), backend.processes) == (None, 1)
    assert backend._workers_for(100, 1e9) is not None
    assert backend.processes == 2


def test_a_module_prefix_works_in_worker_processes(open_gymnasium):
    pytest.importorskip("Box2D")
    described = describe("gymnasium:LunarLander-v3")
    forest = Forest.stack([TREES["LunarLander-v3"]])
    ours = open_gymnasium(described, workers=2).evaluate(forest, np.arange(4), "fitness")
    assert ours.returns[0].tolist() == [
        plain_gymnasium("LunarLander-v3", TREES["LunarLander-v3"], e)[0] for e in range(4)
    ]


def test_limits_and_signs_of_life_hold_in_worker_processes(open_gymnasium, monkeypatch):
    monkeypatch.setattr(gymnasium_backend, "_PROBED_STEPS", 10)
    backend = open_gymnasium(SlowEnv, workers=2)
    forest, seeds = Forest.stack([leaf(0)]), np.arange(4)
    backend.limit = Limit(max_env_steps=300)
    with pytest.raises(LimitReachedError):
        backend.evaluate(forest, seeds, "fitness")
    assert 300 < backend.steps.total() <= 310
    beats = []
    backend.on_steps = beats.append
    started = time.perf_counter()
    backend.limit = Limit(deadline=started + 3.0)
    before = backend.steps.total()
    with pytest.raises(LimitReachedError) as caught:
        backend.evaluate(forest, seeds, "fitness")
    assert caught.value.reason == "max_seconds"
    assert 3.0 <= time.perf_counter() - started < 3.5
    assert len(beats) >= 4
    assert beats == sorted(beats)
    assert backend.steps.total() > before + 300
    backend.limit = None


def test_a_worker_that_dies_is_one_line_and_later_calls_begin_anew(open_gymnasium, monkeypatch):
    monkeypatch.setenv("TEST_ENVIRONMENT_LIVES_IN", str(os.getpid()))
    backend = open_gymnasium(faulty.DyingEnv, workers=2)
    forest = Forest.stack([leaf(0)])
    with pytest.raises(EnvironmentFaultError, match=r"worker process.*died.*env\.workers=1") as caught:
        backend.evaluate(forest, np.arange(4), "fitness")
    assert "\n" not in str(caught.value)
    # So few episodes are played in this process.
    assert backend.evaluate(forest, np.arange(3), "fitness").env_steps == 9


def test_environments_in_worker_processes_are_closed(open_gymnasium, monkeypatch, tmp_path):
    monkeypatch.setenv("TEST_CLOSED_IN", str(tmp_path))
    backend = open_gymnasium(ClosingEnv, workers=2)
    backend.evaluate(Forest.stack([leaf(0)]), np.arange(200), "fitness")
    backend.close()
    assert {int(path.name) for path in tmp_path.iterdir()} - {os.getpid()}


def unpicklable():
    class LocalEnv(WalkEnv):
        pass

    return LocalEnv


def test_an_environment_that_cannot_be_sent_is_told_or_played_here(open_gymnasium, monkeypatch, caplog):
    described = describe(register(unpicklable()))
    forest = Forest.stack([leaf(0)])
    with pytest.raises(
        EnvironmentFaultError, match=r'cannot be sent to worker.*"module:Class".*env\.workers=1'
    ):
        open_gymnasium(described, workers=2)
    monkeypatch.setattr(gymnasium_backend, "_START_SECONDS", 0.0)
    monkeypatch.setattr(gymnasium_backend, "available_cores", lambda: 2)
    backend = open_gymnasium(described, workers=0)
    assert backend.evaluate(forest, np.arange(4), "fitness").env_steps > 0
    assert backend.processes == 1
    assert "running in this process alone" in caplog.text


def test_only_the_cores_of_this_process_are_counted(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7}, raising=False)
    assert backend_module.available_cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert backend_module.available_cores() == 1


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system has no affinity")
def test_on_one_core_there_is_one_worker(open_gymnasium, monkeypatch):
    """As after `taskset`: other cores are there, and are not ours."""
    monkeypatch.setattr(gymnasium_backend, "_START_SECONDS", 0.0)
    monkeypatch.setattr(gymnasium_backend, "_SEND_SECONDS", 0.0)
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        backend = open_gymnasium(WalkEnv, workers=0)
        assert backend._workers_for(100, 1e9) is None
    finally:
        os.sched_setaffinity(0, allowed)
    assert (open_gymnasium(WalkEnv, workers=0)._workers_for(100, 1e9) is None) == (len(allowed) == 1)


REGISTERING = """
import gymnasium
from environments_for_tests import WalkEnv


class RegisteringEnv(WalkEnv):
    pass


gymnasium.register("Registering-v0", "registering:RegisteringEnv")
"""


@pytest.mark.parametrize("environment_id", ["registering:Registering-v0", "Registering-v0"])
def test_a_module_that_registers_its_environment_does_so_once_in_a_worker(tmp_path, environment_id):
    """A worker begins with an empty registry, as another process does here."""
    (tmp_path / "registering.py").write_text(REGISTERING)
    program = (
        "import sys, gymnasium\n"
        "from ge_torchrl.environments.sending import unpack\n"
        "from ge_torchrl.environments.spec import make_gymnasium\n"
        "make_gymnasium(unpack(sys.stdin.buffer.read()))\n"
    )
    packing = (
        "import sys, registering\n"
        "from ge_torchrl.environments.sending import portable\n"
        "from ge_torchrl.environments.spec import describe\n"
        f"sys.stdout.buffer.write(portable(describe({environment_id!r})))\n"
    )
    path = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    packed = subprocess.run([sys.executable, "-c", packing], env=path, capture_output=True, check=True)
    done = subprocess.run(
        [sys.executable, "-c", program], env=path, input=packed.stdout, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr.decode()) == (0, "")
