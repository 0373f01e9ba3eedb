"""Records as values: what they count by themselves, and what of them the clock says."""

from collections import Counter
from dataclasses import fields

from hypothesis import given
from hypothesis import strategies as st
from records_for_tests import generation, summary

from ge_torchrl.artefacts.records import (
    CLOCK_FIELDS,
    ArchiveRecord,
    GenerationRecord,
    RefinementRecord,
    Summary,
)

RECORDS = (GenerationRecord, RefinementRecord, ArchiveRecord, Summary)


def test_every_field_that_the_clock_fills_is_known():
    timed = {field.name for record in RECORDS for field in fields(record) if "second" in field.name}
    # Whether worker processes pay is measured.
    assert timed | {"workers", "sampling_workers"} == CLOCK_FIELDS


@given(st.dictionaries(st.sampled_from(("fitness", "refinement", "polish", "test")), st.integers(0, 10**12)))
def test_all_steps_are_the_sum_of_the_ledger(steps):
    assert summary(steps=steps).env_steps_total == sum(steps.values())


def test_a_summary_keeps_the_ledger_as_it_was():
    ledger = Counter({"fitness": 7})
    found = summary(steps=ledger)
    ledger["test"] += 1
    assert (found.steps, found.env_steps_total) == ({"fitness": 7}, 7)


def test_the_best_of_a_generation_counts_refined_trees():
    assert generation(0, 9.0, 480.0).best == 480.0
    assert generation(0, 490.0, 480.0).best == 490.0
    assert generation(0, None, 480.0).best == 480.0
    assert generation(0, 9.0).best == 9.0
    assert generation(0, None).best is None
