// A camera around a point: by mouse, touch and keyboard.

class Orbit {
  /** Starts where the pictures of the scene are taken. `changed` is called after each movement. */
  constructor(canvas, scene, changed) {
    const { eye, axes, fovy } = scene.view;
    const back = axes[2];
    const distance = Math.max(dot(sub(eye, scene.center), back), 0.3);
    this.target = sub(eye, scale(back, distance));
    this.distance = 1.08 * distance;
    this.yaw = Math.atan2(back[1], back[0]);
    this.pitch = Math.asin(clamp(back[2], -1, 1));
    Object.assign(this, { canvas, scene, changed, fovy, shift: [0, 0, 0], pointers: new Map(), moved: 0 });
    this.start = { distance: this.distance, target: this.target, yaw: this.yaw, pitch: this.pitch };
    this.listen();
  }
  reset() {
    this.changed(Object.assign(this, this.start));
  }

  /** Returns eye, axes and what else a picture needs. The scene fits into a picture of 4 to 3, and into a narrower one. */
  view(reach) {
    const { width, height } = this.canvas;
    const distance = this.distance * Math.max(1, (4 * height) / (3 * width));
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const back = [c * Math.cos(this.pitch), s * Math.cos(this.pitch), Math.sin(this.pitch)];
    const right = [-s, c, 0];
    const eye = add(add(this.target, this.shift), scale(back, distance));
    const center = add(this.scene.center, this.shift);
    return { eye, axes: [right, cross(back, right), back], fovy: this.fovy, distance, center, reach };
  }
  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = clamp(this.pitch + pitch, -1.55, 1.55);
    this.changed();
  }

  /** Moves the target by parts of the picture's height. */
  pan(x, y) {
    const { axes, distance } = this.view(1);
    const size = 2 * distance * Math.tan(this.fovy / 2);
    this.target = add(this.target, add(scale(axes[0], -x * size), scale(axes[1], y * size)));
    this.changed();
  }
  zoom(factor) {
    this.distance = clamp(this.distance * factor, 0.1 * this.start.distance, 12 * this.start.distance);
    this.changed();
  }
  listen() {
    const { canvas, pointers } = this;
    const on = (name, action) => canvas.addEventListener(name, action, { passive: false });
    const middle = () => {
      const all = [...pointers.values()];
      const at = [0, 1].map((i) => all.reduce((sum, p) => sum + p[i], 0) / all.length);
      const spread = all.length > 1 ? Math.hypot(all[0][0] - all[1][0], all[0][1] - all[1][1]) : 1;
      return { at, spread, count: all.length };
    };
    on("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      this.moved = pointers.size > 1 ? 99 : 0;
    });
    on("pointermove", (event) => {
      if (!pointers.has(event.pointerId)) return;
      const before = middle();
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      const after = middle();
      const [x, y] = [0, 1].map((i) => (after.at[i] - before.at[i]) / canvas.clientHeight);
      this.moved += Math.hypot(x, y) * canvas.clientHeight;
      if (after.count > 1) this.zoom(before.spread / (after.spread || 1));
      if (after.count > 1 || event.shiftKey || event.buttons & 6) this.pan(x, y);
      else this.turn(-3.6 * x, 3.6 * y);
    });
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => pointers.delete(event.pointerId));
    on("contextmenu", (event) => event.preventDefault());
    // The wheel scrolls the page until the picture is chosen.
    on("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault();
      this.zoom(Math.exp(clamp(event.deltaY, -120, 120) * 0.0022));
    });
  }
}
