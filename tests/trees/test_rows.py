import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ge_torchrl.trees.rows import gather, starts


@given(st.data(), st.lists(st.integers(0, 3), max_size=6))
def test_gathered_rows_are_those_of_the_items_one_by_one(data, lengths):
    start = starts(lengths)
    assert start.dtype == np.int64
    assert np.diff(start).tolist() == lengths
    items = data.draw(st.lists(st.sampled_from(range(len(lengths))), max_size=8)) if lengths else []
    gathered, rows = gather(start, items)
    each = [list(range(start[item], start[item + 1])) for item in items]
    assert rows.tolist() == [row for of_item in each for row in of_item]
    assert gathered.tolist() == starts([len(of_item) for of_item in each]).tolist()
