import numpy as np
import pytest
from records_for_tests import history
from sweeps_for_tests import write_run

from ge_torchrl.report.findings import method_text, overview_table, runs_tables
from ge_torchrl.report.runs import read_runs

UNSOLVED = {"solved": False, "test_mean": 100.0}


def rng():
    return np.random.default_rng(0)


@pytest.fixture
def runs(tmp_path):
    for method in ("GE", "thesis"):
        write_run(tmp_path / method / "0", method, generations=history([9.0]), settings={"generations": 2})
    write_run(tmp_path / "GE" / "1", seed=1, **UNSOLVED)
    write_run(tmp_path / "thesis" / "1", "thesis", seed=1)
    return read_runs(tmp_path).runs


def of(method, runs):
    return [run for run in runs if run.method == method]


def test_overview_puts_the_thesis_beside_its_own_settings_only(runs):
    assert overview_table(runs) == (
        "| method | runs | solved | mean test return | mean M | thesis: solved | mean test | mean M |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| CartPole-v1 thesis | 2 | 2 of 2 (34% to 100%) | 487.40 | 53.4 | 9 of 10 | 465.17 | 48.1 |\n"
        "| CartPole-v1 GE | 2 | 1 of 2 (9% to 91%) | 293.70 | 53.4 |  |  |  |"
    )


def test_tables_of_runs_are_named_after_their_methods(runs):
    text = runs_tables(runs)
    assert text.startswith(
        "**CartPole-v1 thesis** (100 test episodes, solved from 475)\n\n"
        "| seed | decision nodes | M | training | test mean ± sd | solved | search s | all s "
        "| thesis | training | test | M | solved |\n"
    )
    assert (
        "| 1 | 3 | 53.4 | 500.00 | 487.40 ± 12.35 | yes | 0.2 | 0.5 | R2 | 234.80 | 199.71 | 35.6 | no |"
        in text
    )
    assert "\n\n**CartPole-v1 GE** (100 test episodes, solved from 475)\n\n" in text
    assert text.endswith("| all | 3.0 | 53.4 | 500.00 | 293.70 | 1 of 2 | 0.2 | 0.5 |")


def test_a_method_in_words(runs):
    text = method_text(of("GE", runs), rng())
    assert text.startswith(runs_tables(of("GE", runs)).partition("\n\n")[2])
    assert text.splitlines()[-4:] == [
        "* Solved: 1 of 2 (9% to 91%).",
        "* Mean training fitness: 500.00 (range 500.00 to 500.00).",
        "* Mean test return: 293.70 (range 100.00 to 487.40). The training fitness is 206.30 above it on average.",
        "* Mean complexity M: 53.40 (range 53.40 to 53.40).",
    ]
    assert "hesis" not in text
    assert "Thesis: Table 4.3. A seed does not make the same run in two programs" in method_text(
        of("thesis", runs), rng()
    )


def test_an_environment_without_threshold_and_thesis(tmp_path):
    write_run(tmp_path / "a", "thesis", environment="Any-v0", solved=None, solved_at=None)
    (run,) = read_runs(tmp_path).runs
    text = method_text([run], rng())
    assert "olved" not in text
    assert "Thesis" not in text
    assert "* Mean test return: 487.40. The" in text, "one run gives no interval"
    assert overview_table([run]).splitlines()[-1] == "| Any-v0 thesis | 1 | 487.40 | 53.4 |"


def test_runs_of_different_settings_are_never_averaged_together(tmp_path):
    for number, generations in enumerate((100, 100, 200)):
        write_run(
            tmp_path / str(number), seed=number, settings={"generations": generations},
            test_mean=100.0 * (number + 1), solved=False,
        )  # fmt: skip
    runs = read_runs(tmp_path).runs
    rows = [line.split(" | ") for line in overview_table(runs).splitlines()[2:]]
    assert [(row[0], row[1], row[3]) for row in rows] == [
        ("| CartPole-v1 GE, ge.generations=100", "2", "150.00"),
        ("| CartPole-v1 GE, ge.generations=200", "1", "300.00"),
    ]
    titles = [line for line in runs_tables(runs).splitlines() if line.startswith("**")]
    assert [title.partition("**")[2].partition("**")[0] for title in titles] == [
        "CartPole-v1 GE, ge.generations=100",
        "CartPole-v1 GE, ge.generations=200",
    ]


def test_seeds_that_stand_twice_are_noticed(tmp_path):
    write_run(tmp_path / "a")
    write_run(tmp_path / "b", version="0.0.9")
    assert "* Some seeds stand more than once" in method_text(read_runs(tmp_path).runs, rng())


def test_warnings_are_told_once(tmp_path):
    warned = "observation 0 was 4.0, outside its declared Box [0, 1]"
    for seed in (3, 5):
        write_run(tmp_path / str(seed), seed=seed, warnings=(warned,))
    write_run(tmp_path / "7", seed=7, warnings=("another",))
    assert method_text(read_runs(tmp_path).runs, rng()).splitlines()[-2:] == [
        f"* Warning of 2 runs (seed 3 first): {warned}",
        "* Warning of 1 run (seed 7 first): another",
    ]


def test_a_refiner_that_was_never_due_is_told_of(tmp_path):
    for seed in (0, 1):
        write_run(tmp_path / str(seed), "GE+PPO", seed=seed, refined=0)
    title = "**CartPole-v1 GE+PPO** (100 test episodes, solved from 475; PPO refined no tree)"
    assert runs_tables(read_runs(tmp_path).runs).startswith(title)


def test_five_runs_have_an_interval_and_four_a_range(tmp_path):
    for seed in range(5):
        write_run(tmp_path / str(seed), seed=seed, test_mean=100.0 * seed)
    runs = read_runs(tmp_path).runs
    assert "* Mean test return: 150.00 (range 0.00 to 300.00)." in method_text(runs[:4], rng())
    assert "range" not in method_text(runs, rng())
