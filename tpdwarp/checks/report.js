"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);
const rows = [...document.querySelectorAll(".frames .row")];
const state = { index: 0, group: "beauty", stops: 0, split: 50, filter: "all", pictures: null, codes: {}, turn: 0 };

function visible(index) {
  const status = data.frames[index].status;
  return state.filter === "all" || status === "failed" || (state.filter === "noted" && status === "warned");
}

function filterBy(name) {
  state.filter = name;
  document.querySelectorAll("[data-filter]").forEach((button) =>
    button.setAttribute("aria-pressed", String(button.dataset.filter === name)));
  rows.forEach((row, index) => { row.parentElement.hidden = !visible(index); });
  if (!visible(state.index)) step(1, visible) || step(-1, visible);
}

function step(direction, wanted) {
  for (let index = state.index + direction; index >= 0 && index < data.frames.length; index += direction) {
    if (wanted(index)) {
      select(index);
      return true;
    }
  }
  return false;
}

function groupsOf(pictures) {
  return pictures ? Object.keys(pictures.sources).filter((name) => name.endsWith(".b")).map((name) => name.slice(0, -2)) : [];
}

function reveal(row) {
  // Scrolls the list alone; scrollIntoView would move the page as well.
  const list = row.closest(".frames");
  const above = row.offsetTop - list.offsetTop;
  if (above < list.scrollTop || above + row.offsetHeight > list.scrollTop + list.clientHeight) {
    list.scrollTop = above - list.clientHeight / 2;
  }
}

function select(index) {
  const frame = data.frames[index];
  rows[state.index].removeAttribute("aria-current");
  rows[index].setAttribute("aria-current", "true");
  reveal(rows[index]);
  state.index = index;
  const block = find(`pictures-${index}`);
  state.pictures = block ? JSON.parse(block.textContent) : null;
  const marks = { same: "✓ the same", passed: "✓ within limits", warned: "! warned", failed: "✗ failed" };
  find("name").textContent = (frame.name.startsWith("photons") ? frame.name : `Frame ${frame.name}`) + ": " + marks[frame.status];
  find("name").className = frame.status;
  find("findings").replaceChildren(...frame.findings.map(([severity, kind, text]) => {
    const item = document.createElement("li");
    item.className = severity === "fail" ? "failed" : "warned";
    item.textContent = `${severity === "fail" ? "Fails" : "Warns"}: ${kind}: ${text}`;
    return item;
  }));
  showMeasures(frame);
  moveCursors(frame.frame);
  const groups = groupsOf(state.pictures);
  const beyond = groups.find((group) => frame.findings.some((finding) => finding[2].startsWith(`${group}:`)));
  if (!groups.includes(state.group)) state.group = beyond || groups[0] || "beauty";
  find("group").replaceChildren(...groups.map((group) => new Option(group, group, false, group === state.group)));
  find("pictures").hidden = groups.length === 0;
  find("no-pictures").hidden = groups.length > 0 || frame.leftOut.length > 0;
  find("left-out").hidden = frame.leftOut.length === 0;
  find("left-out").textContent = `Pictures left out to keep this page small: ${frame.leftOut.join(", ")}. Check this frame alone to see them.`;
  return load();
}

async function load() {
  const turn = (state.turn += 1);
  const codes = {};
  const prefix = `${state.group}.`;
  const sources = state.pictures ? state.pictures.sources : {};
  const names = Object.keys(sources).filter((name) => name.startsWith(prefix) && !name.slice(prefix.length).includes("."));
  await Promise.all(names.map(async (name) => { codes[name.slice(prefix.length)] = await loadCodes(sources[name]); }));
  if (turn !== state.turn) return;
  if (!codes.a) codes.a = codes.b;
  state.codes = codes;
  draw();
}

function scale(name) {
  const scales = state.pictures.scales;
  const found = scales[`${state.group}.${name}`];
  return found === undefined ? scales[`${state.group}.b`] : found;
}

function draw() {
  const { codes } = state;
  document.body.dataset.shown = String(state.index);
  if (!codes.b) return;
  const name = data.frames[state.index].name;
  const pair = { a: exposed(codes.a, scale("a"), state.stops), b: exposed(codes.b, scale("b"), state.stops) };
  document.querySelectorAll("[data-panel]").forEach((panel) => {
    const kind = panel.dataset.panel;
    const canvas = panel.querySelector("canvas");
    panel.hidden = !codes[kind];
    if (panel.hidden) return;
    if (kind in pair) paint(canvas, pair[kind], `${state.group} of frame ${name}, ${kind === "a" ? "A, checked" : "B, baseline"}`);
    else {
      const largest = scale(kind).toPrecision(3);
      paint(canvas, heated(codes[kind]), `Heat map of ${kind === "flip" ? "FLIP" : "the difference"}, largest ${largest}`);
      panel.querySelector("figcaption").textContent = `${kind === "flip" ? "FLIP" : "Difference"}, dark 0, bright ${largest}`;
    }
  });
  state.pair = pair;
  drawWipe();
  drawHistogram();
  showWorst();
}

function drawWipe() {
  const { a, b } = state.pair;
  const canvas = find("wipe");
  paint(canvas, b, `A left of ${state.split} percent of the width, B right of it`);
  const edge = Math.round((state.split / 100) * a.width);
  const pen = canvas.getContext("2d");
  if (edge > 0) pen.putImageData(a, 0, 0, 0, 0, edge, a.height);
  find("stage").style.setProperty("--split", `${state.split}%`);
  find("split").value = state.split;
}

function drawHistogram() {
  const canvas = find("histogram");
  const bins = 64;
  const count = (codes) => {
    const found = new Float64Array(bins);
    for (let i = 0; i < codes.data.length; i += 4) for (let c = 0; c < 3; c += 1) found[codes.data[i + c] >> 2] += 1;
    return [...found].map((value) => Math.log10(1 + value / (codes.width * codes.height / 1000)));
  };
  const [a, b] = [count(state.codes.a), count(state.codes.b)];
  const highest = Math.max(...a, ...b);
  canvas.width = 640;
  canvas.height = 120;
  const pen = canvas.getContext("2d");
  pen.fillStyle = "#101418";
  pen.fillRect(0, 0, 640, 120);
  const top = (value) => 118 - (112 * value) / highest;
  pen.fillStyle = "#c46a2d";
  b.forEach((value, bin) => pen.fillRect(bin * 10 + 1, top(value), 8, 118 - top(value)));
  pen.strokeStyle = "#8ec1ff";
  pen.lineWidth = 2;
  pen.beginPath();
  a.forEach((value, bin) => { pen.lineTo(bin * 10, top(value)); pen.lineTo(bin * 10 + 10, top(value)); });
  pen.stroke();
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `Histogram of A and B from 0 to ${scale("b").toPrecision(3)}`);
}

function showWorst() {
  const worst = data.frames[state.index].worst[state.group];
  const strip = state.codes.zoom;
  find("worst").hidden = !worst || !strip;
  if (find("worst").hidden) return;
  const pixels = exposed(strip, scale("zoom"), state.stops);
  find("worst").querySelector("tbody").replaceChildren(...worst.map(([column, row, a, b], place) => {
    const line = document.createElement("tr");
    [`(${column}, ${row})`, a, b].forEach((text) => line.insertCell().append(text));
    [0, 1].forEach((side) => {
      const canvas = document.createElement("canvas");
      canvas.className = "zoom";
      canvas.width = canvas.height = data.zoom;
      canvas.getContext("2d").putImageData(pixels, -place * data.zoom, -side * data.zoom);
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${side ? "B" : "A"} around pixel (${column}, ${row})`);
      line.insertCell().append(canvas);
    });
    return line;
  }));
}

function showMeasures(frame) {
  const groups = Object.keys(frame.measures);
  find("measured").hidden = groups.length === 0;
  if (!groups.length) return;
  const cell = (tag, text, beyond) => {
    const made = document.createElement(tag);
    made.textContent = text;
    if (tag === "th") made.scope = "col";
    if (beyond) made.className = "beyond";
    return made;
  };
  const line = (cells) => { const made = document.createElement("tr"); made.append(...cells); return made; };
  const [head, body] = ["thead", "tbody"].map((part) => find("measured").querySelector(part));
  head.replaceChildren(line([cell("th", "Group"), ...frame.measures[groups[0]].map(([label]) => cell("th", label))]));
  body.replaceChildren(...groups.map((group) => line([cell("td", group), ...frame.measures[group].map(([, value, limit]) => {
    if (value === null) return cell("td", "–");
    const beyond = limit !== null && Math.abs(value) > limit;
    return cell("td", `${value.toPrecision(3)}${beyond ? " > " : " / "}${limit === null ? "–" : limit.toPrecision(2)}`, beyond);
  })])));
}

function moveCursors(frame) {
  document.querySelectorAll("figure.curves").forEach((figure) => {
    const { first, last, left, right } = Object.fromEntries(Object.entries(figure.dataset).map(([k, v]) => [k, Number(v)]));
    const cursor = figure.querySelector(".cursor");
    const width = figure.querySelector("svg[role]").viewBox.baseVal.width;
    const share = frame === null || last <= first ? -1 : (frame - first) / (last - first);
    const x = share < 0 || share > 1 ? -9 : width * (left + share * (right - left));
    cursor.setAttribute("x1", x);
    cursor.setAttribute("x2", x);
  });
}

function expose(stops) {
  state.stops = Math.max(-8, Math.min(8, stops));
  find("exposure").value = state.stops;
  find("stops").textContent = state.stops;
  draw();
}

function splitAt(percent) {
  state.split = Math.max(0, Math.min(100, Math.round(percent)));
  if (state.pair) drawWipe();
}

function nextGroup() {
  const groups = groupsOf(state.pictures);
  if (!groups.length) return;
  state.group = groups[(groups.indexOf(state.group) + 1) % groups.length];
  find("group").value = state.group;
  load();
}

rows.forEach((row, index) => row.addEventListener("click", () => select(index)));
document.querySelectorAll("[data-filter]").forEach((button) =>
  button.addEventListener("click", () => filterBy(button.dataset.filter)));
find("before").addEventListener("click", () => step(-1, visible));
find("after").addEventListener("click", () => step(1, visible));
find("group").addEventListener("change", (event) => { state.group = event.target.value; load(); });
find("exposure").addEventListener("input", (event) => expose(Number(event.target.value)));
find("split").addEventListener("input", (event) => splitAt(Number(event.target.value)));
find("wipe").addEventListener("pointermove", (event) => splitAt((100 * event.offsetX) / event.target.clientWidth));
document.querySelectorAll("figure.curves svg[role]").forEach((chart) => chart.addEventListener("click", (event) => {
  const { first, last, left, right } = chart.closest("figure").dataset;
  const share = (event.offsetX / chart.clientWidth - Number(left)) / (Number(right) - Number(left));
  const wanted = Number(first) + share * (Number(last) - Number(first));
  const distances = data.frames.map((frame) => (frame.frame === null ? Infinity : Math.abs(frame.frame - wanted)));
  select(distances.indexOf(Math.min(...distances)));
}));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const tag = event.target.tagName;
  if (tag === "SELECT" || (tag === "INPUT" && event.key.startsWith("Arrow"))) return;
  const failed = (index) => data.frames[index].status === "failed";
  const actions = {
    ArrowLeft: () => step(-1, visible),
    ArrowRight: () => step(1, visible),
    n: () => step(1, failed),
    p: () => step(-1, failed),
    "[": () => expose(state.stops - 0.5),
    "]": () => expose(state.stops + 0.5),
    g: nextGroup,
    f: () => filterBy(state.filter === "failed" ? "all" : "failed"),
  };
  // Space presses a focused button, as everywhere.
  if (tag !== "BUTTON") actions[" "] = () => splitAt(state.split > 50 ? 0 : 100);
  if (event.key in actions) {
    actions[event.key]();
    event.preventDefault();
  }
});

const firstFailure = data.frames.findIndex((frame) => frame.status === "failed");
if (data.frames.length) select(firstFailure < 0 ? 0 : firstFailure);
