// The page of a run.

[view.across, view.up] = featuresByUse(treeNow());
startTree();
startPlayer();
startStrips();
startPartition();
startCharts();
startAgain();
view.tree = -1;
chooseTree(0);
