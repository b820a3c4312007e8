// Charts over time with the cursor of the replay.

/** Makes an element; texts are never markup. */
function element(tag, attributes = {}, children = []) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") made.textContent = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/** Formats a measured number with at most four significant digits. */
function short(value) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "–" : value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  const text = size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(2) : Number(value.toPrecision(4)).toString();
  return text.replace("-", "−");
}

/** A strip of time: a canvas with a cursor that the pointer moves. Subclasses draw it. */
class Strip {
  constructor(name, seek) {
    this.canvas = element("canvas");
    this.cursor = element("div", { class: "replay-cursor" });
    this.area = element("div", { class: name }, [this.canvas, this.cursor]);
    this.last = 1;
    const move = (event) => {
      const { left, width } = this.area.getBoundingClientRect();
      seek(Math.round(clamp((event.clientX - left) / width, 0, 1) * this.last));
    };
    this.area.addEventListener("pointerdown", (event) => {
      this.area.setPointerCapture(event.pointerId);
      move(event);
    });
    this.area.addEventListener("pointermove", (event) => event.buttons && move(event));
  }
  show(time) {
    this.cursor.style.left = `${(100 * time) / this.last}%`;
    if (this.area.role) this.area.setAttribute("aria-valuenow", Math.round(time));
  }

  /** Prepares the canvas and shades what is violated: its context, width and height. */
  begin(look, motion) {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.area;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const paper = this.canvas.getContext("2d");
    paper.scale(ratio, ratio);
    const x = (sample) => (width * sample) / this.last;
    const shade = (from, to, color) => {
      paper.fillStyle = color;
      paper.fillRect(x(Math.max(from, 0)), 0, Math.max(x(Math.min(to, this.last)) - x(Math.max(from, 0)), 1), height);
    };
    if (motion.window) shade(...motion.window, look.window);
    motion.violated.forEach(([from, to]) => shade(from - 0.5, to + 0.5, look.shade));
    return { paper, x, width, height };
  }
  mark(paper, x, height, motion, look) {
    if (motion.decided === null) return;
    paper.fillStyle = look.fail;
    paper.fillRect(x(motion.decided) - 0.75, 0, 1.5, height);
  }
}

/** The time line below the picture. */
class TimeLine extends Strip {
  constructor(seek) {
    super("replay-line", seek);
    const facts = { role: "slider", tabindex: 0, "aria-label": "control step", "aria-valuemin": 0 };
    Object.entries(facts).forEach(([name, value]) => this.area.setAttribute(name, value));
  }
  draw(look, motion, dt) {
    const { paper, x, width, height } = this.begin(look, motion);
    this.area.setAttribute("aria-valuemax", this.last);
    const seconds = this.last * dt;
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300].find((every) => (every / seconds) * width > 44) ?? 600;
    paper.font = "11px system-ui, sans-serif";
    for (let t = 0; t <= seconds + 1e-9; t += step) {
      paper.fillStyle = look.line;
      paper.fillRect(x(t / dt), height - 5, 1, 5);
      paper.fillStyle = look.soft;
      const text = `${Number(t.toFixed(2))} s`;
      paper.fillText(text, clamp(x(t / dt) + 3, 0, width - paper.measureText(text).width), height - 7);
    }
    this.mark(paper, x, height, motion, look);
  }
}

/** A signal, or the robustness of a predicate, of one or two simulations. */
class Plot extends Strip {
  constructor(title, unit, isRobustness, seek) {
    super("replay-plot", seek);
    const values = ["fail", "pass"].map((kind) => element("b", { class: kind }));
    const name = element("figcaption", {}, [element("span", { text: title, title }), ...values]);
    Object.assign(this, { unit, isRobustness, values, figure: element("figure", {}, [name, this.area]) });
  }
  draw(look, motion, series) {
    Object.assign(this, { series }).figure.hidden = false;
    const { paper, x, height } = this.begin(look, motion);
    const all = series.flatMap(({ values }) => [...values].filter(Number.isFinite)).concat(this.isRobustness ? [0] : []);
    let [low, high] = all.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
    this.figure.hidden = !this.isRobustness && low === high; // Such a signal has nothing to show.
    if (!(low < high)) [low, high] = all.length ? [low - 1, low + 1] : [-1, 1];
    const y = (value) => height - 3 - ((height - 6) * (value - low)) / (high - low);
    paper.fillStyle = look.soft;
    if (this.isRobustness) paper.fillRect(0, y(0) - 0.5, x(this.last), 1);
    for (const { values, color } of [...series].reverse()) {
      Object.assign(paper, { strokeStyle: color, lineWidth: 1.6, lineJoin: "round" });
      paper.beginPath();
      values.forEach((value, sample) => {
        if (Number.isFinite(value)) paper[Number.isFinite(values[sample - 1]) ? "lineTo" : "moveTo"](x(sample), y(value));
      });
      paper.stroke();
    }
    this.mark(paper, x, height, motion, look);
    paper.font = "10px system-ui, sans-serif";
    Object.assign(paper, { strokeStyle: look.chart, lineWidth: 3, fillStyle: look.soft });
    for (const [value, at] of [[high, 11], [low, height - 3]]) {
      for (const write of ["strokeText", "fillText"]) paper[write](short(value), 3, at);
    }
  }
  show(time) {
    super.show(time);
    this.values.forEach((label, index) => {
      const values = this.series?.[index]?.values;
      const unit = index === 0 && this.unit ? ` ${this.unit}` : "";
      label.textContent = values?.length ? short(values[Math.min(Math.round(time), values.length - 1)]) + unit : "";
    });
  }
}
