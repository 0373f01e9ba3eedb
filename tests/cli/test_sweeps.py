"""The end of a sweep: its page stands beside its runs, and never changes how the sweep ends."""

from concurrent.futures.process import BrokenProcessPool

import pytest
from sweeps_for_tests import write_run

from ge_torchrl import __main__ as command_line
from ge_torchrl.__main__ import main
from ge_torchrl.report.html import writing


def runs_that_leave_files(experiment, monkeypatch):
    original = experiment.run

    def run(config, output_dir, console):
        if config.seed not in experiment.failures:
            write_run(output_dir, seed=config.seed)
        return original(config, output_dir, console)

    monkeypatch.setattr(experiment, "run", run)


def test_the_page_of_a_sweep_is_written_at_its_end(experiment, monkeypatch, tmp_path, capsys):
    runs_that_leave_files(experiment, monkeypatch)
    assert main(["-m", "seed=0,1", "hydra.sweep.dir=there"]) == 0
    page = tmp_path / "there" / "report.html"
    assert "2 finished runs" in page.read_text()
    assert capsys.readouterr().out.endswith("the runs side by side: there/report.html\n")


def test_a_job_that_fails_is_named_there(experiment, monkeypatch, tmp_path):
    runs_that_leave_files(experiment, monkeypatch)
    experiment.failures[1] = ValueError("no")
    assert main(["-m", "seed=0,1,2", "hydra.sweep.dir=there"]) == 1
    page = (tmp_path / "there" / "report.html").read_text()
    assert "2 finished runs" in page
    assert "1 job failed" in page
    assert '<span class="job">1_seed=1</span></td><td>failed</td><td>no</td>' in page


@pytest.mark.parametrize("within_a_run", [True, False])
def test_ctrl_c_leaves_the_page_of_what_is_finished(experiment, monkeypatch, tmp_path, capsys, within_a_run):
    runs_that_leave_files(experiment, monkeypatch)
    if within_a_run:
        experiment.interrupted = {1}  # This run ends well, with what it found.
    else:
        experiment.failures[1] = KeyboardInterrupt()
    assert main(["-m", "seed=0,1,2", "hydra.sweep.dir=there"]) == 130
    page = (tmp_path / "there" / "report.html").read_text()
    assert ("2 finished runs" in page) == within_a_run
    printed = capsys.readouterr()
    assert printed.out.endswith("interrupted; the runs that finished, side by side: there/report.html\n")
    assert not printed.err


def test_ctrl_c_again_leaves_no_page(experiment, monkeypatch, tmp_path, capsys):
    runs_that_leave_files(experiment, monkeypatch)
    experiment.failures[1] = KeyboardInterrupt()

    def pressed_again(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(writing, "sweep_page", pressed_again)
    assert main(["-m", "seed=0,1,2", "hydra.sweep.dir=there"]) == 130
    assert not (tmp_path / "there" / "report.html").exists()
    assert capsys.readouterr() == ("", "ge-torchrl: interrupted; no page of the sweep\n")


def test_a_sweep_that_its_launcher_breaks_off_leaves_its_page(experiment, monkeypatch, tmp_path, capsys):
    runs_that_leave_files(experiment, monkeypatch)
    experiment.failures[1] = SystemExit(3)
    assert main(["-m", "seed=0,1,2", "hydra.sweep.dir=there"]) == 2
    assert "1 finished run" in (tmp_path / "there" / "report.html").read_text()
    assert "side by side: there/report.html" in capsys.readouterr().out


def test_a_process_that_dies_under_joblib_is_told_in_one_line(experiment, monkeypatch, capsys):
    def launched(**_):
        def dying():
            raise BrokenProcessPool("it was terminated")

        return lambda _: dying

    monkeypatch.setattr(command_line.hydra, "main", launched)
    assert main(["-m", "seed=0,1"]) == 1
    assert experiment.runs == []
    assert capsys.readouterr().err.startswith(
        "ge-torchrl: a process of the sweep died, perhaps for want of memory"
    )


def test_a_single_run_has_no_page_of_a_sweep(experiment, monkeypatch, tmp_path, capsys):
    runs_that_leave_files(experiment, monkeypatch)
    assert main(["seed=3", "hydra.run.dir=alone"]) == 0
    assert not (tmp_path / "alone" / "report.html").exists(), (
        "the run itself writes it, and this one is no real one"
    )
    assert "side by side" not in capsys.readouterr().out


def test_where_no_run_is_finished_nothing_is_said_of_a_page(experiment, capsys):
    assert main(["-m", "seed=0,1"]) == 0
    assert len(experiment.runs) == 2
    assert capsys.readouterr() == ("", "")


def test_a_page_that_cannot_be_made_is_told_in_one_line(experiment, monkeypatch, capsys):
    runs_that_leave_files(experiment, monkeypatch)

    def breaking(*_):
        raise ZeroDivisionError("a bug\nof ours")

    monkeypatch.setattr(writing, "sweep_page", breaking)
    assert main(["-m", "seed=0,1"]) == 0
    assert capsys.readouterr().err == "ge-torchrl: no page of the sweep: a bug of ours\n"
