// SPDX-License-Identifier: MIT
// Ties the player to the page: buttons, switches, keys, and the first moment.

function swatch(key, look) {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { className: "key", width: 36, height: 20 });
  const pen = canvas.getContext("2d"), ramps = { time: look.time, height: HEIGHT };
  for (let x = 0; x < 36; x++) {
    pen.fillStyle = ramps[key] ? mixed(ramps[key], x / 35) : key === "occupied" ? `rgb(${x < 18 ? look.free : look.occupied})` : look[key];
    pen.fillRect(x, key === "occupied" ? 0 : 5, 1, key === "occupied" ? 20 : 10);
  }
  return canvas;
}

function makeSwitches(player) {
  $("layers").querySelectorAll("label").forEach((label) => label.remove());
  player.layers.forEach((entry, number) => {
    const label = document.createElement("label"), box = document.createElement("input");
    Object.assign(box, { type: "checkbox", checked: entry.shown, id: `layer-${number}` });
    box.addEventListener("change", () => {
      entry.shown = box.checked;
      player.stale = true;
    });
    label.append(box, swatch(entry.key, player.look), entry.name);
    $("layers").append(label);
  });
  const coloured = (colour, words) => {
    const item = document.createElement("span"), bar = document.createElement("span");
    item.className = "item";
    bar.className = "swatch";
    bar.style.background = colour;
    item.append(bar, words);
    return [item, " "];
  };
  const parts = [];
  if (player.layers.some(({ name }) => name === "Loop edges")) parts.push("Loop edges by residual: ", ...RESIDUALS.flatMap(([colour, words]) => coloured(colour, words)));
  const marks = Object.keys(player.facts.marks).filter((kind) => player.facts.marks[kind].length);
  if (marks.length) parts.push(parts.length ? document.createElement("br") : "", "Marks on the time line: ", ...marks.flatMap((kind) => coloured(player.look[kind], MARKS[kind])));
  $("legend").replaceChildren(...parts);
}

function bindKeys(player) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
    const at = event.target, typing = at.tagName === "SELECT", pressing = at.tagName === "BUTTON" || at.type === "checkbox";
    const actions = {
      " ": () => (pressing ? null : player.playing ? player.pause() : player.play()),
      ArrowRight: () => (event.shiftKey ? player.seek(player.time + player.duration / 20) : player.step(1)),
      ArrowLeft: () => (event.shiftKey ? player.seek(player.time - player.duration / 20) : player.step(-1)),
      Home: () => player.seek(0),
      End: () => player.seek(player.duration),
      "+": () => player.faster(1),
      "=": () => player.faster(1),
      "-": () => player.faster(-1),
      f: () => player.camera.setFollow(!player.camera.follow),
      0: () => player.camera.showAll(),
      "?": () => $("keys").showModal(),
    };
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (typing || (key === " " && pressing)) return;
    if (/^[1-9]$/.test(key)) $(`layer-${Number(key) - 1}`)?.click();
    else if (actions[key]) actions[key]();
    else return;
    event.preventDefault();
  });
}

function bindControls(player) {
  const on = (id, act, kind = "click") => $(id).addEventListener(kind, act);
  on("play", () => (player.playing ? player.pause() : player.play()));
  on("back", () => player.step(-1));
  on("forth", () => player.step(1));
  on("scrub", () => player.seek(Number($("scrub").value)), "input");
  on("speed", () => player.setSpeed(Number($("speed").value)), "change");
  on("closer", () => player.camera.zoom(1.5));
  on("farther", () => player.camera.zoom(1 / 1.5));
  on("whole", () => player.camera.showAll());
  on("follow", () => player.camera.setFollow(!player.camera.follow));
  on("help", () => $("keys").showModal());
  on("topic", () => { player.stale = true; }, "change");
  on("theme", () => {
    player.restyle(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
    makeSwitches(player);
  });
  for (const speed of SPEEDS) $("speed").append(new Option(`${speed}×`, `${speed}`));
  $("scrub").max = player.duration;
  bindKeys(player);
}

function fillIn(player) {
  const { facts } = player;
  $("title").textContent = document.title = facts.title;
  $("facts").textContent = facts.facts.join(" · ");
  $("notes").textContent = facts.notes.join(" ");
  $("camera").hidden = !facts.images;
  $("topic").hidden = facts.images?.length === 1;
  if (facts.images?.length === 1) $("topic").before(facts.images[0].topic);
  (facts.images || []).forEach((entry, number) => $("topic").append(new Option(entry.topic, `${number}`)));
}

// #t=12.5&speed=20&paused: where to begin. Who asked the system for less motion is not surprised by a film.
function begin(player) {
  const wish = new URLSearchParams(location.hash.slice(1)), still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  player.setSpeed(Number(wish.get("speed")) || SPEEDS.find((speed) => speed >= 1 && player.duration / speed <= 45) || 200);
  player.seek(Number(wish.get("t")) || 0);
  if (wish.has("follow")) player.camera.setFollow(true);
  if (!still && !wish.has("paused")) player.play();
}

async function start() {
  const system = matchMedia("(prefers-color-scheme: dark)");
  document.documentElement.dataset.theme = system.matches ? "dark" : "light";
  let failed = false; // arrays that come after one that could not be loaded must not hide why
  try {
    const facts = await loadFacts();
    const arrays = await loadArrays(facts, (done, all) => {
      if (!failed) $("loading").textContent = `Loading the result … ${done} of ${all}`;
    });
    $("loading").hidden = true;
    document.querySelector("main").hidden = false;
    const player = new Player(facts, arrays);
    fillIn(player);
    bindControls(player);
    player.restyle(document.documentElement.dataset.theme);
    player.camera.showAll();
    makeSwitches(player);
    system.addEventListener("change", () => {
      player.restyle(system.matches ? "dark" : "light");
      makeSwitches(player);
    });
    new ResizeObserver(() => player.resized()).observe($("stage"));
    begin(player);
    requestAnimationFrame((now) => player.frame(now));
    window.player = player;
  } catch (error) {
    failed = true;
    $("loading").hidden = false;
    $("loading").textContent = `This result cannot be played: ${error.message}`;
    throw error;
  }
}

start();
