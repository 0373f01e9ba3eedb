"""Whether arrays are those of one tree; what is wrong is said in one line."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import FloatArray, IntArray, TreeArrays, depth_first, selected

_INT32 = np.iinfo(np.int32)


def as_ints(name: str, values: ArrayLike) -> IntArray:
    """Copy into [n] int32; refuse what would wrap, be cut off or be no integer."""
    array = _array(name, values)
    if array.ndim != 1:
        raise InvalidTreeError(f"{name} must be one row of integers, not an array of shape {array.shape}")
    if array.size == 0:
        return np.zeros(0, np.int32)
    if array.dtype.kind not in "iu" or array.min() < _INT32.min or array.max() > _INT32.max:
        raise InvalidTreeError(f"{name} must hold 32-bit integers, not {array.dtype} such as {array.flat[0]}")
    return array.astype(np.int32)


def as_floats(name: str, values: ArrayLike, n_dimensions: int = 1) -> FloatArray:
    """Copy into finite float32; -0.0 becomes 0.0, since equal trees must hold the same bytes."""
    array = _array(name, values)
    if array.ndim != n_dimensions:
        raise InvalidTreeError(
            f"{name} must be an array of {n_dimensions} dimensions, not one of shape {array.shape}"
        )
    if array.size == 0:
        return np.zeros(array.shape, np.float32)
    if array.dtype.kind not in "fiu":
        raise InvalidTreeError(f"{name} must hold real numbers, not {array.dtype}")
    with np.errstate(over="ignore"):
        floats: FloatArray = array.astype(np.float32) + np.float32(0.0)
    finite = np.isfinite(floats)
    if not finite.all():
        place = int(np.argmin(finite.reshape(len(floats), -1).all(axis=1)))
        raise InvalidTreeError(f"{name}[{place}] must be a finite float32, not {array[place]}")
    return floats


def _array(name: str, values: ArrayLike) -> NDArray[np.generic]:
    try:
        return np.array(values)
    except ValueError as error:
        raise InvalidTreeError(f"{name} must be one array of numbers: {error}") from error


def checked(raw: TreeArrays) -> TreeArrays:
    """Return the arrays in their types and depth first, if they are those of one tree.

    Raises:
        InvalidTreeError: They are not.
    """
    arrays = TreeArrays(
        children_left=as_ints("children_left", raw.children_left),
        children_right=as_ints("children_right", raw.children_right),
        term_start=as_ints("term_start", raw.term_start),
        feature=as_ints("feature", raw.feature),
        weight=as_floats("weight", raw.weight),
        threshold=as_floats("threshold", raw.threshold),
        action=as_ints("action", raw.action),
        value=as_floats("value", raw.value, n_dimensions=2),
        leaf_term_start=as_ints("leaf_term_start", raw.leaf_term_start),
        leaf_feature=as_ints("leaf_feature", raw.leaf_feature),
        leaf_weight=as_floats("leaf_weight", raw.leaf_weight, n_dimensions=2),
    )
    _check_lengths(arrays)
    for name in ("feature", "leaf_feature", "action"):
        numbers: IntArray = getattr(arrays, name)
        if len(numbers) > 0 and numbers.min() < 0:
            place = int(np.argmin(numbers))
            raise InvalidTreeError(f"{name}[{place}] must be at least 0, not {numbers[place]}")
    _check_starts("term_start", arrays.term_start, len(arrays.feature), at_least=1)
    _check_starts("leaf_term_start", arrays.leaf_term_start, len(arrays.leaf_feature), at_least=0)
    _check_parents(arrays)
    n_splits = len(arrays.threshold)
    splits, leaves = depth_first(arrays.children_left, arrays.children_right, 0 if n_splits else ~0)
    if len(splits) < n_splits:
        raise InvalidTreeError(f"{n_splits - len(splits)} splits form a cycle that the root does not reach")
    if splits == list(range(n_splits)) and leaves == list(range(n_splits + 1)):
        return arrays
    return selected(arrays, splits, leaves)


def _check_lengths(arrays: TreeArrays) -> None:
    n_splits, n_leaves = len(arrays.threshold), len(arrays.value)
    expected = {
        "children_left": n_splits,
        "children_right": n_splits,
        "term_start": n_splits + 1,
        "weight": len(arrays.feature),
        "value": n_splits + 1,
        "leaf_term_start": n_leaves + 1,
        "leaf_weight": len(arrays.leaf_feature),
    }
    for name, length in expected.items():
        if len(getattr(arrays, name)) != length:
            raise InvalidTreeError(
                f"{name} must have length {length} in a tree of {n_splits} splits, {n_splits + 1} leaves, "
                f"{len(arrays.feature)} terms of splits and {len(arrays.leaf_feature)} terms of leaves; "
                f"it has length {len(getattr(arrays, name))}"
            )
    width = arrays.value.shape[1]
    if arrays.leaf_weight.shape[1] != width:
        raise InvalidTreeError(
            f"leaf_weight must have one column for each of the {width} values of a leaf, "
            f"not {arrays.leaf_weight.shape[1]}"
        )
    if len(arrays.action) != (0 if width > 0 else n_leaves) or (width == 0 and len(arrays.leaf_feature) > 0):
        raise InvalidTreeError(
            f"each of the {n_leaves} leaves must hold one action, or values and linear terms; these hold "
            f"{len(arrays.action)} actions, {width} values each and {len(arrays.leaf_feature)} linear terms"
        )


def _check_starts(name: str, start: IntArray, n_terms: int, at_least: int) -> None:
    counts = np.diff(start.astype(np.int64))
    if start[0] != 0 or start[-1] != n_terms or (counts < at_least).any():
        raise InvalidTreeError(
            f"{name} must begin at 0, leave at least {at_least} terms to each, and end at {n_terms}, "
            f"the number of terms; it is {start.tolist()[:20]}"
        )


def _check_parents(arrays: TreeArrays) -> None:
    n_splits = len(arrays.threshold)
    for name in ("children_left", "children_right"):
        children: IntArray = getattr(arrays, name)
        bad = (children == 0) | (children >= n_splits) | (children < ~n_splits)
        if bad.any():
            place = int(np.argmax(bad))
            raise InvalidTreeError(
                f"{name}[{place}] must be one of the splits 1 to {n_splits - 1} (the root is nobody's child) "
                f"or a leaf, ~0 to ~{n_splits}; it is {children[place]}"
            )
    children = np.concatenate([arrays.children_left, arrays.children_right])
    for what, parents, root in (
        ("split", np.bincount(children[children >= 0], minlength=n_splits), n_splits > 0),
        ("leaf", np.bincount(~children[children < 0], minlength=n_splits + 1), n_splits == 0),
    ):
        parents[:1] += root
        if (parents != 1).any():
            place = int(np.argmax(parents != 1))
            raise InvalidTreeError(f"{what} {place} must have exactly one parent, not {parents[place]}")
