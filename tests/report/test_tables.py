from records_for_tests import summary

from ge_torchrl.report.tables import RunRow, Table, runs_table

RUNS = [
    RunRow.of(summary(seed=0, evolve_seconds=0.25)),
    RunRow.of(
        summary(
            seed=1, solved=False, test_mean=199.7, train_fitness=234.8, complexity_M=35.6, decision_nodes=2
        )
    ),
]


def test_a_row_a_run_and_one_over_all():
    assert runs_table(RUNS).markdown() == (
        "| seed | decision nodes | M | training | test mean ± sd | solved | search s | all s |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 0 | 3 | 53.4 | 500.00 | 487.40 ± 12.35 | yes | 0.2 | 0.5 |\n"
        "| 1 | 2 | 35.6 | 234.80 | 199.70 ± 12.35 | no | 0.2 | 0.5 |\n"
        "| all | 2.5 | 44.5 | 367.40 | 343.55 | 1 of 2 | 0.2 | 0.5 |"
    )


def test_columns_that_no_run_fills_are_left_out():
    tested = RunRow(7, 2, -83.0, 4.5, None, 12.25)
    assert runs_table([tested]).aligned() == (
        "seed  decision nodes  test mean ± sd  all s\n"
        "   7               2   -83.00 ± 4.50   12.2\n"
        " all             2.0          -83.00   12.2"
    )


def test_a_table_for_a_terminal_is_aligned_to_the_right():
    table = Table.of(["seed", "mean", ""], [["3", "-110.00", "here"], ["10", "-9.5", ""]])
    assert table.aligned() == ("seed     mean\n   3  -110.00  here\n  10     -9.5")


def test_tables_stand_side_by_side():
    left, right = Table.of(["a"], [["1"], ["2"]]), Table.of(["b"], [["3"], ["4"]])
    assert left.beside(right) == Table.of(["a", "b"], [["1", "3"], ["2", "4"]])


def test_a_table_for_a_person_has_a_head_that_stands_out_and_fits_the_terminal(monkeypatch):
    table = Table.of(["seed", "mean [±]"], [["3", "-110.00"], ["10", "-9.5"]])
    for name, value in (("TERM", "xterm-256color"), ("COLUMNS", "40")):
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("NO_COLOR", raising=False)
    lines = table.drawn().splitlines()
    assert "\x1b[1m" in lines[0]
    assert "mean [±]" in lines[0]
    assert set(lines[1].strip()) == {"─"}
    assert [line.split() for line in lines[2:]] == [["3", "-110.00"], ["10", "-9.5"]]
    monkeypatch.setenv("COLUMNS", "12")
    assert max(len(line) for line in table.drawn().splitlines() if "\x1b" not in line) <= 12
    assert [table.told(form) for form in ("plain", "markdown")] == [table.aligned(), table.markdown()]
