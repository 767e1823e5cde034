// The surface in WebGL: triangles once, colours of its vertices as often as the mixture changes.
const VERTEX = `#version 300 es
in vec3 place; in vec3 colour; uniform mat3 turn; uniform vec3 middle; uniform vec2 scale;
out vec3 mixed; out vec3 seen;
void main() {
  seen = turn * (place - middle);
  mixed = colour;
  gl_Position = vec4(seen.xy * scale, -seen.z * scale.y * 0.4, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 mixed; in vec3 seen; out vec4 pixel;
void main() {
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float light = 0.45 + 0.55 * abs(dot(normal, normalize(vec3(0.3, 0.5, 1.0))));
  pixel = vec4(mixed * light, 1.0);
}`;

const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer;

export class SurfaceView {
  constructor(canvas, note) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (!this.gl) {
      canvas.hidden = true;
      note.hidden = false;
      note.textContent = "This browser has no WebGL 2: only the section is shown.";
      return;
    }
    this.turn = { across: -1.1, around: 0.6, zoom: 1 };
    this.count = 0;
    this.prepare();
    this.listen();
  }

  prepare() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    this.program = program;
    this.places = gl.createBuffer();
    this.shades = gl.createBuffer();
    this.corners = gl.createBuffer();
  }

  setMesh({ vertices_mm, triangles, colours }) {
    if (!this.gl) return;
    const gl = this.gl, places = new Float32Array(bytes(vertices_mm));
    const corners = new Uint32Array(bytes(triangles));
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    places.forEach((one, i) => {
      low[i % 3] = Math.min(low[i % 3], one);
      high[i % 3] = Math.max(high[i % 3], one);
    });
    this.middle = low.map((one, i) => (one + high[i]) / 2);
    this.size = Math.hypot(...low.map((one, i) => high[i] - one)) || 1;
    this.count = corners.length;
    this.fill(this.places, "place", places, gl.FLOAT, false);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.corners);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    this.setColours(colours);
  }

  setColours(colours) {
    if (!this.gl) return;
    this.fill(this.shades, "colour", new Uint8Array(bytes(colours)), this.gl.UNSIGNED_BYTE, true);
    this.draw();
  }

  fill(buffer, name, data, type, normalised) {
    const gl = this.gl, where = gl.getAttribLocation(this.program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(where);
    gl.vertexAttribPointer(where, 3, type, normalised, 0, 0);
  }

  draw() {
    const gl = this.gl, { across, around, zoom } = this.turn;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.count) return;
    const [ca, sa, cr, sr] = [Math.cos(across), Math.sin(across), Math.cos(around), Math.sin(around)];
    const where = (name) => gl.getUniformLocation(this.program, name);
    gl.uniformMatrix3fv(where("turn"), false, [cr, ca * sr, sa * sr, -sr, ca * cr, sa * cr, 0, -sa, ca]);
    gl.uniform3fv(where("middle"), this.middle);
    const scale = 2.3 * zoom / this.size, wide = this.canvas.height / this.canvas.width;
    gl.uniform2f(where("scale"), scale * wide, scale);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
  }

  listen() {
    const canvas = this.canvas;
    canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
    canvas.onpointermove = (event) => {
      if (event.buttons) this.rotate(event.movementX * 0.01, event.movementY * 0.01);
    };
    canvas.onwheel = (event) => {
      event.preventDefault();
      this.turn.zoom = Math.min(20, Math.max(0.2, this.turn.zoom * Math.exp(-event.deltaY * 0.001)));
      this.draw();
    };
    canvas.onkeydown = (event) => {
      const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      if (by) { event.preventDefault(); this.rotate(...by); }
    };
  }

  rotate(around, across) {
    this.turn.around += around;
    this.turn.across += across;
    this.draw();
  }
}
