"use strict";
// Whatever comes from outside is text: elements are made one by one, and never from markup.
const SVG = "http://www.w3.org/2000/svg", $ = (id) => document.getElementById(id);
const make = (tag, of = {}, ...inside) => fill(document.createElement(tag), of, inside);
const draw = (tag, of = {}, ...inside) => fill(document.createElementNS(SVG, tag), of, inside);
function fill(element, of, inside) {
  for (const [name, value] of Object.entries(of)) element.setAttribute(name, value);
  element.append(...inside);
  return element;
}
// What a browser does not show, and what reorders the letters beside it: names come from the network.
const HIDDEN = /[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u061c\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb]/g;
const visible = (_, value) => (typeof value === "string" ? value.replace(HIDDEN, (letter) => `\\u${letter.charCodeAt(0).toString(16).padStart(4, "0")}`) : value);
const say = (element, text) => { if (element.textContent !== text) element.textContent = text; };
const set = (element, name, value) => { if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value); };

const SIDES = { ros2: "ROS 2", ros: "ROS 1", yarp: "YARP", zeromq: "ZeroMQ" }, [HUB] = Object.keys(SIDES);
const STATES = ["active", "waiting", "degraded", "error"];
const sideClass = (side) => (Object.hasOwn(SIDES, side) ? side : "other");
const KEEP = 120, TILES = 12, ROWS = 400, LOOK_MS = 1000, PREVIEW_MS = 400;

// ---- numbers ----
const number = (value, digits = 0) => value.toLocaleString("en", { maximumFractionDigits: digits, minimumFractionDigits: digits }).replaceAll(",", "\u202f");
const hz = (value) => number(value, value > 0 && value < 100 ? 1 : 0);
function bytes(value) {
  const units = ["B", "kB", "MB", "GB"];
  let at = 0;
  while (value >= 999.5 && at < 3) { value /= 1000; at += 1; }
  return `${number(value, at && value < 100 ? 1 : 0)}\u202f${units[at]}`;
}
const time = (us) => (us >= 1e6 ? `${number(us / 1e6, 1)}\u202fs` : us >= 1000 ? `${number(us / 1000, us < 1e5 ? 1 : 0)}\u202fms` : `${number(us)}\u202fµs`);
const total = (map) => Object.values(map).reduce((sum, count) => sum + count, 0);

// ---- what is known ----
let routes = [], known = new Map(), answer = { middlewares: {} }, heard = 0;
let chosen = null, only = null, sort = { by: "name", down: false };

function take(next) {
  const before = known;
  known = new Map();
  answer = next;
  routes = next.routes.map((route) => {
    const dropped = total(route.counters.drops), last = before.get(route.id);
    const [from, to] = [route.from, route.to].map((end) => {
      const at = end.indexOf(":");
      return { side: end.slice(0, at), name: end.slice(at + 1) };
    });
    const arrived = dropped - (route.counters.drops.lost_upstream || 0);
    const queued = Math.max(0, route.counters.received - route.counters.sent - arrived);
    const one = { ...route, ends: { from, to }, dropped, queued, losing: last ? Math.max(0, dropped - last.dropped) : 0,
      history: last ? last.history : [], preview: last ? last.preview : null, why: last && last.state === route.state ? last.why : null };
    one.history.push([route.messages_per_s, route.counters.latency.p99_us]);
    if (one.history.length > KEEP) one.history.shift();
    known.set(route.id, one);
    return one;
  });
}
const isPattern = (route) => route.pattern !== undefined;
const side = (route) => sideClass(route.ends.from.side === HUB ? route.ends.to.side : route.ends.from.side);
// A route without a name of its own is called as its ends are: one of them, on the graph where it is there, is shorter.
function title(route) {
  if (route.name !== `${route.from} -> ${route.to}`) return route.name;
  return route.ends.to.side === HUB || route.ends.from.side !== HUB ? route.ends.to.name : route.ends.from.name;
}
const sentence = (route) => (route.state === "active" ? "active" : route.state === "waiting" ? `waiting for ${route.reason}` : `${route.state}: ${route.reason}`);
function patternWords({ pattern }) {
  const over = pattern.over_limit ? `, ${number(pattern.over_limit)} over the limit` : "";
  return `${number(pattern.routes)} routes now, ${number(pattern.waiting)} names wait${over}`;
}
function meant(route) {
  if (only && route.state !== only) return false;
  const words = $("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
  const text = `${route.name} ${route.from} ${route.to} ${route.kind} ${route.type} ${SIDES[route.ends.from.side] || ""} ${SIDES[route.ends.to.side] || ""}`.toLowerCase();
  return words.every((word) => text.includes(word));
}

// ---- head ----
function head() {
  say($("node"), answer.node || "");
  document.title = `${(answer.node || "wrapyfi").replace(/^\//, "")} · wrapyfi`;
  const holder = $("states");
  if (!holder.childElementCount) {
    for (const state of STATES) {
      const button = make("button", { type: "button", class: state, "aria-pressed": "false" }, make("span", { class: "dot" }), make("b"), document.createTextNode(` ${state}`));
      button.addEventListener("click", () => { only = only === state ? null : state; render(); });
      holder.append(button);
    }
    $("totals").append(...["messages/s", "per s", "dropped/s"].map((word) => make("div", {}, make("dt", {}, word), make("dd"))));
  }
  const real = routes.filter((route) => !isPattern(route));
  STATES.forEach((state, at) => {
    const count = real.filter((route) => route.state === state).length, button = holder.children[at];
    say(button.querySelector("b"), number(count));
    button.hidden = count === 0 && state !== "active" && only !== state;
    set(button, "aria-pressed", only === state);
  });
  const sum = (of) => real.reduce((all, route) => all + of(route), 0), fields = $("totals").children;
  const losing = sum((route) => route.losing);
  [number(sum((route) => route.messages_per_s)), bytes(sum((route) => route.bytes_per_s)), number(losing)].forEach((text, at) => say(fields[at].querySelector("dd"), text));
  fields[2].classList.toggle("bad", losing > 0);
}

// ---- picture: sides as cards, names as ports, routes as cables ----
let drawn = "", cables = new Map(), notes = new Map();
function picture() {
  const graph = $("graph"), width = Math.max(640, $("picture").clientWidth);
  const real = routes.filter((route) => !isPattern(route)).slice(0, 1500);
  const shape = JSON.stringify([width, innerHeight, real.map((route) => [route.id, route.from, route.to])]);
  if (shape !== drawn) { drawn = shape; lay(graph, width, real); }
  const few = real.length <= 40;
  for (const route of real) {
    const cable = cables.get(route.id);
    if (!cable) continue;
    const rate = route.messages_per_s, moves = rate > 0 && route.state !== "waiting";
    set(cable.group, "class", `route ${side(route)} ${route.state}${moves ? " moves" : ""}${chosen === route.id ? " is" : ""}`);
    const thick = Math.min(1, Math.log10(1 + route.bytes_per_s / 100) / 5.3), wide = cable.thin * (1 + 2.4 * thick);
    set(cable.line, "stroke-width", wide.toFixed(1));
    set(cable.flow, "stroke-width", (wide + (few ? 3 : 1.2)).toFixed(1));
    const seconds = moves ? Math.max(.35, 2.1 - .55 * Math.log10(1 + rate)).toFixed(1) : "1";
    if (cable.seconds !== seconds) { cable.seconds = seconds; cable.flow.style.animationDuration = `${seconds}s`; }
    if (cable.rate) {
      const text = route.state === "active" ? (rate > 0 ? `${hz(rate)} Hz` : "still") : route.state, wide = text.length * 8.3 + 14;
      say(cable.rate, text);
      set(cable.pill, "x", (cable.x - wide / 2).toFixed(1));
      set(cable.pill, "width", wide.toFixed(1));
    }
  }
  graph.classList.toggle("chosen", cables.has(chosen));
  for (const [name, note] of notes) {
    const waits = answer.middlewares[name];
    say(note.text, waits ? cut(`waits for ${waits}`, note.room) : note.count);
    set(note.text, "class", waits ? "note waiting" : "note");
  }
}
const cut = (text, room) => { const all = [...text]; return all.length <= room ? text : `${all.slice(0, Math.max(1, room - 1)).join("")}…`; };
const cutFront = (text, room) => { const all = [...text]; return all.length <= room ? text : `…${all.slice(all.length - Math.max(1, room - 1)).join("")}`; };

function lay(graph, width, real) {
  graph.replaceChildren();
  cables = new Map();
  notes = new Map();
  // Names by side; those of each side in the order in which their cables cross least.
  const sides = new Map();
  const port = ({ side, name }) => {
    if (!sides.has(side)) sides.set(side, new Map());
    const ports = sides.get(side);
    if (!ports.has(name)) ports.set(name, { side, name, peers: new Set(), at: 0 });
    return ports.get(name);
  };
  if (!real.length) sides.set(HUB, new Map());
  for (const { ends } of real) {
    const [a, b] = [port(ends.from), port(ends.to)];
    a.peers.add(b); b.peers.add(a);
  }
  const hub = sides.get(HUB) || new Map(), spokes = [...sides.keys()].filter((name) => name !== HUB);
  const size = (name) => sides.get(name).size;
  const columns = [[], []];
  for (const name of [...spokes].sort((a, b) => size(b) - size(a) || (a < b ? -1 : 1))) {
    const load = (column) => column.reduce((sum, it) => sum + size(it) + 4, 0);
    columns[load(columns[0]) <= load(columns[1]) ? 0 : 1].push(name);
  }
  const order = (ports) => [...ports].sort((a, b) => a.at - b.at || (a.name < b.name ? -1 : a.name > b.name ? 1 : 0));
  const lists = [columns[0].map((name) => order(sides.get(name).values())), [order(hub.values())], columns[1].map((name) => order(sides.get(name).values()))];
  for (let round = 0; round < 6; round += 1) {
    for (const column of [0, 2]) { let at = 0; const all = lists[column].flat().length; lists[column].flat().forEach((it) => { it.place = at / all; at += 1; }); }
    const mean = (it) => { const peers = [...it.peers].filter((peer) => peer.side !== it.side); return peers.length ? peers.reduce((sum, peer) => sum + peer.place, 0) / peers.length : 1; };
    lists[1][0].forEach((it) => { it.at = mean(it); });
    lists[1][0] = order(lists[1][0]);
    lists[1][0].forEach((it, at) => { it.place = at / lists[1][0].length; });
    for (const column of [0, 2]) lists[column] = lists[column].map((list) => { list.forEach((it) => { it.at = mean(it); }); return order(list); });
  }
  // Sizes: rows as tall as the window has room for.
  const HEAD = 62, FOOT = 14, GAP = 26, TOP = 8;
  const tallest = Math.max(...lists.map((column) => column.reduce((sum, list) => sum + list.length, 0)), 1);
  const heads = Math.max(...lists.map((column) => column.length), 1);
  const room = Math.max(300, innerHeight * .64) - heads * (HEAD + FOOT + GAP);
  const row = Math.max(tallest > 300 ? 2.4 : 5, Math.min(tallest < 7 ? 50 : 38, room / tallest));
  const named = row >= 12.5, font = Math.min(tallest < 7 ? 19 : 16.5, row * .82);
  const rows = (list) => Math.max(1, list.length) * row;
  // Cables between the outer columns pass below the card in the middle, each on a level of its own.
  const lane = (name) => (name === HUB ? 1 : columns[0].includes(name) ? 0 : 2);
  const across = real.filter(({ ends }) => Math.abs(lane(ends.from.side) - lane(ends.to.side)) === 2).length;
  const step = Math.min(24, 240 / Math.max(1, across)), below = across ? 14 + across * step : 0;
  const tall = (column, lane) => column.reduce((sum, list) => sum + rows(list) + HEAD + FOOT, lane === 1 ? below : 0) + Math.max(0, column.length - 1) * GAP;
  const height = Math.max(...lists.map(tall)) + 2 * TOP;
  const lanes = lists.filter((column) => column.length).length;
  const cardWidth = Math.min(460, Math.max(170, width * (lanes === 3 ? .225 : .3)));
  const xs = lists[0].length ? (lists[2].length ? [0, (width - cardWidth) / 2, width - cardWidth] : [width * .06, width * .94 - cardWidth, 0]) : [0, (width - cardWidth) / 2, 0];
  fill(graph, { viewBox: `0 0 ${width} ${height.toFixed(0)}`, height: height.toFixed(0) }, []);
  const under = draw("g"), over = draw("g"), cards = draw("g");
  let middle = null;
  lists.forEach((column, lane) => {
    let y = TOP + (height - 2 * TOP - tall(column, lane)) / 2;
    column.forEach((list, at) => {
      const name = lane === 1 ? HUB : columns[lane ? 1 : 0][at], tallCard = HEAD + FOOT + rows(list), x = xs[lane];
      const card = draw("g", { class: `${sideClass(name)}${lane === 1 ? " hub" : ""}` });
      card.append(draw("rect", { class: "card", x, y, width: cardWidth, height: tallCard, rx: 16 }), draw("rect", { class: "stripe", x: x + 16, y: y + 17, width: 6, height: 28, rx: 3 }),
        draw("text", { class: "title", x: x + 32, y: y + 31 }, SIDES[name] || cut(name, 16)));
      const what = lane === 1 ? "graph, " : "", count = `${what}${number(list.length)} name${list.length === 1 ? "" : "s"}`;
      const note = draw("text", { class: "note", x: x + 32, y: y + 48 }, count);
      card.append(note);
      notes.set(name, { text: note, count, room: Math.floor((cardWidth - 44) / 7.8) });
      const letters = Math.floor((cardWidth - 40) / (font * .605));
      list.forEach((it, index) => {
        Object.assign(it, { lane, left: x, right: x + cardWidth, y: y + HEAD + (index + .5) * row, box: card });
        if (named) {
          const text = draw("text", { "font-size": font.toFixed(1), y: (it.y + font * .35).toFixed(1), x: x + (lane === 0 ? cardWidth - 20 : lane === 2 ? 20 : cardWidth / 2), "text-anchor": lane === 0 ? "end" : lane === 2 ? "start" : "middle" }, cutFront(it.name, letters));
          card.append(text);
        }
      });
      if (!named) groups(card, list, row, x, cardWidth);
      cards.append(card);
      if (lane === 1) middle = { left: x, right: x + cardWidth, level: y + tallCard + 14 + step / 2 };
      y += tallCard + GAP;
    });
  });
  const thin = Math.max(.8, Math.min(2.2, row / 9)), labels = row >= 12.5;
  const seen = new Map(), pills = [];
  const isFree = ([x, y]) => !pills.some((other) => Math.abs(other[0] - x) < 80 && Math.abs(other[1] - y) < 21);
  for (const route of real) {
    const [a, b] = [port(route.ends.from), port(route.ends.to)];
    let x1 = a.right, x2 = b.left, bend;
    if (a.lane === b.lane) {
      const outward = a.lane === 2 ? "left" : "right";
      [x1, x2, bend] = [a[outward], b[outward], outward === "right" ? 70 : -70];
    } else if (a.lane > b.lane) [x1, x2] = [a.left, b.right];
    // A cable on top of another, of the way back: a little lower.
    const pair = [`${a.side}:${a.name}`, `${b.side}:${b.name}`].sort().join("\n"), again = seen.get(pair) || 0;
    seen.set(pair, again + 1);
    const shift = again * Math.min(7, row / 4), [y1, y2] = [a.y + shift, b.y + shift];
    const far = bend ?? (x2 - x1) * .5, c1 = x1 + far, c2 = bend === undefined ? x2 - far : x2 + far;
    const spot = (t, u = 1 - t) => [u * u * u * x1 + 3 * u * u * t * c1 + 3 * u * t * t * c2 + t * t * t * x2, u * u * u * y1 + 3 * u * u * t * y1 + 3 * u * t * t * y2 + t * t * t * y2];
    let way = `M${x1} ${y1}C${c1} ${y1} ${c2} ${y2} ${x2} ${y2}`, spots = [.5, .62, .38, .74, .26, .56, .44, .68, .32, .82, .18, .88, .12].map((t) => spot(t));
    if (Math.abs(a.lane - b.lane) === 2) {
      const [e1, e2] = a.lane < b.lane ? [middle.left, middle.right] : [middle.right, middle.left], { level } = middle;
      const [m1, m2] = [(x1 + e1) / 2, (e2 + x2) / 2];
      way = `M${x1} ${y1}C${m1} ${y1} ${m1} ${level} ${e1} ${level}L${e2} ${level}C${m2} ${level} ${m2} ${y2} ${x2} ${y2}`;
      spots = [.5, .28, .72].map((t) => [e1 + (e2 - e1) * t, level]);
      middle.level += step;
    }
    const line = draw("path", { class: "cable", d: way }), flow = draw("path", { class: "flow", d: way });
    const turn = Math.sign(x2 - c2) || 1, big = Math.min(9, Math.max(3, row * .42));
    const group = draw("g", { tabindex: -1 }, line, flow,
      draw("circle", { class: "port", cx: x1, cy: y1, r: Math.max(1.4, Math.min(4.5, row * .2)) }),
      draw("path", { class: "head", d: `M${x2 + turn * 1} ${y2}l${-turn * big} ${-big * .62}v${big * 1.24}z` }));
    // The rate stands where no other one does.
    const [cx, cy] = spots.find(isFree) || spots[0];
    let rate = null, pill = null;
    if (labels) {
      pills.push([cx, cy]);
      pill = draw("rect", { class: "pill", y: (cy - 10).toFixed(1), height: 20, rx: 10 });
      rate = draw("text", { class: "rate", x: cx.toFixed(1), y: (cy + 4.6).toFixed(1) });
      group.append(pill, rate);
    }
    group.append(draw("path", { class: "touch", d: way, "stroke-width": Math.max(5, Math.min(18, row * .7)).toFixed(1) }));
    group.addEventListener("click", () => choose(route.id));
    group.addEventListener("pointerenter", () => tip(over, route.id, (x1 + x2) / 2, (y1 + y2) / 2, width, height));
    group.addEventListener("pointerleave", () => over.replaceChildren());
    under.append(group);
    cables.set(route.id, { group, line, flow, rate, pill, x: cx, thin, seconds: "" });
  }
  graph.append(cards, under, over);
}

// Where names have no room: bands for namespaces, with the name of each that has room for one.
function groups(card, list, row, x, width) {
  const space = (name) => { const parts = name.split("/").filter(Boolean); return parts.length > 1 ? `/${parts[0]}` : "/"; };
  let begin = 0, odd = false;
  for (let at = 1; at <= list.length; at += 1) {
    if (at < list.length && space(list[at].name) === space(list[begin].name)) continue;
    const tall = (at - begin) * row, y = list[begin].y - row / 2;
    if (odd) card.append(draw("rect", { class: "band", x: x + 1, y, width: width - 2, height: tall }));
    if (tall >= 15) {
      const size = 13.5, text = `${cut(space(list[begin].name), Math.floor((width - 90) / 8.2))}  ${at - begin}`;
      card.append(draw("text", { class: "group", "font-size": size, x: x + width / 2, y: y + tall / 2 + size * .35, "text-anchor": "middle" }, text));
    }
    odd = !odd;
    begin = at;
  }
}

function tip(over, id, x, y, width, height) {
  const route = known.get(id);
  if (!route) return;
  const lines = [cut(title(route), 70), cut(`${route.from}  →  ${route.to}`, 90), cut(`${sentence(route)} · ${hz(route.messages_per_s)} Hz`, 90)];
  const wide = Math.max(...lines.map((line) => [...line].length)) * 8.5 + 28, tall = lines.length * 21 + 18;
  const left = Math.max(4, Math.min(width - wide - 4, x - wide / 2)), top = y > tall + 26 ? y - tall - 18 : Math.min(height - tall - 4, y + 22);
  const box = draw("g", { class: "tip" }, draw("rect", { x: left, y: top, width: wide, height: tall, rx: 10 }));
  lines.forEach((line, at) => box.append(draw("text", { x: left + 14, y: top + 25 + at * 21 }, line)));
  over.replaceChildren(box);
}

// ---- newest messages ----
let tiles = new Map();
const watch = new IntersectionObserver((entries) => entries.forEach((entry) => { entry.target.dataset.seen = entry.isIntersecting ? "1" : ""; }));
const rank = (route) => (/Image/.test(route.type) ? 0 : /Audio|Sound/.test(route.type) ? 1 : 2);
function live() {
  // Those that are shown stay where they are; others take the places that are free.
  const shown = new Set(tiles.keys());
  const worth = routes.filter((route) => !isPattern(route) && meant(route) && route.kind === "topic" && (route.messages_per_s > 0 || shown.has(route.id)));
  const wanted = [...worth].sort((a, b) => rank(a) - rank(b) || shown.has(b.id) - shown.has(a.id)).slice(0, TILES);
  const keep = new Set(wanted.map((route) => route.id));
  for (const [id, tile] of tiles) if (!keep.has(id)) { watch.unobserve(tile.box); tile.box.remove(); tiles.delete(id); }
  for (const route of wanted) {
    let tile = tiles.get(route.id);
    if (!tile) {
      const show = make("div", { class: "show" }), rate = make("span");
      const box = make("article", { class: "tile" }, show, make("footer", {}, make("span", { class: "dot" }), make("span", { class: "name" }, title(route)), rate));
      box.addEventListener("click", () => choose(route.id));
      tile = { box, show, rate };
      tiles.set(route.id, tile);
      watch.observe(box);
      const after = wanted.slice(wanted.indexOf(route) + 1).map((other) => tiles.get(other.id)).find(Boolean);
      $("live").insertBefore(box, after ? after.box : null);
    }
    set(tile.box, "class", `tile ${side(route)} ${route.state}${chosen === route.id ? " is" : ""}`);
    say(tile.rate, route.messages_per_s > 0 ? `${hz(route.messages_per_s)} Hz` : "still");
    show(tile.show, route);
  }
}
function show(box, route) {
  const preview = route.preview;
  if (box.shown === preview && box.firstChild) return;
  box.shown = preview;
  if (!preview) {
    box.replaceChildren(make("p", { class: "none" }, "no message since the page looks"));
  } else if (preview.kind === "image") {
    let image = box.querySelector("img");
    if (!image) { image = make("img", { alt: "" }); box.replaceChildren(image); }
    // A picture that the bridge itself has made.
    image.src = `data:image/png;base64,${preview.png}`;
    image.title = preview.what;
  } else if (preview.kind === "sound") {
    const high = preview.wave.map(([, top], at) => `${at ? "L" : "M"}${at} ${(50 - top * 46).toFixed(1)}`), low = preview.wave.map(([bottom], at) => `L${at} ${(50.6 - bottom * 46).toFixed(1)}`);
    const last = Math.max(1, preview.wave.length - 1);
    const svg = draw("svg", { viewBox: `0 0 ${last} 100`, preserveAspectRatio: "none" }, draw("path", { class: "axis", d: `M0 50H${last}`, "vector-effect": "non-scaling-stroke" }), draw("path", { class: "wave", d: `${high.join("")}${low.reverse().join("")}Z` }));
    box.replaceChildren(svg);
    box.title = preview.what;
  } else {
    box.replaceChildren(make("div", { class: "value" }, ...fields(preview.text)));
  }
}
// Fields of an object a line each, what is in its header last; anything else as it is.
function fields(text) {
  let value;
  try { value = JSON.parse(text); } catch { return [text]; }
  if (value === null || typeof value !== "object" || Array.isArray(value)) return [typeof value === "string" ? value : text];
  const lines = [], short = (it) => (typeof it === "number" && !Number.isInteger(it) ? String(Number(it.toPrecision(5))) : typeof it === "string" ? it : JSON.stringify(it));
  const plain = (it) => it === null || typeof it !== "object";
  const walk = (name, it) => {
    if (lines.length > 60) return;
    if (plain(it)) lines.push([name, short(it)]);
    else if (Array.isArray(it)) {
      if (it.every(plain)) lines.push([name, `[${it.slice(0, 12).map(short).join(", ")}${it.length > 12 ? `, … ${it.length}` : ""}]`]);
      else it.slice(0, 6).forEach((inner, at) => walk(`${name}[${at}]`, inner));
    } else for (const [key, inner] of Object.entries(it)) walk(name ? `${name}.${key}` : key, inner);
  };
  const { header, ...rest } = value;
  walk("", rest);
  if (header !== undefined) walk("header", header);
  return lines.flatMap(([name, it]) => [make("span", { class: "key" }, `${name} `), `${it}\n`]);
}

// ---- table ----
const COLUMNS = [
  ["name", "route", (r) => title(r).toLowerCase()], ["history", "last two minutes"], ["rate", "Hz", (r) => r.messages_per_s], ["bytes", "per s", (r) => r.bytes_per_s],
  ["p50", "latency p50", (r) => r.counters.latency.p50_us], ["p99", "p99", (r) => r.counters.latency.p99_us], ["queued", "queued", (r) => r.queued], ["dropped", "dropped", (r) => r.dropped],
];
let lines = new Map();
function heads() {
  for (const [by, word, of] of COLUMNS) {
    const th = make("th", { scope: "col" }, word);
    if (of) th.addEventListener("click", () => { sort = { by, down: sort.by === by ? !sort.down : by !== "name" }; table(); });
    $("heads").append(th);
  }
}
function spark(history, width, height) {
  const most = Math.max(...history.map(([rate]) => rate), 1e-9), step = width / (KEEP - 1), begin = width - (history.length - 1) * step;
  const points = history.map(([rate], at) => `${(begin + at * step).toFixed(1)} ${(height - 1.5 - (rate / most) * (height - 4)).toFixed(1)}`);
  return [`M${points.join("L")}`, `M${begin.toFixed(1)} ${height}L${points.join("L")}L${width} ${height}Z`];
}
function table() {
  const of = COLUMNS.find(([by]) => by === sort.by)[2];
  [...$("heads").children].forEach((th, at) => { if (COLUMNS[at][0] === sort.by) th.setAttribute("aria-sort", sort.down ? "descending" : "ascending"); else th.removeAttribute("aria-sort"); });
  const all = routes.filter(meant).sort((a, b) => { const [x, y] = [of(a), of(b)]; const way = x < y ? -1 : x > y ? 1 : 0; return (sort.down ? -way : way) || (a.id < b.id ? -1 : 1); });
  const some = all.slice(0, ROWS), keep = new Set(some.map((route) => route.id));
  say($("count"), all.length === routes.length ? String(all.length) : `${all.length} of ${routes.length}`);
  $("more").hidden = all.length <= ROWS;
  say($("more"), `${number(all.length - ROWS)} more: filter to see them`);
  for (const [id, line] of lines) if (!keep.has(id)) { line.row.remove(); lines.delete(id); }
  some.forEach((route, at) => {
    let line = lines.get(route.id);
    if (!line) {
      const cells = Array.from({ length: 6 }, () => make("span")), reason = make("div", { class: "reason" }), path = draw("path"), area = draw("path", { class: "area" });
      const row = make("tr", { tabindex: 0 }, make("td", { class: "route" }, make("div", {}, make("span", { class: "dot" }), make("span", { class: "name" }, title(route)), make("span", { class: "ends" })), reason),
        make("td", {}, draw("svg", { class: "spark", viewBox: "0 0 96 24" }, area, path)), ...cells.map((cell) => make("td", {}, cell)));
      row.addEventListener("click", () => choose(route.id));
      row.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(route.id); });
      line = { row, cells, reason, path, area, ends: row.querySelector(".ends") };
      lines.set(route.id, line);
    }
    const counters = route.counters, flows = counters.sent > 0;
    set(line.row, "class", `${side(route)} ${route.state}${chosen === route.id ? " is" : ""}`);
    const both = `${route.from} → ${route.to}`;
    say(line.ends, both === route.name ? carries(route) : `${both} · ${carries(route)}`);
    say(line.reason, isPattern(route) ? patternWords(route) : route.state === "active" ? "" : sentence(route));
    line.reason.title = line.reason.textContent;
    const [curve, area] = spark(route.history, 96, 24);
    set(line.path, "d", curve);
    set(line.area, "d", area);
    const texts = [hz(route.messages_per_s), bytes(route.bytes_per_s), flows ? time(counters.latency.p50_us) : "–", flows ? time(counters.latency.p99_us) : "–", number(route.queued), number(route.dropped)];
    texts.forEach((text, index) => { say(line.cells[index], text); set(line.cells[index], "class", /^(0|0\u202fB|–)$/.test(text) ? "zero" : index === 5 && route.losing > 0 ? "bad" : ""); });
    const body = $("rows");
    if (body.children[at] !== line.row) body.insertBefore(line.row, body.children[at] || null);
  });
}
const carries = ({ kind, type }) => `${kind} ${type.replace(/\/(msg|srv|action)\//, "/")}`;

// ---- the chosen route ----
let opened = null, panel = {};
function choose(id) {
  chosen = chosen === id ? null : id;
  render();
  const route = known.get(chosen);
  if (route && route.state !== "active" && !isPattern(route) && !route.why) ask(route);
}
function detail() {
  const box = $("detail"), route = known.get(chosen);
  box.hidden = !route;
  if (!route) { opened = null; return; }
  if (opened !== route.id) {
    opened = route.id;
    const close = make("button", { type: "button", "aria-label": "Close" }, "✕"), why = make("button", { type: "button" }, "why?");
    close.addEventListener("click", () => choose(route.id));
    why.addEventListener("click", () => { const now = known.get(route.id); if (now) ask(now); });
    panel = { show: make("div", { class: "show" }), state: make("p", { class: "diagnosis" }), told: make("div"), facts: make("dl"), path: draw("path"), area: draw("path", { class: "area" }), peak: make("h3") };
    const history = draw("svg", { class: "history", viewBox: "0 0 400 90", preserveAspectRatio: "none" }, panel.area, panel.path);
    box.replaceChildren(make("div", { class: "top" }, make("span", { class: "dot" }), make("h2", { class: "name" }, title(route)), why, close), panel.show,
      make("div", { class: "part" }, make("p", { class: "ends" }, route.from), make("p", { class: "ends" }, `→ ${route.to}`)), make("div", { class: "part" }, panel.state, panel.told),
      make("div", { class: "part" }, panel.peak, history), make("div", { class: "part" }, panel.facts));
  }
  set(box, "class", `${side(route)} ${route.state}`);
  panel.show.hidden = isPattern(route) || route.kind !== "topic";
  show(panel.show, route);
  say(panel.state, isPattern(route) ? patternWords(route) : sentence(route));
  if (panel.why !== route.why) { panel.why = route.why; diagnosis(panel.told, route.why); }
  const [curve, area] = spark(route.history, 400, 90);
  set(panel.path, "d", curve);
  set(panel.area, "d", area);
  say(panel.peak, `messages a second, at most ${hz(Math.max(...route.history.map(([rate]) => rate)))} in two minutes`);
  const { counters } = route, facts = [["carries", carries(route)], ...(route.cause ? [["cause", route.cause.replaceAll("_", " ")]] : []), ["now", `${hz(route.messages_per_s)} Hz, ${bytes(route.bytes_per_s)}/s`], ["latency p50, p99", counters.sent ? `${time(counters.latency.p50_us)}, ${time(counters.latency.p99_us)}` : "–"],
    ["received", `${number(counters.received)}, ${bytes(counters.received_bytes)}`], ["sent", `${number(counters.sent)}, ${bytes(counters.sent_bytes)}`], ["queued", number(route.queued)],
    ...Object.entries(counters.goals ?? {}).map(([event, count]) => [`goals ${event.replaceAll("_", " ")}`, number(count)]),
    ...Object.entries(counters.drops).map(([reason, count]) => [`dropped: ${reason.replaceAll("_", " ")}`, number(count)]),
    ...(counters.refused ? [["refused last", counters.refused.who], ["to let it in", counters.refused.allow]] : []),
    ...Object.entries(counters.qos_events).map(([event, count]) => [event.replaceAll("_", " "), number(count)]),
    ...(counters.unread ? [["passed on unread", number(counters.unread)]] : []), ...(route.panics ? [["panics", number(route.panics)]] : [])];
  const text = JSON.stringify(facts);
  if (panel.text !== text) { panel.text = text; panel.facts.replaceChildren(...facts.flatMap(([word, value]) => [make("dt", {}, word), make("dd", {}, value)])); }
}
function diagnosis(box, why) {
  const parts = [];
  if (why === "asked") parts.push(make("p", {}, "looking …"));
  else if (why && why.fault) parts.push(make("p", {}, why.fault));
  else if (why && why.what) parts.push(make("p", {}, why.what), make("p", { class: "remedy" }, why.remedy));
  else if (why) parts.push(make("p", {}, "nothing is missing on its way"));
  box.replaceChildren(...parts);
}
async function ask(route) {
  const keep = (what) => { const now = known.get(route.id); if (now) { now.why = what; detail(); } };
  keep("asked");
  try { keep(await get(`/why.json?id=${route.id}`, 8000)); } catch (error) { keep({ fault: `no answer: ${error.message}` }); }
}

// ---- asking the bridge ----
async function get(path, ms) {
  const reply = await fetch(path, { signal: AbortSignal.timeout(ms), cache: "no-store" });
  if (!reply.ok) throw new Error(`HTTP status ${reply.status}`);
  return JSON.parse(await reply.text(), visible);
}
function render() { head(); picture(); live(); table(); detail(); }
let missed = 0;
async function look() {
  if (!document.hidden || !heard) {
    try {
      take(await get("/routes.json", 4000));
      [heard, missed] = [Date.now(), 0];
      $("fault").hidden = true;
    } catch {
      missed += 1;
      const since = heard ? `; the numbers are ${Math.round((Date.now() - heard) / 1000)} s old` : "";
      if (missed > 1) { say($("fault"), `The bridge does not answer${since}. The page goes on as soon as it does.`); $("fault").hidden = false; }
    }
    document.documentElement.classList.toggle("still", missed > 1);
    if (heard) render();
  }
  setTimeout(look, LOOK_MS);
}
async function peek() {
  const ids = document.hidden ? [] : [...tiles].filter(([, tile]) => tile.box.dataset.seen).map(([id]) => id);
  if (!document.hidden && known.has(chosen) && !isPattern(known.get(chosen)) && !ids.includes(chosen)) ids.unshift(chosen);
  if (ids.length) {
    try {
      const found = await get(`/previews.json?id=${ids.slice(0, TILES + 1).join("&id=")}`, 4000);
      for (const [id, preview] of Object.entries(found)) {
        const route = known.get(id);
        if (!route) continue;
        route.preview = preview;
        if (tiles.has(id)) show(tiles.get(id).show, route);
        if (opened === id && panel.show) show(panel.show, route);
      }
    } catch { /* The next look tells. */ }
  }
  setTimeout(peek, PREVIEW_MS);
}

// ---- begin ----
const light = matchMedia("(prefers-color-scheme: light)");
let theme = null;
try { theme = localStorage.getItem("theme"); } catch { /* Not allowed here: as the system has it. */ }
const dress = () => { document.documentElement.dataset.theme = theme || (light.matches ? "light" : "dark"); };
light.addEventListener("change", dress);
$("theme").addEventListener("click", () => {
  theme = document.documentElement.dataset.theme === "light" ? "dark" : "light";
  try { localStorage.setItem("theme", theme); } catch { /* It lasts as long as the page. */ }
  dress();
});
$("filter").addEventListener("input", () => { live(); table(); });
addEventListener("keydown", (event) => { if (event.key === "Escape" && chosen) choose(chosen); });
new ResizeObserver(() => { if (heard) picture(); }).observe($("picture"));
document.addEventListener("visibilitychange", () => document.documentElement.classList.toggle("still", document.hidden));
dress();
heads();
look();
peek();
