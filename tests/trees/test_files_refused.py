"""What is no file of a tree is refused in one line, with the key where it is wrong."""

import json
import math

import pytest
from documents_for_tests import TEXT, WIDE_TEXT, places, replaced

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.files import from_json


@pytest.mark.parametrize("text", ["", "{", "tree", TEXT[:-5], "\ufeff" + TEXT, "[" * 100_000, "1" * 10_000])
def test_text_that_is_no_json_is_refused(text):
    with pytest.raises(InvalidTreeError, match=r"best\.json: expected JSON"):
        from_json(text, source="best.json")


@pytest.mark.parametrize("text", ["[]", "null", "3", '"tree"'])
def test_json_that_is_no_object_is_refused(text):
    with pytest.raises(InvalidTreeError, match="expected a JSON object, got"):
        from_json(text)


def test_a_key_that_stands_twice_is_refused():
    with pytest.raises(InvalidTreeError, match="'seed' stands 2 times in one object"):
        from_json(TEXT.replace('"seed": 3', '"seed": 3, "seed": 4'))


def keys_of_objects(content):
    """Yield (path, key) of every entry whose key the format fixes."""
    for path in places(content):
        if path and path[0] != "provenance" and "kwargs" not in path[:-1] and isinstance(path[-1], str):
            yield path


@pytest.mark.parametrize("path", list(keys_of_objects(json.loads(WIDE_TEXT))), ids=str)
def test_a_missing_or_unknown_key_is_refused_by_name(path):
    if path[-1] != "action_bounds":
        with pytest.raises(InvalidTreeError, match=rf"best.json: .*{path[-1]}: expected"):
            from_json(json.dumps(removed(json.loads(WIDE_TEXT), path)), "best.json")
    with pytest.raises(InvalidTreeError, match="'extra': not a key of"):
        from_json(json.dumps(replaced(json.loads(WIDE_TEXT), (*path[:-1], "extra"), 0)))


def removed(value, path):
    if len(path) == 1:
        return {key: entry for key, entry in value.items() if key != path[0]}
    return replaced(value, path[:1], removed(value[path[0]], path[1:]))


S0, S1, L0 = ("splits", 0), ("splits", 1), ("leaves", 0)
BOUNDS = ("environment", "action_bounds")
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
        (
            ("environment", "actions"),
            ["force"],
            "environment.action_bounds: .* each of the 1 actions .* got 2",
        ),
        (BOUNDS, {}, "environment.action_bounds: expected an array, got {}"),
        (BOUNDS, [[0, 1]], "environment.action_bounds: .* each of the 2 actions .* got 1"),
        ((*BOUNDS, 1), 3, r"environment.action_bounds\[1\]: expected an array, got 3"),
        ((*BOUNDS, 1), [0], r"action_bounds\[1\]: expected the least and the greatest value, got \[0\]"),
        ((*BOUNDS, 0), ["0", 1], r"action_bounds\[0\]\[0\]: expected a finite float32 number, got '0'"),
        ((*BOUNDS, 0), [0, math.inf], r"action_bounds\[0\]\[1\]: expected a finite .* got inf"),
        (
            (*BOUNDS, 0),
            [1, 0],
            r"action_bounds\[0\]: expected a least and a greatest value, .* got 1.0 and 0",
        ),
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
