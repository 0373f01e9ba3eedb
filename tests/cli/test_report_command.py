"""The command that reports finished runs, as a user types it."""

import re

import pytest
from records_for_tests import history, refinement
from sweeps_for_tests import write_run

from ge_torchrl.__main__ import main
from ge_torchrl.report import canvas


@pytest.fixture
def sweep(tmp_path):
    folder = tmp_path / "sweep"
    for seed in range(4):
        write_run(folder / "ge" / str(seed), seed=seed, generations=history([9.0] * 5 + [500.0]))
        write_run(
            folder / "ppo" / str(seed),
            "GE+PPO",
            seed=seed,
            generations=history([9.0] * (seed + 1) + [500.0] * (5 - seed)),
            refinements=[refinement(1)],
        )
    return folder


def test_command_prints_tables_and_says_where_the_report_is(sweep, capsys):
    broken = write_run(sweep / "broken")
    (broken / "history.jsonl").write_text("?\n")
    assert main(["report", str(sweep)]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("CartPole-v1 GE+PPO (100 test episodes, solved from 475)\n\nseed  ")
    report, page = sweep / "report" / "report.md", sweep / "report.html"
    assert printed.out.endswith(f"\n\nreport: {report}\npage: {page}\n")
    assert "ge_torchrl sweep" in page.read_text()
    assert "ge_torchrl run" in (sweep / "ge" / "0" / "report.html").read_text()
    assert re.fullmatch(rf"ge-torchrl: left out: {broken}: .*history\.jsonl:1 is not JSON.*\n", printed.err)
    assert f"## Left out\n\n* {broken}: " in (sweep / "report" / "report.md").read_text()


def test_command_takes_output_and_against(sweep, tmp_path, capsys):
    output = tmp_path / "there"
    assert main(["report", str(sweep / "ge"), "--against", str(sweep / "ppo"), "--output", str(output)]) == 0
    assert "generations to solve" in (output / "report.md").read_text()
    assert not (sweep / "ge" / "report").exists()
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("sweep")
@pytest.mark.parametrize(
    "arguments",
    [
        ["nowhere"],
        ["."],
        ["sweep", "--against", "nowhere"],
        ["sweep", "--against", "sweep/ge"],
        ["sweep", "--output", "file"],
        ["sweep", "--unknown"],
        [],
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, monkeypatch, capsys, arguments):
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty" if arguments == ["."] else tmp_path)
    assert main(["report", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("ge-torchrl: ")
    assert error.count("\n") == 1


def test_without_matplotlib_the_tables_are_printed_all_the_same(sweep, monkeypatch, capsys):
    monkeypatch.setattr(canvas, "find_spec", lambda _: None)
    assert main(["report", str(sweep), "--markdown"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("**CartPole-v1 GE+PPO** (100 test episodes, solved from 475)\n\n| seed |")
    assert "report:" not in printed.out
    assert printed.err == (
        "ge-torchrl: no report: figures need matplotlib; expected it installed: "
        'pip install -c constraints.txt -e ".[plots]"\n'
    )
    assert not (sweep / "report").exists()
    assert main(["report", str(sweep), "--output", "out"]) == 2
