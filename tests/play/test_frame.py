"""Frames: everything in its place, whatever the tree, and nothing that cannot be read."""

from dataclasses import replace

import numpy as np
import pytest
from documents_for_tests import CONTROLLER
from hypothesis import given, settings
from PIL import ImageColor
from stages_for_tests import controller_of, moment_of
from strategies import any_trees
from trees_of_all_kinds import large_tree

from ge_torchrl.play import frame, ink
from ge_torchrl.play.frame import SIZE, Stage, features_in_order
from ge_torchrl.play.lettering import Lettering, short
from ge_torchrl.play.rule import Box
from ge_torchrl.play.traces import Traces
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import DecisionTree

PICTURE = np.full((400, 600, 3), 60, np.uint8)


def pixels(image, box):
    """[H, W, 3] the part of a frame."""
    return np.asarray(image)[box.top : box.top + box.height, box.left : box.right]


def rgb(colour):
    return np.array(ImageColor.getrgb(colour))


def has(image, colour):
    return bool((np.asarray(image) == rgb(colour)).all(axis=-1).any())


def contrast(one, other):
    brighter, darker = sorted(
        (
            sum(0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2] for v in [linear(colour)])
            for colour in (one, other)
        ),
        reverse=True,
    )
    return (brighter + 0.05) / (darker + 0.05)


def linear(colour):
    return [ink._linear(channel / 255) for channel in rgb(colour)]


def test_a_frame_shows_picture_path_and_action():
    image = Stage(CONTROLLER, 7, None).frame(moment_of(CONTROLLER, picture=PICTURE))
    assert (image.size, image.mode) == (SIZE, "RGB")
    assert (pixels(image, Box(200, 200, 50, 50)) == 60).all()
    # theta = 0.3 is not below its threshold, so the right is gone to.
    rule = pixels(image, frame._RULE)
    assert has(rule, ink.LIT)
    assert has(rule, ink.LIT_LINE)
    assert has(rule, ink.colour_of(1))


def test_at_the_end_it_is_said_why():
    stage = Stage(CONTROLLER, 7, None)
    going, ended = (stage.frame(moment_of(CONTROLLER, ended=told)) for told in ("", "ended by its limit"))
    assert not has(pixels(ended, frame._FIGURES), ink.colour_of(1))
    assert has(pixels(going, frame._FIGURES), ink.colour_of(1))


@settings(max_examples=25)
@given(any_trees())
def test_any_tree_stays_within_its_place(tree):
    controller = controller_of(tree)
    image = Stage(controller, 7, None).frame(moment_of(controller))
    array = np.asarray(image)
    assert (array[60:, 572:596] == 255).all()
    assert (array[:, SIZE[0] - 20 :] == 255).all()
    assert (array[SIZE[1] - 12 :] == 255).all()


@pytest.mark.parametrize("depth", [None, 90])
def test_a_long_tree_is_folded(depth):
    tree = large_tree("CartPole-v1")
    if depth is not None:
        tree = DecisionTree.leaf(0)
        for _ in range(depth):
            tree = DecisionTree.split(3, -9.0, DecisionTree.leaf(1), tree)
    controller = Controller(tree, CONTROLLER.names)
    image = Stage(controller, 7, None).frame(moment_of(controller))
    assert has(pixels(image, frame._RULE), ink.LIT)
    assert (np.asarray(image)[SIZE[1] - 12 :] == 255).all()


def test_many_features_with_long_names_and_other_letters_have_a_place():
    n = 40
    names = replace(
        CONTROLLER.names,
        features=tuple(f"the_angle_of_joint_{i}_of_the_left_leg" for i in range(n)),
        units=("ångström/s",) * n,
        actions=("ganz_weit_nach_links_lehnen_und_warten", "θ̇ vergrößern"),
    )
    controller = Controller(DecisionTree.split(30, 0.5, DecisionTree.leaf(0), DecisionTree.leaf(1)), names)
    assert features_in_order(controller)[:3] == [30, 0, 1]
    image = Stage(controller, 7, None).frame(moment_of(controller, np.zeros(n, np.float32)))
    assert (np.asarray(image)[60:, 572:596] == 255).all()


def test_what_is_observed_is_drawn_over_time_where_there_is_no_picture():
    observations = np.vstack([np.linspace(0, 1, 2000), *np.zeros((3, 2000))]).T.astype(np.float32)
    traces = Traces(CONTROLLER.names, features_in_order(CONTROLLER), observations)
    image = Stage(CONTROLLER, 7, traces).frame(moment_of(CONTROLLER))
    assert has(pixels(image, frame._SCENE), ink.LIT_LINE)
    late = Stage(CONTROLLER, 7, traces).frame(replace(moment_of(CONTROLLER), step=1999))
    drawn = [
        int((pixels(image, frame._SCENE) == rgb(ink.LIT_LINE)).all(axis=-1).sum()) for image in (image, late)
    ]
    assert drawn[0] < drawn[1]


def test_inks_can_be_read():
    assert min(contrast(colour, ink.PAPER) for colour in (ink.INK, ink.QUIET, ink.LIT_LINE)) > 4.5
    assert min(contrast(colour, ink.LIT) for colour in (ink.INK, ink.LIT_LINE)) > 4
    assert min(contrast(colour, ink.ink_on(colour)) for colour in ink.ACTION_COLOURS) > 4.5


def test_texts_are_cut_in_their_middle_and_wrapped_between_words():
    letters = Lettering(CONTROLLER.names)
    assert letters.cut("theta", 16, 200) == "theta"
    shorter = letters.cut("the_angle_of_joint_4", 16, 100)
    assert shorter.startswith("the")
    assert shorter.endswith("4")
    assert letters.width(shorter, 16) <= 100
    assert (
        " ".join(letters.wrapped("2 x - 0.5 theta + 3 theta_dot", 16, 120)) == "2 x - 0.5 theta + 3 theta_dot"
    )
    assert letters.cut("theta", 16, 1) == "t"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.01322, "-0.0132"),
        (12.345, "12.35"),
        (1234.5, "1234"),
        (1.2e-7, "1.2e-07"),
        (0.5, "0.500"),
    ],
)
def test_numbers_are_short(value, text):
    assert short(value) == text
