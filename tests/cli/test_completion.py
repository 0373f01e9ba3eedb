"""TAB in shells: what is offered, and the scripts in the shells themselves."""

import os
import shlex
import shutil
import subprocess
import sys

import pytest
from pages_for_tests import ROOT

from ge_torchrl.__main__ import main
from ge_torchrl.cli import RUN, VERBS, complete_words
from ge_torchrl.cli.completing import SCRIPTS


@pytest.fixture
def offered(capsys, monkeypatch):
    """What is offered at the end of a line."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "")

    def words(line):
        assert complete_words(line.split(" ")) == 0
        return capsys.readouterr().out.split()

    return words


def test_commands_groups_and_keys_are_offered_first(offered):
    first = offered("")
    assert {*VERBS, RUN, "env=", "env.", "refiner=", "ge.", "seed="} <= set(first)
    assert offered("pla") == ["play"]
    assert offered("run ge.gen") == ["ge.gene_probability=", "ge.generations=", "ge.genotype_length="]
    assert offered("seed=1 refiner.") == sorted(offered("refiner."))
    assert {"refiner.ppo.", "refiner.schedule.", "refiner.method="} <= set(offered("refiner."))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("env=car", ["env=cartpole"]),
        ("experiment=", [f"experiment=thesis/{name}" for name in ("acrobot", "cartpole", "mountaincar")]),
        ("refiner.ppo.optimizer=", ["refiner.ppo.optimizer=adam", "refiner.ppo.optimizer=rmsprop"]),
        ("ge.stop_when_solved=t", ["ge.stop_when_solved=true"]),
        ("ge.max_seconds=", ["ge.max_seconds=null"]),
        ("--multi", ["--multirun"]),
        ("evaluate --route ", ["auto", "gymnasium", "kernel"]),
        ("evaluate --ro", ["--route"]),
        ("evaluate ", []),
        ("play tree.json --episode w", ["worst"]),
        ("explain refiner.ppo.opt", ["refiner.ppo.optimizer"]),
        ("check CartP", ["CartPole-v1"]),
        ("init env=cartp", ["env=cartpole"]),
        ("check LunarLander-v3 env.kw", ["env.kwargs="]),
        ("tune env=cart", ["env=cartpole"]),
        ("tune env=cartpole --tri", ["--trials"]),
        ("completion ", ["bash", "fish", "zsh"]),
        ("nonsense ", None),
    ],
)
def test_what_may_follow_is_offered(offered, line, words):
    found = offered(line)
    assert words is None or found == words


def test_every_command_offers_its_flags(offered):
    assert all("--help" in offered(f"{verb} --") for verb in (*VERBS, RUN))


LOADED = """
import sys
sys.argv = ["ge-torchrl", "completion", "words", "env="]
from ge_torchrl.program import main
assert main() == 0
heavy = {"torch", "numba", "gymnasium", "hydra", "numpy", "rich"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""


def test_what_is_asked_at_every_tab_loads_nothing_large():
    subprocess.run([sys.executable, "-c", LOADED], check=True, stdout=subprocess.DEVNULL)


@pytest.fixture
def in_shell(tmp_path):
    """Run lines of a shell in which the program is installed."""
    script = tmp_path / "ge-torchrl"
    script.write_text(
        f"#!{sys.executable}\nimport sys\nfrom ge_torchrl.program import main\nsys.exit(main())\n"
    )
    script.chmod(0o755)
    (tmp_path / "tree.json").write_text("")
    environment = {
        **os.environ,
        "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HOME": str(tmp_path),
        "XDG_CONFIG_HOME": str(tmp_path),
        "XDG_DATA_HOME": str(tmp_path),
    }

    def run(shell, *lines):
        if shutil.which(shell) is None:
            pytest.skip(f"{shell} is not installed")
        (tmp_path / "script").write_text(SCRIPTS[shell])
        done = subprocess.run(
            [shell, "-c", "\n".join(lines)],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        return done.stdout.split()

    return run


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ge-torchrl pla", ["play"]),
        ("ge-torchrl env=car", ["cartpole"]),
        ("ge-torchrl seed=3 experiment=thesis/a", ["thesis/acrobot"]),
        ("ge-torchrl completion ", ["bash", "fish", "zsh"]),
        ("ge-torchrl evaluate tr", []),
    ],
)
def test_bash_completes(in_shell, line, words):
    call = f"COMP_LINE={shlex.quote(line)} COMP_POINT={len(line)}"
    found = in_shell("bash", "source ./script", call, "_ge_torchrl", r'printf "%s\n" "${COMPREPLY[@]}"')
    assert found == words
    # Where nothing is offered, bash completes the names of files.
    assert in_shell("bash", "source ./script", "complete -p ge-torchrl")[1:3] == ["-o", "default"]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ge-torchrl pla", ["--", "play"]),
        ("ge-torchrl env=car", ["--", "env=cartpole"]),
        ("ge-torchrl ge", ["-S", "--", "ge."]),
        ("ge-torchrl evaluate tr", ["FILES"]),
        ("ge-torchrl completion ''", ["--", "bash", "fish", "zsh"]),
    ],
)
def test_zsh_completes(in_shell, line, words):
    stand_ins = (
        "compdef() { }",
        'compadd() { print -l -- "$@" }',
        "_files() { print FILES }",
        f"words=({line}) CURRENT={len(line.split())}",
    )
    assert in_shell("zsh", *stand_ins, "source ./script", "_ge_torchrl") == words


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ge-torchrl pla", ["play"]),
        ("ge-torchrl env=car", ["env=cartpole"]),
        ("ge-torchrl evaluate tr", ["tree.json"]),
        ("ge-torchrl completion ", ["bash", "fish", "zsh"]),
    ],
)
def test_fish_completes(in_shell, line, words):
    assert in_shell("fish", "source ./script", f"complete -C '{line}'") == words


@pytest.mark.parametrize("shell", sorted(SCRIPTS))
def test_the_script_of_a_shell_is_printed(capsys, shell):
    assert main(["completion", shell]) == 0
    assert capsys.readouterr().out == SCRIPTS[shell]
    assert main(["completion", "tcsh"]) == 2
    assert "argument shell: invalid choice" in capsys.readouterr().err
