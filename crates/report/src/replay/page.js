// A replay in the page: controls, time, lists and the link between them.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

class Replay {
  constructor(root) {
    this.root = root;
    this.blocks = [...root.querySelectorAll("template")];
    this.motions = new Map();
    Object.assign(this, { time: 0, speed: 1, isPlaying: false, picked: -1, shows: {} });
    this.ready = this.start();
  }
  async start() {
    const { head, bytes } = await unpack(this.blocks[0]);
    const floats = new Float32Array(bytes.slice(0, head.floats).buffer);
    const indices = new Uint32Array(bytes.slice(head.floats).buffer);
    const part = (values, [first, count]) => values.subarray(first, first + count);
    head.meshes = head.meshes.map((mesh) => [part(floats, mesh.vertices), part(indices, mesh.triangles)]);
    head.cloths = head.cloths.map((cloth) => ({ ...cloth, triangles: part(indices, cloth.triangles) }));
    this.scene = head;
    this.ghost = head.simulations.findIndex((simulation) => simulation.role === "ghost");
    this.build();
    try {
      this.renderer = new Renderer(this.canvas, head);
    } catch (error) {
      this.root.classList.add("is-flat");
      this.pick.textContent = `No 3-D picture: ${error.message}.`;
    }
    this.orbit = new Orbit(this.canvas, head, () => this.request());
    new ResizeObserver(() => this.resize()).observe(this.view);
    const recolor = () => setTimeout(() => this.resize());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolor);
    document.getElementById("theme")?.addEventListener("change", recolor);
    await this.open(0);
  }

  /** Returns the motion of a simulation, which is read when it is first needed. */
  async motion(index) {
    if (!this.motions.has(index)) this.motions.set(index, new Motion(this.scene, await unpack(this.blocks[index + 1])));
    return this.motions.get(index);
  }

  /** Shows a simulation from the instant on from which nothing can satisfy the requirement, or at the present time. */
  async open(index, keepsTime = false) {
    const { scene } = this;
    this.index = index;
    const other = this.ghost >= 0 && index !== this.ghost ? await this.motion(this.ghost) : null;
    const main = await this.motion(index);
    if (this.index !== index) return;
    Object.assign(this, { main, other, last: Math.max(main.last, other?.last ?? 0) });
    const { role, title, note, isViolated } = scene.simulations[index];
    this.label.textContent = ["failure", "value"].includes(role) ? `${title}: ${note}` : note;
    this.label.className = isViolated ? "fail" : "pass";
    this.ghostLabel.hidden = !other;
    this.buttons.forEach((button, i) => button.setAttribute("aria-pressed", i === index));
    const place = scene.sweep.findIndex((value) => value.simulation === index);
    if (this.slider && place >= 0) this.slider.value = place;
    this.slider?.setAttribute("aria-valuetext", title);
    this.paths = this.tracks();
    this.resize();
    this.seek(keepsTime ? this.time : main.decided ?? 0);
  }
  build() {
    const { scene, root } = this;
    const seek = (sample) => {
      this.play(false);
      this.seek(sample);
    };
    const button = (text, label, action) =>
      element("button", { type: "button", text, title: label, "aria-label": label, onclick: action });
    this.canvas = element("canvas", { tabindex: 0, "aria-label": "3-D replay; its keys are listed below" });
    this.label = element("b");
    this.ghostLabel = element("span", { class: "pass", text: `${scene.ghost}: the ghost` });
    this.clock = element("output");
    this.pick = element("output", { class: "replay-pick" });
    const head = element("div", { class: "replay-head" }, [this.label, this.ghostLabel]);
    this.view = element("div", { class: "replay-view" }, [this.canvas, this.pick, this.clock]);
    this.line = new TimeLine(seek);
    this.playButton = button("▶", "play (space)", () => this.play(!this.isPlaying));
    const speeds = SPEEDS.map((speed) => element("option", { value: speed, text: `${speed} ×`, selected: speed === 1 }));
    this.speeds = element("select", { "aria-label": "speed", onchange: () => (this.speed = Number(this.speeds.value)) }, speeds);
    const step = (steps) => () => seek(Math.round(this.time) + steps);
    const time = element("div", { class: "replay-time" }, [button("‹", "a control step back (←)", step(-1)), this.playButton,
      button("›", "a control step on (→)", step(1)), this.line.area, this.speeds]);
    const box = (name) => {
      this.shows[name] = element("input", { type: "checkbox", checked: true, onchange: () => this.request() });
      return element("label", {}, [this.shows[name], ` ${name}`]);
    };
    const modes = [["over", "ghost over it"], ["beside", "ghost beside it"], ["hidden", "no ghost"]];
    this.modes = element("select", { "aria-label": scene.ghost, onchange: () => this.request() },
      modes.map(([value, text]) => element("option", { value, text })));
    const tools = element("div", { class: "replay-tools" }, [this.modes, box("contacts"), box("paths"),
      button("reset view", "the first view (r)", () => this.orbit.reset())]);
    this.buttons = scene.simulations.map(({ title, note, isViolated }, index) => element("button",
      { type: "button", class: isViolated ? "fail" : "pass", title: note, text: title, onclick: () => this.open(index) }));
    const chosen = (test) => this.buttons.filter((_, index) => test(scene.simulations[index].role));
    const first = element("div", { class: "replay-first" }, chosen((role) => !["failure", "value"].includes(role)));
    const failures = chosen((role) => role === "failure");
    const list = failures.length ? [element("details", { open: failures.length < 13 }, [
      element("summary", { text: `All ${scene.failures} failures${scene.missing ? `, of which ${scene.missing} need a command` : ""}` }),
      element("div", { class: "replay-list" }, failures), element("p", { text: scene.command })])] : [];
    this.plots = [...scene.predicates.map(({ name, unit }) => new Plot(`ρ of ${name}`, unit, true, seek)),
      ...scene.signals.map(({ name, unit }) => new Plot(name, unit, false, seek))];
    const charts = element("div", { class: "replay-plots" }, this.plots.map((plot) => plot.figure));
    const keys = element("p", { class: "replay-keys", text: "Drag turns, Shift and drag or two fingers move, wheel (after a click) or + and − zoom, a click names a body. " +
      "Space plays, ← and → step, Home and End jump, Shift and arrows turn, < and > change the speed." });
    root.append(first, head, this.view, time, tools, ...this.sweep(), charts, ...list, keys);
    this.canvas.addEventListener("click", (event) => this.choose(event));
    root.addEventListener("keydown", (event) => this.key(event, seek));
  }

  /** Returns the slider over values of the axis that causes the failure. */
  sweep() {
    const { sweep, simulations, axis } = this.scene;
    if (!sweep.length) return [];
    this.slider = element("input", { type: "range", min: 0, max: sweep.length - 1, "aria-label": axis,
      oninput: () => this.open(sweep[this.slider.value].simulation, true) });
    const mark = ({ simulation, isConfirmed }) => !simulations[simulation].isViolated ? "✓" : isConfirmed ? "✕" : "△";
    const marks = sweep.map(mark);
    const values = sweep.map(({ value }, place) => element("span",
      { class: { "✓": "pass", "✕": "fail" }[marks[place]] ?? "open", text: `${marks[place]} ${value}` }));
    const open = marks.includes("△") ? ", △ fails, but was not confirmed with another physics step, collision algorithm and start" : "";
    return [element("div", { class: "replay-sweep" }, [element("p", { text: `${axis}, all else nominal: ✕ fails, ✓ passes${open}` }), this.slider,
      element("div", {}, values)])];
  }
  choose(event) {
    this.canvas.focus({ preventScroll: true });
    if (this.orbit.moved > 4 || !this.renderer) return;
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const [w, h] = [Math.round(width), Math.round(height)];
    const at = Math.floor(event.clientX - left) + w * (h - 1 - Math.floor(event.clientY - top));
    this.picked = this.identities(w, h)[at];
    this.pick.textContent = [...this.scene.bodies, ...this.scene.cloths.map((cloth) => cloth.name)][this.picked] ?? "";
    this.paths = this.tracks();
    this.request();
  }

  /** Returns the index of the body at each pixel, from the lower left; that of no body is -1. */
  identities(width, height, time = this.time) {
    return this.renderer.bodies({ motion: this.main, time, offset: [0, 0, 0] }, this.orbit.view(1), width, height);
  }
  key(event, seek) {
    if (event.target.matches("select, input, button") || event.ctrlKey || event.metaKey || event.altKey) return;
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    const speed = SPEEDS.indexOf(this.speed);
    const actions = {
      " ": () => this.play(!this.isPlaying),
      ArrowLeft: () => seek(Math.round(this.time) - 1), ArrowRight: () => seek(Math.round(this.time) + 1),
      Home: () => seek(0), End: () => seek(this.last),
      "+": () => this.orbit.zoom(0.9), "=": () => this.orbit.zoom(0.9), "-": () => this.orbit.zoom(1.1),
      r: () => this.orbit.reset(),
      "<": () => this.hasten(SPEEDS[speed - 1]), ">": () => this.hasten(SPEEDS[speed + 1]),
    };
    const action = event.shiftKey && turn ? () => this.orbit.turn(...turn) : actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }
  hasten(speed) {
    if (speed) this.speeds.value = this.speed = speed;
  }
  play(isPlaying) {
    if (isPlaying && !this.isPlaying) {
      if (this.time >= this.last) this.time = 0;
      let before = performance.now();
      const tick = (now) => {
        if (!this.isPlaying) return;
        this.seek(this.time + ((now - before) / 1000 / this.scene.dt) * this.speed);
        before = now;
        if (this.time >= this.last) this.play(false);
        else requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    }
    if (!isPlaying && this.isPlaying) this.seek(Math.round(this.time));
    this.isPlaying = isPlaying;
    this.playButton.textContent = isPlaying ? "❚❚" : "▶";
  }
  seek(time) {
    this.time = clamp(time, 0, this.last);
    [this.line, ...this.plots].forEach((strip) => strip.show(this.time));
    this.clock.textContent = `${(this.time * this.scene.dt).toFixed(2)} s · step ${Math.floor(this.time)} of ${this.last}`;
    this.request();
  }

  /** Draws everything that depends on size or colors. */
  resize() {
    if (!this.main) return;
    const style = getComputedStyle(this.root);
    const color = (name) => style.getPropertyValue(`--${name}`).trim();
    const numbers = (name) => [1, 3, 5].map((i) => parseInt(color(name).slice(i, i + 2), 16) / 255);
    const isDark = numbers("bg")[0] < 0.5;
    this.look = { fail: color("fail"), pass: color("pass"), soft: color("soft"), line: color("line"), chart: color("chart"), shade: color("cfbd9b5"),
      window: color("ceceff2"), sky: isDark ? [0.1, 0.115, 0.135] : [0.925, 0.94, 0.955], ground: isDark ? [0.2, 0.22, 0.25] : [0.86, 0.87, 0.88],
      bright: isDark ? 0.92 : 1, ghost: [0.2, 0.5, 0.85], arrow: [0.9, 0.2, 0.05] };
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(this.view.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.view.clientHeight * ratio));
    this.line.last = this.last;
    this.line.draw(this.look, this.main, this.scene.dt);
    this.plots.forEach((plot, index) => {
      const series = [{ values: this.main.series[index], color: this.look.fail }];
      if (this.other) series.push({ values: this.other.series[index], color: this.look.pass });
      plot.last = this.last;
      plot.draw(this.look, this.main, series);
    });
    this.seek(this.time);
  }

  /** Returns the places of a body at all samples. */
  tracks() {
    const { bodies, traced } = this.scene;
    const chosen = this.picked >= 0 && this.picked < bodies.length ? [this.picked] : [];
    return [...new Set([...traced, ...chosen])].flatMap((body) => [this.other, this.main].filter(Boolean).map((motion) =>
      ({ motion, isTool: body === traced[0], points: Array.from({ length: motion.samples }, (_, sample) => motion.pose(body, sample).p) })));
  }
  request() {
    if (this.isWaiting || !this.main || !this.renderer) return;
    this.isWaiting = true;
    requestAnimationFrame(() => this.draw((this.isWaiting = false)));
  }
  draw() {
    const { main, other, time, orbit, scene, shows } = this;
    const mode = other ? this.modes.value : "hidden";
    const place = (motion) => motion.pose(scene.root, time).p;
    orbit.shift = scene.isMobile ? sub(place(main), main.pose(scene.root, 0).p) : [0, 0, 0];
    const view = orbit.view(scene.reach * (mode === "beside" ? 2 : 1));
    const layer = { motion: main, time, offset: [0, 0, 0] };
    const layers = [layer];
    const offset = scale([-Math.sin(orbit.start.yaw), Math.cos(orbit.start.yaw), 0], 1.3 * scene.reach);
    if (mode === "over") layers.push({ motion: other, time, offset: [0, 0, 0], isGhost: true, other: layer });
    if (mode === "beside") layers.push({ motion: other, time, offset });
    const contacts = shows.contacts.checked ? main.contactsAt(time) : [];
    const arrows = contacts.map(({ point, force }) =>
      ({ point, way: scale(unit(force), clamp(0.03 + 0.0012 * norm(force), 0.03, 0.25) * Math.max(scene.reach, 0.5)) }));
    const paths = [];
    const sample = Math.floor(time);
    for (const { motion, isTool, points } of shows.paths.checked ? this.paths : []) {
      if (motion === other && mode !== "over") continue;
      const [r, g, b] = motion !== main ? this.look.ghost : isTool ? [0.45, 0.47, 0.5] : [0.85, 0.33, 0.02];
      for (const [part, a, width] of [[points.slice(0, sample + 1), 0.95, motion === main ? 1.6 : 1.1], [points.slice(sample), 0.35, 0.8]]) {
        if (part.length > 1) paths.push({ points: part.flat(), color: [r * a, g * a, b * a, a], width });
      }
    }
    this.renderer.draw({ view, layers, arrows, paths, look: this.look, picked: this.picked });
  }

  /** Returns the place of a body of the open simulation at a sample: position and quaternion. */
  pose(name, sample) {
    return this.main.pose(this.scene.bodies.indexOf(name), sample);
  }
}

const replays = [...document.querySelectorAll(".replay")].map((root) => (root.replay = new Replay(root)));
// A mark of a map, or a link of a table, opens the replay of its simulation.
document.addEventListener("click", (event) => {
  const row = event.target.closest?.("a[href^='#']")?.getAttribute("href").slice(1);
  for (const replay of row ? replays : []) {
    const index = replay.scene?.simulations.findIndex((simulation) => simulation.row && row === `${replay.root.dataset.run}-t${simulation.row[0]}-s${simulation.row[1]}`) ?? -1;
    if (index < 0) continue;
    event.preventDefault();
    replay.open(index);
    replay.root.scrollIntoView({ block: "start", behavior: "smooth" });
  }
});
