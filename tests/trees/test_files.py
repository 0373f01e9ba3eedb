import contextlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from documents_for_tests import CONTROLLER, NAMES, TEXT, WIDE, WIDE_TEXT, names_for, places, replaced
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


@pytest.mark.parametrize(
    ("controller", "text"), [(CONTROLLER, TEXT), (WIDE, WIDE_TEXT)], ids=["narrow", "wide"]
)
def test_a_controller_and_its_text(controller, text):
    assert to_json(controller) == text
    assert from_json(text) == controller


def test_a_file_from_before_there_were_bounds_is_read_without_any():
    content = json.loads(WIDE_TEXT)
    del content["environment"]["action_bounds"]
    controller = from_json(json.dumps(content))
    assert controller == replace(WIDE, names=replace(WIDE.names, action_bounds=()))
    assert json.loads(to_json(controller)) == content


def test_the_source_of_a_users_own_dynamics_comes_back():
    controller = replace(CONTROLLER, names=replace(NAMES, source="0123abcd"))
    text = to_json(controller)
    assert '"source": "0123abcd"' in text
    assert from_json(text) == controller


def test_no_provenance_is_an_empty_object():
    text = to_json(Controller(leaf(0), NAMES))
    assert text.endswith('"provenance": {}\n}\n')
    assert from_json(text).provenance == {}


@given(any_trees(), st.dictionaries(st.text(), finite_json_values, max_size=3))
def test_every_controller_comes_back(tree, provenance):
    controller = Controller(tree, names_for(tree), provenance)
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
    """The value with the numbers of the tree and the bounds as float32; no bounds are as good as none."""
    environment = value["environment"]
    content = {key: value[key] for key in ("splits", "leaves")} | {"bounds": environment.get("action_bounds")}
    content = json.loads(json.dumps(content), parse_float=np.float32)
    bounds = content.pop("bounds") or []
    return {**value, **content, "environment": {**environment, "action_bounds": bounds}}


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
