// What the tree does across two features, the others held as they are at the moment that the player shows.

const featuresByUse = (tree) => {
  const use = new Array(width).fill(0);
  tree.splits.forEach((split) => split.terms.forEach(([feature]) => (use[feature] += 1 + (split.visits ?? 0))));
  tree.leaves.forEach((leaf) => (leaf.linear ?? []).forEach(([feature]) => (use[feature] += 0.5 + 0.1 * (leaf.visits ?? 0))));
  return [...use.keys()].sort((one, other) => use[other] - use[one] || one - other);
};
const usedBy = (tree) => {
  const used = new Set();
  tree.splits.forEach((split) => split.terms.forEach(([feature]) => used.add(feature)));
  tree.leaves.forEach((leaf) => (leaf.linear ?? []).forEach(([feature]) => used.add(feature)));
  return used;
};

// The values of a feature in the episodes of the tree and in its thresholds, with some room.
const ranges = new Map();
const rangeOf = (feature) => {
  const key = `${view.tree} ${feature}`;
  if (ranges.has(key)) return ranges.get(key);
  let low = Infinity, high = -Infinity;
  const take = (value) => {
    if (!Number.isFinite(value)) return;
    low = Math.min(low, value);
    high = Math.max(high, value);
  };
  for (const { observations } of episodesOf(treeNow())) for (let i = feature; i < observations.length; i += width) take(observations[i]);
  for (const { terms, threshold } of treeNow().splits) if (terms.length === 1 && terms[0][0] === feature) take(threshold / terms[0][1]);
  if (low > high) [low, high] = [-1, 1];
  const room = (high - low) * 0.06 || Math.abs(high) || 1;
  ranges.set(key, [low - room, high + room]);
  return ranges.get(key);
};

const CELL = 3, LEFT = 58, BOTTOM = 42, TOP = 8, RIGHT = 10;

const paintRegions = (tree, context, wide, high, xs, ys) => {
  const observation = observationNow() ?? new Float32Array(width).map((_, i) => (rangeOf(i)[0] + rangeOf(i)[1]) / 2);
  const point = Float32Array.from(observation), pixels = context.createImageData(wide, high);
  const shades = tree.leaves.map((leaf) =>
    leaf.action === undefined ? null : [1, 3, 5].map((i) => parseInt(colourOf(leaf.action).slice(i, i + 2), 16)),
  );
  const [low, top] = actionSpan();
  for (let row = 0; row < high; row++) {
    point[view.up] = ys[1] - ((row + 0.5) / high) * (ys[1] - ys[0]);
    for (let column = 0; column < wide; column++) {
      point[view.across] = xs[0] + ((column + 0.5) / wide) * (xs[1] - xs[0]);
      const { leaf } = wayOf(tree, point), place = 4 * (row * wide + column);
      const shade = shades[leaf] ?? shadeOf(valuesOf(tree.leaves[leaf], point)[0], low, top);
      for (let i = 0; i < 3; i++) pixels.data[place + i] = shade[i];
      pixels.data[place + 3] = 255;
    }
  }
  context.putImageData(pixels, 0, 0);
};
const actionSpan = () => {
  const [low, high] = environment.bounds[0] ?? [null, null];
  if (low !== null && high !== null) return [low, high];
  let most = 1e-9;
  for (const { actions, wide } of data.episodes) for (let i = 0; i < actions.length; i += wide) most = Math.max(most, Math.abs(actions[i]));
  return [-most, most];
};

const startPartition = () => {
  const section = at("partition-section");
  if (width < 2) return;
  section.hidden = false;
  const choices = [at("across"), at("up")];
  for (const choice of choices) {
    environment.features.forEach((feature, i) => choice.append(html("option", { value: i }, feature.name)));
  }
  choices[0].addEventListener("change", () => choose("across", "up", Number(choices[0].value)));
  choices[1].addEventListener("change", () => choose("up", "across", Number(choices[1].value)));
  const choose = (key, other, feature) => change(view[other] === feature ? { [key]: feature, [other]: view[key] } : { [key]: feature });

  let parts = null;
  const build = (room) => {
    const plotWide = Math.max(120, Math.min(room, 760) - LEFT - RIGHT), plotHigh = Math.round(Math.min(plotWide * 0.62, 420));
    const canvas = html("canvas", { width: Math.ceil(plotWide / CELL), height: Math.ceil(plotHigh / CELL), "aria-hidden": "true" });
    canvas.style.cssText = `position:absolute;left:${LEFT}px;top:${TOP}px;width:${plotWide}px;height:${plotHigh}px;image-rendering:pixelated`;
    const overlay = svg("svg", { width: plotWide + LEFT + RIGHT, height: plotHigh + TOP + BOTTOM, style: "position:relative", role: "img" });
    const frame = html("div", { style: `position:relative;width:${plotWide + LEFT + RIGHT}px;margin:0 auto` }, canvas, overlay);
    at("partition").replaceChildren(frame);
    parts = { canvas, overlay, plotWide, plotHigh };
    redraw();
  };
  const redraw = () => {
    if (!parts) return;
    const { canvas, overlay, plotWide, plotHigh } = parts, xs = rangeOf(view.across), ys = rangeOf(view.up);
    const px = (value) => LEFT + ((value - xs[0]) / (xs[1] - xs[0])) * plotWide;
    const py = (value) => TOP + plotHigh - ((value - ys[0]) / (ys[1] - ys[0])) * plotHigh;
    parts.px = px;
    parts.py = py;
    const lines = svg("g"), clip = svg("clipPath", { id: "inside" }, svg("rect", { x: LEFT, y: TOP, width: plotWide, height: plotHigh }));
    const tracks = svg("g", { "clip-path": "url(#inside)" });
    for (const episode of episodesOf(treeNow())) {
      const isNow = episode === episodeNow();
      let path = "";
      for (let step = 0; step <= episode.kept; step++) {
        const x = px(episode.observations[step * width + view.across]), y = py(episode.observations[step * width + view.up]);
        if (Number.isFinite(x + y)) path += `${path ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
      }
      const track = svg("path", { d: path, fill: "none", stroke: "#14171a", "stroke-width": isNow ? 1.8 : 1, opacity: isNow ? 0.9 : 0.22 });
      if (isNow) tracks.append(track);
      else tracks.prepend(track);
    }
    parts.dot = svg("circle", { r: 6, fill: "#ffffff", stroke: "#14171a", "stroke-width": 2.5 });
    tracks.append(parts.dot);
    axesInto(lines, { xs, ys, px, py, left: LEFT, top: TOP, wide: plotWide, high: plotHigh, grid: false,
      across: environment.features[view.across].name + unitOf(view.across), up: environment.features[view.up].name + unitOf(view.up) });
    overlay.setAttribute("aria-label", `Regions of the tree across ${environment.features[view.across].name} and ${environment.features[view.up].name}`);
    overlay.replaceChildren(clip, lines, tracks);
    paintRegions(treeNow(), canvas.getContext("2d"), canvas.width, canvas.height, xs, ys);
    tell();
    moveDot();
  };
  const moveDot = () => {
    const observation = observationNow();
    parts.dot.setAttribute("opacity", observation ? 1 : 0);
    if (!observation) return;
    parts.dot.setAttribute("cx", parts.px(observation[view.across]));
    parts.dot.setAttribute("cy", parts.py(observation[view.up]));
  };
  const othersOf = () => [...usedBy(treeNow())].filter((feature) => feature !== view.across && feature !== view.up);
  const tell = () => {
    const others = othersOf(), observation = observationNow(), place = at("partition-told");
    const held = others.slice(0, 6).map((feature) => {
      const value = observation ? observation[feature] : (rangeOf(feature)[0] + rangeOf(feature)[1]) / 2;
      return `${environment.features[feature].name} = ${figures(value)}${unitOf(feature)}`;
    });
    const told = others.length
      ? `A slice: held as ${observation ? "at the step that the player shows" : "in the middle of their range"} are ${held.join(", ")}${others.length > 6 ? ", and others" : ""}.`
      : "The tree looks at no other features, so this is the whole of it.";
    const keys = environment.bounds.length
      ? [html("span", { class: "key" }, rampOf(), ` ${environment.actions[0]}, ${figures(actionSpan()[0])} to ${figures(actionSpan()[1])}`)]
      : [...new Set(treeNow().leaves.map((leaf) => leaf.action))].sort().map((action) => html("span", { class: "key" }, chipOf(action), environment.actions[action]));
    place.replaceChildren(html("div", {}, ...keys), told + (observation ? " Lines are the recorded episodes, the dot is the step shown." : ""));
  };
  const rampOf = () => {
    const bar = html("span", { class: "chip", style: `width: 72px; background: linear-gradient(90deg, rgb(${LOW}), rgb(${ZERO}), rgb(${HIGH}))` });
    return bar;
  };
  onWidth(at("partition"), build);
  watch((changed) => {
    if (changed.has("tree")) {
      const [across, up] = featuresByUse(treeNow());
      if (!usedBy(treeNow()).has(view.across) || !usedBy(treeNow()).has(view.up)) Object.assign(view, { across, up });
    }
    choices[0].value = view.across;
    choices[1].value = view.up;
    if (["tree", "episode", "across", "up"].some((key) => changed.has(key))) redraw();
    else if (parts && changed.has("step")) {
      moveDot();
      if (othersOf().length) {
        const { canvas } = parts;
        paintRegions(treeNow(), canvas.getContext("2d"), canvas.width, canvas.height, rangeOf(view.across), rangeOf(view.up));
        tell();
      }
    }
  });
};
