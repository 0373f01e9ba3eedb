"""The program in a process of its own, as a user starts and stops it."""

import os
import signal
import subprocess
import sys
import tomllib

import pytest
from pages_for_tests import ROOT


@pytest.mark.parametrize("arguments", [["env=foo"], ["-m", "ge.population_size=1,2"]])
def test_program_started_by_a_user_reports_a_mistake(tmp_path, arguments):
    command = [sys.executable, "-m", "ge_torchrl", *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_command_line_loads_no_torch():
    code = "import sys, ge_torchrl.__main__; sys.exit('torch' in sys.modules or 'numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0


IMPORTS = """
import sys
sys.modules["matplotlib"] = None  # As where the extra for figures is not installed.
from ge_torchrl.cli.output import prepare_output
prepare_output()
import cma, gymnasium, numba, tensordict, torch, torchrl, torchrl.collectors, torchrl.envs, torchrl.objectives
"""


def test_no_package_that_a_run_imports_prints_a_warning():
    done = subprocess.run([sys.executable, "-c", IMPORTS], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


NOTHING_FOUND = b"ge-torchrl: interrupted before there was a result\n"
PRINTS = """
import sys, types
room = types.ModuleType("ge_torchrl.run.experiment")
def run(config, output_dir, console):
    console.print("├─ yes: 1 ± 2 ☃")
    for line in range(1000 if "many" in sys.argv else 1):
        console.print(line)
        print(line)
    return types.SimpleNamespace(stopped_by="generations")
room.run, room.plan = run, lambda config: None
room.resume = room.is_finished = None
sys.modules["ge_torchrl.run.experiment"] = sys.modules["ge_torchrl.run.plan"] = room
from ge_torchrl.__main__ import main
sys.exit(main(["seed=1"]))
"""


def test_output_to_an_ascii_terminal_never_raises(tmp_path):
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-c", PRINTS], cwd=tmp_path, capture_output=True, check=False, env=environment
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode("ascii") == "|- yes: 1 +- 2 ?\n0\n0\n"


def test_output_that_nobody_reads_any_more_ends_the_program_quietly(tmp_path):
    command = [sys.executable, "-c", PRINTS, "many"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        program.stdout.close()
        errors = program.stderr.read()
    assert (program.returncode, errors) == (141, b"")


def console_script(folder):
    """Write what an installation makes of the declared console script; return its path."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["ge-torchrl"]
    module, function = declared.split(":")
    script = folder / "ge-torchrl"
    script.write_text(f"import sys\nfrom {module} import {function}\nsys.exit({function}())\n")
    return str(script)


def interrupted(folder, command, package):
    """Run a command that is interrupted in the middle of importing a package; return what came of it."""
    (folder / f"{package}.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    return subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


@pytest.mark.parametrize("package", ["hydra", "yaml", "gymnasium"])
@pytest.mark.parametrize("is_script", [False, True])
def test_ctrl_c_while_packages_are_imported_is_quiet(tmp_path, package, is_script):
    command = [console_script(tmp_path)] if is_script else ["-m", "ge_torchrl"]
    done = interrupted(tmp_path, command, package)
    assert (done.returncode, done.stdout) == (130, b"")
    # Of Gymnasium only the command line itself has need.
    assert done.stderr == (NOTHING_FOUND if package == "gymnasium" else b"")


def test_who_imports_the_command_line_keeps_their_own_ctrl_c(tmp_path):
    done = interrupted(tmp_path, ["-c", "import ge_torchrl.program, ge_torchrl.__main__"], "hydra")
    assert b"KeyboardInterrupt" in done.stderr


def test_information_that_nobody_reads_ends_quietly(tmp_path):
    command = [sys.executable, "-m", "ge_torchrl", "--help"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        program.stdout.close()
        errors = program.stderr.read()
    assert (program.returncode, errors) == (141, b"")


def test_jobs_run_side_by_side_with_one_thread_each(tmp_path):
    """The real program: the launcher pickles the job and runs it in processes of its own."""
    few = ["evaluation.validation_episodes=2", "evaluation.test_episodes=2"]
    small = ["ge.population_size=8", "ge.generations=2", *few]
    arguments = ["-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "refiner=none", *small]
    finished = subprocess.run(
        [sys.executable, "-m", "ge_torchrl", *arguments, "ge.genotype_length=64,2", "hydra.sweep.dir=sweep"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert finished.returncode == 2
    assert "no genotype of 2 codons gave a tree" in finished.stderr, "the other one goes on"
    (folder,) = (path.parent for path in tmp_path.glob("sweep/*/summary.json"))
    assert "genotype_length=64" in folder.name
    assert "threads: 1" in (folder / "config.yaml").read_text()


LOOKS = """
import os, signal, sys, types
room = types.ModuleType("ge_torchrl.run.plan")
def plan(config):
    os.kill(os.getpid(), signal.SIGINT)
room.plan = plan
sys.modules["ge_torchrl.run.plan"] = room
import atexit
atexit.register(os.kill, os.getpid(), signal.SIGINT)
from ge_torchrl.program import main
sys.argv = ["ge-torchrl", "seed=1"]
sys.exit(main())
"""


def test_ctrl_c_before_a_run_says_that_nothing_was_found_and_later_ones_say_nothing(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", LOOKS],
        cwd=tmp_path,
        capture_output=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", NOTHING_FOUND)
