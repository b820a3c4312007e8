// Pictures by WebGL2: a light with a shadow map, translucent ghosts, arrows, paths, and bodies under a pixel.

const VERTEX = `#version 300 es
layout(location = 0) in vec3 corner;
layout(location = 1) in vec3 direction;
uniform mat4 model, camera, lamp;
uniform vec3 size;
uniform float reach;
out vec3 place, normal, local;
out vec4 lit;
void main() {
  vec4 at = model * vec4(corner * size, 1.0);
  place = at.xyz;
  local = corner;
  normal = mat3(model) * (direction / size);
  lit = lamp * vec4(place + 0.008 * reach * normalize(normal), 1.0);
  gl_Position = camera * at;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
in vec3 place, normal, local;
in vec4 lit;
uniform vec4 color;
uniform vec3 eye, sun, sky, center;
uniform float ground, glow, rim, reach, bright;
uniform sampler2DShadow shadows;
out vec4 pixel;
float light() {
  vec3 at = 0.5 * lit.xyz / lit.w + 0.5;
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  for (int i = 0; i < 9; i++) {
    vec2 offset = vec2(i % 3 - 1, i / 3 - 1) * 1.3 / vec2(textureSize(shadows, 0));
    sum += texture(shadows, vec3(at.xy + offset, at.z - 0.0006));
  }
  return sum / 9.0;
}
void main() {
  vec3 n = normalize(normal);
  vec3 way = normalize(eye - place);
  if (dot(n, way) < 0.0) n = -n;
  vec3 base = color.rgb;
  if (ground > 0.0) {
    // Lines each half meter, which blur where they are narrower than a pixel.
    vec2 width = max(1.6 * fwidth(place.xy), vec2(0.006));
    vec2 line = smoothstep(width, vec2(0.0), abs(fract(place.xy * 2.0 - 0.5) - 0.5) / 2.0);
    base *= 1.0 - 0.09 * max(line.x, line.y) * min(0.012 / max(width.x, width.y), 1.0);
  }
  float facing = max(dot(n, sun), 0.0);
  float shine = pow(max(dot(n, normalize(sun + way)), 0.0), 48.0) * (1.0 - ground);
  float lamp = light();
  vec3 soft = mix(vec3(0.34, 0.33, 0.32), vec3(0.52, 0.53, 0.55), 0.5 + 0.5 * n.z);
  vec3 shaded = bright * base * (soft + vec3(0.5) * facing * lamp) + 0.16 * shine * lamp;
  float alpha = mix(color.a, 0.85, rim * pow(1.0 - max(dot(n, way), 0.0), 2.0));
  shaded = mix(shaded, base, glow);
  if (ground > 0.0) shaded = mix(shaded, sky, smoothstep(1.2, 4.5, length(place.xy - center.xy) / reach));
  pixel = vec4(shaded * alpha, alpha);
}`;

const IDENTITY_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 color;
out vec4 pixel;
void main() { pixel = color; }`;

// A path is a row of points; each instance is a rectangle from one to the next.
const PATH_VERTEX = `#version 300 es
layout(location = 0) in vec3 from;
layout(location = 1) in vec3 to;
uniform mat4 camera;
uniform vec2 pixels;
uniform float width;
void main() {
  vec4 a = camera * vec4(from, 1.0), b = camera * vec4(to, 1.0);
  vec2 way = (b.xy / b.w - a.xy / a.w) * pixels;
  way = length(way) > 1e-4 ? normalize(way) : vec2(1.0, 0.0);
  vec4 at = gl_VertexID < 2 ? a : b;
  float side = gl_VertexID % 2 == 0 ? 1.0 : -1.0;
  at.xy += side * width * vec2(-way.y, way.x) / pixels * at.w;
  gl_Position = at - vec4(0.0, 0.0, 0.0005 * at.w, 0.0);
}`;

const SUN = unit([0.42, -0.36, 1.0]);
const SHADOWS = 2048;

class Renderer {
  /** Makes the renderer of a scene, or throws if the browser has no WebGL2. */
  constructor(canvas, scene) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("this browser has no WebGL2");
    Object.assign(this, { gl, canvas, scene });
    this.main = this.program(VERTEX, FRAGMENT);
    this.flat = this.program(VERTEX, IDENTITY_FRAGMENT);
    this.path = this.program(PATH_VERTEX, IDENTITY_FRAGMENT);
    this.shapes = scene.shapes.map((shape) => {
      const { corners, scale: size } = solid(shape, scene.meshes);
      return { ...shape, size, ...this.buffer(corners), local: poseMatrix(shape.position, shape.quaternion) };
    });
    // The numbers of cloths follow the numbers of bodies.
    this.cloths = scene.cloths.map((cloth, index) =>
      ({ ...cloth, ...this.buffer([]), size: [1, 1, 1], body: scene.bodies.length + index }));
    this.arrow = { ...this.buffer(arrow()), size: [1, 1, 1] };
    this.points = gl.createBuffer();
    this.lines = gl.createVertexArray();
    this.shadows = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shadows);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOWS, SHADOWS);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    this.shadowFrame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadows, 0);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }
  program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error("a shader does not compile");
    const at = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      at[name] = gl.getUniformLocation(program, name);
    }
    return { program, at };
  }
  buffer(corners) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
    for (const index of [0, 1]) {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, 3, gl.FLOAT, false, 24, 12 * index);
    }
    return { buffer, array, count: corners.length / 6 };
  }
  use({ program, at }, uniforms) {
    const { gl } = this;
    gl.useProgram(program);
    this.at = at;
    for (const [name, value] of Object.entries(uniforms)) this.set(name, value);
  }
  set(name, value) {
    const { gl, at } = this;
    if (value.length === 16) gl.uniformMatrix4fv(at[name], false, value);
    else if (value.length) gl[`uniform${value.length}fv`](at[name], value);
    else gl.uniform1f(at[name], value);
  }
  paint({ array, count, size }, model, color) {
    const { gl } = this;
    this.set("model", model);
    this.set("size", size);
    this.set("color", color);
    gl.bindVertexArray(array);
    gl.drawArrays(gl.TRIANGLES, 0, count);
  }

  /** Returns what a layer shows at its time: shapes with their places. Of a ghost, only what is elsewhere. */
  placed({ motion, time, offset, other }) {
    const away = (body) => {
      const [a, b] = [motion.pose(body, time), other.motion.pose(body, other.time)];
      const turn = Math.abs(a.q.reduce((sum, v, i) => sum + v * b.q[i], 0));
      return norm(sub(a.p, b.p)) > 0.0015 || turn < 0.999998;
    };
    const bodies = this.scene.bodies.map((_, body) => {
      const { p, q } = motion.pose(body, time);
      return !other || away(body) ? poseMatrix(add(p, offset), q) : null;
    });
    const shapes = this.shapes.filter((shape) => bodies[shape.body] && !(shape.kind === "plane" && norm(offset) > 0))
      .map((shape) => ({ shape, model: multiply(bodies[shape.body], shape.local) }));
    const row = 3 * Math.floor(clamp(time, 0, motion.last));
    const model = poseMatrix(offset, [1, 0, 0, 0]);
    const cloths = this.cloths.map((shape, index) => {
      const first = row * shape.vertices;
      return { shape, model, vertices: motion.vertices[index].subarray(first, first + 3 * shape.vertices) };
    });
    return [...shapes, ...cloths];
  }

  /** Draws placed shapes; `color` returns the color of a shape. A cloth has other corners in each layer. */
  all(placed, color) {
    const { gl } = this;
    for (const { shape, model, vertices } of placed) {
      if (vertices) {
        const corners = mesh(vertices, shape.triangles, -1);
        gl.bindBuffer(gl.ARRAY_BUFFER, shape.buffer);
        gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.DYNAMIC_DRAW);
        shape.count = corners.length / 6;
      }
      this.set("ground", shape.kind === "plane" ? 1 : 0);
      this.paint(shape, model, color(shape));
    }
  }

  /** Draws a frame: layers with motion, time, offset and kind, arrows, paths, view and colors. */
  draw(frame) {
    const [{ gl }, { view, look }, { width, height }] = [this, frame, this.canvas];
    const layers = frame.layers.map((layer) => ({ ...layer, placed: this.placed(layer) }));
    const solid = layers.filter(({ isGhost }) => !isGhost).flatMap(({ placed }) => placed);
    const x = unit(cross([0, 1, 0], SUN));
    const lamp = multiply(scaleMatrix(1 / view.reach, 1 / view.reach, -0.25 / view.reach), lookMatrix(view.center, [x, cross(SUN, x), SUN]));
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.viewport(0, 0, SHADOWS, SHADOWS);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1.5, 3);
    this.use(this.flat, { camera: lamp, lamp });
    this.all(solid.filter(({ shape }) => shape.kind !== "plane" && shape.color[3] > 0.9), () => [1, 1, 1, 1]);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...look.sky, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const camera = this.camera(view, width / height);
    const uniforms = { camera, lamp, eye: view.eye, sun: SUN, sky: look.sky, center: view.center, reach: view.reach,
      bright: look.bright, rim: 0, glow: 0 };
    this.use(this.main, uniforms);
    const tint = (shape) => {
      const [r, g, b, a] = shape.color;
      if (shape.kind === "plane") return [...look.ground.map((own, i) => own * (0.75 + 0.25 * shape.color[i])), a];
      return shape.body === frame.picked ? [0.5 * r + 0.5, 0.5 * g + 0.35, 0.4 * b, a] : [r, g, b, a];
    };
    const isOpaque = ({ shape }) => shape.color[3] > 0.99;
    this.all(solid.filter(isOpaque), tint);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    this.all(solid.filter((shape) => !isOpaque(shape)), tint);
    // A ghost is a little behind what is at the same place.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    for (const { placed } of layers.filter(({ isGhost }) => isGhost)) {
      const ghost = ({ color }) => [...color.slice(0, 3).map((v, i) => 0.35 * v + 0.65 * look.ghost[i]), 0.28];
      const shown = placed.filter(({ shape }) => shape.kind !== "plane");
      // Its depth first, so that one surface of it is seen, not all that are behind each other.
      gl.depthMask(true);
      gl.colorMask(false, false, false, false);
      this.all(shown, ghost);
      gl.colorMask(true, true, true, true);
      gl.depthMask(false);
      gl.depthFunc(gl.LEQUAL);
      this.set("rim", 1);
      this.all(shown, ghost);
    }
    gl.disable(gl.POLYGON_OFFSET_FILL);
    this.paths(frame, camera);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    // Nothing hides an arrow: it is drawn over an empty depth.
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.use(this.main, { ...uniforms, glow: 0.8, ground: 0 });
    for (const { point, way } of frame.arrows) {
      const model = multiply(alongMatrix(point, way), scaleMatrix(...Array(3).fill(norm(way))));
      this.paint(this.arrow, model, [...look.arrow, 1]);
    }
  }
  camera(view, aspect) {
    const near = 0.02 * view.distance;
    return multiply(perspective(view.fovy, aspect, near, 400 * view.distance), lookMatrix(view.eye, view.axes));
  }

  /** Draws paths of points. */
  paths(frame, camera) {
    const { gl, canvas } = this;
    gl.bindVertexArray(this.lines);
    this.use(this.path, { camera, pixels: [canvas.width / 2, canvas.height / 2] });
    for (const { points, color, width } of frame.paths) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.points);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.DYNAMIC_DRAW);
      for (const index of [0, 1]) {
        gl.enableVertexAttribArray(index);
        gl.vertexAttribPointer(index, 3, gl.FLOAT, false, 12, 12 * index);
        gl.vertexAttribDivisor(index, 1);
      }
      this.set("color", color);
      this.set("width", width);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, points.length / 3 - 1);
    }
  }

  /** Returns the body at each pixel of a picture of this size, from the lower left. */
  bodies(layer, view, width, height) {
    const { gl } = this;
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const buffers = [gl.createRenderbuffer(), gl.createRenderbuffer()];
    [[gl.RGBA8, gl.COLOR_ATTACHMENT0], [gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]].forEach(([format, at], i) => {
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffers[i]);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, at, gl.RENDERBUFFER, buffers[i]);
    });
    gl.viewport(0, 0, width, height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.use(this.flat, { camera: this.camera(view, width / height) });
    this.all(this.placed(layer), ({ body }) => [body % 256, Math.floor(body / 256), 0, 255].map((v) => v / 255));
    const out = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, out);
    buffers.forEach((buffer) => gl.deleteRenderbuffer(buffer));
    gl.deleteFramebuffer(frame);
    return Array.from({ length: width * height }, (_, i) => (out[4 * i + 2] ? -1 : out[4 * i] + 256 * out[4 * i + 1]));
  }
}
