import contextlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from documents_for_tests import DOCUMENT, LABELS, TEXT
from hypothesis import given
from hypothesis import strategies as st
from strategies import renumbered_trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.serialization import TreeDocument, from_json, to_json

leaf, split = DecisionTree.leaf, DecisionTree.split

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.integers(-2, 6),
    lambda values: st.lists(values, max_size=6) | st.dictionaries(st.text(max_size=5), values, max_size=3),
    max_leaves=8,
)
finite_json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda values: st.lists(values, max_size=3) | st.dictionaries(st.text(), values, max_size=3),
    max_leaves=5,
)


def content(**changes):
    return {**json.loads(TEXT), **changes}


def places(value, path=()):
    """Yield the path to every value within a JSON value."""
    yield path
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for key, entry in entries:
        yield from places(entry, (*path, key))


def replaced(value, path, new):
    if not path:
        return new
    copy = value.copy()
    copy[path[0]] = replaced(value[path[0]], path[1:], new)
    return copy


def test_text_of_a_document():
    assert to_json(DOCUMENT) == TEXT


def test_document_of_a_text():
    assert from_json(TEXT) == DOCUMENT


def test_no_provenance_is_an_empty_object():
    text = to_json(TreeDocument(leaf(0), LABELS))
    assert text.endswith('"provenance": {}\n}\n')
    assert from_json(text).provenance == {}


@given(renumbered_trees(n_actions=2), st.dictionaries(st.text(), finite_json_values, max_size=3))
def test_every_document_comes_back(tree, provenance):
    document = TreeDocument(tree, LABELS, provenance)
    text = to_json(document)
    assert from_json(text) == document
    assert to_json(from_json(text)) == text


def test_equal_documents_give_equal_text_whatever_the_order_of_their_provenance():
    one, other = (
        TreeDocument(leaf(0), LABELS, dict(p)) for p in [{"a": 1, "b": 2}.items(), [("b", 2), ("a", 1)]]
    )
    assert one == other
    assert hash(one) == hash(other)
    assert to_json(one) == to_json(other)


def test_provenance_is_copied():
    provenance = {"seeds": [1]}
    document = TreeDocument(leaf(0), LABELS, provenance)
    provenance["seeds"].append(2)
    assert document.provenance == {"seeds": [1]}


def test_thresholds_are_rounded_to_float32_and_may_be_whole_numbers():
    document = from_json(json.dumps(content(threshold=[0.015399999916553497, 1, 0, 0, -0.0])))
    assert document.tree.threshold.tolist() == [float(np.float32(0.0154)), 1.0, 0.0, 0.0, 0.0]
    assert "[0.0154, 1.0, 0.0, 0.0, 0.0]" in to_json(document)


@pytest.mark.parametrize("end", [-1, 1])
def test_the_largest_float32_comes_back_and_what_rounds_to_infinity_is_refused(end):
    largest = end * float(np.finfo(np.float32).max)
    text = to_json(TreeDocument(split(0, largest, leaf(0), leaf(1)), LABELS))
    assert "3.4028235e+38, " in text
    assert from_json(text).tree.threshold[0] == largest
    too_large = end * (2**128 - 2**103)
    with pytest.raises(InvalidTreeError, match=r"threshold\[0\]: expected a finite float32 number"):
        from_json(text.replace("3.4028235e+38", str(abs(too_large))))
    below = abs(too_large) - 2**75
    assert from_json(text.replace("3.4028235e+38", str(below))).tree.threshold[0] == largest


@pytest.mark.parametrize("text", ["", "{", "tree", TEXT[:-5], "\ufeff" + TEXT, "[" * 100_000, "1" * 10_000])
def test_text_that_is_no_json_is_refused(text):
    with pytest.raises(InvalidTreeError, match=r"best\.json: expected JSON"):
        from_json(text, source="best.json")


@pytest.mark.parametrize("text", ["[]", "null", "3", '"tree"'])
def test_json_that_is_no_object_is_refused(text):
    with pytest.raises(InvalidTreeError, match="expected a JSON object, got"):
        from_json(text)


def test_a_key_that_stands_twice_is_refused():
    with pytest.raises(InvalidTreeError, match="seed: expected once, but it stands 2 times"):
        from_json(TEXT.replace('"seed": 3', '"seed": 3, "seed": 4'))


@pytest.mark.parametrize("key", json.loads(TEXT))
def test_a_missing_key_is_refused_by_name(key):
    with pytest.raises(InvalidTreeError, match=f"best.json: {key}: expected"):
        from_json(json.dumps({name: value for name, value in content().items() if name != key}), "best.json")


@pytest.mark.parametrize("key", ["id", "features", "units", "actions"])
def test_a_missing_key_of_the_environment_is_refused_by_name(key):
    environment = {name: value for name, value in content()["environment"].items() if name != key}
    with pytest.raises(InvalidTreeError, match=f"{key}: expected in environment, but it is missing"):
        from_json(json.dumps(content(environment=environment)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "ge_torchrl.tree/2"}, "format: expected 'ge_torchrl.tree/1', .* got 'ge_torchrl.tree/2'"),
        ({"format": 1}, "format: expected 'ge_torchrl.tree/1', .* got 1"),
        ({"format": "ge_torchrl.tree/2", "nodes": []}, "format: expected"),
        ({"nodes": []}, "'nodes': not a key of the document"),
        ({"feature": 2}, "feature: expected an array, got 2"),
        ({"feature": [2, 3.0, -1, -1, -1]}, r"feature\[1\]: expected a 32-bit integer, got 3.0"),
        ({"feature": [2, "3", -1, -1, -1]}, r"feature\[1\]: expected a 32-bit integer, got '3'"),
        ({"feature": [2**40, 3, -1, -1, -1]}, r"feature\[0\]: expected a 32-bit integer, got 1099511627776"),
        ({"action": [-1, -1, False, True, True]}, r"action\[2\]: expected a 32-bit integer, got False"),
        (
            {"children_left": [1, None, -1, -1, -1]},
            r"children_left\[1\]: expected a 32-bit integer, got None",
        ),
        ({"children_right": [4, 3, -1, -1]}, "children_right: expected 5 entries, as feature has, got 4"),
        ({"threshold": [0.1, True, 0, 0, 0]}, r"threshold\[1\]: expected a finite float32 number, got True"),
        ({"threshold": [0.1, math.nan, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got nan"),
        ({"threshold": [0.1, -math.inf, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got -inf"),
        ({"threshold": [0.1, 1e39, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got 1e\+39"),
        ({"threshold": [0.1, 10**400, 0, 0, 0]}, r"threshold\[1\]: expected a finite .* got 10000"),
        ({"children_left": [1, 0, -1, -1, -1]}, "children must be nodes 1 to 4"),
        ({"children_left": [3, 2, -1, -1, -1]}, "exactly one parent"),
        ({"children_left": [4, 2, -1, -1, -1], "children_right": [3, 1, -1, -1, -1]}, "cycle|one parent"),
        (
            {key: [] for key in ("feature", "threshold", "children_left", "children_right", "action")},
            "at least 1",
        ),
        ({"feature": [4, 3, -1, -1, -1]}, r"feature\[0\]: CartPole-v1 has features 0 to 3, not 4"),
        ({"action": [-1, -1, 0, 1, 2]}, r"action\[4\]: CartPole-v1 has actions 0 to 1, not 2"),
        ({"environment": "CartPole-v1"}, "environment: expected an object, got 'CartPole-v1'"),
        ({"provenance": None}, "provenance: expected an object, got None"),
        ({"provenance": {"fitness": math.nan}}, "provenance: expected a JSON object of finite values"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(changes, message):
    with pytest.raises(InvalidTreeError, match=f"^best.json: .*{message}"):
        from_json(json.dumps(content(**changes)), source="best.json")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"id": 1}, "environment.id: expected a string, got 1"),
        ({"features": "xyz"}, "environment.features: expected an array, got 'xyz'"),
        ({"actions": ["left", 1]}, r"environment.actions\[1\]: expected a string, got 1"),
        ({"units": ["m"]}, "4 features and 1 units"),
        ({"actions": []}, "at least one feature and one action"),
        ({"author": "me"}, "'author': not a key of environment"),
    ],
)
def test_a_wrong_environment_is_refused_with_its_key(changes, message):
    with pytest.raises(InvalidTreeError, match=message):
        from_json(json.dumps(content(environment={**content()["environment"], **changes})))


def test_a_number_that_overflows_float64_is_refused():
    with pytest.raises(InvalidTreeError, match=r"threshold\[0\]: expected a finite float32 number, got inf"):
        from_json(TEXT.replace("0.0154", "1e400"))


@given(st.sampled_from(list(places(json.loads(TEXT)))), json_values)
def test_any_value_anywhere_is_read_as_it_is_or_refused(path, value):
    mutated = replaced(json.loads(TEXT), path, value)
    try:
        document = from_json(json.dumps(mutated))
    except InvalidTreeError:
        return
    expected = {**mutated, "threshold": np.float32(mutated["threshold"]).tolist()}
    read = json.loads(to_json(document))
    assert {**read, "threshold": np.float32(read["threshold"]).tolist()} == expected


@given(st.integers(0, len(TEXT)), st.integers(0, len(TEXT)), st.text(max_size=3))
def test_torn_text_is_read_or_refused(start, end, inserted):
    with contextlib.suppress(InvalidTreeError):
        from_json(TEXT[:start] + inserted + TEXT[end:])


@pytest.mark.parametrize("provenance", [{"run": Path()}, {"fitness": math.inf}, {1j: 0}])
def test_provenance_that_is_no_json_is_refused_at_birth(provenance):
    with pytest.raises(InvalidTreeError, match="provenance: expected a JSON object"):
        TreeDocument(leaf(0), LABELS, provenance)


def test_a_tree_that_the_environment_cannot_run_is_refused_at_birth():
    with pytest.raises(InvalidTreeError, match="has actions 0 to 1, not 2"):
        TreeDocument(leaf(2), LABELS)
