"""Edits of what splits sum and of what leaves with values answer."""

import numpy as np
import pytest

from ge_torchrl.trees import edits
from ge_torchrl.trees.edits import Neighbourhood, forest_of
from ge_torchrl.trees.tree import DecisionTree

leaf, split, weighted, value = (
    DecisionTree.leaf,
    DecisionTree.split,
    DecisionTree.weighted_split,
    DecisionTree.value_leaf,
)
# At the right leaf of a split on feature 0 at 0.5 the first two rows were not seen.
OBSERVED = np.array([[0.0, -2.0], [0.25, 4.0], [1.0, 10.0], [3.0, 30.0]], np.float32)
BOUNDS = ((-1.0, 3.0), (-np.inf, np.inf))


def edited(kind, tree, observed=OBSERVED, n=200, features=(0, 1)):
    """Return what one kind of edit makes of a tree, drawn many times."""
    bounds = BOUNDS[: tree.value.shape[1]]
    of = Neighbourhood(tree, observed, oblique=True, linear=True, action_bounds=bounds)
    drawn = [
        edits.EDITS[kind](
            edits.Edit(
                of._nodes, of._observed, of._leaf_start, features, 3, np.random.default_rng(seed), of._bounds
            )
        )
        for seed in range(n)
    ]
    return forest_of(drawn).trees()


def test_a_new_term_matters_and_leaves_the_sum_where_it_was():
    tree = split(0, 0.5, leaf(0), split(1, 20.0, leaf(1), leaf(2)))
    for other in edited("add_term", tree):
        counts = np.diff(other.term_start).tolist()
        assert sorted(counts) == [1, 2]
        at = counts.index(2)
        rows = OBSERVED if at == 0 else OBSERVED[2:]
        (old, new), (one, weight) = (
            array[other.term_start[at] : other.term_start[at + 1]].tolist()
            for array in (other.feature, other.weight)
        )
        assert (old, new, one) == (at, 1 - at, 1.0)
        share = abs(weight) * rows[:, new].std() / rows[:, old].std()
        assert 0.095 <= share <= 2.1
        assert float(f"{weight:.2g}") == pytest.approx(weight)
        assert other.threshold[at] == pytest.approx(
            tree.threshold[at] + weight * rows[:, new].mean(), abs=1e-5
        )
        assert other.threshold[1 - at] == tree.threshold[1 - at]
        assert other.action.tolist() == tree.action.tolist()
    signs = {float(np.sign(other.weight).prod()) for other in edited("add_term", tree)}
    assert signs == {-1.0, 1.0}


def test_a_split_of_all_features_is_drawn_anew_instead():
    tree = weighted([0, 1], [1.0, 2.0], 0.5, leaf(0), leaf(1))
    assert {len(other.feature) for other in edited("add_term", tree)} == {1}


def test_a_dropped_term_takes_what_it_added_from_the_threshold():
    tree = weighted([0, 1], [1.0, -0.5], 2.0, leaf(0), split(1, 0.0, leaf(1), leaf(2)))
    means = OBSERVED.mean(axis=0)
    found = {
        (int(other.feature[0]), float(other.weight[0]), float(other.threshold[0]))
        for other in edited("drop_term", tree)
    }
    assert found == {
        (0, 1.0, float(np.float32(2.0 + 0.5 * means[1]))),
        (1, -0.5, float(np.float32(2.0 - means[0]))),
    }
    # Where no sum has a term too many, one gets another.
    assert {len(other.feature) for other in edited("drop_term", split(0, 0.5, leaf(0), leaf(1)))} == {2}


def test_a_new_term_of_a_leaf_leaves_its_mean_answer_where_it_was():
    tree = split(0, 0.5, value([1.555, 2.555]), value([0.555, 0.555], {0: [1.0, 0.0], 1: [0.0, 1.0]}))
    reach = [2.0, 1.0]
    columns = set()
    for other in edited("add_leaf_term", tree):
        if len(other.leaf_feature) == 2:
            # The other leaf has no feature left: a constant of some leaf changed.
            assert np.count_nonzero(other.value != tree.value) == 1
            continue
        assert other.leaf_term_start.tolist() == [0, 1, 3]
        (column,) = np.flatnonzero(other.leaf_weight[0])
        columns.add(int(column))
        seen = OBSERVED[:2, other.leaf_feature[0]]
        share = abs(other.leaf_weight[0, column]) * seen.std() / reach[column]
        assert 0.095 <= share <= 2.1
        expected = tree.value[0].astype(float)
        expected[column] -= other.leaf_weight[0, column] * seen.mean()
        assert other.value[0] == pytest.approx(expected, abs=1e-5)
    assert columns == {0, 1}


def test_a_dropped_term_of_a_leaf_adds_its_mean_to_the_constants():
    tree = value([0.5, 0.0], {0: [1.0, 0.25], 1: [0.0, 2.0]})
    means = OBSERVED.mean(axis=0)
    found = {
        (other.leaf_feature.tobytes(), other.value.tobytes()) for other in edited("drop_leaf_term", tree)
    }
    assert found == {
        (np.int32([1]).tobytes(), np.float32([[0.5 + means[0], 0.25 * means[0]]]).tobytes()),
        (np.int32([0]).tobytes(), np.float32([[0.5, 2.0 * means[1]]]).tobytes()),
    }


@pytest.mark.parametrize("kind", ["relabel", "grow"])
def test_new_constants_lie_within_bounds_and_linear_terms_stay(kind):
    tree = value([0.555], {1: [2.0]})
    for other in edited(kind, tree):
        assert other.leaf_feature.tolist() == [1] * other.num_leaves
        new = [constant for constant in other.value[:, 0].tolist() if constant != tree.value[0, 0]]
        assert len(new) == 1
        assert -1 <= new[0] <= 3
        assert float(f"{new[0]:.2g}") == pytest.approx(new[0])
    assert {other.num_decision_nodes for other in edited(kind, tree)} == {int(kind == "grow")}


def test_what_is_constant_or_boundless_gives_finite_numbers():
    observed = np.array([[np.inf, 7.0], [-np.inf, 7.0]], np.float32)
    for kind in ("add_term", "add_leaf_term", "drop_term", "drop_leaf_term", "grow"):
        tree = weighted([0], [3e38], 3e38, value([3e38], {0: [3e38]}), value([1.0]))
        for other in edited(kind, tree, observed, n=50):
            assert np.isfinite(other.parameters).all()


def drawn_kinds(monkeypatch, tree, n=4000, **allowed):
    counts = dict.fromkeys(edits.EDITS, 0)

    def counting(kind):
        def edit(of):
            counts[kind] += 1
            return of.nodes

        return edit

    monkeypatch.setattr(edits, "EDITS", {kind: counting(kind) for kind in edits.EDITS})
    of, rng = Neighbourhood(tree, OBSERVED, **allowed), np.random.default_rng(0)
    for _ in range(n):
        of.draw([0, 1], 3, rng)
    total = sum(counts.values())
    return {kind: count / total for kind, count in counts.items() if count > 0}


def test_terms_come_and_go_only_where_they_may(monkeypatch):
    plain = {"grow": 0.4, "test_anew": 0.3, "drop": 0.1, "relabel": 0.2}
    of_sums, of_leaves = {"add_term": 0.4, "drop_term": 0.2}, {"add_leaf_term": 0.4, "drop_leaf_term": 0.2}
    actions, values = split(0, 0.5, leaf(0), leaf(1)), split(0, 0.5, value([0.0]), value([1.0]))
    for tree, allowed, expected in (
        (actions, {"linear": True}, plain),
        (actions, {"oblique": True}, plain | of_sums),
        (values, {}, plain),
        (values, {"oblique": True, "linear": True}, plain | of_sums | of_leaves),
        (value([0.0]), {"oblique": True, "linear": True}, {"grow": 0.4, "relabel": 0.2} | of_leaves),
        (leaf(0), {"oblique": True, "linear": True}, {"grow": 0.4}),
    ):
        with monkeypatch.context() as patched:
            shares = drawn_kinds(patched, tree, **allowed)
        total = sum(expected.values())
        assert shares == pytest.approx({kind: share / total for kind, share in expected.items()}, abs=0.03)
