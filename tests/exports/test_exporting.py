import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from documents_for_tests import CONTROLLER, WIDE, leaf, split
from exports_for_tests import formats, needs_compiler

from ge_torchrl.errors import RunFaultError, UserError
from ge_torchrl.exports import compiling, exporting
from ge_torchrl.exports.exporting import exported
from ge_torchrl.exports.formats import FORMATS
from ge_torchrl.exports.modules import loaded
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import from_json
from ge_torchrl.trees.tree import DecisionTree

TEXTS = [to for to in FORMATS if FORMATS[to].is_text and to != "sklearn"]


@pytest.mark.parametrize("to", formats())
def test_names_of_features_and_actions_are_kept(to):
    controller = CONTROLLER if to == "sklearn" else WIDE
    content = exported(controller, to)
    text = content.decode(errors="replace").replace("\\_", "_")
    used = {controller.names.features[feature] for feature in controller.tree.feature}
    for name in (*used, *controller.names.actions):
        assert name in text, name
    if to in ("python", "onnx", "sklearn", "json", "c"):
        assert all(name in text for name in controller.names.features)


def off_by_one_float32(controller):
    numbers = controller.tree.parameters.copy()
    numbers[0] = np.nextafter(numbers[0], np.float32(-np.inf))
    return replace(controller, tree=controller.tree.with_parameters(numbers))


def other_way_round(controller):
    left, right = (leaf(int(action)) for action in controller.tree.action[:2])
    return replace(controller, tree=split(2, 0.0154, split(3, 0.2290, right, left), left))


@pytest.mark.parametrize("to", formats())
@pytest.mark.parametrize("wrong", [off_by_one_float32, other_way_round])
def test_an_export_that_answers_otherwise_is_refused(to, wrong, monkeypatch):
    form = FORMATS[to]
    lying = form._replace(write=lambda controller, name: form.write(wrong(controller), name))
    monkeypatch.setattr(exporting, "FORMATS", {to: lying})
    with pytest.raises(RunFaultError, match=f"the exported {to} .*nothing is written"):
        exported(CONTROLLER, to)
    assert exported(CONTROLLER, to, verify=False)


@pytest.mark.parametrize("to", formats(["python", "c", "st", "onnx", "json"]))
def test_an_export_that_clips_otherwise_is_refused(to, monkeypatch):
    unbounded = replace(WIDE, names=replace(WIDE.names, action_bounds=()))
    form = FORMATS[to]
    lying = form._replace(write=lambda _, name: form.write(unbounded, name))
    monkeypatch.setattr(exporting, "FORMATS", {to: lying})
    with pytest.raises(RunFaultError, match="in another way than the tree"):
        exported(WIDE, to)


@pytest.mark.parametrize("to", formats(TEXTS))
def test_an_export_that_cannot_be_read_is_refused_in_one_line(to, monkeypatch):
    form = FORMATS[to]._replace(write=lambda *_: b"nothing of the kind {")
    monkeypatch.setattr(exporting, "FORMATS", {to: form})
    with pytest.raises(RunFaultError, match="nothing is written") as refused:
        exported(CONTROLLER, to)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("tree", "what"),
    [
        (
            DecisionTree.weighted_split([0, 1], [1.0, 2.0], 0.5, leaf(0), leaf(1)),
            "weighted sums in its splits",
        ),
        (DecisionTree.value_leaf([1.0, 2.0], {0: [1.0, 0.0]}), "linear leaves"),
    ],
)
def test_scikit_learn_takes_no_sums(tree, what):
    names = CONTROLLER.names if tree.has_actions else WIDE.names
    with pytest.raises(UserError, match=f"this tree has {what}"):
        exported(Controller(tree, names), "sklearn")


@pytest.mark.parametrize("name", ["", "2c", "while", "a b", "c__d"])
def test_a_name_that_the_language_has_not_is_refused(name):
    with pytest.raises(UserError, match="--name must be letters, digits"):
        exported(CONTROLLER, "c", name)


@needs_compiler
def test_a_name_is_that_of_the_function():
    for to, pattern in (("python", "def pole\\("), ("c", "int pole\\("), ("st", "FUNCTION_BLOCK pole\n")):
        assert re.search(pattern, exported(CONTROLLER, to, "pole").decode())


def test_without_a_compiler_c_is_written_only_unverified(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    with pytest.raises(
        UserError, match=r"expected a compiler \(no-such-compiler\); found none; .*--unverified"
    ):
        exported(CONTROLLER, "c")
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UserError, match=r"\(cc, gcc, clang\); found none"):
        exported(CONTROLLER, "c")
    assert b"int controller" in exported(CONTROLLER, "c", verify=False)


@pytest.mark.parametrize(
    ("to", "package"), [("onnx", "onnx"), ("onnx", "onnxruntime"), ("sklearn", "sklearn")]
)
def test_a_missing_extra_is_told_in_one_line(to, package, monkeypatch):
    # What cannot be found is what `find_spec` answers None for.
    for module in ("onnx_model", "sklearn_tree"):
        monkeypatch.setattr(
            f"ge_torchrl.exports.{module}.find_spec", lambda name: None if name == package else 1
        )
    with pytest.raises(UserError, match=r'pip install -c constraints.txt -e "\.\[export\]"'):
        exported(CONTROLLER, to)
    if package != "onnx":
        assert exported(CONTROLLER, to, verify=False)


def test_python_needs_no_import_and_takes_what_numbers_are_made_of():
    text = exported(CONTROLLER, "python").decode()
    assert "import" not in text
    module = loaded(text.encode())
    for observation in (
        [0.0, 0.0, 0.0154, 0.0],
        np.float32([0, 0, 0.0154, 0]),
        (0, 0, np.float32(0.0154), 0),
    ):
        assert module.controller(observation) == 1
    assert CONTROLLER.names.features == module.FEATURES


@needs_compiler
def test_a_tree_of_actions_needs_no_double_in_c():
    assert "double" not in exported(CONTROLLER, "c").decode()
    assert "0.0154f" in exported(CONTROLLER, "c").decode()
    assert "double" in exported(WIDE, "c").decode()


def test_thresholds_of_the_model_are_the_tree_s_float32():
    onnx = pytest.importorskip("onnx")
    model = onnx.load_from_string(exported(CONTROLLER, "onnx"))
    (values,) = (each for node in model.graph.node for each in node.attribute if each.name == "nodes_values")
    assert np.array_equal(np.float32(values.floats)[:2], CONTROLLER.tree.threshold)
    told = {entry.key: json.loads(entry.value) for entry in model.metadata_props}
    assert told == {key: list(getattr(CONTROLLER.names, key)) for key in ("features", "units", "actions")}


def test_the_tree_of_scikit_learn_is_drawn_by_its_own_tools():
    sklearn_tree = pytest.importorskip("sklearn.tree")
    module = loaded(exported(CONTROLLER, "sklearn"))
    model = module.controller()
    assert model.get_n_leaves() == 3
    assert model.get_depth() == 2
    assert "theta_dot <= 0.23" in sklearn_tree.export_text(model, feature_names=module.FEATURES)


def test_the_file_of_a_tree_is_its_own():
    assert from_json(exported(WIDE, "json").decode()) == WIDE


@needs_compiler
def test_no_format_loads_torch(tmp_path):
    program = (
        "import sys\nfrom ge_torchrl.exports.exporting import exported\n"
        "from ge_torchrl.trees.files import read_controller\n"
        "exported(read_controller(sys.argv[1]), 'c')\n"
        "print(*{'torch', 'onnx', 'sklearn', 'matplotlib', 'gymnasium'} & sys.modules.keys())"
    )
    path = tmp_path / "tree.json"
    path.write_bytes(exported(CONTROLLER, "json"))
    told = subprocess.run(
        [sys.executable, "-c", program, str(path)], check=True, capture_output=True, text=True
    )
    assert told.stdout == "\n"


@pytest.mark.parametrize("to", formats())
def test_large_and_lone_trees_are_exported(to):
    tree = leaf(0)
    for place in range(300):
        tree = split(0, float(place), leaf(place % 2), tree)
    chain = Controller(tree, CONTROLLER.names)
    assert exported(chain, to)
    assert exported(Controller(leaf(1), CONTROLLER.names), to)
    assert exported(Controller(DecisionTree.value_leaf([3.0, -0.0]), WIDE.names), to)


@needs_compiler
def test_a_compiler_that_refuses_is_told_in_one_line():
    with pytest.raises(RunFaultError, match=r"cc failed with status 1: .*error"):
        compiling.answers(
            [Written(CONTROLLER, "controller", b"int controller(")], [np.zeros((1, 4), np.float32)]
        )
