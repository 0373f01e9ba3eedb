"""A child of a tree, as a tree that was put together from its halves."""

from ge_torchrl.trees.tree import DecisionTree


def subtree(tree, node):
    if node < 0:
        if tree.has_actions:
            return DecisionTree.leaf(int(tree.action[~node]))
        terms = range(tree.leaf_term_start[~node], tree.leaf_term_start[~node + 1])
        return DecisionTree.value_leaf(
            tree.value[~node], {int(tree.leaf_feature[term]): tree.leaf_weight[term] for term in terms}
        )
    terms = slice(tree.term_start[node], tree.term_start[node + 1])
    halves = (subtree(tree, children[node]) for children in (tree.children_left, tree.children_right))
    return DecisionTree.weighted_split(tree.feature[terms], tree.weight[terms], tree.threshold[node], *halves)
