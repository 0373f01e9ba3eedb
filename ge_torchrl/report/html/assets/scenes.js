// Environments drawn from what the controller observes: each returns its size, its rate, and what moves it.

const turned = (x, y, degrees) => `translate(${x} ${y}) rotate(${degrees})`;
const degrees = (radians) => (radians * 180) / Math.PI;
const line = (kind, x1, y1, x2, y2) => svg("line", { class: kind, x1, y1, x2, y2 });
const moveLine = (node, x1, y1, x2, y2) => {
  for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) node.setAttribute(name, value);
};

// An arrow along a direction in pixels, of no length where nothing pushes.
const arrow = () => svg("path", { class: "s-push" });
const pointArrow = (node, x, y, along) => {
  const head = Math.sign(along) * 7;
  node.setAttribute("d", Math.abs(along) < 1 ? "" : `M${x} ${y}h${along}m${-head} -6l${head} 6l${-head} 6`);
};
// An arc around a joint, counterclockwise where the turn is above 0.
const bendArrow = (node, x, y, turn, radius = 22) => {
  if (Math.abs(turn) < 0.01) {
    node.setAttribute("d", "");
    return;
  }
  const way = Math.sign(turn), span = 0.5 + 1.9 * Math.min(1, Math.abs(turn));
  const point = (angle, r = radius) => `${x + r * Math.cos(angle)} ${y - r * Math.sin(angle)}`;
  const from = Math.PI / 2 - (way * span) / 2, to = Math.PI / 2 + (way * span) / 2;
  node.setAttribute(
    "d",
    `M${point(from)}A${radius} ${radius} 0 0 ${way > 0 ? 0 : 1} ${point(to)}` +
      `M${point(to - way * 0.34, radius - 6)}L${point(to)}L${point(to - way * 0.3, radius + 7)}`,
  );
};

const cartPole = (root) => {
  const metre = 76, ground = 138, x0 = 200;
  const cart = svg("g"), pole = svg("line", { class: "s-ink", style: "stroke-width: 7; stroke: var(--accent)" }), push = arrow();
  cart.append(
    svg("rect", { class: "s-body", x: -27, y: -24, width: 54, height: 20, rx: 4 }),
    ...[-15, 15].map((x) => svg("circle", { class: "s-body", cx: x, cy: -3, r: 5 })),
  );
  root.append(
    line("s-soft", 0, ground + 3, 400, ground + 3),
    ...[-2.4, 2.4].map((x) => line("s-dash", x0 + x * metre, 20, x0 + x * metre, ground + 8)),
    svg("text", { class: "s-text", x: 200, y: ground + 18, "text-anchor": "middle" }, "0 m"),
    ...[-2.4, 2.4].map((x) =>
      svg("text", { class: "s-text", x: x0 + x * metre, y: ground + 18, "text-anchor": "middle" }, `${figures(x)} m`),
    ),
    cart, pole, push,
  );
  return ([x, , angle], action) => {
    const left = x0 + x * metre, top = ground - 24;
    cart.setAttribute("transform", `translate(${left} ${ground})`);
    moveLine(pole, left, top, left + metre * Math.sin(angle), top - metre * Math.cos(angle));
    const way = action ? (action[0] > 0.5 ? 1 : -1) : 0;
    pointArrow(push, left + way * 32, ground - 14, way * 30);
  };
};

const acrobot = (root) => {
  const metre = 56, x0 = 200, y0 = 122;
  const links = ["s-ink", "s-ink s-second"].map((kind) => svg("line", { class: kind, style: "stroke-width: 8" }));
  const joint = svg("circle", { class: "s-body", r: 6 }), tip = svg("circle", { class: "s-body", r: 5 }), torque = arrow();
  root.append(
    line("s-goal", 70, y0 - metre, 330, y0 - metre),
    svg("text", { class: "s-text", x: 72, y: y0 - metre - 6 }, "the tip has to swing above this line"),
    svg("circle", { class: "s-body", cx: x0, cy: y0, r: 6 }),
    ...links, joint, tip, torque,
  );
  return ([cos1, sin1, cos2, sin2], action) => {
    const x1 = x0 + metre * sin1, y1 = y0 + metre * cos1;
    const x2 = x1 + metre * (sin1 * cos2 + cos1 * sin2), y2 = y1 + metre * (cos1 * cos2 - sin1 * sin2);
    moveLine(links[0], x0, y0, x1, y1);
    moveLine(links[1], x1, y1, x2, y2);
    for (const [node, x, y] of [[joint, x1, y1], [tip, x2, y2]]) {
      node.setAttribute("cx", x);
      node.setAttribute("cy", y);
    }
    bendArrow(torque, x1, y1, action ? action[0] - 1 : 0, 20);
  };
};

const pendulum = (root) => {
  const long = 84, x0 = 200, y0 = 118;
  const rod = svg("line", { class: "s-ink", style: "stroke-width: 13; stroke: var(--accent)" }), torque = arrow();
  root.append(
    svg("circle", { class: "s-dash", cx: x0, cy: y0, r: long }),
    svg("text", { class: "s-text", x: x0, y: 14, "text-anchor": "middle" }, "to be held upright"),
    rod, svg("circle", { class: "s-body", cx: x0, cy: y0, r: 5 }), torque,
  );
  return ([cos, sin], action) => {
    moveLine(rod, x0, y0, x0 - long * sin, y0 - long * cos);
    bendArrow(torque, x0, y0, action ? action[0] / 2 : 0, 30);
  };
};

const mountainCar = (goal, pushOf) => (root) => {
  const scale = 200, left = 1.25, hill = (x) => 0.45 * Math.sin(3 * x) + 0.55;
  const px = (x) => 15 + (x + left) * scale, py = (y) => 235 - y * 165;
  const points = Array.from({ length: 101 }, (_, i) => -1.2 + (1.8 * i) / 100);
  const path = points.map((x) => `${px(x)} ${py(hill(x))}`).join("L");
  const car = svg("g"), push = arrow();
  car.append(
    svg("rect", { class: "s-body", x: -17, y: -18, width: 34, height: 11, rx: 4, style: "fill: var(--accent)" }),
    ...[-10, 10].map((x) => svg("circle", { class: "s-body", cx: x, cy: -5, r: 5 })),
    push,
  );
  root.append(
    svg("path", { class: "s-ground", d: `M${path}L${px(0.6)} 260L${px(-1.2)} 260Z` }),
    svg("path", { class: "s-ink", d: `M${path}` }),
    line("s-goal", px(goal), py(hill(goal)), px(goal), py(hill(goal)) - 38),
    svg("path", { class: "s-goal-fill", d: `M${px(goal)} ${py(hill(goal)) - 38}l18 6l-18 6z` }),
    car,
  );
  return ([x], action) => {
    const slope = degrees(Math.atan2(0.45 * 3 * Math.cos(3 * x) * 165, scale));
    car.setAttribute("transform", turned(px(x), py(hill(x)), -slope));
    const along = action ? pushOf(action[0]) : 0;
    pointArrow(push, Math.sign(along) * 20, -13, 26 * along);
  };
};

const lunarLander = (enginesOf) => (root) => {
  const x0 = 200, ground = 244;
  const lander = svg("g"), legs = [-1, 1].map((side) => svg("path", { class: "s-ink", d: `M${side * 10} -3l${side * 9} 14m${side * -4} 0h${side * 8}` }));
  const flames = {
    main: svg("path", { class: "s-flame", d: "M-5 1L0 27L5 1Z" }),
    right: svg("path", { class: "s-flame", d: "M13 -14l16 4l-16 4z" }),
    left: svg("path", { class: "s-flame", d: "M-13 -14l-16 4l16 4z" }),
  };
  lander.append(
    ...Object.values(flames), ...legs,
    svg("path", { class: "s-body", d: "M-11 -21L-14 -8L-14 0L14 0L14 -8L11 -21Z", style: "fill: var(--accent)" }),
  );
  root.append(
    svg("rect", { class: "s-sky", x: 0, y: 0, width: 400, height: 280, rx: 6 }),
    svg("rect", { class: "s-ground", x: 0, y: ground, width: 400, height: 36 }),
    ...[-0.2, 0.2].flatMap((x) => [
      line("s-goal", x0 + 200 * x, ground, x0 + 200 * x, ground - 24),
      svg("path", { class: "s-goal-fill", d: `M${x0 + 200 * x} ${ground - 24}l13 5l-13 5z` }),
    ]),
    line("s-ink", x0 - 40, ground, x0 + 40, ground),
    svg("text", { class: "s-text", x: 200, y: ground + 22, "text-anchor": "middle" }, "the ground beside the pad is not observed"),
    lander,
  );
  return ([x, y, , , angle, , left, right], action) => {
    lander.setAttribute("transform", turned(x0 + 200 * x, ground - 11 - 133.3 * y, -degrees(angle)));
    const engines = action ? enginesOf(action) : {};
    for (const [name, flame] of Object.entries(flames)) flame.setAttribute("opacity", engines[name] ? 0.45 + 0.55 * engines[name] : 0);
    [left, right].forEach((touches, i) => legs[i].setAttribute("style", touches > 0.5 ? "stroke: var(--good); stroke-width: 3.5" : ""));
  };
};
// The left engine stands at the right side in Gymnasium's own pictures, and pushes to the left.
const landerEngines = ([action]) => ({ right: action === 1, main: action === 2, left: action === 3 });
const landerThrottles = ([main, side]) => ({
  main: main > 0 ? (1 + Math.min(1, main)) / 2 : 0,
  right: side < -0.5 ? Math.min(1, -side) : 0,
  left: side > 0.5 ? Math.min(1, side) : 0,
});

const SCENES = {
  "CartPole-v0": [cartPole, 160, 50],
  "CartPole-v1": [cartPole, 160, 50],
  "Acrobot-v1": [acrobot, 245, 15],
  "Pendulum-v1": [pendulum, 225, 30],
  "MountainCar-v0": [mountainCar(0.5, (action) => action - 1), 255, 30],
  "MountainCarContinuous-v0": [mountainCar(0.45, (force) => Math.max(-1, Math.min(1, force))), 255, 30],
  "LunarLander-v2": [lunarLander(landerEngines), 280, 50],
  "LunarLander-v3": [lunarLander(landerEngines), 280, 50],
  "LunarLanderContinuous-v2": [lunarLander(landerThrottles), 280, 50],
  "LunarLanderContinuous-v3": [lunarLander(landerThrottles), 280, 50],
};

// Any other environment: what it observes, each number on a scale of what it was in the recorded episodes.
const MOST_GAUGES = 12;
// As fast as the clock where it is known how long a step is, and an eye can follow.
const RATE = data.stepSeconds ? Math.max(2, Math.min(120, 1 / data.stepSeconds)) : 30;
const gauges = (root) => {
  const shown = featuresByUse(treeNow()).slice(0, MOST_GAUGES);
  const needles = shown.map((feature, i) => {
    const y = 14 + i * 24, [low, high] = rangeOf(feature);
    const needle = svg("rect", { class: "gauge-now", y: y - 8, width: 4, height: 16, rx: 2 });
    const text = svg("text", { class: "s-text", x: 396, y: y + 4, "text-anchor": "end" });
    const name = environment.features[feature].name;
    root.append(
      svg("text", { class: "s-text", x: 118, y: y + 4, "text-anchor": "end" }, name.length > 17 ? `${name.slice(0, 16)}…` : name),
      svg("rect", { class: "gauge-track", x: 126, y: y - 4, width: 190, height: 8, rx: 4 }), needle, text,
    );
    return (value) => {
      const part = Math.max(0, Math.min(1, (value - low) / (high - low || 1)));
      needle.setAttribute("x", 124 + 190 * part);
      text.textContent = figures(value) + unitOf(feature);
    };
  });
  return (observation) => shown.forEach((feature, i) => needles[i](observation[feature]));
};

// The picture of the step shown, or the last one before it.
const pictured = (place) => {
  const image = html("img", { class: "picture", alt: "The environment, drawn by itself" });
  const none = html("p", { class: "note" }, "The environment drew no picture of itself here. What it observes:");
  place.prepend(image, none);
  return () => {
    const pictures = episodeNow()?.pictures ?? [];
    image.hidden = pictures.length === 0;
    none.hidden = pictures.length > 0 || !episodeNow();
    const last = pictures.filter(([step]) => step <= view.step).at(-1);
    if (last && /^[A-Za-z0-9+/=]*$/.test(last[1])) image.src = `data:image/png;base64,${last[1]}`;
  };
};

const sceneInto = (place) => {
  const own = SCENES[environment.id], [draw, height, rate] = own ?? [gauges, 8 + 24 * Math.min(width, MOST_GAUGES), RATE];
  const root = svg("svg", { viewBox: `0 0 400 ${height}`, width: "100%", role: "img", "aria-label": "The environment at this step" });
  const move = draw(root);
  place.replaceChildren(root);
  const picture = own ? () => {} : pictured(place);
  return {
    rate,
    move: (observation, action) => {
      move(observation, action);
      picture();
    },
  };
};
