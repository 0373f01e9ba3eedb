// The tree, drawn from the top down where there is room, else as an outline; and its rule in words.

const PADDING = 11, LINE = 17, LEVEL_GAP = 40, SIDE_GAP = 18, MOST_LETTERS = 30;
const ruler = document.createElement("canvas").getContext("2d");
const textWidth = (text, size) => {
  ruler.font = `${size}px ${getComputedStyle(document.body).fontFamily}`;
  return ruler.measureText(text).width;
};

// A long sum is broken in front of its signs.
const brokenText = (text) => {
  const lines = [];
  for (const part of minus(text).split(/ (?=[+−<=] )/)) {
    const last = lines.length - 1;
    if (last >= 0 && lines[last].length + part.length < MOST_LETTERS) lines[last] += ` ${part}`;
    else lines.push(part);
  }
  return lines;
};

// Boxes of a tree: splits by their number, leaves by ~number, each with its lines and its size.
const boxesOf = (tree) => {
  const boxes = new Map();
  const total = tree.leaves.reduce((sum, leaf) => sum + (leaf.visits ?? 0), 0);
  const add = (key, node, lines) => {
    const share = total && node.visits !== null ? node.visits / total : null;
    const told = share === null ? "" : percent(share);
    const room = key >= 0 && episodesOf(tree).length ? textWidth("now −0.000e−0", 11) + 12 : 0;
    const wide = Math.max(...lines.map((line) => textWidth(line, 13.5)), textWidth(told, 11) + room, 46);
    const rows = lines.length + (share !== null || room ? 0.85 : 0);
    boxes.set(key, { key, node, lines, share, told, width: wide + 2 * PADDING, height: rows * LINE + 2 * 7 });
  };
  tree.splits.forEach((split, i) => add(i, split, brokenText(`${split.text} ?`)));
  tree.leaves.forEach((leaf, i) => add(~i, leaf, leaf.lines.flatMap(brokenText)));
  return boxes;
};

// Subtrees stand as near to each other as no boxes meet, parents above the middle of their children.
const placedFromTop = (tree, boxes) => {
  const placed = (key) => {
    const box = boxes.get(key), own = [[-box.width / 2, box.width / 2]];
    if (key < 0) return { key, outline: own };
    const left = placed(tree.splits[key].left), right = placed(tree.splits[key].right);
    let apart = 0;
    for (let level = 0; level < Math.min(left.outline.length, right.outline.length); level++) {
      apart = Math.max(apart, left.outline[level][1] - right.outline[level][0] + SIDE_GAP);
    }
    left.shift = -apart / 2;
    right.shift = apart / 2;
    const outline = [...own];
    for (let level = 0; level < Math.max(left.outline.length, right.outline.length); level++) {
      const ends = [left, right]
        .filter((side) => level < side.outline.length)
        .map((side) => side.outline[level].map((x) => x + side.shift));
      outline.push([Math.min(...ends.map((end) => end[0])), Math.max(...ends.map((end) => end[1]))]);
    }
    return { key, outline, left, right };
  };
  const heights = [];
  const measure = (key, level) => {
    heights[level] = Math.max(heights[level] ?? 0, boxes.get(key).height);
    if (key >= 0) for (const side of ["left", "right"]) measure(tree.splits[key][side], level + 1);
  };
  const root = tree.splits.length ? 0 : -1;
  measure(root, 0);
  const tops = heights.map((_, level) => heights.slice(0, level).reduce((sum, h) => sum + h + LEVEL_GAP, 4));
  const whole = placed(root), low = Math.min(...whole.outline.map((end) => end[0]));
  const settle = (part, x, level) => {
    Object.assign(boxes.get(part.key), { x: x - boxes.get(part.key).width / 2, y: tops[level] });
    for (const side of [part.left, part.right]) if (side) settle(side, x + side.shift, level + 1);
  };
  settle(whole, 4 - low, 0);
  return { width: Math.max(...whole.outline.map((end) => end[1])) - low + 8, height: tops.at(-1) + heights.at(-1) + 4 };
};

const INDENT = 26;
const placedAsOutline = (tree, boxes) => {
  let y = 4, right = 0;
  const settle = (key, depth) => {
    const box = boxes.get(key);
    Object.assign(box, { x: 4 + depth * INDENT + (depth ? 30 : 0), y });
    y += box.height + 9;
    right = Math.max(right, box.x + box.width);
    if (key >= 0) for (const side of ["left", "right"]) settle(tree.splits[key][side], depth + 1);
  };
  settle(tree.splits.length ? 0 : -1, 0);
  return { width: right + 4, height: y };
};

const edgeOf = (parent, child, answer, outlined) => {
  const share = child.share ?? 0.3;
  let path, x, y, anchor;
  if (outlined) {
    const from = parent.x + 12, to = child.y + child.height / 2;
    path = `M${from} ${parent.y + parent.height}V${to}H${child.x}`;
    [x, y, anchor] = [child.x - 6, to + 4, "end"];
  } else {
    const x1 = parent.x + parent.width / 2, y1 = parent.y + parent.height;
    const x2 = child.x + child.width / 2, middle = (y1 + child.y) / 2;
    path = `M${x1} ${y1}C${x1} ${middle} ${x2} ${middle} ${x2} ${child.y}`;
    [x, y, anchor] = [x1 + (x2 - x1) * 0.62, middle + 5, "middle"];
  }
  return {
    line: svg("path", { class: "edge", d: path, "stroke-width": 1.2 + (outlined ? 2.5 : 5) * share }),
    label: svg("text", { class: "edge-label", x, y, "text-anchor": anchor }, answer),
  };
};

const drawnTree = (tree, room) => {
  const boxes = boxesOf(tree);
  let size = placedFromTop(tree, boxes);
  const outlined = size.width > Math.max(room, 300) * 1.12;
  if (outlined) size = placedAsOutline(tree, boxes);
  const scale = Math.min(1, Math.max(room / size.width, 0.72));
  const root = svg("svg", {
    class: outlined ? null : "from-top",
    width: size.width * scale,
    height: size.height * scale,
    viewBox: `0 0 ${size.width} ${size.height}`,
    role: "img",
    "aria-label": `Decision tree: ${tree.title}. The rule in words follows below.`,
    style: size.width * scale < room ? `margin: 0 auto` : null,
  });
  const parts = new Map(), edges = svg("g"), labels = svg("g"), nodes = svg("g");
  for (const [key, box] of boxes) {
    const part = nodeOf(tree, box);
    nodes.append(part.group);
    parts.set(key, part);
  }
  tree.splits.forEach((split, i) => {
    for (const [side, answer] of [["left", "yes"], ["right", "no"]]) {
      const edge = edgeOf(boxes.get(i), boxes.get(split[side]), answer, outlined);
      edges.append(edge.line);
      labels.append(edge.label);
      Object.assign(parts.get(split[side]), edge);
    }
  });
  root.append(edges, labels, nodes);
  return { root, parts, outlined };
};

const nodeOf = (tree, box) => {
  const isLeaf = box.key < 0, action = isLeaf ? box.node.action : undefined;
  const colour = action === undefined ? null : colourOf(action);
  const kind = isLeaf ? `answer${colour ? " coloured" : ""}${LIGHT_INK.has(colour) ? " light-ink" : ""}` : "split";
  const group = svg("g", { class: `node ${kind}` });
  const visited = box.share === null ? "" : `: ${box.node.visits.toLocaleString("en-US")} visits, ${percent(box.share)} of all states`;
  group.append(
    svg("title", {}, `${box.lines.join(" ")}${visited}`),
    svg("rect", {
      class: "outline", x: box.x, y: box.y, width: box.width, height: box.height, rx: isLeaf ? 5 : 10,
      style: colour ? `fill: ${colour}` : null,
    }),
  );
  box.lines.forEach((line, i) =>
    group.append(
      svg("text", { class: "question", x: box.x + box.width / 2, y: box.y + 20 + i * LINE, "text-anchor": "middle" }, line),
    ),
  );
  const below = box.y + 18 + box.lines.length * LINE;
  const centred = isLeaf || !episodesOf(tree).length;
  group.append(
    svg("text", { class: "share", x: centred ? box.x + box.width / 2 : box.x + PADDING, y: below, "text-anchor": centred ? "middle" : "start" }, box.told),
  );
  const now = svg("text", { class: "now", x: box.x + box.width - PADDING, y: below, "text-anchor": "end" });
  if (!isLeaf) group.append(now);
  return { group, now };
};

// Lights the way of the observation that the player shows.
const lightTree = (drawn, tree) => {
  const observation = observationNow();
  const { path, leaf } = observation ? wayOf(tree, observation) : { path: [], leaf: null };
  const lit = new Set(leaf === null ? [] : [...path, ~leaf]);
  for (const [key, part] of drawn.parts) {
    const on = lit.has(key);
    part.group.classList.toggle("lit", on);
    part.line?.classList.toggle("lit", on);
    part.label?.classList.toggle("lit", on);
    if (key >= 0) part.now.textContent = on ? `now ${figures(sumOf(tree.splits[key].terms, observation))}` : "";
  }
  for (const way of document.querySelectorAll("#rule .way")) way.classList.toggle("lit", Number(way.dataset.leaf) === leaf);
};

const shareOf = (tree, leaves) => {
  const total = tree.leaves.reduce((sum, leaf) => sum + (leaf.visits ?? 0), 0);
  return total ? leaves.reduce((sum, leaf) => sum + tree.leaves[leaf].visits, 0) / total : null;
};
const chipOf = (action) => (action === undefined ? null : html("span", { class: "chip", style: `background: ${colourOf(action)}` }));

const drawRule = (tree) => {
  const list = html("dl");
  for (const rule of tree.rules) {
    const share = shareOf(tree, rule.ways.map((way) => way.leaf));
    list.append(
      html(
        "div",
        {},
        html(
          "dt",
          {},
          chipOf(tree.leaves[rule.ways[0].leaf].action),
          minus(rule.answer.join(", ")),
          share === null ? null : html("span", { class: "share" }, `in ${percent(share)} of states`),
        ),
        html(
          "dd",
          {},
          ...rule.ways.map((way, i) => {
            const start = i ? "or if " : "if ";
            const text = way.conditions.length ? start + way.conditions.join(" and ") : "always";
            return html("span", { class: "way", "data-leaf": way.leaf }, text + (i < rule.ways.length - 1 ? "," : "."));
          }),
        ),
      ),
    );
  }
  at("rule").replaceChildren(list);
};

// A letter with a dot above is set as such: not every font of mathematics has the combining dot.
const setText = (text, element) =>
  text
    .split(/(\S\u0307)/)
    .filter(Boolean)
    .map((part) =>
      part.endsWith("\u0307")
        ? math("mover", { accent: "false" }, math("mi", {}, part[0]), math("mo", { lspace: "0", rspace: "0" }, "˙"))
        : math(element, element === "mi" && part.length > 1 ? { mathvariant: "normal" } : {}, part.replaceAll(" ", "\u00a0")),
    );

// A formula in MathML, which browsers set themselves: cases, each a sum and when it holds.
const sumElements = (terms) =>
  terms.flatMap(([factor, name], i) => {
    const sign = factor < 0 ? "−" : i ? "+" : null, size = Math.abs(factor);
    return [
      sign && math("mo", i ? {} : { form: "prefix" }, sign),
      name && size === 1 ? null : math("mn", {}, String(size)),
      name && size !== 1 ? math("mspace", { width: "0.2em" }) : null,
      ...setText(name, "mi"),
    ].filter(Boolean);
  });
const drawFormula = (tree) => {
  at("formula").hidden = !tree.formulas.length;
  at("formula").replaceChildren(
    ...tree.formulas.map((formula) => {
      const rows = formula.cases.map((one) =>
        math(
          "mtr",
          {},
          math("mtd", {}, math("mrow", {}, ...sumElements(one.terms))),
          math("mtd", {}, math("mrow", {}, ...setText(one.when.length ? `if ${one.when.join(" and ")}` : "", "mtext"))),
        ),
      );
      const table = math("mtable", { columnalign: "left" }, ...rows);
      // A brace that stretches needs a font of mathematics, which not every machine has; a bar does not.
      if (rows.length > 1) table.setAttribute("class", "cases");
      return math("math", { display: "block" }, ...setText(formula.name, "mi"), math("mo", {}, "="), math("mrow", {}, table));
    }),
    ...tree.formulas
      .filter((formula) => formula.low !== null || formula.high !== null)
      .map((formula) => html("p", { class: "note" }, `${formula.name} is clipped to ${figures(formula.low ?? -Infinity)} to ${figures(formula.high ?? Infinity)}.`)),
  );
};

const drawVisits = (tree) => {
  const total = tree.leaves.reduce((sum, leaf) => sum + (leaf.visits ?? 0), 0);
  at("visits").hidden = !total;
  const rows = [
    ...tree.splits.map((split) => [minus(`${split.text}?`), split.visits]),
    ...tree.leaves.map((leaf) => [minus(leaf.lines.join(", ")), leaf.visits]),
  ].map(([text, visits]) => [text, (visits ?? 0).toLocaleString("en-US"), percent((visits ?? 0) / (total || 1))]);
  at("visits-table").replaceChildren(tableOf(["node", "visits in the test", "share of states"], rows, "Visits of every node"));
};

const startTree = () => {
  const choice = at("tree-choice");
  data.trees.forEach((tree, i) => choice.append(html("option", { value: i }, tree.title)));
  choice.addEventListener("change", () => change({ tree: Number(choice.value) }));
  let drawn = null, room = 0;
  const redraw = () => {
    if (!room) return;
    drawn = drawnTree(treeNow(), room);
    at("tree").replaceChildren(drawn.root);
    at("stage").classList.toggle("tall", drawn.root.height.baseVal.value > 560);
    const seen = treeNow().leaves.reduce((sum, leaf) => sum + (leaf.visits ?? 0), 0);
    at("tree-caption").textContent =
      (treeNow().splits.length ? (drawn.outlined ? "Yes comes first. " : "Yes leads to the left. ") : "") +
      (seen ? `Shares are of the ${seen.toLocaleString("en-US")} states of the test episodes${treeNow().splits.length ? "; thicker lines are taken more often" : ""}.` : "");
    lightTree(drawn, treeNow());
  };
  const retell = () => {
    const tree = treeNow(), measured = tree.measured;
    choice.value = view.tree;
    const interval = measured?.low === undefined || measured.low === measured.high ? "" : ` (${number(measured.low)} to ${number(measured.high)})`;
    at("tree-told").textContent =
      `${counted(tree.nodes, "decision node")}, depth ${tree.depth}, M = ${figures(tree.complexity, 6)}` +
      (measured ? `; mean return ${number(measured.mean)}${interval}${UNTESTED}.` : ".");
    drawRule(tree);
    drawFormula(tree);
    drawVisits(tree);
  };
  retell();
  onWidth(at("tree"), (wide) => {
    room = wide;
    redraw();
  });
  watch((changed) => {
    if (changed.has("tree")) {
      retell();
      redraw();
    } else if (drawn && (changed.has("step") || changed.has("episode"))) lightTree(drawn, treeNow());
  });
};
