// The player: which episode, which step, and how fast.

const PLAY = "M4 2.5v11L13 8z", PAUSE = "M3.5 2.5h3.2v11H3.5zM9.3 2.5h3.2v11H9.3z";

const actionOf = (episode, step) =>
  step < episode.kept ? episode.actions.subarray(step * episode.wide, (step + 1) * episode.wide) : null;
const actionText = (action) =>
  environment.bounds.length
    ? environment.actions.map((name, i) => `${name} = ${figures(action[i])}`).join(", ")
    : environment.actions[action[0]] ?? String(action[0]);
const endOf = (episode) =>
  episode.kept < episode.length
    ? `only the first ${episode.kept.toLocaleString("en-US")} of ${episode.length.toLocaleString("en-US")} steps were kept`
    : episode.end === "terminated" ? "the task ended the episode" : "the episode came to its limit";

// When a step is, where it is known how long steps are.
const timeOf = (step) => (data.stepSeconds ? ` (${number(step * data.stepSeconds, secondDigits)} s)` : "");
const secondDigits = data.stepSeconds ? Math.max(0, Math.min(6, Math.ceil(-Math.log10(data.stepSeconds) - 1e-9))) : 0;

const chooseTree = (tree) => {
  const own = episodesOf(data.trees[tree]);
  const shown = own.find((episode) => episode.rank === "median") ?? own[0];
  change({ tree, episode: shown ? data.episodes.indexOf(shown) : -1, step: 0, playing: false });
};
const chooseEpisode = (episode) => change({ episode, step: 0, playing: false });

const startPlayer = () => {
  const scene = sceneInto(at("scene"));
  const last = () => episodeNow()?.kept ?? 0;
  const seek = (step) => change({ step: Math.max(0, Math.min(last(), step)), playing: false });
  const toggle = () => {
    if (!episodeNow()) return;
    change(view.playing ? { playing: false } : { playing: true, step: view.step >= last() ? 0 : view.step });
  };

  const list = () => {
    const own = episodesOf(treeNow());
    at("player").hidden = own.length === 0;
    at("stage").classList.toggle("alone", own.length === 0);
    at("no-episodes").hidden = own.length > 0;
    at("no-episodes").textContent = !data.isTested
      ? "Episodes are recorded at the end of a run."
      : data.episodes.length
        ? "No episode of this tree was recorded."
        : "This run recorded no episodes, so there is none to play.";
    at("episodes").replaceChildren(
      ...own.map((episode) => {
        const index = data.episodes.indexOf(episode);
        const button = html(
          "button",
          { type: "button", role: "radio", "aria-checked": String(index === view.episode), tabindex: index === view.episode ? 0 : -1, title: `reset(seed=${episode.seed})` },
          html("b", {}, episode.rank),
          number(episode.total),
        );
        button.addEventListener("click", () => chooseEpisode(index));
        return button;
      }),
    );
  };
  at("episodes").addEventListener("keydown", (event) => {
    const turn = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!turn) return;
    event.preventDefault();
    event.stopPropagation();
    const own = episodesOf(treeNow()), place = own.indexOf(episodeNow());
    chooseEpisode(data.episodes.indexOf(own[(place + turn + own.length) % own.length]));
    at("episodes").querySelector('[aria-checked="true"]')?.focus();
  });

  const show = () => {
    const episode = episodeNow();
    if (!episode) return;
    const action = actionOf(episode, view.step), observation = observationNow();
    scene.move(observation, action);
    let sum = 0;
    for (let step = 0; step < view.step; step++) sum += episode.rewards[step];
    const told = action
      ? [chipOf(environment.bounds.length ? undefined : action[0]), html("b", {}, actionText(action))]
      : [html("b", {}, "end"), `: ${endOf(episode)}`];
    at("moment").replaceChildren(
      html("span", {}, "step ", html("b", {}, view.step.toLocaleString("en-US")), ` of ${episode.length.toLocaleString("en-US")}${timeOf(view.step)}`),
      html("span", {}, ...told.filter(Boolean)),
      html("span", {}, "return so far ", html("b", {}, number(sum, 2))),
    );
    at("scrub").max = last();
    at("scrub").value = view.step;
    at("scrub").setAttribute("aria-valuetext", `step ${view.step} of ${episode.length}`);
    at("to-start").disabled = at("back").disabled = view.step === 0;
    at("forward").disabled = view.step >= last();
  };

  at("play").addEventListener("click", toggle);
  at("to-start").addEventListener("click", () => seek(0));
  at("back").addEventListener("click", () => seek(view.step - 1));
  at("forward").addEventListener("click", () => seek(view.step + 1));
  at("scrub").addEventListener("input", () => seek(Number(at("scrub").value)));
  at("speed").addEventListener("change", () => change({ speed: Number(at("speed").value) }));
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || !episodeNow()) return;
    if (event.target.closest("input, select, summary, a, [role=radio], [role=button], .scroll")) return;
    const isButton = event.target.closest("button");
    if (event.key === " " && !isButton) toggle();
    else if (event.key === "ArrowRight") seek(view.step + 1);
    else if (event.key === "ArrowLeft") seek(view.step - 1);
    else if (event.key === "Home" && at("player").contains(event.target)) seek(0);
    else if (event.key === "End" && at("player").contains(event.target)) seek(last());
    else return;
    event.preventDefault();
  });

  let before = 0, due = 0;
  const tick = (now) => {
    if (!view.playing) return;
    due += Math.min(0.25, (now - before) / 1000) * scene.rate * view.speed;
    before = now;
    const steps = Math.floor(due);
    due -= steps;
    if (steps) {
      const step = Math.min(last(), view.step + steps);
      change(step >= last() ? { step, playing: false } : { step });
    }
    requestAnimationFrame(tick);
  };
  watch((changed) => {
    if (changed.has("tree") || changed.has("episode")) list();
    if (changed.has("tree") || changed.has("episode") || changed.has("step")) show();
    if (changed.has("playing")) {
      at("play").setAttribute("aria-label", view.playing ? "Pause" : "Play");
      at("play-icon").setAttribute("d", view.playing ? PAUSE : PLAY);
      if (view.playing) {
        before = performance.now();
        due = 0;
        requestAnimationFrame(tick);
      }
    }
  });
};
