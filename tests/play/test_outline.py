"""The outline of a tree, and what is left of it where there is little room."""

from documents_for_tests import CONTROLLER
from hypothesis import given, settings
from hypothesis import strategies as st
from stages_for_tests import controller_of
from strategies import any_trees

from ge_torchrl.play.outline import Folding, outline
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import DecisionTree


def test_rows_say_what_the_tree_says():
    told = [(row.depth, row.branch, *row.texts) for row in outline(CONTROLLER)]
    assert told == [
        (0, "", "theta < 0.0154 rad?"),
        (1, "yes", "theta_dot < 0.229 rad/s?"),
        (2, "yes", "left"),
        (2, "no", "right"),
        (1, "no", "right"),
    ]
    (row,) = outline(Controller(DecisionTree.leaf(1), CONTROLLER.names))
    assert row.texts == ("always right",)


@settings(max_examples=30)
@given(st.data())
def test_the_end_of_the_path_is_always_shown_and_never_more_than_there_is_room_for(data):
    rows = outline(controller_of(data.draw(any_trees())))
    heights = [data.draw(st.integers(10, 40)) for _ in rows]
    end = data.draw(st.sampled_from([place for place, row in enumerate(rows) if row.node < 0]))
    path = [end]
    while rows[path[0]].parent >= 0:
        path.insert(0, rows[path[0]].parent)
    room = data.draw(st.integers(40, 400))
    folding = Folding(rows, heights, 10)
    shown = folding.shown(path, room)
    assert end in shown
    assert list(shown) == sorted(shown)
    assert sum(folding.height(place, is_folded=folded) for place, folded in shown.items()) <= max(
        room, heights[end]
    )
    if sum(heights) <= room:
        assert shown == dict.fromkeys(range(len(rows)), False)
    for place, is_folded in shown.items():
        below = [child for child, row in enumerate(rows) if row.parent == place]
        assert not (is_folded and (place in path or any(child in shown for child in below)))
        if is_folded:
            assert folding.text(place).startswith("... ")
