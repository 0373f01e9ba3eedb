import numpy as np
import pytest
from hypothesis import given, settings
from strategies import trees
from sweeps_for_tests import CARTPOLE, PRUNED, leaf, split

from ge_torchrl.errors import ArtefactError, InvalidTreeError
from ge_torchrl.report.canvas import ORANGE, SKY
from ge_torchrl.report.drawing import draw_tree, save_tree, tidy_layout
from ge_torchrl.trees.labels import TreeLabels

BOX_HEIGHT = 0.36


def texts(figure):
    return sorted(text.get_text() for text in figure.axes[0].texts)


@given(trees(max_leaves=40))
def test_boxes_neither_meet_nor_leave_the_figure_and_leaves_stand_in_order(tree):
    # Widths of all kinds: a decision is the widest box of all, a leaf next to nothing, and the other way round.
    for decision, leaf_width in ((3.0, 0.2), (0.2, 3.0), (1.0, 1.0)):
        widths = np.where(tree.is_leaf, leaf_width, decision)
        x, y, _, (width, height) = tidy_layout(tree, widths)
        assert (x - widths / 2).min() > 0
        assert (x + widths / 2).max() < width
        assert y.min() > BOX_HEIGHT / 2
        assert y.max() < height - BOX_HEIGHT / 2
        for level in np.unique(y):
            row = np.flatnonzero(y == level)
            row = row[np.argsort(x[row])]
            gaps = (x[row] - widths[row] / 2)[1:] - (x[row] + widths[row] / 2)[:-1]
            assert (gaps > 0.1).all()
        decisions = ~tree.is_leaf
        left, right = tree.children_left[decisions], tree.children_right[decisions]
        assert (x[left] < x[right]).all()
        assert x[decisions] == pytest.approx((x[left] + x[right]) / 2)
        assert (y[left] < y[decisions]).all()


def test_edges_do_not_cross_boxes_as_levels_are_apart():
    layout = tidy_layout(PRUNED, np.ones(PRUNED.n_nodes))
    levels = np.unique(layout.y)
    assert np.diff(levels).min() > BOX_HEIGHT + 0.3


def test_a_drawing_says_what_the_tree_says():
    figure = draw_tree(PRUNED, CARTPOLE)
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
    figure = draw_tree(split(0, 1.0, leaf(0), leaf(1)), CARTPOLE)
    place = {text.get_text(): text.get_position()[0] for text in figure.axes[0].texts}
    assert place["left"] < place["True"] < place["x < 1 m"] < place["False"] < place["right"]
    from matplotlib.colors import to_hex

    colours = [to_hex(box.get_facecolor()).upper() for box in figure.axes[0].patches]
    assert colours == ["#FFFFFF", SKY, ORANGE]


def test_every_text_lies_within_its_box():
    labels = TreeLabels("Strange-v0", ("W" * 40, "i"), ("m", ""), ("$\\alpha$ left", "iii"))
    figure = draw_tree(split(0, -1234.5, split(1, 0.1, leaf(0), leaf(1)), leaf(1)), labels)
    renderer = figure.canvas.get_renderer()
    axes = figure.axes[0]
    boxes = [patch.get_window_extent(renderer) for patch in axes.patches]
    for text in axes.texts:
        if text.get_text() in ("True", "False"):
            continue
        extent = text.get_window_extent(renderer)
        assert any(box.x0 < extent.x0 and extent.x1 < box.x1 for box in boxes if box.contains(*extent.p0))


def test_a_lone_leaf_is_a_box():
    assert texts(draw_tree(leaf(1), CARTPOLE)) == ["right"]


def test_a_figure_grows_with_its_tree():
    small, large = (draw_tree(tree, CARTPOLE).get_size_inches() for tree in (leaf(0), PRUNED))
    assert (large > small).all()


def test_saved_twice_the_bytes_are_the_same(tmp_path):
    first = save_tree(PRUNED, CARTPOLE, tmp_path / "a.b" / "tree")
    again = save_tree(PRUNED, CARTPOLE, tmp_path / "again")
    assert [path.name for path in first] == ["tree.svg", "tree.png"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
    assert first[0].read_text().startswith("<?xml")
    assert first[1].read_bytes().startswith(b"\x89PNG")


@settings(max_examples=3)
@given(trees(n_actions=2, max_leaves=8))
def test_any_tree_can_be_drawn(tree):
    assert len(draw_tree(tree, CARTPOLE).axes[0].patches) == tree.n_nodes


def test_more_actions_than_colours_begin_again():
    labels = TreeLabels("Many-v0", ("x",), ("",), tuple(f"a{i}" for i in range(9)))
    assert texts(draw_tree(leaf(8), labels)) == ["a8"]


def test_labels_must_fit():
    with pytest.raises(InvalidTreeError, match="actions 0 to 1, not 5"):
        draw_tree(leaf(5), CARTPOLE)


def test_a_path_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtefactError, match="cannot be written"):
        save_tree(leaf(0), CARTPOLE, tmp_path / "file" / "tree")
