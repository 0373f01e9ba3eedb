import sys
from pathlib import Path

import pytest
from pages_for_tests import ROOT

import ge_torchrl
from ge_torchrl import __main__ as command_line
from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.folder import CONFIG, RunFolder
from ge_torchrl.errors import EnvironmentFaultError, RunFaultError
from ge_torchrl.report.html.parts import COMMAND


def test_each_run_has_a_folder_of_its_own_and_nothing_else_is_written(experiment, tmp_path):
    for _ in range(3):
        assert main(["seed=4"]) == 0
    folders = [output_dir for _, output_dir in experiment.runs]
    assert len(set(folders)) == 3
    assert all(folder.parent == tmp_path / "outputs" / "cartpole" for folder in folders)
    assert all(folder.name.endswith("-seed4") and folder.is_dir() for folder in folders)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_sweep_runs_all_combinations_in_folders_that_name_them(experiment):
    assert main(["-m", "seed=range(0,2)", "env=cartpole,acrobot"]) == 0
    runs = [(folder.name, config.env.id, config.seed) for config, folder in experiment.runs]
    assert runs == [
        ("0_env=cartpole,seed=0", "CartPole-v1", 0),
        ("1_env=acrobot,seed=0", "Acrobot-v1", 0),
        ("2_env=cartpole,seed=1", "CartPole-v1", 1),
        ("3_env=acrobot,seed=1", "Acrobot-v1", 1),
    ]


def test_the_name_of_a_job_with_many_overrides_is_cut(experiment):
    many = [
        f"refiner.ppo.{key}=0.001"
        for key in ("lr_actor", "lr_critic", "gae_lambda", "entropy_coeff", "clip_epsilon")
    ]
    many += ["refiner.ppo.update_timesteps=1000", "evaluation.validation_episodes=50", "ge.generations=3"]
    assert main(["-m", "seed=0,1", *many]) == 0
    names = [folder.name for _, folder in experiment.runs]
    assert [name[:2] for name in names] == ["0_", "1_"]
    assert all(len(name) < 200 and name.endswith("...") for name in names)


def test_sweep_over_the_same_value_twice_and_over_paths_keeps_jobs_apart(experiment):
    assert main(["-m", "seed=1,1", "experiment=thesis/cartpole"]) == 0
    names = [folder.name for _, folder in experiment.runs]
    assert names == ["0_seed=1", "1_seed=1"]


def test_an_experiment_may_stand_beside_its_own_environment(experiment):
    assert main(["experiment=thesis/acrobot", "env=acrobot"]) == 0
    assert [config.env.id for config, _ in experiment.runs] == ["Acrobot-v1"]


def test_the_configuration_of_a_run_is_read_again_as_its_page_says(experiment, tmp_path):
    assert main(["env=mountaincar", "seed=7", "ge.generations=9"]) == 0
    given, _ = experiment.runs[0]
    RunFolder.create(tmp_path / "sweep" / "RUN", given)
    form = f"--config-path $PWD/RUN --config-name {Path(CONFIG).stem}"
    assert form in (ROOT / "docs" / "sweeps.md").read_text()
    assert COMMAND.replace('"', "").replace("RUN_FOLDER", "RUN") == f"python -m ge_torchrl {form}"
    assert main(form.replace("$PWD", str(tmp_path / "sweep")).split()) == 0
    again, folder = experiment.runs[1]
    assert again == given
    # Where the command is typed, so that no report of the sweep meets it.
    assert folder.is_relative_to(tmp_path / "outputs")


def test_run_that_broke_off_is_one_line_and_a_fault(experiment, capsys):
    experiment.failures[0] = RunFaultError(
        "the run broke off (ZeroDivisionError: a bug); the best tree so far is in x"
    )
    assert main([]) == 1
    assert capsys.readouterr().err == f"ge-torchrl: {experiment.failures[0]}\n"


@pytest.mark.parametrize(
    ("verb", "broken"),
    [("evaluate", "evaluate"), ("evaluate", "is_above_runs"), ("resume", "resume")],
)
def test_a_fault_of_any_verb_is_one_line(experiment, monkeypatch, capsys, verb, broken):
    def breaking(*_):
        raise RunFaultError("the run broke off (ZeroDivisionError: a bug)")

    monkeypatch.setattr(experiment, broken, breaking)
    assert main([verb, "tree.json"]) == 1
    assert capsys.readouterr() == ("", "ge-torchrl: the run broke off (ZeroDivisionError: a bug)\n")


def test_fault_of_the_program_shows_its_traceback_without_hydras_frames(experiment, capsys):
    experiment.failures[0] = ZeroDivisionError("a bug")
    assert main([]) == 1
    shown = capsys.readouterr().err
    assert shown.startswith("Traceback")
    assert shown.endswith("ZeroDivisionError: a bug\n")
    assert "hydra" not in shown.replace("HydraConfig", "").lower()


def test_failing_job_does_not_stop_a_sweep_but_the_status_tells(experiment):
    experiment.failures[1] = EnvironmentFaultError("env.id must be known; got Foo-v0")
    assert main(["-m", "seed=0,1,2"]) == 2
    assert [config.seed for config, _ in experiment.runs] == [0, 1, 2]
    experiment.failures[2] = ZeroDivisionError("a bug")
    assert main(["-m", "seed=0,1,2,3"]) == 1
    assert [config.seed for config, _ in experiment.runs] == [0, 1, 2, 0, 1, 2, 3]


def test_interrupt_ends_everything_quietly(experiment, capsys):
    experiment.failures[1] = KeyboardInterrupt()
    assert main(["-m", "seed=0,1,2"]) == 130
    assert [config.seed for config, _ in experiment.runs] == [0, 1]
    assert capsys.readouterr().err == "ge-torchrl: interrupted before there was a result\n"


@pytest.mark.usefixtures("experiment")
def test_command_line_leaves_the_process_as_it_was(monkeypatch):
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
    before = list(sys.argv)
    assert main(["seed=1"]) == 0
    assert sys.argv == before
    assert "HYDRA_FULL_ERROR" not in command_line.os.environ


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["--help"], "experiment=thesis/cartpole"),
        (["--hydra-help"], "--multirun"),
        (["--cfg", "job", "seed=5"], "seed: 5"),
        (["--cfg", "job", "-p", "ge"], "genotype_length: 100"),
        (["--cfg", "job"], "  bnf: |\n    <dt>        ::= <if>\n"),
        (["--help"], "  bnf: |\n    <dt>        ::= <if>\n"),
        (["--version"], ge_torchrl.__version__),
        (["-sc", "install=bash"], "complete"),
    ],
)
def test_information_is_shown_without_a_run(experiment, tmp_path, capsys, arguments, shown):
    assert main(arguments) == 0
    assert shown in capsys.readouterr().out
    assert experiment.runs == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("experiment")
def test_tab_completes_keys_and_choices(capsys, monkeypatch):
    monkeypatch.setenv("COMP_LINE", "ge-torchrl ge.popu")
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out.strip() == "ge.population_size="
    monkeypatch.setenv("COMP_LINE", "ge-torchrl env=ca")
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out.strip() == "env=cartpole"


def test_ctrl_c_ends_a_run_well_and_the_rest_of_a_sweep(experiment):
    experiment.interrupted = {1}
    assert main(["seed=1"]) == 0
    assert main(["-m", "seed=0,1,2"]) == 130
    assert [config.seed for config, _ in experiment.runs] == [1, 0, 1]
