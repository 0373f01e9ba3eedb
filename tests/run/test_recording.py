"""From what happens in a search to what a run leaves."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from problems_for_tests import (
    ACTIONS,
    BAD,
    FEATURES,
    GOOD,
    POOR,
    UNITS,
    Analytic,
    Answers,
    config_of,
    contender,
    leaf,
    member,
    moved_by,
    problem_of,
)

from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.refiners.protocol import TrainingRecord
from ge_torchrl.run.recording import generation_record, refinement_records, write_untested, write_verdict
from ge_torchrl.search.archive import Archive
from ge_torchrl.search.conclusion import Finalist, Verdict
from ge_torchrl.search.proposals import INDIVIDUAL, KEPT, NEIGHBOUR, Proposal
from ge_torchrl.search.refinement import IMPROVED, Refinement
from ge_torchrl.search.state import Counts, Events, RefinementEvent
from ge_torchrl.search.step import first_state, step
from ge_torchrl.trees.controller import Names

NAMES = Names("CartPole-v1", FEATURES, UNITS, ACTIONS)


class TestGenerationRecord:
    @staticmethod
    def state(**ge):
        problem = problem_of(Analytic(lambda tree: float(tree.num_leaves)), ge=ge)
        return first_state(problem)[0]

    def test_it_tells_the_population_as_it_is(self):
        state = replace(
            self.state(),
            generation=3,
            best_refined=contender(GOOD, 77.0),
            counts=Counts(born=80, invalid=4, refined=5, polished=6),
        )
        events = Events(born=20, invalid=1, evaluation_seconds=0.5, variation_seconds=0.25)
        record = generation_record(state, events, 1234, 9.5)
        valid = state.population.fitness[np.isfinite(state.population.fitness)]
        assert len(valid) < 20
        assert (record.generation, record.env_steps, record.elapsed_seconds) == (3, 1234, 9.5)
        assert (record.best_fitness, record.median_fitness) == (valid.max(), np.median(valid))
        assert (record.mean_fitness, record.best_refined, record.best) == (valid.mean(), 77.0, 77.0)
        assert record.best_decision_nodes == valid.max() - 1
        assert (record.born, record.invalid, record.refined, record.polished) == (20, 1, 5, 6)
        assert (record.evaluation_seconds, record.variation_seconds) == (0.5, 0.25)

    def test_where_nobody_has_a_tree_there_is_nothing_to_tell(self):
        record = generation_record(self.state(genotype_length=2), Events(), 0, 0.0)
        nothing = (
            record.best_fitness,
            record.median_fitness,
            record.mean_fitness,
            record.best_decision_nodes,
        )
        assert nothing == (None,) * 4
        assert record.best is None


class TestRefinementRecord:
    @staticmethod
    def record(proposal, refined=GOOD, training=None, **told):
        told = {"outcome": IMPROVED, "fitness_before": 20.0, "fitness_after": 30.0, **told}
        training = training or TrainingRecord(timesteps=100, updates=2, gradient_steps=8)
        one = Refinement(proposal, refined, refined, 31.0, training=training, seconds=1.5, **told)
        (record,) = refinement_records(
            replace(TestGenerationRecord.state(), generation=4), Events((RefinementEvent(one, True, False),))
        )
        # It can be written as JSON.
        json.dumps(vars(record), allow_nan=False)
        return record

    def test_it_says_which_tree_and_what_came_of_it(self):
        proposal = Proposal(GOOD, INDIVIDUAL, 9.0, individual=7, chosen="best", redraws=2)
        moved = moved_by(np.float32(0.5))(GOOD)
        record = self.record(proposal, moved, fitness_snapped=29.0)
        assert (record.generation, record.outcome, record.origin) == (4, IMPROVED, "individual")
        assert (record.individual, record.chosen, record.redraws, record.fitness_before) == (
            7,
            "best",
            2,
            9.0,
        )
        assert (record.return_before, record.return_after, record.return_snapped) == (20.0, 30.0, 29.0)
        assert (record.decision_nodes, record.parameters_moved, record.leaves_changed) == (2, 2, 0)
        assert record.largest_parameter_move == pytest.approx(0.5)
        assert (record.timesteps, record.updates, record.gradient_steps) == (100, 2, 8)
        assert (record.written_back, record.new_best, record.refine_seconds) == (True, False, 1.5)

    def test_changed_leaves_are_counted(self):
        record = self.record(Proposal(BAD, INDIVIDUAL, 9.0, individual=7))
        assert (record.leaves_changed, record.parameters_moved) == (3, 1)
        assert self.record(Proposal(GOOD, INDIVIDUAL, 9.0, individual=7)).largest_parameter_move == 0.0

    def test_what_was_not_measured_is_null(self):
        record = self.record(Proposal(GOOD, INDIVIDUAL, 9.0, individual=7))
        assert (record.actor_loss, record.kl, record.soft_return, record.return_snapped) == (None,) * 4
        wild = TrainingRecord(actor_loss=math.inf, kl=0.5, failure="the loss is not finite")
        record = self.record(Proposal(GOOD, INDIVIDUAL, 9.0, individual=7), training=wild)
        assert (record.actor_loss, record.kl, record.failure) == (None, 0.5, "the loss is not finite")

    @pytest.mark.parametrize("origin", [NEIGHBOUR, KEPT])
    def test_what_is_no_individual_has_no_number_and_was_not_chosen_in_the_population(self, origin):
        record = self.record(Proposal(GOOD, origin, 9.0))
        assert (record.origin, record.individual, record.chosen) == (origin, None, None)

    def test_one_for_each_tree_that_the_refiner_refined_and_none_for_the_polish(self):
        backend = Analytic(lambda tree: float(tree.num_leaves))
        for refines, polishes, n_records in ((Answers(), Answers(), 2), (None, Answers(), 0)):
            problem = problem_of(backend, refines, polishes, refiner={"candidates": 2}, polish={"every": 2})
            state, _ = first_state(problem)
            for _ in range(2):
                state, events = step(problem, state)
            assert len(refinement_records(state, events)) == n_records
            assert state.counts.polished == 2

    def test_a_refinement_without_a_candidate_is_a_record_too(self):
        (record,) = refinement_records(TestGenerationRecord.state(), Events(redraws=20))
        assert (record.outcome, record.redraws, record.individual) == ("skipped", 20, None)


def finalist(full, pruned, returns, origin="population", archive_fitness=None):
    return Finalist(full, pruned, origin, 41.0, archive_fitness, np.array(returns))


class TestFiles:
    @pytest.fixture
    def folder(self, tmp_path):
        return RunFolder.create(tmp_path / "run", config_of(seed=3))

    def test_a_verdict_is_the_champion_and_the_best_of_each_size(self, folder):
        champion = finalist(GOOD, POOR, [4.0, 6.0], "polish", 5.5)
        small = finalist(leaf(0), leaf(0), [1.0, 2.0])
        verdict = Verdict(
            champion=champion,
            test_returns=np.array([7.0, 9.0]),
            test_returns_full=np.array([7.0, 8.0]),
            by_size=(small, champion),
            test_returns_by_size=np.array([[np.nan, np.nan], [7.0, 9.0]]),
        )
        records = write_verdict(config_of(seed=3), NAMES, folder, verdict)
        assert records == folder.read_archive()
        untested, best = records
        assert (best.decision_nodes, best.depth, best.origin, best.archive_mean) == (1, 1, "polish", 5.5)
        assert (best.validation_mean, best.test_mean, best.test_std) == (5.0, 8.0, 1.0)
        assert (untested.validation_mean, untested.test_mean, untested.test_std) == (1.5, None, None)
        written, full = folder.read_best_tree(), folder.read_best_tree_full()
        assert (written.tree, written.names, full.tree) == (POOR, NAMES, GOOD)
        told = dict(written.provenance)
        assert told.pop("program").startswith("ge_torchrl ")
        assert told == {
            "seed": 3, "grammar": "test", "train_fitness": 41.0, "validation_mean": 5.0, "test_mean": 8.0,
            "test_mean_full": 7.5, "pruned": True,
        }  # fmt: skip
        assert full.provenance["pruned"] is False
        kept = folder.read_archive_tree(1)
        assert (kept.tree, kept.provenance["test_mean"]) == (POOR, 8.0)
        assert (folder.path / "best_tree.txt").read_text().startswith("theta_dot < 0 rad/s?")

    def test_without_an_archive_there_is_no_table(self, folder):
        nothing = np.zeros((0, 2))
        verdict = Verdict(finalist(GOOD, GOOD, [1.0]), np.ones(2), np.ones(2), (), nothing)
        assert write_verdict(config_of(), NAMES, folder, verdict) == []
        assert not (folder.path / "archive.jsonl").exists()

    def test_what_is_left_untested_is_the_best_tree_and_the_best_kept_ones(self, folder):
        archive = Archive((member(POOR, 40.0), member(moved_by(0.1)(POOR), 30.0), member(GOOD, 400.0)))
        write_untested(config_of(seed=3), NAMES, folder, contender(BAD, 9.0), archive)
        best = folder.read_best_tree()
        assert (best.tree, best.provenance["train_fitness"], best.provenance["test_mean"]) == (BAD, 9.0, None)
        told = [(one.decision_nodes, one.archive_mean, one.validation_mean) for one in folder.read_archive()]
        assert told == [(1, 40.0, None), (2, 400.0, None)]
        assert folder.read_archive_tree(2).tree == GOOD
        write_untested(config_of(), NAMES, folder, member(GOOD, 400.0), Archive())
        assert folder.read_best_tree().provenance["train_fitness"] == 400.0
