"""Halves of folded trees of the lander, drawn by Hypothesis."""

from hypothesis import strategies as st

from ge_torchrl.trees.nodes import Split


def asks(feature, threshold):
    return Split((feature,), (1.0,), threshold)


@st.composite
def halves(draw, n_splits=None, features=8):
    n = draw(st.integers(0, 6)) if n_splits is None else n_splits
    if n == 0:
        return [draw(st.integers(0, 3))]
    left = draw(st.integers(0, n - 1))
    split = asks(draw(st.integers(0, features - 1)), draw(st.integers(-8, 8)) / 8)
    children = [draw(halves(size, features)) for size in (left, n - 1 - left)]
    return [split, *children[0], *children[1]]
