// Mode shapes in space: a wireframe on a canvas, turned by dragging or by keys; without any library.
// A scene may have changes of its groups, by which lines are coloured, and the health of its sensors.

const CYCLE_S = 2.4, MOST_FPS = 30;
const MARGIN_PX = 14, LEAST_HEIGHT_PX = 260, MOST_HEIGHT_PX = 560;
// Height of the drawing over its width: higher for towers than for decks.
const LOWEST = 0.6, HIGHEST = 1.25;
const TURN_PER_PX = 0.01, TURN_PER_KEY = Math.PI / 24;
const VIEWS = { corner: [0.6, 0.35], front: [0, 0], side: [-Math.PI / 2, 0], above: [0, Math.PI / 2] };
// Changes at which a colour is full, of which the least that holds all changes of a scene is taken [1].
const FULL = [0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1];
// Healths of a sensor, the worst first, with their signs: told apart by shape, and not by colour alone.
const HEALTHS = { silent: "\u2715", missing: "\u25cb", measures: "\u25cf" };
const DASH = [5, 4];
const MINUS = "\u2212", NARROW = "\u202f";

const make = (tag, text, name) => {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  if (name) element.className = name;
  return element;
};
const button = (text, act) => {
  const made = make("button", text, "act");
  made.type = "button";
  made.addEventListener("click", act);
  return made;
};
const plain = (x, many) => (+x.toPrecision(many)).toString().replace("-", MINUS);

// Of a report, which is English; a page in another language gives words of its own.
const ENGLISH = {
  corner: "Corner", front: "Front", side: "Side", above: "Above", mode: "Mode", amplitude: "Amplitude", start: "Animate", stop: "Stop the animation",
  measured: "{frequency} measured", in_model: "{frequency} in the model", no_shape: "no shape to compare", only_model: "{title} (model)", only_measured: "{title} (measured)",
  chosen: "Mode {title}. {values}.", none: "No modes yet.", nodes: "A structure of {n} nodes in space.",
  legend_both: "Blue lines: model. Orange dots: measured at the sensors; a thin line joins each to the same point of the model.", legend_rest: "Pale lines: at rest.",
  legend_changed: "Thick orange lines: {elements}, suspected to have changed.",
  legend_coloured: "Lines: model, coloured by the change of stiffness. Dots: measured at the sensors; a thin line joins each to the same point of the model.",
  legend_suspected: "Suspected to have changed: {elements}.", change: "{name} {value} ({interval})", changes: "Changes: {changes}.",
  key_loss: "loss of {share}", key_none: "no change", key_gain: "gain of {share}", key_sure: "thick: certain, the 95 % interval leaves out zero", key_unsure: "dashed: not certain", key_fixed: "thin: not estimated",
  sensor_measures: "Sensor measures", sensor_missing: "Sensor missing from the reading", sensor_silent: "Sensor silent", sensors: "{health}: {names}.",
  legend_scale: "Displacements are strongly exaggerated.", legend_turn: "Drag sideways or press the arrow keys to rotate.",
};
const english = saying(ENGLISH);
const SPOKEN = { words: english, digits: plain, fixed: (x, places) => x.toFixed(places) };

function saying(messages) {
  return (key, values = {}) => messages[key].replace(/\{(\w+)\}/g, (_, name) => values[name]);
}

/** Words and numbers of a report in another language. */
function spokenIn(messages, decimal) {
  const written = (text) => text.replace(".", decimal);
  return { words: saying(messages), digits: (x, places) => written(plain(x, places)), fixed: (x, places) => written(x.toFixed(places)) };
}

/** "2.31 Hz measured, 2.29 Hz in the model, MAC 0.98". */
export function said({ measured_hz: seen, measured_sd_hz: sd, model_hz: own, mac }, { words, digits, fixed } = SPOKEN) {
  const parts = [];
  if (seen !== null) parts.push(words("measured", { frequency: `${digits(seen, 4)}${sd ? ` ± ${digits(sd, 2)}` : ""}${NARROW}Hz` }));
  if (own !== null) parts.push(words("in_model", { frequency: `${digits(own, 4)}${NARROW}Hz` }));
  if (seen !== null && own !== null) parts.push(mac === null ? words("no_shape") : `MAC ${fixed(mac, 3)}`);
  return parts.join(", ");
}

function titleOf(mode, place, { words, digits }) {
  const title = `${place + 1}: ${digits(mode.measured_hz ?? mode.model_hz, 4)}${NARROW}Hz`;
  if (mode.measured_hz === null) return words("only_model", { title });
  return mode.model_hz === null ? words("only_measured", { title }) : title;
}

/** Colours of the page or of the report around it, in its light or dark form. */
function colours(root) {
  const style = getComputedStyle(root), dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const of = (name, light, night) => style.getPropertyValue(`--${name}`).trim() || (dark ? night : light);
  return {
    model: of("estimate", "#0072b2", "#56b4e9"), measured: of("inseparable", "#b04900", "#ff9a52"),
    loss: of("inseparable", "#b04900", "#ff9a52"), gain: of("estimate", "#0072b2", "#56b4e9"), wrong: of("bad", "#8f2f0c", "#f6a182"),
    rest: of("line", "#d6dce0", "#353d43"), faint: of("faint", "#5c636a", "#a3aab1"), ink: of("ink", "#1c2024", "#e8eaec"),
  };
}

/** A colour between two of the form #rrggbb. */
function mixed(from, to, share) {
  const parts = [from, to].map((hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)));
  return `#${parts[0].map((a, k) => Math.round(a + share * (parts[1][k] - a)).toString(16).padStart(2, "0")).join("")}`;
}

/** The largest change that a scene's colours have to show, rounded up. */
const fullOf = (changes) => FULL.find((full) => Object.values(changes).every(({ value }) => Math.abs(value) <= full)) ?? FULL.at(-1);

/** Whether a change is certain: its 95 % interval leaves out zero. */
const isSure = ({ lo, hi }) => lo > 0 || hi < 0;

const toneOf = ({ value }, full, tint) => mixed(tint.faint, value < 0 ? tint.loss : tint.gain, Math.min(1, Math.abs(value) / full));

/** The worst health of the sensors at a node; undefined where it is not told. */
const healthOf = (sensors, node) => Object.keys(HEALTHS).find((health) => sensors.some((one) => one.node === node && one.health === health));

export class WireframeView {
  /** `spoken` gives the words of `ENGLISH` and numbers in another language, as `SPOKEN` does. */
  constructor(scene, { still = matchMedia("(prefers-reduced-motion: reduce)").matches, spoken = SPOKEN } = {}) {
    this.spoken = spoken;
    Object.assign(this, { turn: VIEWS.corner.slice(), cycles: 0, amplitude: 0.12, frame: 0, before: null, seen: true });
    this.root = make("div", undefined, "wireframe");
    this.canvas = make("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    // Dragging sideways turns the structure; dragging upwards scrolls the page, as anywhere on a phone.
    Object.assign(this.canvas.style, { display: "block", width: "100%", touchAction: "pan-y", cursor: "grab" });
    this.controls();
    this.told = make("p", undefined, "facts");
    this.told.setAttribute("aria-live", "polite");
    this.legend = make("p", undefined, "facts soft");
    this.keys = make("ul", undefined, "facts soft tones");
    Object.assign(this.keys.style, { display: "flex", flexWrap: "wrap", gap: ".2rem 1.1rem", listStyle: "none", padding: "0" });
    this.root.append(this.bar, this.canvas, this.keys, this.told, this.legend);
    this.listen();
    this.show(scene);
    this.run(!still);
  }

  controls() {
    const { words } = this.spoken;
    this.bar = make("p", undefined, "viewing");
    Object.assign(this.bar.style, { display: "flex", flexWrap: "wrap", gap: ".4rem", alignItems: "center" });
    this.choice = make("select");
    this.choice.setAttribute("aria-label", words("mode"));
    this.choice.addEventListener("change", () => this.choose(Number(this.choice.value)));
    this.holder = button("", () => this.run(!this.running));
    const size = make("input");
    Object.assign(size, { type: "range", min: "0", max: "0.3", step: "0.01", value: String(this.amplitude) });
    Object.assign(size.style, { width: "7rem" });
    size.addEventListener("input", () => { this.amplitude = Number(size.value); this.draw(); });
    const views = Object.entries(VIEWS).map(([name, turn]) => button(words(name), () => { this.turn = turn.slice(); this.draw(); }));
    const label = make("label", `${words("amplitude")} `);
    label.append(size);
    Object.assign(label.style, { display: "flex", alignItems: "center", gap: ".3rem" });
    this.bar.append(this.choice, this.holder, ...views, label);
  }

  listen() {
    const { canvas } = this;
    let last = null;
    canvas.addEventListener("pointerdown", (event) => {
      last = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.rotate((event.clientX - last[0]) * TURN_PER_PX, (event.clientY - last[1]) * TURN_PER_PX);
      last = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { last = null; });
    const keys = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    canvas.addEventListener("keydown", (event) => {
      const by = keys[event.key];
      if (by) this.rotate(by[0] * TURN_PER_KEY, by[1] * TURN_PER_KEY);
      else if (event.key === " ") this.run(!this.running);
      else return;
      event.preventDefault();
    });
    this.sizes = new ResizeObserver(() => this.draw());
    this.sizes.observe(canvas);
    // What nobody sees is not drawn.
    this.watcher = new IntersectionObserver((entries) => { this.seen = entries.at(-1).isIntersecting; });
    this.watcher.observe(canvas);
  }

  rotate(azimuth, elevation) {
    const limit = Math.PI / 2;
    this.turn = [this.turn[0] + azimuth, Math.max(-limit, Math.min(limit, this.turn[1] + elevation))];
    this.draw();
  }

  /** Another scene, such as of the next epoch; the view and the mode stay. */
  show(scene) {
    this.scene = scene;
    const rows = scene.nodes, axes = [0, 1, 2];
    const [low, high] = [Math.min, Math.max].map((pick) => axes.map((k) => rows.reduce((a, row) => pick(a, row[k]), rows[0][k])));
    this.centre = axes.map((k) => (low[k] + high[k]) / 2);
    this.flat = rows.reduce((a, row) => Math.max(a, Math.hypot(row[0] - this.centre[0], row[1] - this.centre[1])), 0);
    this.tall = (high[2] - low[2]) / 2;
    this.length = 2 * Math.hypot(this.flat, this.tall) || 1;
    const titles = scene.modes.map((mode, place) => titleOf(mode, place, this.spoken));
    if (titles.join() !== this.titles?.join()) {
      this.titles = titles;
      this.choice.replaceChildren(...titles.map((title, place) => Object.assign(make("option", title), { value: String(place) })));
    }
    this.choice.hidden = !titles.length;
    this.choose(Math.min(this.place ?? 0, Math.max(titles.length - 1, 0)));
  }

  choose(place) {
    this.place = place;
    this.choice.value = String(place);
    const mode = this.scene.modes[place], { changed, modes, changes = {} } = this.scene, { words } = this.spoken;
    const text = mode ? words("chosen", { title: titleOf(mode, place, this.spoken), values: said(mode, this.spoken) }) : words("none");
    if (this.told.textContent !== text) this.told.textContent = text;
    const both = modes.some((one) => one.points), coloured = Object.keys(changes).length > 0;
    this.legend.textContent = [
      words(!both ? "legend_rest" : coloured ? "legend_coloured" : "legend_both"),
      changed.length ? words(coloured ? "legend_suspected" : "legend_changed", { elements: changed.join(", ") }) : "",
      words("legend_scale"),
    ].filter(Boolean).join(" ");
    // Paper leaves out what can be done on a screen only.
    this.legend.append(" ", make("span", words("legend_turn"), "hint"));
    this.key();
    this.canvas.setAttribute("aria-label", [text, words("nodes", { n: this.scene.nodes.length }), ...this.inWords()].join(" "));
    Object.assign(this.canvas.dataset, { mode: place, nodes: this.scene.nodes.length, lines: this.scene.lines.length, points: mode?.points?.nodes.length ?? 0, changed: changed.join(" ") });
    this.draw();
  }

  /** Changes and sensors in words, for those who do not see the drawing. */
  inWords() {
    const { changes = {}, sensors } = this.scene, { words, digits } = this.spoken;
    const percent = (share) => `${share > 0 ? "+" : ""}${digits(100 * share, 3)}${NARROW}%`;
    const each = Object.entries(changes).map(([name, { value, lo, hi }]) => words("change", { name, value: percent(value), interval: `95${NARROW}%: ${percent(lo)} … ${percent(hi)}` }));
    const groups = Object.keys(HEALTHS).map((health) => [health, sensors.filter((one) => one.health === health).map(({ channel }) => channel)]);
    return [
      ...(each.length ? [words("changes", { changes: each.join(", ") })] : []),
      ...groups.filter(([, names]) => names.length).map(([health, names]) => words("sensors", { health: words(`sensor_${health}`), names: names.join(", ") })),
    ];
  }

  /** What colours, strokes and dots mean; drawn as they are in the picture. */
  key() {
    const { changes = {}, sensors, group_of_line: groups } = this.scene, { words, digits } = this.spoken, tint = colours(this.root), entries = [];
    const full = fullOf(changes), share = `${digits(100 * full, 3)}${NARROW}%`;
    const stroke = (colour, style) => {
      const mark = make("span");
      Object.assign(mark.style, { display: "inline-block", width: "1.6rem", verticalAlign: "middle", marginRight: ".35rem", borderTop: `${style} ${colour}` });
      return mark;
    };
    if (Object.keys(changes).length) {
      entries.push(
        [stroke(tint.loss, "4px solid"), words("key_loss", { share })], [stroke(tint.faint, "4px solid"), words("key_none")], [stroke(tint.gain, "4px solid"), words("key_gain", { share })],
        [stroke(tint.ink, "4px solid"), words("key_sure")], [stroke(tint.ink, "2px dashed"), words("key_unsure")],
      );
      if (groups.some((group) => !(this.scene.groups[group] in changes))) entries.push([stroke(tint.faint, "1px solid"), words("key_fixed")]);
    }
    for (const health of Object.keys(HEALTHS).reverse()) {
      if (!sensors.some((one) => one.health)) break;
      const mark = make("span", HEALTHS[health]);
      Object.assign(mark.style, { color: health === "measures" ? tint.ink : health === "silent" ? tint.wrong : tint.loss, marginRight: ".35rem" });
      mark.setAttribute("aria-hidden", "true");
      entries.push([mark, words(`sensor_${health}`)]);
    }
    this.keys.hidden = !entries.length;
    this.keys.replaceChildren(...entries.map((parts) => {
      const item = make("li");
      item.append(...parts);
      return item;
    }));
    const tones = Object.entries(changes).map(([name, change]) => [name, { tone: toneOf(change, full, tint), sure: isSure(change) }]);
    const counts = Object.keys(HEALTHS).map((health) => [health, sensors.filter((one) => one.health === health).length]);
    Object.assign(this.canvas.dataset, { tones: JSON.stringify(Object.fromEntries(tones)), sensors: JSON.stringify(Object.fromEntries(counts)) });
  }

  run(running) {
    this.running = running;
    this.before = null;
    this.holder.textContent = this.spoken.words(running ? "stop" : "start");
    cancelAnimationFrame(this.frame);
    if (running) this.frame = requestAnimationFrame((now) => this.step(now));
  }

  step(now) {
    const passed = this.before === null ? 0 : now - this.before;
    if (this.before === null || passed >= 1000 / MOST_FPS) {
      this.cycles += Math.min(passed, 100) / 1000 / CYCLE_S;
      this.before = now;
      if (this.seen) this.draw();
    }
    this.frame = requestAnimationFrame((next) => this.step(next));
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.sizes.disconnect();
    this.watcher.disconnect();
  }

  /** Places of nodes as they swing: at rest plus amplitude times Re(shape exp(i phase)). */
  places(nodes, motion) {
    const [c, s] = [Math.cos(2 * Math.PI * this.cycles), Math.sin(2 * Math.PI * this.cycles)], reach = this.amplitude * this.length;
    return nodes.map((node, k) => this.scene.nodes[node].map((at, axis) => {
      const moved = motion ? motion.re[k][axis] * c - (motion.im ? motion.im[k][axis] * s : 0) : 0;
      return at + reach * moved;
    }));
  }

  /** The screen's coordinates: right, down, and towards the reader. */
  projected(places, width, height) {
    const [azimuth, elevation] = this.turn, [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const room = 0.5 * this.amplitude * this.length;
    const across = this.flat + room, up = this.tall * Math.abs(ce) + this.flat * Math.abs(se) + room;
    const scale = Math.min((width / 2 - MARGIN_PX) / across, (height / 2 - MARGIN_PX) / up);
    return places.map((place) => {
      const [x, y, z] = place.map((at, k) => at - this.centre[k]);
      const [right, deep] = [x * ca + y * sa, y * ca - x * sa];
      return [width / 2 + scale * right, height / 2 - scale * (z * ce + deep * se), z * se - deep * ce];
    });
  }

  draw() {
    const { canvas, scene } = this, width = canvas.clientWidth;
    if (!width || !scene) return;
    const form = Math.max(LOWEST, Math.min(HIGHEST, this.tall / (this.flat || 1))), ratio = devicePixelRatio || 1;
    const height = Math.round(Math.max(LEAST_HEIGHT_PX, Math.min(MOST_HEIGHT_PX, form * width)));
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
      canvas.style.height = `${height}px`;
    }
    const pen = canvas.getContext("2d"), tint = colours(this.root), mode = scene.modes[this.place];
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const all = scene.nodes.map((_, node) => node), onScreen = (nodes, motion) => this.projected(this.places(nodes, motion), width, height);
    const rest = onScreen(all, null), moved = mode?.wire ? onScreen(all, mode.wire) : rest;
    this.lines(pen, rest, () => [tint.rest, 1, 1]);
    this.axes(pen, tint, height);
    const changed = new Set(scene.changed.map((name) => scene.groups.indexOf(name))), { changes = {} } = scene, full = fullOf(changes);
    const deep = moved.map((at) => at[2]), [near, far] = [Math.max(...deep), Math.min(...deep)];
    // What is farther away is paler, which tells front from back without perspective.
    const coloured = Object.keys(changes).length > 0;
    if (mode?.wire || coloured) this.lines(pen, moved, (line, [a, b]) => {
      const part = near > far ? ((deep[a] + deep[b]) / 2 - far) / (near - far) : 1, group = scene.group_of_line[line], strength = 0.45 + 0.55 * part;
      if (!coloured) return changed.has(group) ? [tint.measured, 4, strength] : [tint.model, 1.8, strength];
      const change = changes[scene.groups[group]];
      if (!change) return [tint.faint, 1, strength];
      return isSure(change) ? [toneOf(change, full, tint), 4, strength] : [toneOf(change, full, tint), 2, strength, DASH];
    });
    if (mode?.points) this.points(pen, mode.points, moved, onScreen(mode.points.nodes, mode.points), tint);
    const drawn = new Set(mode?.points?.nodes);
    for (const node of new Set(scene.sensors.map((one) => one.node))) if (!drawn.has(node)) this.sensor(pen, moved[node], healthOf(scene.sensors, node), tint);
  }

  lines(pen, at, look) {
    this.scene.lines.forEach((ends, line) => {
      const [first, last] = ends.map((node) => at[node]), [colour, thick, strength, dash = []] = look(line, ends);
      Object.assign(pen, { strokeStyle: colour, lineWidth: thick, globalAlpha: strength, lineCap: dash.length ? "butt" : "round" });
      pen.setLineDash(dash);
      pen.beginPath();
      pen.moveTo(first[0], first[1]);
      pen.lineTo(last[0], last[1]);
      pen.stroke();
    });
    pen.globalAlpha = 1;
    pen.setLineDash([]);
  }

  points(pen, { nodes }, moved, seen, tint) {
    nodes.forEach((node, k) => {
      const health = healthOf(this.scene.sensors, node);
      Object.assign(pen, { strokeStyle: health ? tint.ink : tint.measured, lineWidth: 1.5 });
      pen.beginPath();
      pen.moveTo(moved[node][0], moved[node][1]);
      pen.lineTo(seen[k][0], seen[k][1]);
      pen.stroke();
      this.sensor(pen, seen[k], health, tint, tint.measured);
    });
  }

  /** The dot of a sensor; one whose health nobody tells is a plain one. */
  sensor(pen, [x, y], health, tint, plainly = tint.model) {
    if (!health || health === "measures") return this.dot(pen, [x, y], 3.5, health ? tint.ink : plainly);
    const colour = health === "silent" ? tint.wrong : tint.loss, r = 4;
    Object.assign(pen, { strokeStyle: colour, lineWidth: 2 });
    pen.beginPath();
    if (health === "missing") pen.arc(x, y, r, 0, 2 * Math.PI);
    else for (const way of [1, -1]) {
      pen.moveTo(x - r, y - way * r);
      pen.lineTo(x + r, y + way * r);
    }
    pen.stroke();
  }

  dot(pen, [x, y], radius, colour) {
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.fill();
  }

  /** The three directions, in the corner. */
  axes(pen, tint, height) {
    const [ca, sa, ce, se] = [Math.cos(this.turn[0]), Math.sin(this.turn[0]), Math.cos(this.turn[1]), Math.sin(this.turn[1])];
    const [x0, y0, reach] = [34, height - 34, 22], ways = { x: [ca, sa * se], y: [sa, -ca * se], z: [0, -ce] };
    Object.assign(pen, { strokeStyle: tint.faint, fillStyle: tint.faint, lineWidth: 1, font: "12px system-ui, sans-serif", textAlign: "center", textBaseline: "middle" });
    for (const [name, [right, down]] of Object.entries(ways)) {
      pen.beginPath();
      pen.moveTo(x0, y0);
      pen.lineTo(x0 + reach * right, y0 + reach * down);
      pen.stroke();
      if (Math.hypot(right, down) > 0.2) pen.fillText(name, x0 + 1.35 * reach * right, y0 + 1.35 * reach * down);
    }
  }
}

/** Draw every scene that a report holds. */
/** `messages` as `ENGLISH`, and the mark of decimals, for a report in another language. */
export function drawAll(messages = ENGLISH, decimal = ".") {
  const spoken = spokenIn(messages, decimal);
  for (const place of document.querySelectorAll(".scene")) {
    const view = new WireframeView(JSON.parse(place.querySelector("script").textContent), { spoken });
    place.replaceChildren(view.root);
  }
}
