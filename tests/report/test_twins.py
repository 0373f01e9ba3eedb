"""A configuration and a seed count once, however often they were run, and whoever counts says so."""

from pathlib import Path

import pytest
import yaml
from sweeps_for_tests import write_run

from ge_torchrl.report.evaluation import evaluate_runs
from ge_torchrl.report.html.sweep_page import sweep_page
from ge_torchrl.report.pages import write_report
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.twins import Twin, twins_told


@pytest.fixture
def sweep(tmp_path):
    """Two seeds, of which one was run again within the folder of its run, and found something else."""
    folder = tmp_path / "sweep"
    for seed in (0, 1):
        write_run(folder / f"{seed}_seed={seed}", seed=seed, test_mean=400.0)
    write_run(folder / "1_seed=1" / "outputs" / "x", seed=1, test_mean=500.0)
    return folder


def paths_of(found, folder):
    return [run.path.relative_to(folder).as_posix() for run in found.runs]


def test_a_run_that_was_run_again_within_its_folder_counts_once(sweep):
    found = read_runs(sweep)
    again = sweep / "1_seed=1" / "outputs" / "x"
    assert paths_of(found, sweep) == ["0_seed=0", "1_seed=1"]
    assert found.twins == (Twin(again, sweep / "1_seed=1"),)
    told = "1 run has the configuration and seed of another, which is counted once"
    assert found.left_out == (f"{told}: {again} is {sweep / '1_seed=1'} again",)


def test_whoever_counts_says_so(sweep):
    evaluated = evaluate_runs(sweep, 5, 0, "kernel")
    assert [run.row.seed for run in evaluated.methods[0].runs] == [0, 1]
    assert evaluated.left_out == read_runs(sweep).left_out
    page = sweep_page(sweep, read_runs(sweep))
    assert "2 finished runs" in page
    assert "again" in page.partition("In no figure")[2]
    assert "1_seed=1/<wbr>outputs/<wbr>x" in page.partition("In no figure")[2]


def test_the_report_says_so(sweep):
    pytest.importorskip("matplotlib")
    text = write_report(sweep, None, sweep / "report").read_text()
    assert "1 run has the configuration and seed of another" in text.partition("## Left out")[2]


def test_one_that_was_interrupted_gives_way(tmp_path):
    write_run(tmp_path / "a", stopped_by="interrupt")
    write_run(tmp_path / "deep" / "b")
    found = read_runs(tmp_path)
    assert paths_of(found, tmp_path) == ["deep/b"]
    assert found.twins == (Twin(tmp_path / "a", tmp_path / "deep" / "b"),)


def test_what_changes_nothing_tells_no_runs_apart_and_all_else_does(tmp_path):
    write_run(tmp_path / "0")
    for name, section, key, value in (("1", "evaluation", "threads", 3), ("2", "ge", "wraps", 1)):
        config = write_run(tmp_path / name) / "config.yaml"
        values = yaml.safe_load(config.read_text())
        values[section][key] = value
        config.write_text(yaml.safe_dump(values))
    write_run(tmp_path / "3", version="0.0.9")
    write_run(tmp_path / "4", seed=1)
    assert sorted(paths_of(read_runs(tmp_path), tmp_path)) == ["0", "2", "3", "4"]


def test_many_are_told_in_one_line():
    (line,) = twins_told([Twin(Path(f"b/{i}"), Path(f"a/{i}")) for i in range(5)])
    assert line.startswith(
        "5 runs have the configuration and seed of another, which is counted once: b/0 is a/0 "
    )
    assert line.endswith("; and 2 more")
    assert twins_told([]) == []
