"use strict";
const all = (selector, of = document) => [...of.querySelectorAll(selector)];
const told = (id) => JSON.parse(document.getElementById(id)?.textContent || "null");

// Films: one slider for all films of a card. Its value is a frame; a film that is over keeps its last one.
const films = told("films") || {};

function player(root) {
  const videos = all("video", root);
  const slider = root.querySelector("input");
  const button = root.querySelector(".play");
  const clock = root.querySelector("output");
  const rate = Number(root.dataset.rate);
  const label = button.getAttribute("aria-label");
  let playing = false;

  const load = () => {
    for (const video of videos) if (!video.src) video.src = `data:video/mp4;base64,${films[video.dataset.film]}`;
  };
  const place = (video) => (Math.min(slider.value, video.dataset.frames - 1) + 0.5) / rate;
  const paths = all(".paths [data-from]", root); // of the hand, as each camera of the film shows them
  const say = () => {
    const now = paths.findLast((path) => Number(path.dataset.from) <= slider.value);
    for (const path of paths) path.style.display = path === now ? "" : "none";
    const seconds = `${((slider.value / rate) * root.dataset.speed).toFixed(1)} s`;
    clock.value = seconds;
    slider.setAttribute("aria-valuetext", seconds);
  };
  const seek = () => {
    load();
    for (const video of videos) video.currentTime = place(video);
    say();
  };
  const stop = () => {
    playing = false;
    button.textContent = "Play";
    button.setAttribute("aria-label", label);
    for (const video of videos) video.pause();
  };
  let before = 0;
  const follow = (now) => {
    if (!playing) return;
    root.time += Math.min((now - before) / 1000, 0.25);
    before = now;
    slider.value = Math.floor(root.time * rate);
    say();
    for (const video of videos) {
      const over = root.time * rate >= video.dataset.frames;
      if (over && !video.paused) {
        video.pause();
        video.currentTime = place(video);
      } else if (!over && !video.seeking && Math.abs(video.currentTime - root.time) > 0.3) {
        video.currentTime = root.time; // in step
      }
    }
    if (root.time * rate > Number(slider.max) + 1) stop();
    else requestAnimationFrame(follow);
  };
  const play = () => {
    if (slider.value === slider.max || !root.played) slider.value = 0;
    root.played = true;
    seek();
    playing = true;
    root.time = slider.value / rate;
    before = performance.now();
    button.textContent = "Pause";
    button.setAttribute("aria-label", label.replace("Play", "Pause"));
    for (const video of videos) if (root.time * rate < video.dataset.frames) video.play().catch(() => {});
    requestAnimationFrame(follow);
  };
  button.addEventListener("click", () => (playing ? stop() : play()));
  for (const video of videos) video.addEventListener("click", () => button.click());
  slider.addEventListener("input", () => {
    root.played = true;
    stop();
    seek();
  });
  root.toggle = () => button.click();
  say();
}
all(".player").forEach(player);

function html(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
const plots = told("plots") || [];
const axes = new Map(plots.flatMap((plot) => plot.axes.map((axis) => [axis.id, axis])));

// Filters of the gallery: choices and ranges of quantities, which live in the address: #stage=grasp&light=4..20
const form = document.querySelector(".filters");
const gallery = all(".gallery .card");
const ranges = new Map();
// A choice for each property in which the cards of the gallery differ.
for (const [key, name] of Object.entries({ task: "Task", stage: "Fails at", operator: "Changed", picture: "Picture" })) {
  const values = [...new Set(gallery.flatMap((card) => card.dataset[key].split(" ")))].sort();
  if (values.length < 2) continue;
  const select = html("select", { name: key }, html("option", { value: "" }, "all"));
  for (const value of values) select.append(html("option", { value }, value));
  form.querySelector(".ranges").before(html("label", {}, name, select));
}
const value = (card, id) => {
  for (const plot of plots) {
    const index = plot.axes.findIndex((axis) => axis.id === id);
    if (index >= 0 && plot.cards[card.id]) return plot.cards[card.id][index];
  }
  return null;
};
const fits = (card, chosen) =>
  Object.entries(chosen).every(([key, wanted]) => !wanted || card.dataset[key].split(" ").includes(wanted)) &&
  [...ranges].every(([id, [low, high]]) => {
    const here = value(card, id);
    return here !== null && here >= low && here <= high;
  });

function ranged(axis, one, other) {
  const round = (number) => Number(number.toPrecision(4));
  ranges.set(axis.id, [round(Math.min(one, other)), round(Math.max(one, other))]);
}

function narrow() {
  const selects = all("label > select[name]", form);
  const chosen = Object.fromEntries(selects.map((select) => [select.name, select.value]));
  let shown = 0;
  for (const card of gallery) {
    card.hidden = !fits(card, chosen);
    shown += !card.hidden;
  }
  for (const select of selects)
    for (const option of select.options) {
      const count = gallery.filter((card) => fits(card, { ...chosen, [select.name]: option.value })).length;
      option.textContent = `${option.value || "all"} (${count})`;
    }
  form.querySelector("output").value = `${shown} of ${gallery.length} shown`;
  form.querySelector("[type=reset]").disabled = !Object.values(chosen).some(Boolean) && !ranges.size;
  document.querySelector(".nothing").hidden = shown > 0;
  listed();
}

// Ranges as numbers that can be changed by keyboard; a select adds one.
function listed() {
  const place = form.querySelector(".ranges");
  if (place.contains(document.activeElement) && document.activeElement.type === "number") return;
  place.replaceChildren();
  for (const [id, ends] of ranges) {
    const axis = axes.get(id);
    const inputs = ends.map((end, index) => {
      const input = html("input", { type: "number", step: "any", value: end, "aria-label": `${index ? "Highest" : "Lowest"} ${axis.name}` });
      input.addEventListener("change", () => {
        ends[index] = Number(input.value);
        remember();
      });
      return input;
    });
    place.append(html("label", {}, axis.name, html("span", {}, inputs[0], " to ", inputs[1])));
  }
  const more = html("select", { "aria-label": "Add a range" }, html("option", { value: "" }, "add a range"));
  for (const axis of axes.values()) if (!ranges.has(axis.id)) more.append(html("option", { value: axis.id }, axis.name));
  more.addEventListener("change", () => {
    const axis = axes.get(more.value);
    ranged(axis, axis.low, axis.high);
    remember();
  });
  if (axes.size) place.append(html("label", {}, "Range", more));
}

// To the address, and from there.
function remember() {
  const kept = new URLSearchParams();
  for (const select of all("label > select[name]", form)) if (select.value) kept.set(select.name, select.value);
  for (const [id, ends] of ranges) kept.set(id, ends.join(".."));
  history.replaceState(null, "", kept.size ? `#${kept}` : location.pathname + location.search);
  narrow();
}
function recall() {
  if (!form || !location.hash.includes("=")) return form && narrow();
  form.reset();
  ranges.clear();
  for (const [name, wanted] of new URLSearchParams(location.hash.slice(1))) {
    const select = form.querySelector(`select[name="${CSS.escape(name)}"]`);
    if (select) select.value = wanted;
    else if (axes.has(name)) ranged(axes.get(name), ...wanted.split("..").map(Number));
  }
  narrow();
}

if (form) {
  form.addEventListener("change", (event) => event.target.name && remember());
  form.addEventListener("reset", () => {
    ranges.clear();
    setTimeout(remember); // after the browser has reset the choices
  });
  form.addEventListener("submit", (event) => event.preventDefault());
  form.reset(); // browsers keep the choices when one navigates back
  addEventListener("hashchange", recall);
}
recall();

// A link to what is folded up unfolds it.
function unfold() {
  const target = location.hash.includes("=") ? null : document.getElementById(location.hash.slice(1));
  if (target instanceof HTMLDetailsElement) target.open = true;
}
addEventListener("hashchange", unfold);
unfold();

// The page of a run that goes on loads itself again.
const follow = document.getElementById("follow");
if (follow) setInterval(() => follow.checked && location.reload(), 1000 * follow.value);

// Commands can be copied.
for (const button of all(".copy"))
  button.addEventListener("click", async () => {
    const code = button.parentElement.querySelector("code");
    try {
      await navigator.clipboard.writeText(code.textContent);
      button.textContent = "copied";
      setTimeout(() => (button.textContent = "copy"), 1500);
    } catch {
      getSelection().selectAllChildren(code);
    }
  });
