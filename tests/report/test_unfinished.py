"""A run that goes on, or was killed, is shown as it stands, and nothing is said of it that no test has said."""

import io
import json
import shutil

import pytest
from rich.console import Console
from runs_for_tests import config
from sweeps_for_tests import write_run

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.report.evaluation import evaluate
from ge_torchrl.report.html.writing import write_pages, write_run_page
from ge_torchrl.report.jobs import unfinished_jobs
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.unfinished import RUNNING, STOPPED, archive_mean, is_unfinished, read_unfinished
from ge_torchrl.run import checkpointing
from ge_torchrl.run.experiment import carry_out, resume


class KilledError(BaseException):
    """What no code of a run answers to: as when the process is gone."""


@pytest.fixture(scope="module")
def looked_at(tmp_path_factory):
    """The folder of a run that was killed after its sixth generation, and what was read of it just before."""
    folder, seen = tmp_path_factory.mktemp("midway") / "run", []

    def look(record, _state, _names):
        if record.generation == 5:
            seen.append((read_unfinished(folder), write_run_page(folder).read_text()))
            raise KilledError
        return False

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpointing, "_TIMES", 0)
        with pytest.raises(KilledError):
            carry_out(
                config(), lambda decided: RunFolder.create(folder, decided), Console(file=io.StringIO()), look
            )
    return folder, *seen[0]


@pytest.fixture
def killed(looked_at, tmp_path):
    shutil.copytree(looked_at[0], tmp_path / "run")
    return tmp_path / "run"


def data_of(page):
    return json.loads(page.partition('id="data">')[2].partition("</script>")[0])


def verdict_of(page):
    return page.partition('class="verdict">')[2].partition("</p>")[0]


def test_a_run_that_goes_on_says_so(looked_at):
    _, run, page = looked_at
    assert (run.state, len(run.history)) == (RUNNING, 6)
    assert "Still running</span> after 6 of 15 generations; <strong>not tested</strong>" in verdict_of(page)
    assert "ge_torchrl resume" not in page


def test_its_numbers_are_those_of_its_files(looked_at):
    folder, run, page = looked_at
    assert run.train_fitness == RunFolder(folder).read_best_tree().provenance["train_fitness"]
    assert f"{run.train_fitness:.2f}" in verdict_of(page)
    data = data_of(page)
    assert (data["isTested"], data["episodes"], data["returns"]) == (False, [], [])
    of_size = {record.decision_nodes: record.archive_mean for record in RunFolder(folder).read_archive()}
    assert {one.tree.num_decision_nodes: archive_mean(one) for one in run.archive} == of_size
    for tree in data["trees"]:
        assert tree["measured"] in (None, {"mean": of_size[tree["nodes"]]})
    assert len(data["trees"]) >= len(of_size)


def test_a_run_that_was_killed_is_reported_and_can_go_on(killed, capsys):
    assert main(["report", str(killed)]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.startswith(
        "CartPole-v1 GE, seed 0: was interrupted, not tested\n6 of 15 generations in "
    )
    assert f"\nto go on: python -m ge_torchrl resume {killed}\n" in printed.out
    assert printed.out.endswith(f"\npage: {killed / 'report.html'}\n")
    page = (killed / "report.html").read_text()
    assert "Interrupted</span>" in verdict_of(page)
    assert "ge_torchrl</span> <span" in page.partition("To go on")[2]
    for word in ("Solved", "Not solved", "unseen episode"):
        assert word not in page.partition("<main")[0]


def test_nothing_is_said_of_going_on_where_no_checkpoint_is_left(killed, capsys):
    shutil.rmtree(killed / "checkpoints")
    assert main(["report", str(killed)]) == 0
    assert "to go on" not in capsys.readouterr().out
    assert "To go on" not in (killed / "report.html").read_text()


def test_evaluate_and_export_take_it_as_it_stands(killed, capsys):
    assert evaluate(killed, 20, 0) == evaluate(killed / "best_tree.json", 20, 0)
    (size, *_) = [record.decision_nodes for record in RunFolder(killed).read_archive()]
    assert evaluate(killed, 5, 0, nodes=size).decision_nodes == size
    assert main(["export", str(killed), "--to", "text"]) == 0
    assert "theta" in capsys.readouterr().out


def test_it_has_another_page_when_it_has_come_to_its_end(killed):
    write_run_page(killed)
    assert is_unfinished(killed)
    resume(killed, Console(file=io.StringIO()))
    assert not is_unfinished(killed)
    page = (killed / "report.html").read_text()
    assert "Interrupted" not in page
    assert data_of(page)["isTested"]


def test_a_sweep_leads_to_it(killed):
    write_run(killed.parent / "other")
    page = write_pages(killed.parent, read_runs(killed.parent)).written.read_text()
    assert '<a class="job" href="run/report.html">run</a>' in page
    (job,) = unfinished_jobs(killed.parent)
    assert (job.state, job.told.partition(" in ")[0]) == (STOPPED, "6 generations")
    assert job.told.endswith("; resume goes on with it")


def test_a_fault_is_named(killed):
    (killed / "traceback.txt").write_text("Traceback\nValueError: <b>no</b>\n")
    assert read_unfinished(killed).in_words == "broke off (ValueError: <b>no</b>), not tested"
    assert "by ValueError: &lt;b&gt;no&lt;/b&gt;; <strong>not tested" in write_run_page(killed).read_text()


@pytest.mark.parametrize("arguments", [["--output", "there"], ["--against", "there"]])
def test_what_tells_of_finished_runs_is_refused(killed, capsys, arguments):
    assert main(["report", str(killed), *arguments]) == 2
    assert "tell of finished runs" in capsys.readouterr().err


def test_a_run_without_a_tree_yet_is_one_line(killed, capsys):
    (killed / "best_tree.json").unlink()
    (killed / "report.html").unlink()
    assert main(["report", str(killed)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (killed / "report.html").exists()


def test_one_that_was_interrupted_and_tested_tells_how_it_goes_on(tmp_path):
    path = write_run(tmp_path / "run", stopped_by="interrupt")
    told = "Interrupted after 2 of 2 generations, and tested as it stood then."
    assert told in write_run_page(path).read_text()
    assert "ge_torchrl</span> <span" not in write_run_page(path).read_text().partition("<main")[0]
    (path / "checkpoints").mkdir()
    (path / "checkpoints" / "00000001.checkpoint").write_bytes(b"")
    assert "To go on, as if it had been left alone:" in write_run_page(path).read_text()
