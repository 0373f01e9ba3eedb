import json
from pathlib import Path

from ge_torchrl.__main__ import main


def test_evaluate_measures_a_tree(experiment, capsys):
    assert main(["evaluate", "runs/tree.json"]) == 0
    assert capsys.readouterr().out == "mean return 499.5\n"
    assert main(["evaluate", "t", "--episodes", "5", "--seed", "1", "--route", "kernel", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"mean": 499.5}
    assert main(["evaluate", "run", "--nodes", "3"]) == 0
    assert experiment.evaluated == [
        (Path("runs/tree.json"), 1000, 10000, "auto", None),
        (Path("t"), 5, 1, "kernel", None),
        (Path("run"), 1000, 10000, "auto", 3),
    ]


def test_evaluate_measures_the_trees_of_many_runs(experiment, tmp_path, capsys):
    (tmp_path / "multirun").mkdir()
    assert main(["evaluate", "multirun", "--episodes", "10", "--seed", "7"]) == 0
    printed = capsys.readouterr()
    assert printed.out == "a table\n"
    assert printed.err == "ge-torchrl: left out: multirun/3: broken\n"
    assert main(["evaluate", "multirun", "--markdown", "--nodes", "3"]) == 0
    assert capsys.readouterr().out == "| a table |\n"
    assert main(["evaluate", "multirun", "--json", "--route", "kernel"]) == 0
    assert json.loads(capsys.readouterr().out) == {"episodes": 10}
    assert experiment.evaluated == [
        (Path("multirun"), 10, 7, "auto", None),
        (Path("multirun"), 1000, 10000, "auto", 3),
        (Path("multirun"), 1000, 10000, "kernel", None),
    ]
