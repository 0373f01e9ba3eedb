// What every part of the page uses: the data, elements, numbers, and what the reader looks at.

const data = JSON.parse(document.getElementById("data").textContent);
const at = (id) => document.getElementById(id);

const SVG = "http://www.w3.org/2000/svg";
const MATH = "http://www.w3.org/1998/Math/MathML";

// Texts of files become text nodes and attributes only, never markup.
const created = (node, attributes, children) => {
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
};
const html = (name, attributes = {}, ...children) => created(document.createElement(name), attributes, children);
const svg = (name, attributes = {}, ...children) => created(document.createElementNS(SVG, name), attributes, children);
const math = (name, attributes = {}, ...children) => created(document.createElementNS(MATH, name), attributes, children);

const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

// The colours of actions are those of Okabe and Ito, which people of all kinds of colour vision tell apart.
const COLOURS = ["#56b4e9", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#0072b2", "#d55e00"];
const LIGHT_INK = new Set(["#0072b2"]);
const colourOf = (action) => COLOURS[action % COLOURS.length];
// From the lowest value of an action by no action to the highest.
const LOW = [0, 114, 178], ZERO = [244, 244, 240], HIGH = [213, 94, 0];
const shadeOf = (value, low, high) => {
  const most = Math.max(Math.abs(low), Math.abs(high)) || 1;
  const part = Math.max(-1, Math.min(1, value / most)), end = part < 0 ? LOW : HIGH, share = Math.abs(part);
  return ZERO.map((zero, i) => Math.round(zero + share * (end[i] - zero)));
};

const minus = (text) => text.replace(/(^|[\s(=])-(?=[\s\d])/g, "$1−");
const number = (value, digits = 2) =>
  value === null || value === undefined
    ? ""
    : minus(value.toLocaleString("en-US", { minimumFractionDigits: digits, maximumFractionDigits: digits }));
const figures = (value, digits = 3) => {
  if (!Number.isFinite(value)) return "unknown";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return minus(value.toExponential(digits - 1));
  return minus(String(Number(value.toPrecision(size >= 1000 ? Math.ceil(Math.log10(size)) : digits))));
};
const percent = (share) => {
  if (share > 0 && share < 0.001) return "< 0.1 %";
  return `${number(100 * share, share === 0 || share === 1 || share >= 0.1 ? 0 : 1)} %`;
};
const short = (count) =>
  count >= 1e6 ? `${figures(count / 1e6)} M` : count >= 1e4 ? `${figures(count / 1e3)} k` : count.toLocaleString("en-US");
const counted = (n, thing) => (n === 1 ? `1 ${thing}` : `${n.toLocaleString("en-US")} ${thing}s`);

const environment = data.environment;
// What a run without a verdict says of its trees.
const UNTESTED = data.isTested ? "" : " on the archive's episodes, untested";
const width = environment.features.length;
const unitOf = (feature) => (environment.features[feature].unit ? ` ${environment.features[feature].unit}` : "");

// Thresholds and weights are float32 in the run, so they are here.
for (const tree of data.trees) {
  for (const split of tree.splits) {
    split.threshold = Math.fround(split.threshold);
    for (const term of split.terms) term[1] = Math.fround(term[1]);
  }
}
for (const episode of data.episodes) {
  for (const name of ["observations", "actions", "rewards"]) episode[name] = floats(episode[name]);
  episode.wide = episode.kept ? episode.actions.length / episode.kept : 1;
}

const sumOf = (terms, observation, from = 0) => {
  let sum = 0;
  for (const [feature, weight] of terms) sum += weight * observation[from + feature];
  return sum;
};
// The splits on the way of an observation through a tree, and the leaf that it comes to.
const wayOf = (tree, observation, from = 0) => {
  const path = [];
  let node = tree.splits.length ? 0 : -1;
  while (node >= 0) {
    path.push(node);
    const split = tree.splits[node];
    node = sumOf(split.terms, observation, from) < split.threshold ? split.left : split.right;
  }
  return { path, leaf: ~node };
};
const valuesOf = (leaf, observation, from = 0) =>
  leaf.value.map((constant, column) => {
    let sum = constant;
    for (const [feature, weights] of leaf.linear) sum += weights[column] * observation[from + feature];
    const [low, high] = environment.bounds[column] ?? [null, null];
    return Math.min(high ?? Infinity, Math.max(low ?? -Infinity, sum));
  });

// What the reader looks at. Whoever draws something watches, and is told which of it changed.
const view = { tree: 0, episode: -1, step: 0, playing: false, speed: 1, across: 0, up: 0 };
const watchers = [];
const watch = (watcher) => watchers.push(watcher);
const change = (changes) => {
  const changed = new Set(Object.keys(changes).filter((key) => view[key] !== changes[key]));
  Object.assign(view, changes);
  if (changed.size) for (const watcher of watchers) watcher(changed);
};

const treeNow = () => data.trees[view.tree];
// The episodes to play with a tree: its own; with the unpruned champion those of the pruned one.
const episodesOf = (tree) => {
  const key = tree.key === "full" ? "champion" : tree.key;
  return data.episodes.filter((episode) => episode.tree === key && episode.kept > 0);
};
const episodeNow = () => data.episodes[view.episode] ?? null;
const observationNow = () => {
  const episode = episodeNow();
  return episode ? episode.observations.subarray(view.step * width, (view.step + 1) * width) : null;
};

// What is printed is drawn as wide as a page of A4 or Letter within its margins.
const PAPER = 660;

// Draws again where the place becomes wider or narrower, and for paper.
const onWidth = (place, drawn) => {
  let last = 0;
  addEventListener("beforeprint", () => last && drawn(PAPER));
  addEventListener("afterprint", () => last && drawn(last));
  new ResizeObserver(() => {
    const now = Math.floor(place.clientWidth);
    if (now > 0 && now !== last) {
      last = now;
      drawn(now);
    }
  }).observe(place);
};

// A table in the manner of the page's others.
const tableOf = (head, rows, caption) =>
  html(
    "div",
    { class: "scroll", tabindex: 0, role: "group", "aria-label": caption },
    html(
      "table",
      {},
      html("thead", {}, html("tr", {}, ...head.map((title) => html("th", { scope: "col" }, title)))),
      html(
        "tbody",
        {},
        ...rows.map((row) =>
          html("tr", {}, ...row.map((cell) => html("td", { class: /^[\d−+<]/.test(cell) ? "number" : null }, cell))),
        ),
      ),
    ),
  );
