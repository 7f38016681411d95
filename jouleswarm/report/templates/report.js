"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const COLOURS = ["#E69F00", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#8C6D31", "#7F7F7F", "#999933"];
const HATCHES = ["", "M0 4L4 0", "M0 2H4", "M2 0V4", "M0 0L4 4", "M0 2H4M2 0V4", "M0 4L4 0M0 0L4 4", "M1 1h1", "M0 1H4M0 3H4"];
const state = { at: {}, hidden: new Set(), isLog: false };

function node(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function joules(value) {
  if (value === null || value === undefined) return "-";
  const [unit, of] = value >= 1e6 ? ["MJ", 1e6] : value >= 1e3 ? ["kJ", 1e3] : ["J", 1];
  return `${Number((value / of).toPrecision(4))} ${unit}`;
}

/* Equations (8)-(12), as energy/literal.py has them: counts and constants in, joules by cause and site out. */
function price(counts, e, beta) {
  const moved = (bytes, bitPerJ) => (bytes * 8) / bitPerJ;
  const down = e.dl_bit_per_j === null ? e.ul_bit_per_j : e.dl_bit_per_j;
  const center = counts.gradients_support + beta * counts.gradients_query;
  const direct = e.sidelink === "direct";
  const sideRobots = direct ? moved(counts.sidelink_bytes, e.sl_bit_per_j) : moved(counts.sidelink_sent_bytes, e.ul_bit_per_j);
  const gamma = e.base_station_pue === null ? e.pue : e.base_station_pue;
  const sideCenter = direct ? 0 : gamma * moved(counts.sidelink_bytes, down);
  const causes = {
    computing_datacenter: e.pue * center * e.p0_w * e.t0_batch_s,
    computing_robots: counts.gradients_robots * e.pk_w * e.tk_batch_s,
    uplink: moved(counts.uplink_bytes, e.ul_bit_per_j),
    downlink: moved(counts.downlink_bytes, down),
    sidelink: sideRobots + sideCenter,
    acting: counts.motions * e.motion_j,
    evaluating: counts.evaluation_motions * (e.motion_j + e.forward_j),
  };
  const atCenter = causes.computing_datacenter + causes.downlink + sideCenter;
  const total = Object.values(causes).reduce((sum, each) => sum + each, 0);
  const grams = (spent, perKwh) => (perKwh === null ? null : (spent / 3.6e6) * perKwh);
  const sites = [grams(atCenter, e.datacenter_g_per_kwh), grams(total - atCenter, e.robots_g_per_kwh)];
  return { causes, total, grams: sites.includes(null) ? null : sites[0] + sites[1] };
}

function valueOf(slider) {
  const own = data.constants[slider.key], at = state.at[slider.key];
  if (at === undefined) return own;
  return slider.is_factor ? Number((own * 10 ** at).toPrecision(4)) : at;
}

function bills() {
  const e = { ...data.constants };
  for (const slider of data.sliders) e[slider.key] = valueOf(slider);
  return data.arms.map((arm) => ({
    arm,
    ...(arm.counts ? price(arm.counts, e, arm.beta) : { causes: arm.causes, total: arm.total, grams: null }),
  }));
}

/* What the comparison is at the prices of the moment; of arms that may not be compared joules alone. */
function sentence(found) {
  const isMoved = Object.keys(state.at).length > 0;
  const plain = found.find((each) => each.arm.arm === data.plain);
  const others = found.filter((each) => data.compared.includes(each.arm.arm));
  const grams = (each) => (each.grams === null ? "" : `, ${Number(each.grams.toPrecision(3))} gCO2e`);
  const told = plain && plain.total && others.length
    ? others.slice(0, 3).map((each) => {
      const factor = each.total / plain.total;
      const way = factor >= 1 ? `costs ${Number(factor.toPrecision(2))} times` : `saves a factor of ${Number((1 / factor).toPrecision(2))} over`;
      return `${each.arm.short} ${way} ${plain.arm.short}: ${joules(each.total)}${grams(each)} against ${joules(plain.total)}${grams(plain)}`;
    })
    : found.slice(0, 3).map((each) => `${each.arm.short} ${joules(each.total)}${grams(each)}`);
  return isMoved ? `At these prices: ${told.join("; ")}` : "Energy of each arm by cause";
}

function scale(top, bottom, width, isLog) {
  if (!isLog) return (value) => (top ? (value / top) * width : 0);
  const low = Math.log10(bottom), high = Math.log10(top);
  return (value) => ((Math.log10(Math.max(value, bottom)) - low) / (high - low || 1)) * width;
}

function ticks(top, bottom, isLog) {
  if (isLog) {
    const found = [];
    const step = Math.ceil((Math.log10(top) - Math.log10(bottom)) / 6);
    for (let power = Math.ceil(Math.log10(bottom)); power <= Math.log10(top); power += step) found.push(10 ** power);
    return found;
  }
  const rough = top / 4, size = 10 ** Math.floor(Math.log10(rough || 1));
  const step = [1, 2, 5, 10].map((each) => each * size).find((each) => each >= rough) || 1;
  const found = [];
  for (let value = 0; value <= top; value += step) found.push(value);
  return found;
}

function patterns(svg) {
  const defs = svg.appendChild(node("defs", {}));
  COLOURS.forEach((colour, place) => {
    const made = defs.appendChild(node("pattern", { id: `cause-${place}`, width: 4, height: 4, patternUnits: "userSpaceOnUse" }));
    made.append(node("rect", { width: 4, height: 4, fill: colour }), node("path", { d: HATCHES[place], stroke: "#fff", "stroke-width": 0.8, fill: "none" }));
  });
}

function drawBars() {
  const all = bills(), found = all.filter((each) => !state.hidden.has(each.arm.arm) && each.total !== null);
  byId("now").textContent = sentence(all);
  byId("now").dataset.totals = JSON.stringify(Object.fromEntries(all.map((each) => [each.arm.arm, each.total])));
  const box = byId("bars"), width = Math.max(box.clientWidth, 240), high = 46, room = 8;
  const svg = node("svg", { viewBox: `0 0 ${width} ${found.length * high + 30}`, role: "img", "aria-label": "energy by cause and arm" });
  patterns(svg);
  const parts = found.flatMap((each) => Object.values(each.causes)).filter((value) => value > 0);
  const top = Math.max(...found.map((each) => each.total), 1e-9), least = Math.min(...parts, top);
  const bottom = 10 ** Math.floor(Math.log10(least)), inside = width - room - 24;
  const x = scale(top, bottom, inside, state.isLog);
  for (const tick of ticks(top, bottom, state.isLog)) {
    const at = room + x(tick);
    svg.append(node("line", { x1: at, x2: at, y1: 0, y2: found.length * high + 6, class: "axis" }));
    svg.append(node("text", { x: at, y: found.length * high + 20, "text-anchor": "middle" }, tick === 0 ? "0" : joules(tick)));
  }
  found.forEach((each, row) => {
    const y = row * high;
    svg.append(node("text", { x: room, y: y + 14 }, `${each.arm.name}: ${joules(each.total)}`));
    let start = 0;
    data.causes.forEach((cause, place) => {
      const value = each.causes[cause.key] || 0;
      if (!value) return;
      const share = Math.round((100 * value) / each.total);
      const tip = `${each.arm.name}, ${cause.label}: ${joules(value)} (${share}%)`;
      const [from, wide] = state.isLog ? [x(value) - 3, 6] : [x(start), Math.max(x(value), 0.5)];
      const bar = node("rect", { x: room + from, y: y + 19, width: wide, height: 20, fill: `url(#cause-${place})`, stroke: "var(--card)", "stroke-width": 0.5, "data-tip": tip });
      bar.append(node("title", {}, tip));
      svg.append(bar);
      start += value;
    });
  });
  box.replaceChildren(svg);
}

function legend() {
  const used = data.causes.map((cause, place) => [cause, place]).filter(([cause]) => bills().some((each) => each.causes[cause.key]));
  byId("causes").replaceChildren(...used.map(([cause, place]) => {
    const entry = document.createElement("span"), key = document.createElement("span");
    key.className = "key";
    const svg = key.appendChild(node("svg", { viewBox: "0 0 12 12" }));
    svg.append(node("rect", { width: 12, height: 12, fill: `url(#cause-${place})` }));
    entry.append(key, cause.label);
    return entry;
  }));
}

function drawRewards() {
  const box = byId("rewards");
  const panels = Object.entries(data.rewards).map(([task, curves]) => panel(task, curves));
  box.replaceChildren(...panels);
}

function panel(task, curves) {
  const width = 300, height = 150, left = 34, down = 20;
  const shown = data.arms.filter((arm) => !state.hidden.has(arm.arm) && curves[arm.arm]);
  const points = Object.values(curves).flat(), values = [...points.map((each) => each[1]), data.target];
  const last = Math.max(...points.map((each) => each[0]), 1), low = Math.min(...values), high = Math.max(...values);
  const x = (round) => left + (round / last) * (width - left - 8);
  const y = (value) => 18 + (1 - (value - low) / (high - low || 1)) * (height - 18 - down);
  const svg = node("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `R of task ${task} by round` });
  svg.append(node("text", { x: left, y: 11 }, `task ${task}`));
  const labelled = [low, high].filter((value) => Math.abs(y(value) - y(data.target)) > 10);
  for (const value of [...labelled, data.target]) svg.append(node("text", { x: left - 4, y: y(value) + 4, "text-anchor": "end" }, Math.round(value)));
  svg.append(node("line", { x1: left, x2: width - 8, y1: y(data.target), y2: y(data.target), class: "target" }));
  svg.append(node("line", { x1: left, x2: width - 8, y1: height - down + 2, y2: height - down + 2, class: "axis" }));
  svg.append(node("text", { x: left, y: height - 5 }, "0"), node("text", { x: width - 8, y: height - 5, "text-anchor": "end" }, `round ${last}`));
  for (const arm of shown) {
    const way = curves[arm.arm].map(([round, value]) => `${x(round).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
    svg.append(node("polyline", { points: way, fill: "none", stroke: arm.colour, "stroke-width": 2, "stroke-dasharray": arm.dash }));
    const [end, worth] = curves[arm.arm].at(-1);
    svg.append(node("circle", { cx: x(end), cy: y(worth), r: 3, fill: arm.colour }));
  }
  const cursor = svg.appendChild(node("line", { y1: 16, y2: height - down, class: "axis", visibility: "hidden" }));
  svg.addEventListener("pointermove", (event) => {
    const frame = svg.getBoundingClientRect(), at = ((event.clientX - frame.left) / frame.width) * width;
    const round = Math.min(last, Math.max(0, Math.round(((at - left) / (width - left - 8)) * last)));
    cursor.setAttribute("x1", x(round));
    cursor.setAttribute("x2", x(round));
    cursor.setAttribute("visibility", "visible");
    const told = shown.map((arm) => [arm, curves[arm.arm].find((each) => each[0] === round)]).filter((each) => each[1]);
    byId("round").textContent = `task ${task}, round ${round}: ${told.map(([arm, each]) => `${arm.short} R ${each[1]}`).join(", ") || "nobody learns any more"}`;
  });
  return svg;
}

function drawArms() {
  byId("arms").replaceChildren(...data.arms.map((arm) => {
    const button = document.createElement("button"), key = document.createElement("span");
    key.className = "key";
    key.style.background = arm.colour;
    button.append(key, arm.name);
    button.dataset.arm = arm.arm;
    button.setAttribute("aria-pressed", String(!state.hidden.has(arm.arm)));
    button.addEventListener("click", () => {
      if (!state.hidden.delete(arm.arm)) state.hidden.add(arm.arm);
      draw();
    });
    return button;
  }));
  for (const walk of document.querySelectorAll("svg.map g[data-arm]")) {
    walk.style.display = state.hidden.has(walk.dataset.arm) ? "none" : "";
  }
}

function drawSliders() {
  byId("sliders").replaceChildren(...data.sliders.map((slider) => {
    const label = document.createElement("label"), told = document.createElement("b"), input = document.createElement("input");
    const own = data.constants[slider.key];
    const tell = () => {
      const value = valueOf(slider);
      told.textContent = value === null ? "not known" : `${Number((value / slider.per_unit).toPrecision(4))} ${slider.unit}`;
    };
    Object.assign(input, { type: "range", min: slider.is_factor ? -1 : 0, max: slider.is_factor ? 1 : 1000, step: slider.is_factor ? 0.05 : 10 });
    input.value = slider.is_factor ? 0 : own || 0;
    input.dataset.key = slider.key;
    input.addEventListener("input", () => {
      state.at[slider.key] = Number(input.value);
      tell();
      drawBars();
    });
    tell();
    const name = document.createElement("span");
    name.textContent = `${slider.name}, ${slider.meaning}`;
    label.append(name, told, input);
    return label;
  }));
}

function draw() {
  drawArms();
  drawBars();
  drawRewards();
}

function press(isLog) {
  state.isLog = isLog;
  byId("log").setAttribute("aria-pressed", String(isLog));
  byId("linear").setAttribute("aria-pressed", String(!isLog));
  drawBars();
}

byId("bill").hidden = !data.arms.some((arm) => arm.total !== null);
byId("prices").hidden = data.sliders.length === 0;
byId("learning").hidden = !Object.values(data.rewards).some((curves) => Object.keys(curves).length);
byId("log").addEventListener("click", () => press(true));
byId("linear").addEventListener("click", () => press(false));
byId("reset").addEventListener("click", () => {
  state.at = {};
  drawSliders();
  drawBars();
});
for (const kind of ["pointerover", "pointerdown"]) {
  byId("bars").addEventListener(kind, (event) => {
    if (event.target.dataset.tip) byId("said").textContent = event.target.dataset.tip;
  });
}
window.addEventListener("resize", drawBars);
drawSliders();
draw();
legend();
