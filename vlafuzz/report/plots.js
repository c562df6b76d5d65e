"use strict";
// Where a policy fails. Observable Plot draws (`Plot`, in plot.min.js); the numbers come from the page.
const WIDE = 340;
const MARGINS = { marginTop: 10, marginRight: 12, marginBottom: 26, marginLeft: 46 };
const ROWS = 8; // axes of the lines: more are too many to read
const CELLS = 24; // of a map, across
const percent = (share) => `${Math.round(100 * share)}%`;
const cut = (text, most) => (text.length > most ? `${text.slice(0, most - 1)}…` : text);
const written = (axis, value) => {
  const short = String(Number(value.toPrecision(3)));
  return axis.options.length ? axis.options[value] : axis.unit === "×" ? `× ${short}` : short + axis.unit;
};
const said = (axis) => axis.bands.map(([low, high]) => `fails from ${written(axis, low)} to ${written(axis, high)}`).join(", ");
const ends = ({ options, low, high }) => (options.length ? [-0.5, options.length - 0.5] : [low, high]);

// Options are at their indices. Labels are a channel, since of a logarithmic scale Plot drops some formatted ones.
const scale = (axis) => ({ type: axis.log ? "log" : "linear", domain: ends(axis), label: null });
const labels = (mark, axis, tickRotate = 0) => {
  const options = axis.options.map((_, index) => index);
  const steps = axis.high / axis.low > 25 ? [0.01, 0.05, 0.2, 1, 5, 20, 100] : [0.25, 0.5, 1, 2, 4];
  const powers = steps.filter((value) => value >= axis.low && value <= axis.high);
  const ticks = options.length ? options : axis.log ? powers : 4;
  return mark({ ticks, text: (value) => cut(written(axis, value), 12), tickRotate: options.length ? tickRotate : 0 });
};
const edges = (axis) => axis.bands.map(([low, high]) => (Math.abs(low - axis.nominal) < Math.abs(high - axis.nominal) ? low : high));
const usual = (axis) => (axis.options.length || axis.nominal < axis.low || axis.nominal > axis.high ? [] : [axis.nominal]);

function drawn(label, role, options) {
  const picture = Plot.plot({ width: WIDE, ...MARGINS, style: { fontSize: "11px" }, ariaLabel: label, ...options });
  picture.setAttribute("role", role);
  for (const part of all("[aria-label]", picture)) part.removeAttribute("aria-label"); // the kind of a mark
  return picture;
}

// A drag over a plot chooses ranges of its axes. What lies above can still be pointed at.
function brushed(picture, kind, extent, choose) {
  if (!form) return;
  const brush = kind().extent(extent).touchable(false); // a finger scrolls
  const area = Plot.select(picture).insert("g", "g.above").attr("class", "brush").call(brush);
  brush.on("end", ({ selection }) => {
    if (!selection) return;
    choose(selection);
    area.call(brush.clear);
    remember();
  });
}
const box = ({ height, marginTop, marginBottom, marginLeft, width = WIDE }) => [
  [marginLeft, marginTop],
  [width - MARGINS.marginRight, height - marginBottom],
];

// The failure rate along an axis: a curve with its 95 % band, or a bar for each option.
function curve(plot, axis) {
  const rates = axis.curve.filter((_, index) => index % 10 === 0).map(([place, [rate]]) => `${written(axis, place)}: ${percent(rate)}`);
  const bars = axis.bars.map((bar, index) => ({ ...bar, index, title: `${axis.options[index]}: ${bar.count} of ${bar.of}` }));
  const found = [...rates, ...bars.map(({ title }) => title)].join(", ") || "no random scenes";
  const size = { ...MARGINS, height: axis.options.length ? 180 : 150, marginBottom: axis.options.length ? 62 : 26 };
  const place = { x: "0", y: ([, [rate]]) => rate };
  const told = ([place, [rate, low, high]]) => `${written(axis, place)}: ${percent(rate)} (${percent(low)} to ${percent(high)})`;
  const picture = drawn(`Failure rate by ${axis.name}. ${found}. ${said(axis)}`, "img", {
    ...size,
    x: scale(axis),
    y: { domain: [0, 1], ticks: [0, 0.5, 1], tickFormat: percent, label: null },
    marks: [
      labels(Plot.axisX, axis, -35),
      Plot.frame({ className: "frame" }),
      Plot.ruleY([0.5], { className: "grid" }),
      Plot.rect(axis.bands, { x1: "0", x2: "1", title: "2", className: "fails" }),
      Plot.areaY(axis.curve, { x: "0", y1: ([, [, low]]) => low, y2: ([, [, , high]]) => high, className: axis.id && plot.random < plot.enough ? "few" : "band" }),
      Plot.ruleX(edges(axis), { className: "edge" }),
      Plot.ruleX(usual(axis), { className: "usual" }),
      Plot.lineY(axis.curve, { ...place, className: "curve" }),
      Plot.rect(bars.filter(({ of }) => of), { x1: ({ index }) => index - 0.3, x2: ({ index }) => index + 0.3, y1: 0, y2: ({ count, of }) => count / of, title: "title", className: "bar" }),
      Plot.ruleX(bars.filter(({ of }) => of), { x: "index", y1: "low", y2: "high", className: "whisker" }),
      Plot.tip(axis.curve, Plot.pointerX({ ...place, title: told, className: "tip" })),
    ],
  });
  const x = picture.scale("x");
  if (axis.id) brushed(picture, Plot.brushX, box(size), ([left, right]) => ranged(axis, x.invert(left), x.invert(right)));
  return picture;
}

// The ground of a map: how often random scenes fail near each place, from blue (never) to red; bare where there are hardly any.
function ground(shown, xAxis, yAxis, rows) {
  const share = ({ low, high }, value) => (value - low) / (high - low);
  const value = ({ low, high }, share) => low + share * (high - low);
  const random = shown.filter((scene) => scene.random).map(({ failed, x, y }) => [failed, share(xAxis, x), share(yAxis, y)]);
  return Array.from({ length: CELLS * rows }, (_, cell) => {
    const [column, row] = [cell % CELLS, Math.floor(cell / CELLS)];
    let [of, bad] = [0, 0];
    for (const [failed, across, along] of random) {
      // The window has a standard deviation of an eighth of each range: of 50 scenes it holds about five.
      const weight = Math.exp(-32 * ((across - (column + 0.5) / CELLS) ** 2 + (along - (row + 0.5) / rows) ** 2));
      of += weight;
      bad += weight * failed;
    }
    const [x1, x2] = [column, column + 1].map((edge) => value(xAxis, edge / CELLS));
    const [y1, y2] = [row, row + 1].map((edge) => value(yAxis, edge / rows));
    return { x1, x2, y1, y2, of, fill: `color-mix(in srgb, var(--fails) ${Math.round((100 * bad) / of)}%, var(--passes))` };
  }).filter(({ of }) => of > 2);
}

// Scenes by two quantities, with the regions of certified causes; or a map of them.
function scatter(plot, xAxis, yAxis, map = null) {
  const [across, along] = [xAxis, yAxis].map((axis) => plot.axes.indexOf(axis) + 3);
  const jitter = (axis, number) => (axis.options.length ? ((number * 0.618) % 1) * 0.6 - 0.3 : 0);
  const shown = plot.points
    .filter((point) => point[across] !== null && point[along] !== null)
    .sort(([one], [other]) => one - other)
    .map(([failed, random, card, ...values], number) => ({
      failed,
      random,
      card: document.getElementById(card) && card,
      x: values[across - 3] + jitter(xAxis, number),
      y: values[along - 3] + jitter(yAxis, number),
      says: `${failed ? "fails" : "passes"}: ${xAxis.name} ${written(xAxis, values[across - 3])}, ${yAxis.name} ${written(yAxis, values[along - 3])}`,
    }));
  // A cause has a band on each of its axes, and takes all of the others.
  const causes = new Set([...xAxis.bands, ...yAxis.bands].map(([, , title]) => title));
  const regions = [...causes].flatMap((title) => {
    const [columns, rows] = [xAxis, yAxis].map((axis) => {
      const bands = axis.bands.filter((band) => band[2] === title);
      return bands.length ? bands : [ends(axis)];
    });
    return columns.flatMap(([x1, x2]) => rows.map(([y1, y2]) => ({ x1, x2, y1, y2, title })));
  });
  const corners = { x1: "x1", x2: "x2", y1: "y1", y2: "y2" };
  const rated = map && plot.random >= plot.enough;
  const shape = map ? (yAxis.high - yAxis.low) / (xAxis.high - xAxis.low || 1) : 0.85; // of a map, so that a metre is a metre
  const size = { ...MARGINS, marginLeft: yAxis.options.length ? 84 : 46, marginBottom: xAxis.options.length ? 62 : 26 };
  size.height = Math.round(Math.min(Math.max(282 * shape, 120), 420)) + size.marginTop + size.marginBottom;
  const bad = shown.filter(({ failed }) => failed).length;
  const picture = drawn(`${bad} of ${shown.length} scenes that fail, by ${xAxis.name} and ${yAxis.name}. ${said(xAxis)} ${said(yAxis)}`, "group", {
    ...size,
    x: { ...scale(xAxis), reverse: map?.mirrored },
    y: { ...scale(yAxis), insetBottom: map?.below ? 16 : 0 },
    color: { type: "identity" },
    marks: [
      labels(Plot.axisX, xAxis, -35),
      labels(Plot.axisY, yAxis),
      Plot.frame({ className: "frame" }),
      rated ? Plot.rect(ground(shown, xAxis, yAxis, Math.ceil(CELLS * shape)), { ...corners, fill: "fill", className: "ground" }) : null,
      Plot.rect(regions, { ...corners, title: "title", className: rated ? "outlined" : "fails" }),
      Plot.ruleX(usual(xAxis), { className: "usual" }),
      map?.below ? Plot.text([`▼ ${map.below}`], { frameAnchor: "bottom", dy: -4 }) : null,
      Plot.dot(shown, {
        x: "x",
        y: "y",
        r: ({ card }) => (card ? 5 : 3.2),
        fill: ({ failed }) => (failed ? "var(--fails)" : "none"),
        stroke: ({ failed, card }) => (card ? "var(--ink)" : failed ? "var(--panel)" : "var(--passes)"),
        opacity: ({ random }) => (random ? 1 : 0.55),
        title: ({ says, card }) => says + (card ? "; opens its card" : ""),
        href: ({ card }) => card && `#${card}`,
        sort: null, // failures stay above
        className: "above",
      }),
    ],
    r: { type: "identity" },
    opacity: { type: "identity" },
  });
  const [x, y] = ["x", "y"].map((name) => picture.scale(name));
  brushed(picture, Plot.brush, box(size), ([[left, top], [right, bottom]]) => {
    ranged(xAxis, x.invert(left), x.invert(right));
    ranged(yAxis, y.invert(top), y.invert(bottom));
  });
  for (const link of all("a", picture)) linked(link, document.getElementById(link.href.baseVal.slice(1)));
  return picture;
}

// A dot opens its card, whose picture is beside it as long as it is pointed at or has the focus.
function linked(link, card) {
  const shown = card.querySelector(".fails video") || card.querySelector("video");
  const source = shown?.poster;
  const picture = html("img", { class: "preview", alt: "" });
  const show = () => {
    if (!source) return;
    picture.src = source;
    const dot = link.getBoundingClientRect();
    const right = dot.right + 168 > document.documentElement.clientWidth;
    picture.style.left = `${scrollX + (right ? dot.left - 168 : dot.right + 8)}px`;
    picture.style.top = `${scrollY + Math.max(dot.top - 80, 0)}px`;
    document.body.append(picture);
  };
  for (const event of ["pointerenter", "focus"]) link.addEventListener(event, show);
  for (const event of ["pointerleave", "blur", "click"]) link.addEventListener(event, () => picture.remove());
  link.addEventListener("click", () => {
    card.hidden = false;
    const films = card.querySelector(".player");
    if (films && !matchMedia("(prefers-reduced-motion: reduce)").matches) setTimeout(films.toggle, 300);
  });
}

// Parallel coordinates, an axis a row: each random scene is a line from the first axis to the last.
function parallel(plot, axes, width) {
  const shown = plot.points.filter(([, random]) => random).sort(([one], [other]) => one - other);
  const bad = shown.filter(([failed]) => failed).length;
  const narrow = width === WIDE; // names stand above the axes, not beside them
  const size = { ...MARGINS, width, height: (narrow ? 44 : 38) * axes.length + 10, marginLeft: narrow ? 10 : 0.36 * width, marginTop: 24, marginBottom: 24 };
  const flat = ({ log }, value) => (log ? Math.log(value) : value);
  const share = (axis, value) => (flat(axis, value) - flat(axis, ends(axis)[0])) / (flat(axis, ends(axis)[1]) - flat(axis, ends(axis)[0]));
  const corners = shown.flatMap(([failed, , , ...values], scene) =>
    axes.map((axis, row) => ({ failed, scene, row, value: values[plot.axes.indexOf(axis)], axis })).filter(({ value }) => value !== null),
  );
  const bands = axes.flatMap((axis, row) => axis.bands.map(([low, high, title]) => ({ row, title, low: share(axis, low), high: share(axis, high) })));
  const beside = { y: (_, row) => row, dx: narrow ? 0 : -8 };
  const limits = ({ options, low, high, ...axis }) => (options.length ? [options[0], options.at(-1)] : [low, high].map((end) => written({ options, ...axis }, end)));
  const picture = drawn(`${bad} of ${shown.length} random scenes that fail, by ${axes.map(({ name }) => name).join(", ")}`, "img", {
    ...size,
    x: { domain: [0, 1], axis: null },
    y: { domain: [axes.length - 1, 0], axis: null },
    color: { type: "identity" },
    marks: [
      Plot.ruleY(axes.keys(), { className: "frame" }),
      Plot.rect(bands, { x1: "low", x2: "high", y1: ({ row }) => row - 0.15, y2: ({ row }) => row + 0.15, title: "title", className: "fails" }),
      Plot.line(corners, {
        x: ({ axis, value }) => share(axis, value),
        y: "row",
        z: "scene",
        stroke: ({ failed }) => (failed ? "var(--fails)" : "var(--passes)"),
        strokeOpacity: 0.6,
        strokeWidth: 1,
      }),
      Plot.text(axes, { ...beside, x: 0, dy: narrow ? -12 : -6, textAnchor: narrow ? "start" : "end", text: ({ name }) => cut(name, narrow ? 34 : 38), className: "name" }),
      Plot.text(axes, { ...beside, x: narrow ? 1 : 0, dy: narrow ? -12 : 7, textAnchor: "end", text: (axis) => limits(axis).map((end) => cut(end, 17)).join(" to "), className: "limits" }),
    ],
  });
  const [x, y] = ["x", "y"].map((name) => picture.scale(name));
  axes.forEach((axis, row) => {
    const [low, high] = ends(axis).map((end) => flat(axis, end));
    const value = (pixel) => (axis.log ? Math.exp : Number)(low + x.invert(pixel) * (high - low));
    const extent = [[x.apply(0), y.apply(row) - 14], [x.apply(1), y.apply(row) + 14]];
    brushed(picture, Plot.brushX, extent, ([left, right]) => ranged(axis, value(left), value(right)));
  });
  return picture;
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

function draw(root) {
  const plot = plots[root.dataset.plot];
  if (plots.length > 1) root.append(html("h3", { class: "of" }, plot.title));
  if (plot.random && plot.random < plot.enough) {
    const few = plot.random === 1 ? "There is 1 random scene" : `There are ${plot.random} random scenes`;
    root.append(html("p", { class: "warn" }, `${few}: too few for curves that mean much, which are hatched. From ${plot.enough} on they are drawn in full.`));
  }
  const panel = (title, picture, kind = "plot", says = "") => {
    const element = html("section", { class: kind }, html("h3", {}, ...title), picture, ...(says ? [html("p", { class: "says" }, says)] : []));
    root.append(element);
    return (other) => element.querySelector("svg").replaceWith(other);
  };
  if (plot.severity) panel([plot.severity.name], curve(plot, plot.severity));
  const sorted = [...plot.axes].sort((a, b) => matters(b) - matters(a));
  for (const map of plot.maps) {
    const [across, along] = [map.across, map.along].map((id) => plot.axes.find((axis) => axis.id === id));
    const says = "Ground: how often random scenes fail near there, blue (never) to red (always). Frames: ranges of causes.";
    panel([map.title], scatter(plot, across, along, map), "plot tall", plot.random < plot.enough ? "" : says);
  }
  let [x, y] = sorted;
  if (y) {
    const title = [
      pick(plot.axes, y, "Vertical axis", (axis) => swap(scatter(plot, x, (y = axis)))),
      "by",
      pick(plot.axes, x, "Horizontal axis", (axis) => swap(scatter(plot, (x = axis), y))),
    ];
    const says = "Red: fails. Ring: passes. Pale: chosen by the search. Outlined: has a card below or above, which a click opens.";
    const swap = panel(title, scatter(plot, x, y), "plot tall", says);
  }
  if (sorted.length > 2 && plot.random) {
    const width = root.clientWidth > 640 ? 2 * WIDE : WIDE;
    const says = "Red: fails. Blue: passes. Where red lines meet on an axis, its value matters; those along which the failure rate changes most come first.";
    panel(["Random scenes, a line each"], parallel(plot, sorted.slice(0, ROWS), width), "plot tall broad", says);
  }
  for (const several of plot.random ? Plot.group(sorted, (axis) => axis.operator).values() : []) {
    const title = several.length > 1 ? pick(several, several[0], "Quantity", (axis) => swap(curve(plot, axis))) : several[0].name;
    const swap = panel([title], curve(plot, several[0]));
  }
}
all(".plots").forEach(draw);
