import re

import pytest
from sweeps_for_tests import history, refinement, write_run

from ge_torchrl.__main__ import main
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report import canvas
from ge_torchrl.report.runs import Pair, read_run
from ge_torchrl.report.sweep import best_run, gather_runs, telling_pairs, write_report


@pytest.fixture
def sweep(tmp_path):
    folder = tmp_path / "sweep"
    for seed in range(4):
        write_run(folder / "ge" / str(seed), seed=seed, generations=history([9.0] * 5 + [500.0]))
        write_run(
            folder / "ppo" / str(seed),
            seed=seed,
            refiner="ppo",
            generations=history([9.0] * (seed + 1) + [500.0] * (5 - seed)),
            refinements=[refinement(1)],
        )
    return folder


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_report_links_to_nothing_that_is_missing_and_leaves_nothing_unlinked(sweep, tmp_path):
    write_run(sweep / "acrobot", environment="Acrobot-v1", solved_at=-100.0, test_mean=-90.0)
    report = write_report(sweep, None, tmp_path / "out")
    text = report.read_text()
    linked = set(re.findall(r"\]\(([^)]+)\)", text))
    written = {str(path) for path in contents(tmp_path / "out") if path.suffix == ".svg"}
    assert linked == written
    assert len(written) == 3 + 4 + 1 + 2
    assert re.findall(r"^## (.*)$", text, flags=re.MULTILINE) == ["Acrobot-v1", "CartPole-v1"]
    assert re.findall(r"^### CartPole-v1: (.*)$", text, flags=re.MULTILINE) == [
        "GE+PPO",
        "what PPO did",
        "GE",
        "generations to solve, with PPO and without",
        "figures",
        "the best tree of GE+PPO",
        "the best tree of GE",
    ]


def test_each_refined_method_is_compared_with_ge_alone(sweep, tmp_path):
    for seed in range(2):
        write_run(sweep / "cmaes" / str(seed), seed=seed, refiner="cmaes", refinements=[refinement(1)])
    text = write_report(sweep, None, tmp_path / "out").read_text()
    assert (
        "GE is Grammatical Evolution alone, GE+CMA-ES with trees refined by CMA-ES, GE+PPO with trees refined by PPO."
        in text
    )
    assert re.findall(r"^### CartPole-v1: (.*)$", text, flags=re.MULTILINE) == [
        "GE+PPO",
        "what PPO did",
        "GE+CMA-ES",
        "what CMA-ES did",
        "GE",
        "generations to solve, with PPO and without",
        "generations to solve, with CMA-ES and without",
        "figures",
        "the best tree of GE+PPO",
        "the best tree of GE+CMA-ES",
        "the best tree of GE",
    ]
    assert {path.name for path in (tmp_path / "out" / "figures").glob("*.svg")} == {
        "cartpole-v1-fitness.svg",
        "cartpole-v1-ge-ppo-solving.svg",
        "cartpole-v1-ge-ppo-pairs.svg",
        "cartpole-v1-ge-cma-es-solving.svg",
        "cartpole-v1-ge-cma-es-pairs.svg",
    }


def test_equal_artefacts_give_equal_bytes(sweep, tmp_path):
    write_report(sweep, None, tmp_path / "one")
    write_report(sweep, None, tmp_path / "other")
    assert contents(tmp_path / "one") == contents(tmp_path / "other")


def test_a_report_on_a_report_replaces_it(sweep):
    write_report(sweep, None, sweep / "report")
    first = contents(sweep / "report")
    write_report(sweep, None, sweep / "report")
    assert contents(sweep / "report") == first


def test_the_other_method_may_lie_elsewhere(sweep, tmp_path):
    together = write_report(sweep, None, tmp_path / "together").read_text()
    apart = write_report(sweep / "ppo", sweep / "ge", tmp_path / "apart").read_text()
    assert apart.splitlines()[1:] == together.splitlines()[1:]


def test_against_adds_only_what_is_lacking(sweep):
    (sweep / "ge" / "other").mkdir()
    write_run(sweep / "ge" / "other" / "0", environment="Acrobot-v1")
    runs = gather_runs(sweep / "ppo", sweep).runs
    assert [run.environment for run in runs] == ["CartPole-v1"] * 8
    with pytest.raises(ArtefactError, match=r"those in .*ppo are of CartPole-v1 GE\+PPO"):
        gather_runs(sweep / "ppo", sweep / "ppo")


def test_the_best_run_is_that_of_validation_then_the_simplest(tmp_path):
    runs = [
        read_run(
            write_run(tmp_path / name, validation_mean=validation, test_mean=test, complexity_M=complexity)
        )
        for name, validation, test, complexity in [
            ("a", 490.0, 500.0, 17.8),
            ("b", 499.0, 480.0, 53.4),
            ("c", 499.0, 470.0, 35.6),
        ]
    ]
    assert best_run(runs).path.name == "c"


def test_telling_pairs_are_those_that_save_most_in_the_order_of_seeds(sweep):
    pairs = [
        Pair(read_run(sweep / "ppo" / str(seed)), read_run(sweep / "ge" / str(seed))) for seed in range(4)
    ]
    assert [pair.refined.seed for pair in telling_pairs(pairs[::-1], 475.0)] == [0, 1, 2]


def test_command_prints_tables_and_says_where_the_report_is(sweep, capsys):
    broken = write_run(sweep / "broken")
    (broken / "history.jsonl").write_text("?\n")
    assert main(["report", str(sweep)]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("**CartPole-v1 GE+PPO** (100 test episodes, solved from 475)\n\n| seed |")
    assert printed.out.endswith(f"\n\nreport: {sweep / 'report' / 'report.md'}\n")
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
    assert main(["report", str(sweep)]) == 0
    printed = capsys.readouterr()
    assert "| seed |" in printed.out
    assert "report:" not in printed.out
    assert printed.err == (
        'ge-torchrl: no report: figures need matplotlib; expected it installed: pip install "ge-torchrl[plots]"\n'
    )
    assert not (sweep / "report").exists()
    assert main(["report", str(sweep), "--output", "out"]) == 2
