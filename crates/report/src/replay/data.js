// Data of a page: each template holds base64 of zlib of a JSON head and numbers.

/** Returns head and bytes of a template. */
async function unpack(template) {
  const text = atob(template.content.textContent);
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const start = 4 + new DataView(bytes.buffer).getUint32(0, true);
  return { head: JSON.parse(new TextDecoder().decode(bytes.subarray(4, start))), bytes: bytes.subarray(start) };
}

/** A simulation: poses, vertices, contacts and signals of each sample. */
class Motion {
  constructor(scene, { head, bytes }) {
    Object.assign(this, head, { last: head.samples - 1 });
    const { samples } = head;
    let at = 0;
    const next = () => {
      let value = 0;
      for (let factor = 1, byte = 128; byte > 127; factor *= 128) {
        byte = bytes[at++];
        value += (byte & 127) * factor;
      }
      return value % 2 ? -(value + 1) / 2 : value / 2;
    };
    // Numbers are differences from the number before.
    const columns = (rows, widths) => {
      const out = new Float64Array(rows * widths.length);
      widths.forEach((width, column) => {
        for (let row = 0, sum = 0; row < rows; row++) {
          sum += next();
          out[row * widths.length + column] = sum * width;
        }
      });
      return out;
    };
    const point = Array(3).fill(scene.grid);
    const turn = Array(4).fill(1 / 32767);
    this.bodies = scene.bodies.map(() => columns(samples, [...point, ...turn]));
    this.vertices = scene.cloths.map((cloth) =>
      columns(samples, Array.from({ length: 3 * cloth.vertices }, () => scene.grid)));
    const counts = columns(samples, [1]);
    this.firsts = [0];
    counts.forEach((count) => this.firsts.push(this.firsts.at(-1) + count));
    this.contacts = columns(this.firsts.at(-1), [...point, ...Array(3).fill(0.01)]);
    // The predicates come first, then the signals.
    const floats = new Float32Array(bytes.slice(head.integers).buffer);
    const series = (_, index) => floats.subarray(index * head.values, (index + 1) * head.values);
    this.series = [...scene.predicates, ...scene.signals].map(series);
  }

  /** Returns position and quaternion of a body; between two samples, between their poses. */
  pose(body, time) {
    const poses = this.bodies[body];
    const t = clamp(time, 0, this.last);
    const a = 7 * Math.floor(t);
    const b = Math.min(a + 7, 7 * this.last);
    const s = t - Math.floor(t);
    const mix = (i) => poses[a + i] + s * (poses[b + i] - poses[a + i]);
    return { p: [mix(0), mix(1), mix(2)], q: [mix(3), mix(4), mix(5), mix(6)] };
  }

  /** Returns point and force of each contact at the last sample. */
  contactsAt(time) {
    const sample = Math.floor(clamp(time, 0, this.last));
    const found = [];
    for (let i = this.firsts[sample]; i < this.firsts[sample + 1]; i++) {
      const row = [...this.contacts.subarray(6 * i, 6 * i + 6)];
      found.push({ point: row.slice(0, 3), force: row.slice(3) });
    }
    return found;
  }
}
