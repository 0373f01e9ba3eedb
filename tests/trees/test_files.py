import contextlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from documents_for_tests import CONTROLLER, NAMES, TEXT, WIDE, WIDE_TEXT
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import from_json, to_json
from ge_torchrl.trees.tree import DecisionTree

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
    copy[path[0]] = replaced(value[path[0]], path[1:], new) if path[1:] else new
    return copy


@pytest.mark.parametrize(
    ("controller", "text"), [(CONTROLLER, TEXT), (WIDE, WIDE_TEXT)], ids=["narrow", "wide"]
)
def test_a_controller_and_its_text(controller, text):
    assert to_json(controller) == text
    assert from_json(text) == controller


def test_no_provenance_is_an_empty_object():
    text = to_json(Controller(leaf(0), NAMES))
    assert text.endswith('"provenance": {}\n}\n')
    assert from_json(text).provenance == {}


@given(any_trees(), st.dictionaries(st.text(), finite_json_values, max_size=3))
def test_every_controller_comes_back(tree, provenance):
    names = replace(WIDE.names, actions=("a", "b", "c")) if tree.has_actions else WIDE.names
    controller = Controller(tree, names, provenance)
    text = to_json(controller)
    assert from_json(text) == controller
    assert to_json(from_json(text)) == text


def test_equal_controllers_give_equal_text_whatever_the_order_of_their_provenance():
    one, other = (
        Controller(leaf(0), NAMES, dict(p)) for p in [{"a": 1, "b": 2}.items(), [("b", 2), ("a", 1)]]
    )
    assert one == other
    assert hash(one) == hash(other)
    assert to_json(one) == to_json(other)


def test_provenance_is_copied():
    provenance = {"seeds": [1]}
    controller = Controller(leaf(0), NAMES, provenance)
    provenance["seeds"].append(2)
    assert controller.provenance == {"seeds": [1]}


def test_numbers_are_rounded_to_float32_and_may_be_whole():
    text = TEXT.replace("0.0154", "0.015399999916553497").replace("0.229", "1").replace("1.0}]", "1}]")
    controller = from_json(text)
    assert controller.tree.threshold.tolist() == [float(np.float32(0.0154)), 1.0]
    assert to_json(controller) == TEXT.replace("0.229", "1.0")
    assert from_json(TEXT.replace("0.229", "-0.0")).tree == from_json(TEXT.replace("0.229", "0")).tree


def test_any_numbering_is_read():
    content = json.loads(TEXT)
    content["leaves"] = [{"action": 1}, {"action": 0}, {"action": 1}]
    for split, children in zip(content["splits"], ((1, -1), (-2, -3)), strict=True):
        split["left"], split["right"] = children
    assert from_json(json.dumps(content)) == CONTROLLER


@pytest.mark.parametrize("end", [-1, 1])
def test_the_largest_float32_comes_back_and_what_rounds_to_infinity_is_refused(end):
    largest = end * float(np.finfo(np.float32).max)
    text = to_json(Controller(split(0, largest, leaf(0), leaf(1)), NAMES))
    assert "3.4028235e+38, " in text
    assert from_json(text).tree.threshold[0] == largest
    too_large = end * (2**128 - 2**103)
    with pytest.raises(InvalidTreeError, match=r"splits\[0\].threshold: expected a finite float32 number"):
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
    with pytest.raises(InvalidTreeError, match="'seed': expected once, but it stands 2 times"):
        from_json(TEXT.replace('"seed": 3', '"seed": 3, "seed": 4'))


def keys_of_objects(content):
    """Yield (path, key) of every entry whose key the format fixes."""
    for path in places(content):
        if path and path[0] != "provenance" and "kwargs" not in path[:-1] and isinstance(path[-1], str):
            yield path


@pytest.mark.parametrize("path", list(keys_of_objects(json.loads(WIDE_TEXT))), ids=str)
def test_a_missing_or_unknown_key_is_refused_by_name(path):
    with pytest.raises(InvalidTreeError, match=rf"best.json: .*{path[-1]}: expected"):
        from_json(json.dumps(removed(json.loads(WIDE_TEXT), path)), "best.json")
    with pytest.raises(InvalidTreeError, match="'extra': not a key of"):
        from_json(json.dumps(replaced(json.loads(WIDE_TEXT), (*path[:-1], "extra"), 0)))


def removed(value, path):
    if len(path) == 1:
        return {key: entry for key, entry in value.items() if key != path[0]}
    return replaced(value, path[:1], removed(value[path[0]], path[1:]))


S0, S1, L0 = ("splits", 0), ("splits", 1), ("leaves", 0)
LINEAR = ("leaves", 0, "linear", 0)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            ("format",),
            "ge_torchrl.tree/3",
            "format: expected 'ge_torchrl.tree/2' or .*/1', .* got 'ge_torchrl.tree/3'",
        ),
        (("format",), 1, "format: expected 'ge_torchrl.tree/2' or .* got 1"),
        (("splits",), {}, "splits: expected an array, got {}"),
        (("splits",), [], "leaves: expected 1, one more than there are splits, got 3"),
        (S0, 3, r"splits\[0\]: expected an object, got 3"),
        (S0, [[[[[[[[]]]]]]]], r"splits\[0\]: expected an object, got \[\[.*"),
        ((*S0, "terms"), {}, r"splits\[0\].terms: expected an array, got {}"),
        ((*S0, "terms"), [], r"splits\[0\].terms: expected at least one term, got none"),
        ((*S0, "terms", 0), 1, r"splits\[0\].terms\[0\]: expected an object, got 1"),
        (
            (*S0, "terms", 0, "feature"),
            3.0,
            r"splits\[0\].terms\[0\].feature: expected a 32-bit integer, got 3.0",
        ),
        ((*S0, "terms", 0, "feature"), "3", r"terms\[0\].feature: expected a 32-bit integer, got '3'"),
        (
            (*S0, "terms", 0, "feature"),
            2**40,
            r"terms\[0\].feature: expected a 32-bit integer, got 1099511627776",
        ),
        ((*S0, "terms", 0, "feature"), 10**400, r"terms\[0\].feature: expected a 32-bit integer, got 1000"),
        ((*S0, "terms", 0, "feature"), -1, r"terms\[0\].feature: expected at least 0, got -1"),
        ((*S0, "terms", 0, "feature"), 4, r"splits\[0\]: CartPole-v1 has features 0 to 3, not 4"),
        (
            (*S0, "terms", 0, "weight"),
            math.nan,
            r"terms\[0\].weight: expected a finite float32 number, got nan",
        ),
        (
            (*S0, "terms", 0, "weight"),
            1e39,
            r"terms\[0\].weight: expected a finite float32 number, got 1e\+39",
        ),
        (
            (*S0, "terms", 0, "weight"),
            -(10**400),
            r"terms\[0\].weight: expected a finite float32 number, got -1000",
        ),
        ((*S0, "terms", 0, "weight"), None, r"terms\[0\].weight: expected a finite float32 number, got None"),
        ((*S1, "threshold"), True, r"splits\[1\].threshold: expected a finite float32 number, got True"),
        ((*S1, "threshold"), math.nan, r"splits\[1\].threshold: expected a finite .* got nan"),
        ((*S1, "threshold"), -math.inf, r"splits\[1\].threshold: expected a finite .* got -inf"),
        ((*S1, "threshold"), 1e39, r"splits\[1\].threshold: expected a finite .* got 1e\+39"),
        ((*S1, "threshold"), 10**400, r"splits\[1\].threshold: expected a finite .* got 10000"),
        ((*S1, "threshold"), [0.1], r"splits\[1\].threshold: expected a finite .* got \[0.1\]"),
        ((*S0, "left"), None, r"splits\[0\].left: expected a 32-bit integer, got None"),
        ((*S0, "left"), True, r"splits\[0\].left: expected a 32-bit integer, got True"),
        (
            (*S0, "left"),
            0,
            r"splits\[0\].left: expected a split, 1 to 1 \(0 is the root\), or a leaf, -1 to -3, got 0",
        ),
        ((*S0, "left"), 2, r"splits\[0\].left: expected a split, 1 to 1 .* got 2"),
        ((*S1, "right"), -4, r"splits\[1\].right: expected a split, 1 to 1 .* or a leaf, -1 to -3, got -4"),
        (
            (*S1, "left"),
            1,
            "splits: leaf 0 must have exactly one parent, not 0|splits: split 1 must have exactly one",
        ),
        ((*S1, "right"), -1, "splits: leaf 0 must have exactly one parent, not 2"),
        ((*S0, "left"), -3, "splits: split 1 must have exactly one parent, not 0"),
        (("leaves",), None, "leaves: expected an array, got None"),
        (("leaves",), [], "leaves: expected 3, one more than there are splits, got 0"),
        (L0, 0, r"leaves\[0\]: expected an object, got 0"),
        ((*L0, "action"), False, r"leaves\[0\].action: expected a 32-bit integer, got False"),
        ((*L0, "action"), -1, r"leaves\[0\].action: expected at least 0, got -1"),
        ((*L0, "action"), 10**30, r"leaves\[0\].action: expected a 32-bit integer, got 10000"),
        ((*L0, "action"), 2, r"leaves\[0\]: CartPole-v1 has actions 0 to 1, not 2"),
        (
            ("leaves", 1),
            {"value": [0.5], "linear": []},
            r"leaves\[1\].action: expected in leaves\[1\], but it is missing",
        ),
        (("environment",), "CartPole-v1", "environment: expected an object, got 'CartPole-v1'"),
        (("environment", "id"), 1, "environment.id: expected a string, got 1"),
        (("environment", "features"), "xyz", "environment.features: expected an array, got 'xyz'"),
        (("environment", "features"), [], "environment.units: .* has 0 features and 4 units"),
        (("environment", "actions"), ["left", 1], r"environment.actions\[1\]: expected a string, got 1"),
        (("environment", "units"), ["m"], "environment.units: .* has 4 features and 1 units"),
        (("environment", "actions"), [], "environment.actions: expected at least one name"),
        (("environment", "wrappers"), [{}], r"environment.wrappers\[0\]: expected a string, got {}"),
        (("environment", "kwargs"), [], "environment.kwargs: expected an object, got \\[\\]"),
        (
            ("environment", "kwargs"),
            {"a": math.inf},
            "environment.kwargs: expected a JSON object of finite values",
        ),
        (
            ("environment", "max_episode_steps"),
            0,
            "environment.max_episode_steps: expected at least 1 or null, got 0",
        ),
        (
            ("environment", "max_episode_steps"),
            2.5,
            "environment.max_episode_steps: expected a 32-bit integer, got 2.5",
        ),
        (("provenance",), None, "provenance: expected an object, got None"),
        (("provenance",), {"fitness": math.nan}, "provenance: expected a JSON object of finite values"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(path, value, message):
    refused(replaced(json.loads(TEXT), path, value), message)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ((*L0, "value"), 0.5, r"leaves\[0\].value: expected an array, got 0.5"),
        ((*L0, "value"), [], r"leaves\[0\].value: expected at least one number, got 0"),
        (
            (*L0, "value"),
            [0.5, math.nan],
            r"leaves\[0\].value\[1\]: expected a finite float32 number, got nan",
        ),
        (
            (*L0, "value"),
            [0.5, 1e39],
            r"leaves\[0\].value\[1\]: expected a finite float32 number, got 1e\+39",
        ),
        (
            ("leaves", 1, "value"),
            [0.5],
            r"leaves\[1\].value: expected 2 numbers, as leaves\[0\].value has, got 1",
        ),
        ((*L0, "linear"), {}, r"leaves\[0\].linear: expected an array, got {}"),
        (LINEAR, [], r"leaves\[0\].linear\[0\]: expected an object, got \[\]"),
        ((*LINEAR, "feature"), -2, r"linear\[0\].feature: expected at least 0, got -2"),
        ((*LINEAR, "feature"), 4, r"leaves\[0\]: Somewhere-v0 has features 0 to 3, not 4"),
        ((*LINEAR, "weights"), 1.0, r"leaves\[0\].linear\[0\].weights: expected an array, got 1.0"),
        (
            (*LINEAR, "weights"),
            [1.0],
            r"linear\[0\].weights: expected 2 numbers, as leaves\[0\].value has, got 1",
        ),
        ((*LINEAR, "weights"), [1.0, 10**400], r"linear\[0\].weights\[1\]: expected a finite .* got 1000"),
        (("environment", "actions"), ["force"], r"leaves\[0\].value: Somewhere-v0 takes 1 values, not 2"),
        (("leaves", 1), {"action": 0}, r"leaves\[1\].value: expected in leaves\[1\], but it is missing"),
    ],
)
def test_a_wrong_value_of_a_leaf_is_refused_with_its_key(path, value, message):
    refused(replaced(json.loads(WIDE_TEXT), path, value), message)


def refused(content, message):
    with pytest.raises(InvalidTreeError, match=f"^best.json: .*{message}") as caught:
        from_json(json.dumps(content), source="best.json")
    assert "\n" not in str(caught.value)


def test_a_cycle_is_refused():
    content = json.loads(TEXT)
    splits = [{"terms": [{"feature": 0, "weight": 1.0}], "threshold": 0.5}] * 3
    children = [(-1, -2), (2, -3), (1, -4)]
    content["splits"] = [
        {**split, "left": left, "right": right} for split, (left, right) in zip(splits, children, strict=True)
    ]
    content["leaves"] = [{"action": 0}] * 4
    refused(content, "splits: 2 splits form a cycle that the root does not reach")


@pytest.mark.parametrize("nested", ['{"a":' * 100_000, "[" * 100_000])
@pytest.mark.parametrize("where", ['"provenance": ', '"splits": ', '"kwargs": '])
def test_deep_nesting_is_refused(where, nested):
    with pytest.raises(InvalidTreeError, match="expected JSON"):
        from_json(TEXT.replace(where, where + nested))


def test_a_number_that_overflows_float64_is_refused():
    with pytest.raises(
        InvalidTreeError, match=r"splits\[0\].threshold: expected a finite float32 number, got inf"
    ):
        from_json(TEXT.replace("0.0154", "1e400"))


@given(st.sampled_from([TEXT, WIDE_TEXT]), st.data(), json_values)
def test_any_value_anywhere_is_read_as_it_is_or_refused(text, data, value):
    content = json.loads(text)
    mutated = replaced(content, data.draw(st.sampled_from(list(places(content)))), value)
    try:
        controller = from_json(json.dumps(mutated))
    except InvalidTreeError:
        return
    assert rounded(json.loads(to_json(controller))) == rounded(mutated)


def rounded(value):
    """The value with the numbers of the tree as float32."""
    content = json.loads(
        json.dumps({key: value[key] for key in ("splits", "leaves")}), parse_float=np.float32
    )
    return {**value, **content}


@given(st.integers(0, len(TEXT)), st.integers(0, len(TEXT)), st.text(max_size=3))
def test_torn_text_is_read_or_refused(start, end, inserted):
    with contextlib.suppress(InvalidTreeError):
        from_json(TEXT[:start] + inserted + TEXT[end:])


@pytest.mark.parametrize("provenance", [{"run": Path()}, {"fitness": math.inf}, {1j: 0}])
def test_provenance_that_is_no_json_is_refused_at_birth(provenance):
    with pytest.raises(InvalidTreeError, match="provenance: expected a JSON object"):
        Controller(leaf(0), NAMES, provenance)


def test_a_tree_that_the_environment_cannot_run_is_refused_at_birth():
    with pytest.raises(InvalidTreeError, match="has actions 0 to 1, not 2"):
        Controller(leaf(2), NAMES)
