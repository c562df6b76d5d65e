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
  const say = () => {
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

// Plots: SVG, so that text is text and colours follow the scheme. Numbers come from the page.
const NS = "http://www.w3.org/2000/svg";
function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== null) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
function html(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
const percent = (share) => `${Math.round(100 * share)}%`;
const short = (value) => String(Number(value.toPrecision(3)));
const written = (axis, value) =>
  axis.options.length ? axis.options[value] : axis.unit === "×" ? `× ${short(value)}` : short(value) + axis.unit;

// A scale from the values of an axis to pixels, with ticks at round values.
function scale(axis, from, to) {
  const { low, high } = axis.options.length ? { low: -0.5, high: axis.options.length - 0.5 } : axis;
  const flat = axis.log ? Math.log : (value) => value;
  const back = axis.log ? Math.exp : (value) => value;
  const at = (value) => from + ((flat(value) - flat(low)) / (flat(high) - flat(low) || 1)) * (to - from);
  at.back = (pixel) => back(flat(low) + ((pixel - from) / (to - from)) * (flat(high) - flat(low)));
  if (axis.options.length) at.ticks = axis.options.map((_, index) => index);
  else if (axis.log) at.ticks = [0.01, 0.05, 0.2, 1, 5, 20, 100].filter((value) => value >= low && value <= high);
  else {
    const rough = (high - low) / 5;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= rough) || rough;
    at.ticks = [];
    for (let value = Math.ceil(low / step - 1e-9) * step; value <= high + step * 1e-9; value += step)
      at.ticks.push(Math.abs(value) < step * 1e-9 ? 0 : value);
  }
  return at;
}

const WIDE = 340;
const BOX = { left: 40, right: 10, top: 8, bottom: 26 };

function frame(height, x, xAxis, label) {
  const picture = svg("svg", { viewBox: `0 0 ${WIDE} ${height}`, role: "img", "aria-label": label });
  const bottom = height - BOX.bottom;
  picture.append(
    svg("rect", { class: "frame", x: BOX.left, y: BOX.top, width: WIDE - BOX.left - BOX.right, height: bottom - BOX.top }),
  );
  const every = Math.ceil(x.ticks.length / 6);
  x.ticks.forEach((value, index) => {
    if (index % every) return;
    const text = written(xAxis, value);
    const anchor = x(value) > WIDE - 30 ? "end" : "middle";
    picture.append(svg("text", { x: x(value), y: bottom + 15, "text-anchor": anchor }, text.length > 12 ? `${text.slice(0, 11)}…` : text));
  });
  return picture;
}

function shade(picture, axis, x, height) {
  const bottom = height - BOX.bottom;
  for (const [low, high, title] of axis.bands) {
    const [left, right] = [x(low), x(high)].sort((a, b) => a - b);
    const area = svg("rect", { class: "fails", x: left, y: BOX.top, width: Math.max(right - left, 1), height: bottom - BOX.top });
    area.append(svg("title", {}, title));
    picture.append(area);
    const nearest = Math.abs(low - axis.nominal) < Math.abs(high - axis.nominal) ? low : high;
    picture.append(svg("line", { class: "edge", x1: x(nearest), x2: x(nearest), y1: BOX.top, y2: bottom }));
  }
  if (!axis.options.length && axis.nominal >= axis.low && axis.nominal <= axis.high)
    picture.append(svg("line", { class: "usual", x1: x(axis.nominal), x2: x(axis.nominal), y1: BOX.top, y2: bottom }));
}

const said = (axis) => axis.bands.map(([low, high]) => `fails from ${written(axis, low)} to ${written(axis, high)}`).join(", ");

function curve(plot, axis) {
  const height = 150;
  const x = scale(axis, BOX.left, WIDE - BOX.right);
  const y = (rate) => height - BOX.bottom - rate * (height - BOX.bottom - BOX.top);
  const rates = axis.curve.map(([place, [rate]]) => `${written(axis, place)}: ${percent(rate)}`).filter((_, index) => index % 10 === 0);
  const bars = axis.bars.map(({ count, of }, index) => `${axis.options[index]}: ${count} of ${of}`);
  const found = [...rates, ...bars].join(", ") || "no random scenes";
  const picture = frame(height, x, axis, `Failure rate by ${axis.name}. ${found}. ${said(axis)}`);
  for (const rate of [0, 0.5, 1]) {
    picture.append(svg("text", { x: BOX.left - 5, y: y(rate) + 4, "text-anchor": "end" }, percent(rate)));
    if (rate === 0.5) picture.append(svg("line", { class: "grid", x1: BOX.left, x2: WIDE - BOX.right, y1: y(rate), y2: y(rate) }));
  }
  shade(picture, axis, x, height);
  if (axis.curve.length) {
    const line = axis.curve.map(([place, [rate]]) => `${x(place)},${y(rate)}`);
    const upper = axis.curve.map(([place, [, , high]]) => `${x(place)},${y(high)}`);
    const lower = axis.curve.map(([place, [, low]]) => `${x(place)},${y(low)}`).reverse();
    const few = plot.random < plot.enough ? "band few" : "band";
    picture.append(svg("polygon", { class: few, points: [...upper, ...lower].join(" ") }));
    picture.append(svg("polyline", { class: "curve", points: line.join(" ") }));
  }
  axis.bars.forEach(({ count, of, low, high }, index) => {
    if (!of) return;
    const wide = Math.min(40, (0.6 * (WIDE - BOX.left - BOX.right)) / axis.options.length);
    picture.append(svg("rect", { class: "bar", x: x(index) - wide / 2, y: y(count / of), width: wide, height: y(0) - y(count / of) }));
    picture.append(svg("line", { class: "whisker", x1: x(index), x2: x(index), y1: y(low), y2: y(high) }));
  });
  brush(picture, height, (left, right) => ranged(axis, x.back(left), x.back(right)));
  return picture;
}

function scatter(plot, xAxis, yAxis, map = null) {
  const wide = WIDE - BOX.left - BOX.right;
  const edge = map?.below ? 14 : 0;
  const shape = (yAxis.high - yAxis.low) / (xAxis.high - xAxis.low || 1); // of a map, so that a metre is a metre
  const height = map ? Math.round(Math.min(Math.max(wide * shape, 120), 420)) + BOX.top + BOX.bottom + edge : 280;
  const x = map?.mirrored ? scale(xAxis, WIDE - BOX.right, BOX.left) : scale(xAxis, BOX.left, WIDE - BOX.right);
  const y = scale(yAxis, height - BOX.bottom - edge, BOX.top);
  const [across, along] = [plot.axes.indexOf(xAxis), plot.axes.indexOf(yAxis)];
  const shown = plot.points.filter((point) => point[3 + across] !== null && point[3 + along] !== null);
  const bad = shown.filter(([failed]) => failed).length;
  const picture = frame(height, x, xAxis, `${bad} of ${shown.length} scenes that fail, by ${xAxis.name} and ${yAxis.name}. ${said(xAxis)} ${said(yAxis)}`);
  picture.setAttribute("role", "group");
  for (const value of y.ticks) {
    const text = written(yAxis, value);
    picture.append(svg("text", { x: BOX.left - 5, y: y(value) + 4, "text-anchor": "end" }, text.length > 7 ? `${text.slice(0, 6)}…` : text));
  }
  shade(picture, xAxis, x, height);
  for (const [low, high] of yAxis.bands) {
    const [top, bottom] = [y(low), y(high)].sort((a, b) => a - b);
    picture.append(svg("rect", { class: "fails", x: BOX.left, y: top, width: wide, height: Math.max(bottom - top, 1) }));
  }
  if (map?.below) picture.append(svg("text", { x: WIDE / 2, y: height - BOX.bottom - 4, "text-anchor": "middle" }, `▼ ${map.below}`));
  const spread = (axis, number) => (axis.options.length ? ((number * 0.618) % 1) * 0.6 - 0.3 : 0);
  const layer = svg("g");
  brush(picture, height, (left, right, top, bottom) => {
    ranged(xAxis, x.back(left), x.back(right));
    ranged(yAxis, y.back(top), y.back(bottom));
  }, true);
  shown.sort((a, b) => a[0] - b[0]);
  shown.forEach((point, number) => {
    const [failed, random, card] = point;
    const where = { cx: x(point[3 + across] + spread(xAxis, number)), cy: y(point[3 + along] + spread(yAxis, number)) };
    const dot = svg("circle", { class: `dot ${failed ? "bad" : "good"}${random ? "" : " led"}`, r: card ? 5 : 3.2, ...where });
    const values = `${xAxis.name} ${written(xAxis, point[3 + across])}, ${yAxis.name} ${written(yAxis, point[3 + along])}`;
    const known = card && document.getElementById(card);
    dot.append(svg("title", {}, `${failed ? "fails" : "passes"}: ${values}${known ? "; opens its card" : ""}`));
    if (known) {
      const link = svg("a", { href: `#${card}` }, dot);
      link.addEventListener("click", () => open(card));
      preview(link, known);
      layer.append(link);
    } else layer.append(dot);
  });
  picture.append(layer);
  return picture;
}

// What a dot's card shows, beside the dot as long as it is pointed at or has the focus.
function preview(link, card) {
  const shown = card.querySelector(".fails video") || card.querySelector("video, .still img");
  const source = shown?.poster || shown?.src;
  if (!source) return;
  let picture = null;
  const show = () => {
    if (picture) return;
    picture = html("img", { class: "preview", src: source, alt: "" });
    const dot = link.getBoundingClientRect();
    const right = dot.right + 168 > document.documentElement.clientWidth;
    picture.style.left = `${scrollX + (right ? dot.left - 168 : dot.right + 8)}px`;
    picture.style.top = `${scrollY + Math.max(dot.top - 80, 0)}px`;
    document.body.append(picture);
  };
  const hide = () => {
    picture?.remove();
    picture = null;
  };
  for (const event of ["pointerenter", "focus"]) link.addEventListener(event, show);
  for (const event of ["pointerleave", "blur", "click"]) link.addEventListener(event, hide);
}

// Parallel coordinates, with an axis a row: each random scene is a line from the first axis to the last.
const ROWS = 8; // more are too many to read

function parallel(plot, axes) {
  const y = (row) => 22 + 38 * row;
  const height = y(axes.length - 1) + 22;
  const shown = plot.points.filter(([, random]) => random).sort((a, b) => a[0] - b[0]);
  const bad = shown.filter(([failed]) => failed).length;
  const names = axes.map((axis) => axis.name).join(", ");
  const picture = svg("svg", { viewBox: `0 0 ${WIDE} ${height}`, role: "img", "aria-label": `${bad} of ${shown.length} random scenes that fail, by ${names}` });
  const rows = axes.map((axis) => [axis, scale(axis, BOX.left, WIDE - BOX.right), plot.axes.indexOf(axis)]);
  rows.forEach(([axis, x], row) => {
    picture.append(svg("line", { class: "frame", x1: BOX.left, x2: WIDE - BOX.right, y1: y(row), y2: y(row) }));
    for (const [low, high] of axis.bands) {
      const [left, right] = [x(low), x(high)].sort((a, b) => a - b);
      picture.append(svg("rect", { class: "fails", x: left, y: y(row) - 5, width: Math.max(right - left, 1), height: 10 }));
    }
  });
  for (const [failed, , , ...values] of shown) {
    const corners = rows.map(([, x, index], row) => (values[index] === null ? null : `${x(values[index])},${y(row)}`));
    const points = corners.filter(Boolean).join(" ");
    picture.append(svg("polyline", { class: failed ? "scene bad" : "scene", points }));
  }
  rows.forEach(([axis], row) => {
    const ends = axis.options.length ? [0, axis.options.length - 1] : [axis.low, axis.high];
    const name = axis.name.length > 32 ? `${axis.name.slice(0, 31)}…` : axis.name;
    picture.append(svg("text", { x: BOX.left, y: y(row) - 7 }, `${name}: ${ends.map((end) => written(axis, end)).join(" to ")}`));
  });
  const nearest = (middle) => rows[Math.min(Math.max(Math.round((middle - 22) / 38), 0), rows.length - 1)];
  brush(picture, height, (left, right, top, bottom) => {
    const [axis, x] = nearest((top + bottom) / 2);
    ranged(axis, x.back(left), x.back(right));
  }, true);
  return picture;
}

function open(id) {
  const card = document.getElementById(id);
  card.hidden = false;
  const root = card.querySelector(".player");
  if (root && !matchMedia("(prefers-reduced-motion: reduce)").matches) setTimeout(() => root.toggle(), 300);
}

// A drag over a plot chooses a range of its axis, or of both.
function brush(picture, height, choose, both = false) {
  let start = null;
  const area = svg("rect", { class: "brush", visibility: "hidden" });
  const place = (event) => {
    const box = picture.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * WIDE;
    const y = ((event.clientY - box.top) / box.height) * height;
    return [Math.min(Math.max(x, BOX.left), WIDE - BOX.right), Math.min(Math.max(y, BOX.top), height - BOX.bottom)];
  };
  const corners = (event) => {
    const [x, y] = place(event);
    const rows = both ? [Math.min(y, start[1]), Math.max(y, start[1])] : [BOX.top, height - BOX.bottom];
    return [Math.min(x, start[0]), Math.max(x, start[0]), ...rows];
  };
  picture.append(area);
  picture.addEventListener("pointerdown", (event) => {
    if (form && !event.target.closest("a") && event.pointerType !== "touch") start = place(event);
  });
  picture.addEventListener("pointermove", (event) => {
    if (!start) return;
    const [left, right, top, bottom] = corners(event);
    const size = { x: left, y: top, width: right - left, height: bottom - top, visibility: "visible" };
    for (const [name, value] of Object.entries(size)) area.setAttribute(name, value);
  });
  addEventListener("pointerup", (event) => {
    if (!start) return;
    const [left, right, top, bottom] = corners(event);
    start = null;
    area.setAttribute("visibility", "hidden");
    if (right - left < 6) return;
    choose(left, right, top, bottom);
    remember();
  });
}

function pick(axes, chosen, label, change) {
  const select = html("select", { "aria-label": label });
  for (const axis of axes) select.append(html("option", { value: axis.id }, axis.name));
  select.value = chosen.id;
  select.addEventListener("change", () => change(axes.find((axis) => axis.id === select.value)));
  return select;
}

// How much the failure rate changes along an axis: which of an operator's quantities is shown first.
const matters = (axis) => {
  const rates = [...axis.curve.map(([, [rate]]) => rate), ...axis.bars.filter(({ of }) => of).map(({ count, of }) => count / of)];
  return (axis.bands.length ? 10 : 0) + (rates.length ? Math.max(...rates) - Math.min(...rates) : 0);
};

const plots = told("plots") || [];
const axes = new Map(plots.flatMap((plot) => plot.axes.map((axis) => [axis.id, axis])));

function draw(root) {
  const plot = plots[root.dataset.plot];
  if (plots.length > 1) root.append(html("h3", { class: "of" }, plot.title));
  if (plot.random < plot.enough) {
    const few = plot.random === 1 ? "There is 1 random scene" : `There are ${plot.random} random scenes`;
    root.append(html("p", { class: "warn" }, `${few}: too few for curves that mean much, which are hatched. From ${plot.enough} on they are drawn in full.`));
  }
  const panel = (title, picture, wide = false) => {
    const element = html("section", { class: wide ? "plot wide" : "plot" }, html("h3", {}, ...title), picture);
    root.append(element);
    return element;
  };
  const swap = (element, picture) => element.querySelector("svg").replaceWith(picture);
  const numbers = [...plot.axes].sort((a, b) => matters(b) - matters(a));
  for (const map of plot.maps) {
    const [across, along] = [map.across, map.along].map((id) => plot.axes.find((axis) => axis.id === id));
    panel([map.title], scatter(plot, across, along, map), true);
  }
  if (numbers.length > 1) {
    let [x, y] = numbers;
    const redraw = () => swap(slice, scatter(plot, x, y));
    const title = [
      pick(plot.axes, y, "Vertical axis", (axis) => ((y = axis), redraw())),
      "by",
      pick(plot.axes, x, "Horizontal axis", (axis) => ((x = axis), redraw())),
    ];
    const slice = panel(title, scatter(plot, x, y), true);
    slice.append(html("p", { class: "says" }, "Red: fails. Ring: passes. Pale: chosen by the search. Outlined: has a card below or above, which a click opens."));
  }
  if (numbers.length > 2 && plot.random) {
    const shown = panel(["Random scenes, a line each"], parallel(plot, numbers.slice(0, ROWS)), true);
    shown.append(html("p", { class: "says" }, "Red: fails. Blue: passes. Where red lines meet on an axis, its value matters; those along which the failure rate changes most come first."));
  }
  const operators = Map.groupBy ? Map.groupBy(numbers, (axis) => axis.operator) : grouped(numbers);
  for (const several of operators.values()) {
    const change = (axis) => swap(element, curve(plot, axis));
    const title = several.length > 1 ? pick(several, several[0], "Quantity", change) : several[0].name;
    const element = panel([title], curve(plot, several[0]));
  }
}
function grouped(list) {
  const groups = new Map();
  for (const axis of list) groups.set(axis.operator, [...(groups.get(axis.operator) || []), axis]);
  return groups;
}

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

document.body.prepend(
  svg("svg", { width: 0, height: 0, "aria-hidden": "true", style: "position:absolute" },
    svg("pattern", { id: "hatch", width: 6, height: 6, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
      svg("line", { class: "hatched", x1: 0, x2: 0, y1: 0, y2: 6 }))),
);
all(".plots").forEach(draw);
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
