"""Testing the trees of runs again."""

import json

import numpy as np
import pytest
from runs_for_tests import config, run

from ge_torchrl.errors import ArtefactError
from ge_torchrl.evaluation import evaluate


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    summary, output = run(config(), folder)
    return folder, summary, output


class TestEvaluation:
    def test_a_run_and_its_tree_file_give_the_same(self, finished):
        folder = finished[0]
        assert evaluate(folder, 50, 0) == evaluate(folder / "best_tree.json", 50, 0)

    def test_routes_agree_and_seeds_count_up(self, finished):
        tree = finished[0] / "best_tree.json"
        whole = evaluate(tree, 6, 100, "compiled")
        parts = [evaluate(tree, 3, 100, "gymnasium"), evaluate(tree, 3, 103, "gymnasium")]
        assert whole.mean == pytest.approx(np.mean([part.mean for part in parts]))
        assert (whole.min, whole.max) == (min(p.min for p in parts), max(p.max for p in parts))

    def test_summary_as_json_and_text(self, finished):
        summary = evaluate(finished[0], 10, 7)
        values = summary.as_dict()
        assert values.keys() >= {"mean", "std", "min", "max", "episodes", "solved"}
        assert json.loads(json.dumps(values)) == values
        assert "over 10 episodes" in summary.as_text()
        assert "seeds 7 to 16" in summary.as_text()

    def test_missing_trees_are_named(self, tmp_path):
        with pytest.raises(ArtefactError, match="nowhere"):
            evaluate(tmp_path / "nowhere.json", 1, 0)
        with pytest.raises(ArtefactError, match=r"best_tree\.json"):
            evaluate(tmp_path, 1, 0)
