from sweeps_for_tests import refinement, skipped

from ge_torchrl.report.refinements import RefinementCounts, count_refinements


def test_both_ways_of_counting():
    records = [
        refinement(40, before=100.0, again=90.0, after=95.0, thresholds_moved=0, new_best=False),
        refinement(80, before=90.0, again=100.0, after=95.0, leaves_changed=0),
        refinement(120, before=9.0, again=9.0, after=499.8),
        refinement(160, before=500.0, again=490.0, after=490.0, new_best=False),
    ]
    assert count_refinements(records) == RefinementCounts(
        applied=4,
        beyond_fitness=2,
        beyond_return=2,
        new_best=2,
        moved_thresholds=3,
        changed_leaves=3,
        failed=0,
        skipped=0,
        timesteps=400_000,
    )


def test_a_failure_is_an_application_that_improved_nothing_and_a_skip_is_none():
    nothing = dict.fromkeys(
        ("return_after", "soft_return", "thresholds_moved", "leaves_changed", "largest_threshold_move")
    )
    failed = refinement(
        40, outcome="failed", failure="loss is NaN", new_best=False, timesteps=3000, **nothing
    )
    counts = count_refinements([failed, skipped(80)])
    assert counts == RefinementCounts(1, 0, 0, 0, 0, 0, failed=1, skipped=1, timesteps=3000)


def test_nothing_gives_zeros():
    assert count_refinements([]) == RefinementCounts(0, 0, 0, 0, 0, 0, 0, 0, 0)
