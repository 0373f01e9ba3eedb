"""Files of the format before this one are still read."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from documents_for_tests import CONTROLLER, TEXT, TEXT_1
from hypothesis import given
from hypothesis import strategies as st
from strategies import trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.files import from_json, read_controller, to_json

PUBLISHED = sorted((Path(__file__).parents[2] / "docs" / "trees").glob("thesis_*.json"))


def content(**changes):
    return {**json.loads(TEXT_1), **changes}


def in_format_1(tree, numbering):
    """The arrays of the old format for a tree whose nodes behind the root are numbered anyhow."""
    n_splits, n_nodes = tree.num_decision_nodes, tree.num_decision_nodes + tree.num_leaves
    place = {
        node: numbering[node if node >= 0 else n_splits + ~node] for node in range(-tree.num_leaves, n_splits)
    }
    arrays = {key: [-1] * n_nodes for key in ("feature", "children_left", "children_right", "action")}
    arrays["threshold"] = [0.0] * n_nodes
    for node in range(n_splits):
        arrays["feature"][place[node]] = int(tree.feature[node])
        arrays["threshold"][place[node]] = float(tree.threshold[node])
        arrays["children_left"][place[node]] = place[int(tree.children_left[node])]
        arrays["children_right"][place[node]] = place[int(tree.children_right[node])]
    for number, action in enumerate(tree.action):
        arrays["action"][place[~number]] = int(action)
    return arrays


def test_the_old_text_gives_the_same_controller():
    assert from_json(TEXT_1) == CONTROLLER
    assert to_json(from_json(TEXT_1)) == TEXT


@given(st.data(), trees(n_actions=2))
def test_every_tree_is_read_whatever_its_numbering(data, tree):
    n_nodes = tree.num_decision_nodes + tree.num_leaves
    numbering = [0, *data.draw(st.permutations(range(1, n_nodes)))]
    assert from_json(json.dumps(content(**in_format_1(tree, numbering)))).tree == tree


@pytest.mark.parametrize("path", PUBLISHED, ids=lambda path: path.stem)
def test_the_published_trees_are_read(path):
    controller = read_controller(path)
    assert controller.names.id in {"CartPole-v1", "Acrobot-v1", "MountainCar-v0"}
    assert path.read_text() == to_json(controller)
    old = json.loads(path.read_text()) | {"format": "ge_torchrl.tree/1"}
    del old["splits"], old["leaves"]
    for key in ("kwargs", "wrappers", "max_episode_steps"):
        del old["environment"][key]
    nodes = range(controller.tree.num_decision_nodes + controller.tree.num_leaves)
    assert from_json(json.dumps(old | in_format_1(controller.tree, list(nodes)))) == controller


def test_there_are_three_published_trees():
    assert len(PUBLISHED) == 3


@pytest.mark.parametrize("key", json.loads(TEXT_1))
def test_a_missing_key_is_refused_by_name(key):
    with pytest.raises(InvalidTreeError, match=rf"best.json: {key}: expected"):
        from_json(json.dumps({name: value for name, value in content().items() if name != key}), "best.json")


@pytest.mark.parametrize("key", ["id", "features", "units", "actions"])
def test_a_missing_key_of_the_environment_is_refused_by_name(key):
    environment = {name: value for name, value in content()["environment"].items() if name != key}
    with pytest.raises(
        InvalidTreeError, match=rf"environment.{key}: expected in environment, but it is missing"
    ):
        from_json(json.dumps(content(environment=environment)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"nodes": []}, "'nodes': not a key of the document"),
        ({"feature": 2}, "feature: expected an array, got 2"),
        ({"feature": [2, 3.0, -1, -1, -1]}, r"feature\[1\]: expected a 32-bit integer, got 3.0"),
        ({"feature": [2**40, 3, -1, -1, -1]}, r"feature\[0\]: expected a 32-bit integer, got 1099511627776"),
        ({"feature": [2, -1, -1, -1, -1]}, r"feature\[1\]: -1 stands at leaves and nowhere else"),
        ({"feature": [2, 3, 0, -1, -1]}, r"feature\[2\]: -1 stands at leaves and nowhere else"),
        ({"feature": [2, -2, -1, -1, -1]}, "feature.* must be at least 0, not -2"),
        ({"action": [-1, -1, False, True, True]}, r"action\[2\]: expected a 32-bit integer, got False"),
        ({"action": [-1, 0, 0, 1, 1]}, r"action\[1\]: -1 stands at decision nodes and nowhere else"),
        ({"action": [-1, -1, -1, 1, 1]}, r"action\[2\]: -1 stands at decision nodes and nowhere else"),
        (
            {"children_left": [1, None, -1, -1, -1]},
            r"children_left\[1\]: expected a 32-bit integer, got None",
        ),
        ({"children_right": [4, 3, -1, -1]}, "children_right: expected 5 entries, as feature has, got 4"),
        ({"children_right": [4, -1, -1, -1, -1]}, r"children_right\[1\]: a node has two children or none"),
        ({"threshold": [0.1, True, 0, 0, 0]}, r"threshold\[1\]: expected a finite float32 number, got True"),
        ({"threshold": [0.1, math.nan, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got nan"),
        ({"threshold": [0.1, 1e39, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got 1e\+39"),
        ({"threshold": [0.1, 10**400, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got 10000"),
        ({"threshold": [0.1, 0.2, 0.3, 0, 0]}, r"threshold\[2\]: 0 stands at leaves"),
        ({"children_left": [1, 0, -1, -1, -1]}, r"children_left\[1\]: children are nodes 1 to 4"),
        ({"children_left": [3, 2, -1, -1, -1]}, "exactly one parent"),
        (
            {"children_left": [4, 2, -1, -1, -1], "children_right": [3, 1, -1, -1, -1]},
            "cycle|one parent",
        ),
        (
            {key: [] for key in ("feature", "threshold", "children_left", "children_right", "action")},
            "at least one node",
        ),
        ({"feature": [4, 3, -1, -1, -1]}, r"splits\[0\]: CartPole-v1 has features 0 to 3, not 4"),
        ({"action": [-1, -1, 0, 1, 2]}, r"leaves\[2\]: CartPole-v1 has actions 0 to 1, not 2"),
        ({"environment": "CartPole-v1"}, "environment: expected an object, got 'CartPole-v1'"),
        ({"provenance": None}, "provenance: expected an object, got None"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(changes, message):
    with pytest.raises(InvalidTreeError, match=rf"^best.json: .*{message}") as caught:
        from_json(json.dumps(content(**changes)), source="best.json")
    assert "\n" not in str(caught.value)


def test_a_leaf_as_root_beside_other_nodes_is_refused():
    beside = {
        "feature": [-1, 0, -1, -1],
        "threshold": [0.0, 0.5, 0.0, 0.0],
        "children_left": [-1, 2, -1, -1],
        "children_right": [-1, 3, -1, -1],
        "action": [0, -1, 0, 1],
    }
    with pytest.raises(InvalidTreeError, match=r"children_left\[0\]: the root is a leaf"):
        from_json(json.dumps(content(**beside)))


@given(
    st.sampled_from(["feature", "threshold", "children_left", "children_right", "action"]),
    st.integers(0, 4),
    st.integers(-3, 6),
)
def test_any_entry_is_read_as_it_is_or_refused(key, place, value):
    changed = json.loads(TEXT_1)
    changed[key][place] = value
    try:
        tree = from_json(json.dumps(changed)).tree
    except InvalidTreeError:
        return
    again = in_format_1(tree, range(tree.num_decision_nodes + tree.num_leaves))
    observed = np.random.default_rng(0).normal(size=(50, 4)).astype(np.float32)
    assert (
        from_json(json.dumps(changed | again)).tree.decide(observed).tolist()
        == tree.decide(observed).tolist()
    )
