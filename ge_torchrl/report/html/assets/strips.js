// Strips below the player: what the tree compares, its actions, and the rewards, over the whole episode.

const MOST_SUMS = 6;

// The different sums of a tree's splits, with the thresholds that they are compared with, the most visited first.
const sumsOf = (tree) => {
  const sums = new Map();
  tree.splits.forEach((split) => {
    const key = JSON.stringify(split.terms);
    const known = sums.get(key) ?? { terms: split.terms, thresholds: [], visits: 0, name: minus(split.text.split(" < ")[0]) };
    known.thresholds.push(split.threshold);
    known.visits += split.visits ?? 1;
    sums.set(key, known);
  });
  return [...sums.values()].sort((one, other) => other.visits - one.visits);
};

// What the strips show: the sums; then what leaves compute with, and where nothing is read at all, what is observed.
const shownOf = (tree) => {
  const sums = sumsOf(tree), seen = new Set(sums.filter(({ terms }) => terms.length === 1).map(({ terms }) => terms[0][0]));
  const read = new Set(tree.leaves.flatMap((leaf) => (leaf.linear ?? []).map(([feature]) => feature)));
  const more = sums.length || read.size ? [...read].filter((feature) => !seen.has(feature)) : [...environment.features.keys()];
  const alone = more.sort((one, other) => one - other).map((feature) => ({ terms: [[feature, 1]], thresholds: [], name: environment.features[feature].name }));
  return [...sums, ...alone];
};

const curveOf = (values, thresholds = []) => {
  const finite = values.filter(Number.isFinite);
  let low = Math.min(...finite, ...thresholds), high = Math.max(...finite, ...thresholds);
  if (!(high > low)) [low, high] = [low - 1, high + 1];
  const y = (value) => 38 - (34 * (value - low)) / (high - low);
  const path = values.map((value, i) => `${i ? "L" : "M"}${i} ${y(Number.isFinite(value) ? value : low).toFixed(2)}`).join("");
  return [
    ...thresholds.map((value) => svg("line", { class: "threshold", x1: 0, x2: values.length, y1: y(value), y2: y(value) })),
    svg("path", { class: "curve", d: path }),
  ];
};

const startStrips = () => {
  const place = at("strips");
  let cursors = [], tellers = [];

  const row = (name, length, low, tell, ...children) => {
    const value = html("b");
    const picture = svg("svg", { viewBox: `0 0 ${Math.max(1, length)} 42`, preserveAspectRatio: "none", "aria-hidden": "true" }, ...children);
    const cursor = html("div", { class: "cursor" });
    const plot = html("div", { class: low ? "plot low" : "plot" }, picture, cursor);
    const seek = (event) => {
      const box = plot.getBoundingClientRect();
      const step = Math.round(((event.clientX - box.left) / box.width) * length);
      change({ step: Math.max(0, Math.min(episodeNow().kept, step)), playing: false });
    };
    plot.addEventListener("pointerdown", (event) => {
      plot.setPointerCapture(event.pointerId);
      seek(event);
    });
    plot.addEventListener("pointermove", (event) => event.buttons && seek(event));
    cursors.push(cursor);
    tellers.push(() => (value.textContent = tell(view.step)));
    return [html("div", { class: "name" }, name, value), plot];
  };

  const blocks = (episode) => {
    const drawn = [];
    for (let from = 0, step = 1; step <= episode.kept; step++) {
      if (step < episode.kept && episode.actions[step] === episode.actions[from]) continue;
      drawn.push(svg("rect", { x: from, y: 0, width: step - from, height: 42, fill: colourOf(episode.actions[from]) }));
      from = step;
    }
    return drawn;
  };

  const actionRows = (episode) => {
    if (!environment.bounds.length) {
      const tell = (step) => (step < episode.kept ? environment.actions[episode.actions[step]] : "end");
      return row("action", episode.kept, true, tell, ...blocks(episode));
    }
    return environment.actions.flatMap((name, i) => {
      const values = Array.from({ length: episode.kept }, (_, step) => episode.actions[step * episode.wide + i]);
      return row(name, episode.kept, false, (step) => (step < episode.kept ? figures(values[step]) : "end"), ...curveOf(values, [0]));
    });
  };

  // In seconds where it is known how long a step is.
  const timeRow = (length) => {
    const last = Math.max(1, length) * (data.stepSeconds ?? 1), ticks = ticksOf([0, last], 6, data.stepSeconds ? 0 : 1);
    const marks = ticks.map((value) => {
      const share = (100 * value) / last, align = share > 94 ? -100 : share < 4 ? 0 : -50;
      return html("span", { style: `left: ${share.toFixed(2)}%; transform: translateX(${align}%)` }, tickText(value));
    });
    return [html("div", { class: "name" }, data.stepSeconds ? "seconds" : "step"), html("div", { class: "ticks" }, ...marks)];
  };

  const build = () => {
    const episode = episodeNow(), tree = treeNow();
    place.hidden = !episode;
    cursors = [];
    tellers = [];
    if (!episode) return;
    const rows = [], sums = sumsOf(tree), shown = shownOf(tree);
    for (const sum of shown.slice(0, MOST_SUMS)) {
      const values = Array.from({ length: episode.kept + 1 }, (_, step) => sumOf(sum.terms, episode.observations, step * width));
      const unit = sum.terms.length === 1 ? unitOf(sum.terms[0][0]) : "";
      rows.push(...row(sum.name, episode.kept, false, (step) => figures(values[step]) + unit, ...curveOf(values, sum.thresholds)));
    }
    rows.push(...actionRows(episode));
    const rewards = Array.from(episode.rewards);
    rows.push(...row("reward", episode.kept, true, (step) => (step < episode.kept ? figures(rewards[step]) : "end"), ...curveOf(rewards)));
    const told = sums.length ? "Dashed lines are thresholds. Click or drag to go to a step." : "Click or drag to go to a step.";
    const keys = environment.bounds.length ? [] : environment.actions.map((name, i) => html("span", {}, chipOf(i), name));
    rows.push(...timeRow(episode.kept));
    const more =
      sums.length > MOST_SUMS
        ? ` The ${MOST_SUMS} most visited of ${sums.length} comparisons are shown.`
        : shown.length > MOST_SUMS ? ` ${MOST_SUMS} of ${shown.length} are shown.` : "";
    place.replaceChildren(...rows, html("div", { class: "legend" }, ...keys, html("span", {}, told + more)));
  };
  const follow = () => {
    const episode = episodeNow();
    if (!episode) return;
    for (const cursor of cursors) cursor.style.left = `${(100 * view.step) / Math.max(1, episode.kept)}%`;
    for (const tell of tellers) tell();
  };
  watch((changed) => {
    if (changed.has("tree") || changed.has("episode")) build();
    if (changed.has("tree") || changed.has("episode") || changed.has("step")) follow();
  });
};
