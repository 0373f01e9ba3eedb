"""Ctrl-C in processes of their own, as a terminal sends it."""

import os
import pty
import signal
import subprocess
import sys
import threading
import time

import pytest
from pages_for_tests import ROOT

BEGIN = """
import ctypes, sys, threading, time
from ge_torchrl import interrupts
from ge_torchrl.interrupts import interrupt_again, last_words, leave_quietly, leave_soon

def never_return():
    # As compiled code: without the interpreter's lock, and deaf to signals.
    lock = ctypes.create_string_buffer(256)
    for _ in range(2):
        ctypes.CDLL(None).pthread_mutex_lock(lock)

def tell_when_stuck():
    main = threading.main_thread().ident
    while sys._current_frames()[main].f_code.co_name not in {"never_return", "step"}:
        time.sleep(0.01)
    time.sleep(0.3)
    print("ready", flush=True)

leave_quietly()
interrupt_again()
"""
SAVES = """
threading.Thread(target=tell_when_stuck, daemon=True).start()
with last_words(lambda: "the best tree is in a folder"):
    never_return()
"""
SAVES_NOTHING = """
interrupts._SAVING = 0.3
threading.Thread(target=tell_when_stuck, daemon=True).start()
with last_words(lambda: never_return()):
    never_return()
"""
HANGS = """
hung = "env.id=Cart-v0 must return"
threading.Timer(0.1, interrupts.interrupt, [threading.main_thread().ident, hung]).start()
print("ready", flush=True)
"""
HEARS = """
import signal

def notes(*_):
    # Raises nothing, which could come between any two lines of this script.
    interrupts._Heard.at = time.monotonic()

interrupts._interrupt = notes
signal.signal(signal.SIGINT, notes)
print("ready", flush=True)
until = time.monotonic() + 3 * interrupts._PATIENCE
while time.monotonic() < until:
    time.sleep(0.01)
"""
PLANT = """
class Spin:
    features = ("x",)
    actions = {"force": (-1.0, 1.0)}
    start = [(1.0, 2.0)]
    max_episode_steps = 100

    def step(state, force):
        x = state[0]
        while x > 0.0:
            x = x * 1.0
        return (x,), x, False
"""


def started(script, folder=None, **more):
    """Start a script that says when it is ready for Ctrl-C."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **more}
    program = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stdout.readline() == "ready\n"
    return program


def ended(program):
    """Return how it ended: status, output, errors."""
    late = threading.Timer(60, program.kill)
    late.start()
    with program:
        output, errors = program.stdout.read(), program.stderr.read()
    late.cancel()
    return program.returncode, output, errors


@pytest.mark.parametrize(
    ("script", "saved", "number"),
    [
        (SAVES, "the best tree is in a folder", signal.SIGINT),
        (SAVES, "the best tree is in a folder", signal.SIGTERM),
        (SAVES_NOTHING, "nothing was saved", signal.SIGHUP),
    ],
)
def test_code_that_does_not_return_ends_with_what_was_saved(script, saved, number):
    program = started(BEGIN + script)
    program.send_signal(number)
    told = f"ge-torchrl: interrupted in code that did not return; {saved}\n"
    assert ended(program) == (130, "", told)


@pytest.mark.parametrize(
    ("waits", "saved"),
    [
        (
            'with last_words(lambda: "the best tree is in a folder"):\n    never_return()',
            "; the best tree is in a folder",
        ),
        ("try:\n    time.sleep(60)\nexcept KeyboardInterrupt:\n    interrupts.end_hung(hung)", ""),
    ],
)
def test_a_program_that_interrupts_itself_tells_why(waits, saved):
    status, _, errors = ended(started(BEGIN + HANGS + waits))
    assert (status, errors) == (2, f"ge-torchrl: env.id=Cart-v0 must return{saved}\n")


def test_who_hears_of_ctrl_c_goes_on_however_often_it_comes():
    program = started(BEGIN + HEARS)
    for press in range(40):
        program.send_signal(signal.SIGINT)
        # Of two at once it hears once, or one comes before the one in front was heard of.
        time.sleep(0.02 if press % 2 else 0.0005)
    assert ended(program) == (0, "", "")


WAITS = """
try:
    print("ready", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_a_scheduler_or_a_terminal_sends_is_heard_as_ctrl_c(number):
    program = started(BEGIN + WAITS)
    program.send_signal(number)
    assert ended(program) == (0, "interrupted\n", "")


CLEANS_UP = """
class Slow:
    def __del__(self):
        print("ready", flush=True)
        time.sleep(60)

class HalfMade:
    def __del__(self):
        raise AttributeError("it has no handle yet")

try:
    slow = Slow()
    del slow
    time.sleep(60)
except KeyboardInterrupt:
    half_made = HalfMade()
    del half_made
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_comes_while_a_compiler_cleans_up_is_heard_and_shows_no_traceback(number):
    program = started(BEGIN + CLEANS_UP)
    program.send_signal(number)
    assert ended(program) == (0, "interrupted\n", "")


COMPILES = """
def compiled():
    interrupts.begin_unbroken()
    try:
        print("ready", flush=True)
        until = time.monotonic() + 1
        while time.monotonic() < until:
            time.sleep(0.01)
    except BaseException:
        print("broken off", flush=True)
    print("compiled", flush=True)
    interrupts.end_unbroken()
"""
FIRST = "compiled()"
LATER = """
try:
    with last_words(lambda: "the best tree is in a folder"):
        compiled()
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("when", "expected"),
    [
        (FIRST, (130, "", "ge-torchrl: interrupted before there was a result\n")),
        (LATER, (0, "compiled\ninterrupted\n", "")),
    ],
)
def test_what_comes_while_kernels_are_compiled_breaks_no_compiler_off(when, expected, number):
    program = started(BEGIN + COMPILES + when)
    program.send_signal(number)
    assert ended(program) == expected


def test_what_else_cannot_be_raised_is_shown():
    loud = """
class Loud:
    def __del__(self):
        raise ValueError("shown")

Loud()
"""
    program = started(BEGIN + loud + WAITS)
    program.send_signal(signal.SIGINT)
    status, output, errors = ended(program)
    assert (status, output) == (0, "interrupted\n")
    assert "ValueError: shown" in errors


def test_who_was_told_to_hear_no_hangup_hears_none():
    program = started("import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + BEGIN + WAITS)
    program.send_signal(signal.SIGHUP)
    time.sleep(0.2)
    assert program.poll() is None
    program.send_signal(signal.SIGTERM)
    assert ended(program) == (0, "interrupted\n", "")


def test_a_terminal_that_is_gone_is_printed_to_no_more():
    """What is printed after that goes nowhere, and breaks nothing off."""
    script = BEGIN + WAITS + "\nprint('after', flush=True)\nos.write(told, b'done')"
    reading, told = os.pipe()
    os.set_inheritable(told, True)
    program, terminal = pty.fork()
    if program == 0:
        os.execve(  # noqa: S606
            sys.executable,
            [sys.executable, "-c", f"import os; told = os.dup({told})\n{script}"],
            {**os.environ, "PYTHONPATH": str(ROOT)},
        )
    while b"ready" not in os.read(terminal, 1000):
        pass
    os.close(terminal)
    assert os.waitpid(program, 0)[1] == 0
    assert os.read(reading, 10) == b"done"
    os.close(reading)
    os.close(told)


def test_a_thread_that_never_returns_does_not_keep_the_program():
    leaves = """
interrupts._LEAVING = 0.5
from concurrent.futures import ThreadPoolExecutor
pool = ThreadPoolExecutor(1)
pool.submit(never_return)
print("ready", flush=True)
print("in the buffer")
sys.exit(leave_soon(3))
"""
    assert ended(started(BEGIN + leaves)) == (3, "in the buffer\n", "")


def test_a_step_that_does_not_return_is_told_while_an_environment_is_looked_at():
    looks = """
from ge_torchrl.cli import waiting
waiting._SILENCE_SECONDS, waiting._STEP_SECONDS = 0.1, 0.3
print("ready", flush=True)
with waiting.looked_at("plant.py:Cart"):
    time.sleep(0.5)
    interrupts.Stepping.since = time.perf_counter()
    never_return()
"""
    status, _, errors = ended(started(BEGIN + looks))
    first, told = errors.splitlines()
    assert (status, first) == (2, "ge-torchrl: looking at plant.py:Cart ...")
    assert told.startswith(
        "ge-torchrl: env.dynamics=plant.py:Cart must return from every step; one has not in 0 s"
    )


def test_a_plants_loop_without_end_can_be_interrupted(tmp_path):
    (tmp_path / "plant.py").write_text(PLANT)
    steps = """
import gymnasium
from ge_torchrl.environments.plants.environment import register_plant
environment = gymnasium.make(register_plant("plant.py:Spin"))
environment.reset(seed=0)
threading.Thread(target=tell_when_stuck, daemon=True).start()
environment.step([0.5])
"""
    program = started(BEGIN + steps, tmp_path)
    program.send_signal(signal.SIGINT)
    status, _, errors = ended(program)
    assert (status, errors) == (
        130,
        "ge-torchrl: interrupted in code that did not return; nothing was saved\n",
    )
