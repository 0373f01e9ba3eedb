"""An ONNX model, and running it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import UserError
from ge_torchrl.exports.code import bounds_of, clipped_constants, summary
from ge_torchrl.exports.extras import INSTALL, UNVERIFIED, MissingToolError
from ge_torchrl.exports.names import printably_named
from ge_torchrl.exports.written import Written
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import DecisionTree, FloatArray

INPUT, OUTPUT = "observation", "action"
# Old enough for runtimes of some years ago.
_IR, _OPSET, _ML_OPSET = 8, 17, 3
_QUIET = 3


def write(controller: Controller, name: str) -> bytes:
    """Return a model with the input `observation` [N, D] and the output `action`, [N] int64 or [N, A] float32.

    The names of features and actions are in its metadata.

    Args:
        controller: The controller.
        name: The name of the graph.

    Raises:
        UserError: The package onnx is not installed.
    """
    if find_spec("onnx") is None:
        raise UserError(f"an ONNX model is written with the package onnx; {INSTALL}")
    from onnx import TensorProto, checker, helper

    controller = printably_named(controller)
    tree, names = controller.tree, controller.names
    graph = _Graph()
    if tree.is_axis_aligned and not len(tree.leaf_feature) and tree.num_decision_nodes:
        _tree_ensemble(graph, controller)
    else:
        _plain_operators(graph, controller)
    shape: list[str | int | None] = ["N"] if tree.has_actions else ["N", len(names.actions)]
    kind = TensorProto.INT64 if tree.has_actions else TensorProto.FLOAT
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            name,
            [helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["N", len(names.features)])],
            [helper.make_tensor_value_info(OUTPUT, kind, shape)],
            graph.constants,
        ),
        producer_name="ge_torchrl",
        doc_string=summary(controller),
        ir_version=_IR,
        opset_imports=[helper.make_opsetid("", _OPSET), helper.make_opsetid("ai.onnx.ml", _ML_OPSET)],
    )
    told = {"features": names.features, "units": names.units, "actions": names.actions}
    helper.set_model_props(model, {key: json.dumps(texts) for key, texts in told.items()})
    checker.check_model(model)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def answers(written: Sequence[Written], observed: Sequence[FloatArray]) -> list[NDArray[Any]]:
    """Return what onnxruntime answers to [B, D] observations of each model.

    Raises:
        MissingToolError: onnxruntime is not installed.
    """
    if find_spec("onnxruntime") is None:
        raise MissingToolError(f"an ONNX model is verified with onnxruntime; {INSTALL}; {UNVERIFIED}")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = _QUIET
    options.intra_op_num_threads = 1
    found: list[NDArray[Any]] = []
    for one, rows in zip(written, observed, strict=True):
        session = onnxruntime.InferenceSession(one.content, options, providers=["CPUExecutionProvider"])
        (answer,) = session.run([OUTPUT], {INPUT: rows})
        found.append(answer)
    return found


class _Graph:
    """The nodes and constants of a graph, under names that count."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any) -> str:
        from onnx import numpy_helper

        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def node(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        from onnx import helper

        name = output or f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [name], **attributes))
        return name

    def cast(self, value: str, kind: str, output: str = "") -> str:
        from onnx import TensorProto

        return self.node("Cast", value, output=output, to=getattr(TensorProto, kind))


def _tree_ensemble(graph: _Graph, controller: Controller) -> None:
    """Write an axis-aligned tree of actions or constants as the operator for trees."""
    tree = controller.tree
    n_splits, n_leaves = tree.num_decision_nodes, tree.num_leaves
    n_nodes = n_splits + n_leaves
    left, right = (
        [*np.where(children >= 0, children, n_splits + ~children).tolist(), *[0] * n_leaves]
        for children in (tree.children_left, tree.children_right)
    )
    values = (
        tree.action[:, np.newaxis].astype(np.float32) if tree.has_actions else clipped_constants(controller)
    )
    n_values = values.shape[1]
    answered = graph.node(
        "TreeEnsembleRegressor",
        INPUT,
        output="" if tree.has_actions else OUTPUT,
        domain="ai.onnx.ml",
        n_targets=n_values,
        aggregate_function="SUM",
        post_transform="NONE",
        nodes_treeids=[0] * n_nodes,
        nodes_nodeids=list(range(n_nodes)),
        nodes_modes=["BRANCH_LT"] * n_splits + ["LEAF"] * n_leaves,
        nodes_featureids=[*tree.feature.tolist(), *[0] * n_leaves],
        nodes_values=[*tree.threshold.tolist(), *[0.0] * n_leaves],
        nodes_truenodeids=left,
        nodes_falsenodeids=right,
        target_treeids=[0] * (n_leaves * n_values),
        target_nodeids=np.repeat(np.arange(n_splits, n_nodes), n_values).tolist(),
        target_ids=list(range(n_values)) * n_leaves,
        target_weights=values.ravel().tolist(),
    )
    if tree.has_actions:
        row = graph.node("Squeeze", answered, graph.constant(np.array([1])))
        graph.cast(row, "INT64", OUTPUT)


def _plain_operators(graph: _Graph, controller: Controller) -> None:
    """Write a tree with sums, in float64 and in the order of the terms."""
    tree = controller.tree
    leaf = _leaf_index(graph, tree)
    if tree.has_actions:
        graph.node("Gather", graph.constant(tree.action.astype(np.int64)), leaf, output=OUTPUT)
        return
    total = graph.node("Gather", graph.constant(tree.value.astype(np.float64)), leaf, axis=0)
    starts, n_terms = tree.leaf_term_start[:-1], np.diff(tree.leaf_term_start)
    wide = graph.cast(INPUT, "DOUBLE") if n_terms.any() else ""
    for place in range(n_terms.max(initial=0)):
        has_term = n_terms > place
        term = np.where(has_term, starts + place, 0)
        weight = np.where(has_term[:, np.newaxis], tree.leaf_weight[term], 0).astype(np.float64)
        feature = graph.constant(tree.leaf_feature[term].astype(np.int64)[:, np.newaxis])
        value = graph.node("GatherElements", wide, graph.node("Gather", feature, leaf, axis=0), axis=1)
        product = graph.node("Mul", value, graph.node("Gather", graph.constant(weight), leaf, axis=0))
        counts = graph.node("Gather", graph.constant(weight != 0), leaf, axis=0)
        product = graph.node("Where", counts, product, graph.constant(np.zeros(1)))
        total = graph.node("Add", total, product)
    low, high = bounds_of(controller.names)
    answered = graph.cast(total, "FLOAT")
    for bound, beyond in ((low, "Less"), (high, "Greater")):
        if np.isfinite(bound).any():
            limit = graph.constant(bound)
            answered = graph.node("Where", graph.node(beyond, answered, limit), limit, answered)
    graph.node("Identity", answered, output=OUTPUT)


def _leaf_index(graph: _Graph, tree: DecisionTree) -> str:
    """Write which leaf each observation ends in, [N]: the one whose path the answers of all splits agree with."""
    n_splits, n_leaves = tree.num_decision_nodes, tree.num_leaves
    if not n_splits:
        rows = graph.node("Shape", INPUT, start=0, end=1)
        from onnx import numpy_helper

        return graph.node("ConstantOfShape", rows, value=numpy_helper.from_array(np.zeros(1, np.int64)))
    wide = graph.cast(INPUT, "DOUBLE")
    starts, n_terms = tree.term_start[:-1], np.diff(tree.term_start)
    total = ""
    for place in range(int(n_terms.max())):
        has_term = n_terms > place
        term = np.where(has_term, starts + place, 0)
        value = graph.node("Gather", wide, graph.constant(tree.feature[term].astype(np.int64)), axis=1)
        product = graph.node("Mul", value, graph.constant(tree.weight[term].astype(np.float64)))
        if not has_term.all():
            product = graph.node("Where", graph.constant(has_term), product, graph.constant(np.zeros(1)))
        total = graph.node("Add", total, product) if total else product
    is_left = graph.cast(
        graph.node("Less", total, graph.constant(tree.threshold.astype(np.float64))), "FLOAT"
    )
    agrees, depth = np.zeros((n_splits, n_leaves), np.float32), np.zeros(n_leaves, np.float32)
    for leaf, path in _leaf_paths(tree):
        for split, goes_left in path:
            agrees[split, leaf] = 1 if goes_left else -1
            depth[leaf] += goes_left
    # At the leaf that is reached this is 0, at all others less.
    missing = graph.node("Sub", graph.node("MatMul", is_left, graph.constant(agrees)), graph.constant(depth))
    return graph.node("ArgMax", missing, axis=1, keepdims=0)


def _leaf_paths(tree: DecisionTree) -> list[tuple[int, list[tuple[int, bool]]]]:
    """Return each leaf with the splits above it, and whether the way to it goes left there."""
    found = []
    open_nodes: list[tuple[int, list[tuple[int, bool]]]] = [(0, [])]
    while open_nodes:
        node, path = open_nodes.pop()
        if node < 0:
            found.append((~node, path))
            continue
        open_nodes.append((int(tree.children_left[node]), [*path, (node, True)]))
        open_nodes.append((int(tree.children_right[node]), [*path, (node, False)]))
    return found
