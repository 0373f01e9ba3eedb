from records_for_tests import proposal, refinement, skipped
from sweeps_for_tests import write_run

from ge_torchrl.report.refinements import Bridges, RefinementCounts, count_refinements, refinements_text
from ge_torchrl.report.runs import read_runs

NOTHING = dict.fromkeys(RefinementCounts.__dataclass_fields__, 0)


def test_both_ways_of_counting():
    records = [
        refinement(40, before=100.0, again=90.0, after=95.0, parameters_moved=0, new_best=False),
        refinement(80, before=90.0, again=100.0, after=95.0, leaves_changed=0),
        refinement(120, before=9.0, again=9.0, after=499.8, written_back=True),
        refinement(160, before=500.0, again=490.0, after=490.0, new_best=False),
    ]
    assert count_refinements(records) == RefinementCounts(
        applied=4,
        beyond_fitness=2,
        beyond_return=2,
        below_return=1,
        new_best=2,
        written_back=1,
        moved_parameters=3,
        changed_leaves=3,
        failed=0,
        skipped=0,
        timesteps=400_000,
        bridges=None,
    )


def test_a_failure_is_an_application_that_improved_nothing_and_a_skip_is_none():
    nothing = dict.fromkeys(
        ("return_after", "soft_return", "parameters_moved", "leaves_changed", "largest_parameter_move")
    )
    failed = refinement(
        40, outcome="failed", failure="loss is NaN", new_best=False, timesteps=3000, **nothing
    )
    counts = count_refinements([failed, skipped(80)])
    told = {**NOTHING, "applied": 1, "failed": 1, "skipped": 1, "timesteps": 3000, "bridges": None}
    assert counts == RefinementCounts(**told)


def test_nothing_gives_zeros():
    assert count_refinements([]) == RefinementCounts(**{**NOTHING, "bridges": None})


def test_bridges_are_of_the_trees_where_all_returns_are_known():
    records = [
        refinement(40, again=10.0, soft_return=100.0, after=90.0, return_snapped=60.0),
        refinement(80, again=20.0, soft_return=80.0, after=90.0, return_snapped=80.0),
        refinement(120, again=1000.0, soft_return=None, after=1000.0, return_snapped=1000.0),
        refinement(160, again=1000.0, soft_return=1000.0, after=1000.0),
        skipped(200),
    ]
    bridges = count_refinements(records).bridges
    assert bridges == Bridges(2, before=15.0, soft=90.0, after=90.0, snapped=70.0)
    assert (bridges.lost_in_hardening, bridges.lost_in_snapping) == (0.0, 20.0)


def test_a_method_without_soft_trees_has_one_bridge_less():
    bridges = count_refinements([refinement(40, again=10.0, soft_return=None, return_snapped=470.0)]).bridges
    assert bridges == Bridges(1, before=10.0, soft=None, after=480.0, snapped=470.0)
    assert (bridges.lost_in_hardening, bridges.lost_in_snapping) == (None, 10.0)


def test_refinements_in_words(tmp_path):
    write_run(
        tmp_path / "c",
        "GE+PPO",
        refinements=[
            refinement(2, return_snapped=470.0, written_back=True),
            proposal(2, origin="neighbour", again=500.0, after=490.0),
            proposal(2, origin="archive", new_best=True),
            skipped(4),
        ],
        champion_from="refinement",
    )
    write_run(
        tmp_path / "d",
        "GE+PPO",
        seed=1,
        refinements=[refinement(2, before=9.0, again=9.0, after=9.0, new_best=False)],
    )
    assert refinements_text(read_runs(tmp_path).runs) == (
        "| trees refined by PPO | individuals | neighbours | of the archive |\n"
        "| --- | ---: | ---: | ---: |\n"
        "| in all | 2 | 1 | 1 |\n"
        "| return after > fitness before, as the thesis counts | 1 | 0 | 0 |\n"
        "| return after > return before, on the same unseen episodes | 1 | 0 | 1 |\n"
        "| return after \\< return before | 0 | 1 | 0 |\n"
        "| best of its generation | 1 | 0 | 1 |\n"
        "| written back into the population | 1 | 0 | 0 |\n"
        "| some parameter moved | 2 | 1 | 1 |\n"
        "| some leaf changed its action | 2 | 1 | 1 |\n"
        "| training broke off | 0 | 0 | 0 |\n"
        "\n"
        "* Mean loss of each bridge, of the 1 tree with all returns known: -280.00 in hardening (soft 200.00 -> "
        "480.00), 10.00 in snapping to the grammar's constants (480.00 -> 470.00). Before, they returned 90.00.\n"
        "* The champion is a refined tree in 1 of 2 runs. A tree that was written back counts as one of the "
        "population.\n"
        "* 1 more was skipped, as no tree could be a candidate."
    )


def test_refinements_without_gradients_and_a_polish_in_words(tmp_path):
    for seed, champion_from in enumerate(("polish", "population")):
        write_run(
            tmp_path / str(seed),
            "GE+CMA-ES",
            seed=seed,
            refinements=[refinement(2, soft_return=None, return_snapped=480.0)],
            champion_from=champion_from,
            polished=1500,
            polish_seconds=40.0,
        )
    text = refinements_text(read_runs(tmp_path).runs)
    assert text.startswith("| trees refined by CMA-ES | individuals |\n")
    assert text.splitlines()[-3:] == [
        (
            "* Mean loss of each bridge, of the 2 trees with all returns known: 0.00 in snapping to the grammar's "
            "constants (480.00 -> 480.00). Before, they returned 90.00."
        ),
        "* The champion is a refined tree in 0 of 2 runs, and a polished one in 1.",
        "* Besides, 3,000 trees were polished by local search, 1,500 a run in 40.0 s.",
    ]


def test_runs_whose_schedule_never_came_are_told_too(tmp_path):
    write_run(tmp_path / "a", "GE+PPO")
    assert refinements_text(read_runs(tmp_path).runs) == (
        "* PPO refined no tree in 1 run.\n* The champion is a refined tree in 0 of 1 run."
    )
