"""Soft trees with weighted sums in splits and leaves, in plain float64: what the compiled sampler is held to."""

import numpy as np

from ge_torchrl.environments.backend import SoftForest


def soft_forces(trees, n_features, alpha, sd):
    """Trees with values side by side, padded; each leaf draws around its values by `sd`."""
    n_splits = max(tree.num_decision_nodes for tree in trees)
    n_terms = max((int(np.diff(tree.term_start).max(initial=1)) for tree in trees), default=1)
    n_values, n_trees = trees[0].value.shape[1], len(trees)
    soft = SoftForest(
        feature=np.zeros((n_trees, n_splits, n_terms), np.int32),
        weight=np.zeros((n_trees, n_splits, n_terms)),
        threshold=np.zeros((n_trees, n_splits), np.float32),
        alpha=np.full((n_trees, n_splits), float(alpha)),
        children_left=np.full((n_trees, n_splits), ~0, np.int32),
        children_right=np.full((n_trees, n_splits), ~0, np.int32),
        probabilities=np.zeros((0, 0, 0)),
        mean=np.zeros((n_trees, n_splits + 1, n_values)),
        leaf_weight=np.zeros((n_trees, n_splits + 1, n_features, n_values)),
        sd=np.full((n_trees, n_splits + 1, n_values), float(sd)),
    )
    for r, tree in enumerate(trees):
        m = tree.num_decision_nodes
        for split in range(m):
            terms = slice(tree.term_start[split], tree.term_start[split + 1])
            width = terms.stop - terms.start
            soft.feature[r, split, :width] = tree.feature[terms]
            soft.weight[r, split, :width] = tree.weight[terms]
        soft.threshold[r, :m] = tree.threshold
        soft.children_left[r, :m], soft.children_right[r, :m] = tree.children_left, tree.children_right
        soft.mean[r, : m + 1] = tree.value
        for leaf in range(m + 1):
            for term in range(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1]):
                soft.leaf_weight[r, leaf, tree.leaf_feature[term]] += tree.leaf_weight[term]
    return soft


def means_of_leaves(soft, tree, observations):
    """Return [T, L, A], around what each leaf draws on observations [T, D]."""
    return soft.mean[tree] + np.einsum("td,lda->tla", observations.astype(float), soft.leaf_weight[tree])
