import numpy as np
import pytest
from hypothesis import given, settings
from strategies import trees
from sweeps_for_tests import CARTPOLE, PRUNED, controller, leaf, split

from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.canvas import ORANGE, SKY
from ge_torchrl.report.drawing import draw_tree, save_tree, tidy_layout
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.tree import DecisionTree

BOX_HEIGHT = 0.36


def texts(figure):
    return sorted(text.get_text() for text in figure.axes[0].texts)


@given(trees(max_leaves=40))
def test_boxes_neither_meet_nor_leave_the_figure_and_leaves_stand_in_order(tree):
    # Widths of all kinds: a decision is the widest box of all, a leaf next to nothing, and the other way round.
    for decision, leaf_width in ((3.0, 0.2), (0.2, 3.0), (1.0, 1.0)):
        n_splits = tree.num_decision_nodes
        widths = np.repeat([decision, leaf_width], [n_splits, tree.num_leaves])
        x, y, _, _, (width, height) = tidy_layout(tree, widths)
        assert (x - widths / 2).min() > 0
        assert (x + widths / 2).max() < width
        assert y.min() > BOX_HEIGHT / 2
        assert y.max() < height - BOX_HEIGHT / 2
        for level in np.unique(y):
            row = np.flatnonzero(y == level)
            row = row[np.argsort(x[row])]
            gaps = (x[row] - widths[row] / 2)[1:] - (x[row] + widths[row] / 2)[:-1]
            assert (gaps > 0.1).all()
        left, right = (
            np.where(children >= 0, children, n_splits + ~children)
            for children in (tree.children_left, tree.children_right)
        )
        assert (np.diff(x[n_splits:]) > 0).all()
        assert (x[left] < x[right]).all()
        assert x[:n_splits] == pytest.approx((x[left] + x[right]) / 2)
        assert (y[left] < y[:n_splits]).all()


def test_edges_do_not_cross_boxes_as_levels_are_apart():
    layout = tidy_layout(PRUNED, np.ones(PRUNED.num_decision_nodes + PRUNED.num_leaves))
    levels = np.unique(layout.y)
    assert np.diff(levels).min() > BOX_HEIGHT + 0.3


def test_a_drawing_says_what_the_tree_says():
    figure = draw_tree(controller(PRUNED))
    assert texts(figure) == [
        "False",
        "False",
        "True",
        "True",
        "left",
        "right",
        "right",
        "theta < 0.0154 rad",
        "theta_dot < 0.229 rad/s",
    ]


def test_true_goes_left_and_actions_have_their_colours():
    figure = draw_tree(controller(split(0, 1.0, leaf(0), leaf(1))))
    place = {text.get_text(): text.get_position()[0] for text in figure.axes[0].texts}
    assert place["left"] < place["True"] < place["x < 1 m"] < place["False"] < place["right"]
    from matplotlib.colors import to_hex

    colours = [to_hex(box.get_facecolor()).upper() for box in figure.axes[0].patches]
    assert colours == ["#FFFFFF", SKY, ORANGE]


def test_every_text_lies_within_its_box():
    names = Names(
        id="Strange-v0", features=("W" * 40, "i"), units=("m", ""), actions=("$\\alpha$ left", "iii")
    )
    figure = draw_tree(controller(split(0, -1234.5, split(1, 0.1, leaf(0), leaf(1)), leaf(1)), names))
    renderer = figure.canvas.get_renderer()
    axes = figure.axes[0]
    boxes = [patch.get_window_extent(renderer) for patch in axes.patches]
    for text in axes.texts:
        if text.get_text() in ("True", "False"):
            continue
        extent = text.get_window_extent(renderer)
        assert any(box.x0 < extent.x0 and extent.x1 < box.x1 for box in boxes if box.contains(*extent.p0))


def test_a_lone_leaf_is_a_box():
    assert texts(draw_tree(controller(leaf(1)))) == ["right"]


def test_a_figure_grows_with_its_tree():
    small, large = (draw_tree(controller(tree)).get_size_inches() for tree in (leaf(0), PRUNED))
    assert (large > small).all()


def test_saved_twice_the_bytes_are_the_same(tmp_path):
    first = save_tree(controller(PRUNED), tmp_path / "a.b" / "tree")
    again = save_tree(controller(PRUNED), tmp_path / "again")
    assert [path.name for path in first] == ["tree.svg", "tree.png"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
    assert first[0].read_text().startswith("<?xml")
    assert first[1].read_bytes().startswith(b"\x89PNG")


@settings(max_examples=3)
@given(trees(n_actions=2, max_leaves=8))
def test_any_tree_can_be_drawn(tree):
    patches = draw_tree(controller(tree)).axes[0].patches
    assert len(patches) == tree.num_decision_nodes + tree.num_leaves


def test_more_actions_than_colours_begin_again():
    names = Names(id="Many-v0", features=("x",), units=("",), actions=tuple(f"a{i}" for i in range(9)))
    assert texts(draw_tree(controller(leaf(8), names))) == ["a8"]


def test_weighted_splits_and_leaves_with_values_can_be_drawn():
    tree = DecisionTree.weighted_split(
        [0, 2], [0.5, -1.0], 0.25, DecisionTree.value_leaf([0.1]), DecisionTree.value_leaf([-2.0], {1: [3.0]})
    )
    names = Names(id="Any-v0", features=CARTPOLE.features, units=CARTPOLE.units, actions=("torque",))
    figure = draw_tree(controller(tree, names))
    assert len(figure.axes[0].patches) == 3
    assert any("theta" in text for text in texts(figure))


def test_each_value_of_a_leaf_has_a_line_and_all_lines_lie_within_the_box():
    tree = split(
        0, 1.0, DecisionTree.value_leaf([0.5, 1.0], {1: [3.0, 0.0]}), DecisionTree.value_leaf([0.0, -1.0])
    )
    names = Names(id="Any-v0", features=CARTPOLE.features, units=CARTPOLE.units, actions=("force", "torque"))
    figure = draw_tree(controller(tree, names))
    assert "force = 0.5 + 3 x_dot\ntorque = 1" in texts(figure)
    renderer = figure.canvas.get_renderer()
    boxes = [patch.get_window_extent(renderer) for patch in figure.axes[0].patches]
    for text in figure.axes[0].texts:
        if text.get_text() not in ("True", "False"):
            extent = text.get_window_extent(renderer)
            assert any(box.contains(*extent.p0) and box.contains(*extent.p1) for box in boxes)


def test_a_path_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtefactError, match="cannot be written"):
        save_tree(controller(leaf(0)), tmp_path / "file" / "tree")
