// Charts: axes, fitness over generations, size against return, and the returns of the test.

const niceStep = (span, most) => {
  const raw = span / Math.max(1, most), power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= raw) ?? 10 * power;
};
const ticksOf = ([low, high], most, least = 0) => {
  const step = Math.max(least, niceStep(high - low, most)), ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) ticks.push(Number((i * step).toPrecision(12)));
  // One tick alone says nothing of the scale.
  return ticks.length < 2 && !least && most < 9 ? ticksOf([low, high], most + 1) : ticks;
};
const tickText = (value) => minus(String(Math.abs(value) >= 1e5 ? value.toExponential(0) : value));

const axesInto = (group, { xs, ys, px, py, left, top, wide, high, across, up, grid = true, whole = false }) => {
  for (const value of ticksOf(xs, Math.max(2, Math.floor(wide / (whole ? 34 : 70))), whole ? 1 : 0)) {
    group.append(svg("line", { class: "frame", x1: px(value), x2: px(value), y1: top + high, y2: top + high + 4 }));
    group.append(svg("text", { class: "axis", x: px(value), y: top + high + 16, "text-anchor": "middle" }, tickText(value)));
  }
  for (const value of ticksOf(ys, Math.max(2, Math.floor(high / 45)))) {
    group.append(svg("line", { class: grid ? "grid" : "frame", x1: grid ? left : left - 4, x2: grid ? left + wide : left, y1: py(value), y2: py(value) }));
    group.append(svg("text", { class: "axis", x: left - 7, y: py(value) + 4, "text-anchor": "end" }, tickText(value)));
  }
  group.append(
    svg("path", { class: "frame", d: `M${left} ${top}V${top + high}H${left + wide}` }),
    svg("text", { class: "axis-title", x: left + wide / 2, y: top + high + 34, "text-anchor": "middle" }, across),
    svg("text", { class: "axis-title", x: 0, y: 0, "text-anchor": "middle", transform: `translate(13 ${top + high / 2}) rotate(-90)` }, up),
  );
};

// A chart of a width: its root, its scales, and a group that is cut at its frame.
const chartOf = (room, height, xs, ys, across, up, label, whole = false) => {
  const left = 60, top = 10, wide = room - left - 14, high = height - top - 44;
  const px = (value) => left + ((value - xs[0]) / (xs[1] - xs[0] || 1)) * wide;
  const py = (value) => top + high - ((value - ys[0]) / (ys[1] - ys[0] || 1)) * high;
  const root = svg("svg", { class: "chart", viewBox: `0 0 ${room} ${height}`, width: room, height, role: "img", "aria-label": label });
  const id = `cut-${label.replace(/\W+/g, "-")}`, axes = svg("g"), inside = svg("g", { "clip-path": `url(#${id})` }), above = svg("g");
  axesInto(axes, { xs, ys, px, py, left, top, wide, high, across, up, whole });
  root.append(svg("clipPath", { id }, svg("rect", { x: left, y: top - 6, width: wide + 8, height: high + 12 })), axes, inside, above);
  return { root, px, py, left, wide, inside, above };
};
const solvedInto = (chart, ys) => {
  const at = data.solvedAt;
  if (at === null || at < ys[0] || at > ys[1]) return;
  const y = chart.py(at);
  chart.inside.append(svg("line", { class: "solved-line", x1: chart.left, x2: chart.left + chart.wide, y1: y, y2: y }));
  // Below its line, unless the axis is there.
  const below = y + 20 < chart.py(ys[0]);
  chart.above.append(svg("text", { class: "solved-text", x: chart.left + chart.wide, y: below ? y + 14 : y - 5, "text-anchor": "end" }, `solved from ${figures(at, 6)}`));
};
const padded = (values, share = 0.08) => {
  const low = Math.min(...values), high = Math.max(...values), room = (high - low) * share || Math.abs(high) * 0.02 || 1;
  return [low - room, high + room];
};
const keyOf = (text, ...children) => html("span", { class: "key" }, svg("svg", { viewBox: "0 0 16 12" }, ...children), text);

const refinementText = (one) =>
  `generation ${one.generation}: ${one.before === null ? "" : `${number(one.before)} → `}${number(one.after)}, ` +
  `${counted(one.moved ?? 0, "number")} moved` +
  (one.leaves ? `, ${counted(one.leaves, "leaf").replace("leafs", "leaves")} changed` : "") +
  (one.written_back ? ", written back" : "");

const drawProgress = (room) => {
  const { generations, starts, refinements } = data.progress;
  const best = generations.filter(([, value]) => value !== null);
  if (!best.length) return;
  const marks = refinements.filter((one) => one.best && one.best.after !== null);
  // Where the first generations are far below, the curve shows from where it comes near.
  const values = best.map(([, value]) => value), top = Math.max(...values), sorted = [...values].sort((a, b) => a - b);
  const ys = padded([Math.max(sorted[0], top - 4 * (top - sorted[Math.floor(sorted.length / 4)]) - 1e-9), top, ...(data.solvedAt === null ? [] : [data.solvedAt])]);
  const xs = [0, Math.max(1, generations.at(-1)[0])];
  const chart = chartOf(room, 290, xs, ys, "generation", "fitness", "Best fitness over generations", true);
  solvedInto(chart, ys);
  const curve = (column) => {
    let path = "", isOpen = false;
    for (const row of generations) {
      if (row[column] === null) continue;
      path += `${isOpen && !starts.includes(row[0]) ? "L" : "M"}${chart.px(row[0]).toFixed(1)} ${chart.py(row[column]).toFixed(1)}`;
      isOpen = true;
    }
    return path;
  };
  chart.inside.append(svg("path", { class: "median-line", d: curve(2) }), svg("path", { class: "best-line", d: curve(1) }));
  for (const one of marks) {
    chart.inside.append(
      svg("circle", { class: one.new_best ? "refined better" : "refined", cx: chart.px(one.generation), cy: chart.py(Math.max(ys[0], one.best.after)), r: 4.5 },
        svg("title", {}, `${counted(one.refined, "tree")} refined, ${one.improved} of them improved; most in ${refinementText(one.best)}`)),
    );
  }
  at("progress").replaceChildren(chart.root);
  const keys = [keyOf("best", svg("path", { class: "best-line", d: "M0 6H16" }))];
  if (generations.some(([, , median]) => median !== null && median > ys[0])) keys.push(keyOf("median", svg("path", { class: "median-line", d: "M0 6H16" })));
  if (marks.length) keys.push(keyOf("refined, the one that gained most", svg("circle", { class: "refined", cx: 8, cy: 6, r: 4 })));
  if (marks.some((one) => one.new_best)) keys.push(keyOf("and a new best", svg("circle", { class: "refined better", cx: 8, cy: 6, r: 4 })));
  const refined = refinements.reduce((sum, one) => sum + one.refined, 0), improved = refinements.reduce((sum, one) => sum + one.improved, 0);
  at("progress-told").replaceChildren(
    html("div", {}, ...keys),
    "Fitness on the few training episodes, refined trees included." +
      (refined ? ` ${counted(refined, "tree")} refined, ${improved} of them improved.` : "") +
      (marks.some((one) => one.best.after < ys[0]) ? " Rings at the lower edge lie below it." : "") +
      (starts.length ? " The line breaks where the search begins anew." : ""),
  );
};

const ORIGINS = { individual: "population", neighbour: "neighbour of a kept tree", archive: "kept tree" };
const drawRefinements = () => {
  const { improved } = data.progress;
  at("refinements").hidden = !improved.length;
  at("refinements-table").replaceChildren(
    tableOf(
      ["generation", "tree from", "nodes", "return before", "after", "numbers moved", "largest move", "written back"],
      improved.map((one) => [
        String(one.generation), ORIGINS[one.origin] ?? one.origin, String(one.nodes ?? ""), number(one.before), number(one.after),
        String(one.moved ?? ""), figures(one.largest ?? 0), one.written_back ? "yes" : "",
      ]),
      "What refinement changed",
    ),
  );
};

const drawArchive = (room) => {
  const shown = data.trees.map((tree, i) => ({ ...tree, i })).filter((tree) => tree.key !== "full" && tree.measured);
  at("archive-section").hidden = !shown.length;
  if (!shown.length) return;
  const sizes = shown.map((tree) => tree.nodes), most = Math.max(...sizes);
  const known = data.known.filter((one) => one.nodes <= most + 1);
  // A lone leaf may return so little that all others would look the same: then it stands at the edge.
  const others = shown.filter((tree) => tree.nodes > 0), leaf = shown.find((tree) => tree.nodes === 0);
  const means = (others.length ? others : shown).map((tree) => tree.measured.mean), best = Math.max(...means);
  const near = known.map((one) => one.mean).filter((mean) => mean >= Math.min(...means) - (best - Math.min(...means)) * 0.3 - 1e-9);
  const endsOf = ({ measured }) => [measured.low ?? measured.mean, measured.high ?? measured.mean];
  const marks = [...(others.length ? others : shown).flatMap(endsOf), ...near, ...(data.solvedAt === null ? [] : [data.solvedAt])];
  let ys = padded(marks);
  const isFar = others.length > 0 && leaf && Math.abs(leaf.measured.mean - (ys[0] + ys[1]) / 2) > 1.5 * (ys[1] - ys[0]);
  if (leaf && !isFar) ys = padded([...marks, ...endsOf(leaf)]);
  const xs = [Math.min(...sizes) - 0.6, Math.max(most, ...known.map((one) => one.nodes)) + 0.6];
  const chart = chartOf(room, 290, xs, ys, "decision nodes", data.isTested ? "mean test return" : "mean return, untested", "Mean return against size", true);
  chart.root.setAttribute("role", "group");
  solvedInto(chart, ys);
  for (const one of known) {
    const x = chart.px(one.nodes), y = chart.py(one.mean);
    chart.inside.append(
      one.kind === "possible"
        ? svg("path", { class: "possible", d: `M${x - 11} ${y}h22` }, svg("title", {}, `possible with ${one.nodes}: ${number(one.mean)}`))
        : svg("path", { class: "published", d: `M${x - 4} ${y - 4}l8 8m0 -8l-8 8` }, svg("title", {}, `thesis ${one.run}: ${number(one.mean)}`)),
    );
  }
  for (const tree of shown) {
    const x = chart.px(tree.nodes), { mean, low = mean, high = mean } = tree.measured, isBeyond = tree === leaf && isFar;
    const told = `${tree.title}: mean ${data.isTested ? "test " : ""}return ${number(mean)}${UNTESTED}`;
    const way = mean < ys[0] ? 1 : -1, y = isBeyond ? chart.py(ys[way > 0 ? 0 : 1]) - way * 14 : chart.py(mean);
    const point = svg("g", { class: "point", role: "button", tabindex: 0, "aria-label": told, "aria-pressed": String(tree.i === view.tree), "data-tree": tree.i },
      svg("title", {}, told),
      svg("rect", { class: "hit", x: x - 12, y: y - 14, width: 24, height: 28 }),
      isBeyond
        ? svg("path", { class: "beyond", d: `M${x} ${y}v${way * 12}m-4 ${way * -4}l4 ${way * 4}l4 ${way * -4}` })
        : svg("line", { x1: x, x2: x, y1: chart.py(low), y2: chart.py(high) }),
      svg("circle", { class: "dot", cx: x, cy: y, r: 5.5 }));
    point.addEventListener("click", () => chooseTree(tree.i));
    point.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      chooseTree(tree.i);
    });
    chart.above.append(point);
  }
  at("archive").replaceChildren(chart.root);
  const keys = [
    shown.some((tree) => tree.measured.low !== undefined)
      ? keyOf("best tree of each size, with its 95 % interval", svg("line", { class: "possible", x1: 8, x2: 8, y1: 0, y2: 12, style: "stroke: var(--accent)" }))
      : keyOf(`best tree of each size${UNTESTED}`, svg("circle", { cx: 8, cy: 6, r: 4, style: "fill: none; stroke: var(--accent); stroke-width: 2" })),
  ];
  if (known.some((one) => one.kind === "possible")) keys.push(keyOf("possible, by brute force", svg("path", { class: "possible", d: "M0 6H16" })));
  if (known.some((one) => one.kind === "published")) keys.push(keyOf("runs of the thesis", svg("path", { class: "published", d: "M4 2l8 8m0 -8l-8 8" })));
  const far = isFar ? ` The lone leaf returns ${number(leaf.measured.mean)}, beyond the edge where its dot stands.` : "";
  const hidden = known.filter((one) => one.mean < ys[0]).length;
  at("archive-told").replaceChildren(
    html("div", {}, ...keys),
    (shown.length > 1 ? "Choose a dot to see its tree above." : "This run kept the champion alone.") + far +
      (hidden ? ` ${hidden} of the thesis' runs lie below.` : ""),
  );
};

const drawReturns = (room) => {
  const values = data.returns.filter((value) => value !== null), low = Math.min(...values), high = Math.max(...values);
  const bins = Math.min(40, Math.max(8, Math.round(Math.sqrt(values.length) * 1.3))), counts = new Array(bins).fill(0);
  for (const value of values) counts[Math.min(bins - 1, Math.floor(((value - low) / (high - low)) * bins))] += 1;
  const ys = [0, Math.max(...counts) * 1.08];
  const chart = chartOf(room, 210, [low, high], ys, "return of an episode", "episodes", "Returns of the test episodes");
  counts.forEach((count, i) => {
    const from = low + ((high - low) * i) / bins, to = low + ((high - low) * (i + 1)) / bins;
    chart.inside.append(
      svg("rect", { class: "bar", x: chart.px(from) + 0.5, y: chart.py(count), width: Math.max(1, chart.px(to) - chart.px(from) - 1), height: chart.py(0) - chart.py(count) },
        svg("title", {}, `${counted(count, "episode")} from ${figures(from, 4)} to ${figures(to, 4)}`)),
    );
  });
  const mean = data.trees[0].measured?.mean;
  if (mean !== undefined) {
    chart.above.append(svg("line", { class: "mark", x1: chart.px(mean), x2: chart.px(mean), y1: chart.py(ys[1]), y2: chart.py(0) }));
  }
  at("returns").replaceChildren(chart.root);
  at("returns-told").textContent = `${counted(values.length, "episode")}, from ${number(low)} to ${number(high)}; the line is the mean, ${number(mean)}.`;
};

const startCharts = () => {
  onWidth(at("progress"), drawProgress);
  onWidth(at("archive"), drawArchive);
  drawRefinements();
  const values = data.returns.filter((value) => value !== null);
  if (values.length > 1 && Math.max(...values) > Math.min(...values)) {
    at("returns-section").hidden = false;
    onWidth(at("returns"), drawReturns);
  }
  watch((changed) => {
    if (!changed.has("tree")) return;
    for (const point of document.querySelectorAll(".point")) point.setAttribute("aria-pressed", String(Number(point.dataset.tree) === view.tree));
  });
};
