from sweeps_for_tests import refinement, skipped

from ge_torchrl.report.refinements import Bridges, RefinementCounts, count_refinements

NOTHING = dict.fromkeys(RefinementCounts.__dataclass_fields__, 0)


def test_both_ways_of_counting():
    records = [
        refinement(40, before=100.0, again=90.0, after=95.0, thresholds_moved=0, new_best=False),
        refinement(80, before=90.0, again=100.0, after=95.0, leaves_changed=0),
        refinement(120, before=9.0, again=9.0, after=499.8, written_back=True),
        refinement(160, before=500.0, again=490.0, after=490.0, new_best=False),
    ]
    assert count_refinements(records) == RefinementCounts(
        applied=4,
        beyond_fitness=2,
        beyond_return=2,
        new_best=2,
        written_back=1,
        moved_thresholds=3,
        changed_leaves=3,
        failed=0,
        skipped=0,
        timesteps=400_000,
        bridges=None,
    )


def test_a_failure_is_an_application_that_improved_nothing_and_a_skip_is_none():
    nothing = dict.fromkeys(
        ("return_after", "soft_return", "thresholds_moved", "leaves_changed", "largest_threshold_move")
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
