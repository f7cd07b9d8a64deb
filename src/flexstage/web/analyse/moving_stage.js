// Animation of a stage: its surface in the colours of a field, in top or 3D view.
// The graphics processor moves the corners, so that a frame needs one number; without WebGL 2 the canvas is painted.
const PERIOD = 1800; // of the displayed motion [ms]
const SHADER = {
  vertex: `#version 300 es
    in vec3 point; in vec4 state;
    uniform mat3 turn; uniform vec3 centre; uniform vec3 scale; uniform vec2 shift; uniform float moved; uniform float nearer;
    out vec3 place; out float value;
    void main() {
      place = turn * (point - centre + moved * state.xyz);
      value = state.w;
      gl_Position = vec4(place.xy * scale.xy + shift, -place.z * scale.z - nearer, 1.0);
    }`,
  fragment: `#version 300 es
    precision highp float;
    in vec3 place; in float value;
    uniform sampler2D colours; uniform vec4 plain; uniform bool filled;
    out vec4 colour;
    void main() {
      if (!filled) { colour = vec4(plain.rgb * plain.a, plain.a); return; }
      vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
      vec4 field = texture(colours, vec2(clamp(value, 0.0, 1.0), 0.5));
      vec3 seen = value < -0.001 ? plain.rgb : mix(plain.rgb, field.rgb, field.a);
      colour = vec4(seen * (0.68 + 0.32 * abs(normal.z)), 1.0);
    }`,
};

function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}

export default {
  template: `
    <div class="moving">
      <div class="moving-tools">
        <q-btn dense outline no-caps color="link" :icon="playing ? 'pause' : 'play_arrow'" :label="playing ? 'Pause' : 'Play'" @click="toggle" />
        <label class="small">Amplitude <input type="range" min="0" max="3" step="0.05" v-model.number="amplitude" aria-label="Amplitude" @input="draw"></label>
        <span class="small muted">{{ magnified }}</span>
        <span class="moving-views">
          <q-btn dense flat no-caps color="link" label="Top view" :aria-pressed="String(above)" @click="look(true)" />
          <q-btn dense flat no-caps color="link" label="3D view" :aria-pressed="String(!above)" @click="look(false)" v-if="!geometry.flat" />
          <q-btn dense flat color="link" icon="zoom_in" aria-label="Zoom in" @click="zoom(1.4)" />
          <q-btn dense flat color="link" icon="zoom_out" aria-label="Zoom out" @click="zoom(1 / 1.4)" />
        </span>
      </div>
      <div class="moving-picture">
        <canvas ref="canvas" tabindex="0" role="img" :aria-label="caption" @keydown="pressed" @pointerdown="grasp"
          @pointermove="drag" @pointerup="grasped = null" @pointercancel="grasped = null" @wheel="wheel" @dblclick="look(above)"></canvas>
        <div class="moving-bar" v-if="bar">
          <span class="moving-title">{{ bar.title }}</span>
          <span class="moving-colours" :style="gradient"></span>
          <span class="moving-ticks"><span v-for="tick in bar.ticks" :style="{ bottom: 100 * tick[0] + '%' }">{{ tick[1] }}</span></span>
        </div>
      </div>
    </div>`,
  props: { geometry: Object, state: Object },
  data() {
    return { playing: false, amplitude: 1, above: true, bar: null, caption: "", factor: 0, grasped: null };
  },
  computed: {
    gradient() { return { backgroundImage: `linear-gradient(to top, ${this.bar.colours.join(",")})` }; },
    magnified() {
      return this.factor ? `motion × ${Number((this.factor * this.amplitude).toPrecision(3)).toLocaleString("en-US").replace(/,/g, "\u202f")}` : "not to scale";
    },
  },
  mounted() {
    this.above = this.geometry.flat || !this.geometry.space;
    this.view = { yaw: 0, pitch: 0, zoom: 1, x: 0, y: 0 };
    this.phase = Math.PI / 2;
    const canvas = this.$refs.canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true });
    this.brush = this.gl ? null : canvas.getContext("2d");
    this.unpack();
    if (this.gl) this.upload();
    this.show(this.state);
    this.look(this.above);
    this.sized = new ResizeObserver(() => this.draw());
    this.sized.observe(this.$refs.canvas);
    // colours follow the theme of the page
    this.dressed = new MutationObserver(() => requestAnimationFrame(() => this.draw()));
    this.dressed.observe(document.body, { attributes: true, attributeFilter: ["class"] });
    if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.toggle();
  },
  beforeUnmount() {
    this.playing = false;
    this.sized?.disconnect();
    this.dressed?.disconnect();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  },
  methods: {
    unpack() {
      this.points = new Float32Array(bytes(this.geometry.points));
      this.triangles = new Uint32Array(bytes(this.geometry.triangles));
      this.edges = new Uint32Array(bytes(this.geometry.edges));
      this.low = [Infinity, Infinity, Infinity];
      this.high = [-Infinity, -Infinity, -Infinity];
      this.points.forEach((v, i) => {
        this.low[i % 3] = Math.min(this.low[i % 3], v);
        this.high[i % 3] = Math.max(this.high[i % 3], v);
      });
      this.centre = this.low.map((v, i) => 0.5 * (v + this.high[i]));
    },
    upload() {
      const gl = this.gl, program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, SHADER.vertex], [gl.FRAGMENT_SHADER, SHADER.fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      }
      gl.bindAttribLocation(program, 0, "point");
      gl.bindAttribLocation(program, 1, "state");
      gl.linkProgram(program);
      gl.useProgram(program);
      this.at = (name) => gl.getUniformLocation(program, name);
      this.fill(gl.ARRAY_BUFFER, this.points);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      this.states = gl.createBuffer();
      this.surface = this.fill(gl.ELEMENT_ARRAY_BUFFER, this.triangles);
      this.lines = this.fill(gl.ELEMENT_ARRAY_BUFFER, this.edges);
      gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
      for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
        [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, key, value);
      gl.enable(gl.DEPTH_TEST);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    },
    fill(kind, data) {
      const buffer = this.gl.createBuffer();
      this.gl.bindBuffer(kind, buffer);
      this.gl.bufferData(kind, data, this.gl.STATIC_DRAW);
      return buffer;
    },
    show(state) {
      this.bar = state.bar;
      this.caption = state.caption;
      this.factor = state.factor;
      this.now = state;
      this.values = new Int16Array(bytes(state.values));
      if (this.gl) this.send(state.bar.colours);
      this.draw();
    },
    send(colours) {
      const gl = this.gl;
      const stops = colours.flatMap((c) => [1, 3, 5, 7].map((i) => parseInt(c.slice(i, i + 2), 16)));
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(stops));
      gl.bindBuffer(gl.ARRAY_BUFFER, this.states);
      gl.bufferData(gl.ARRAY_BUFFER, this.values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(1);
      gl.vertexAttribPointer(1, 4, gl.SHORT, true, 0, 0);
    },
    toggle() {
      this.playing = !this.playing;
      this.last = null;
      if (this.playing) requestAnimationFrame(this.step);
    },
    step(time) {
      if (!this.playing) return;
      if (this.last !== null) this.phase += (2 * Math.PI * (time - this.last)) / PERIOD;
      this.last = time;
      this.draw();
      requestAnimationFrame(this.step);
    },
    look(above) {
      this.above = above;
      Object.assign(this.view, { yaw: above ? 0 : 0.45, pitch: above ? 0 : -0.9, zoom: 1, x: 0, y: 0 });
      this.draw();
    },
    turn() {
      const { yaw, pitch } = this.view;
      const c = Math.cos(yaw), s = Math.sin(yaw), d = Math.cos(pitch), e = Math.sin(pitch);
      // rotation about z, then about the horizontal; in columns
      return [c, s * d, s * e, -s, c * d, c * e, 0, -e, d];
    },
    fitted(turn, width, height) {
      // extent of the stage at rest in both directions of the picture
      const half = this.low.map((v, i) => 0.5 * (this.high[i] - v));
      const reach = [0, 1].map((i) => [0, 1, 2].reduce((sum, k) => sum + Math.abs(turn[3 * k + i]) * half[k], 0));
      const pixels = Math.min(width / reach[0], height / reach[1]) * 0.43 * this.view.zoom;
      return [(2 * pixels) / width, (2 * pixels) / height, 0.4 / Math.hypot(...half)];
    },
    draw() {
      const canvas = this.$refs.canvas;
      if (!canvas || !canvas.clientWidth || !this.now) return;
      const dense = this.gl ? Math.min(window.devicePixelRatio || 1, 2) : 1;
      const width = Math.round(canvas.clientWidth * dense), height = Math.round(canvas.clientHeight * dense);
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      const look = getComputedStyle(canvas), turn = this.turn(), scale = this.fitted(turn, width, height);
      const share = this.playing ? (this.now.swings ? Math.sin(this.phase) : 0.5 - 0.5 * Math.cos(this.phase)) : 1;
      const moved = this.now.reach * this.amplitude * share;
      if (this.gl) this.render(look, turn, scale, moved);
      else this.paint(look, turn, scale, moved);
    },
    render(look, turn, scale, moved) {
      const gl = this.gl;
      gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix3fv(this.at("turn"), false, turn);
      gl.uniform3fv(this.at("centre"), this.centre);
      gl.uniform3fv(this.at("scale"), scale);
      gl.uniform2f(this.at("shift"), this.view.x, this.view.y);
      // the stage at rest, behind the moving one
      gl.disable(gl.DEPTH_TEST);
      this.mesh(look, "--muted", 0.5, this.lines, gl.LINES, this.edges, 0, 0);
      gl.enable(gl.DEPTH_TEST);
      this.mesh(look, "--body", 1, this.surface, gl.TRIANGLES, this.triangles, moved, 0);
      this.mesh(look, "--ink", 0.75, this.lines, gl.LINES, this.edges, moved, 0.001);
    },
    paint(look, turn, scale, moved) {
      const brush = this.brush, { width, height } = brush.canvas, count = this.points.length / 3;
      const place = (by) => {
        const at = new Float32Array(3 * count);
        for (let i = 0; i < count; i += 1) {
          const p = [0, 1, 2].map((k) => this.points[3 * i + k] - this.centre[k] + (by * this.values[4 * i + k]) / 32767);
          const [x, y, z] = [0, 1, 2].map((k) => turn[k] * p[0] + turn[3 + k] * p[1] + turn[6 + k] * p[2]);
          at.set([0.5 * width * (1 + x * scale[0] + this.view.x), 0.5 * height * (1 - y * scale[1] - this.view.y), z], 3 * i);
        }
        return at;
      };
      const lines = (at, colour, strength) => {
        brush.beginPath();
        this.edges.forEach((e, i) => brush[i % 2 ? "lineTo" : "moveTo"](at[3 * e], at[3 * e + 1]));
        Object.assign(brush, { strokeStyle: look.getPropertyValue(colour), globalAlpha: strength, lineWidth: 1 });
        brush.stroke();
        brush.globalAlpha = 1;
      };
      brush.clearRect(0, 0, width, height);
      lines(place(0), "--muted", 0.5);
      const at = place(moved), corners = this.triangles, colours = this.now.bar.colours, last = colours.length - 1;
      const sum = (t, of) => of(corners[3 * t]) + of(corners[3 * t + 1]) + of(corners[3 * t + 2]);
      const far = Float32Array.from({ length: corners.length / 3 }, (_, t) => sum(t, (c) => at[3 * c + 2]));
      // painted from back to front
      for (const t of Uint32Array.from(far.keys()).sort((a, b) => far[a] - far[b])) {
        const value = sum(t, (c) => this.values[4 * c + 3]) / 98301;
        brush.beginPath();
        for (let k = 0; k < 3; k += 1) brush.lineTo(at[3 * corners[3 * t + k]], at[3 * corners[3 * t + k] + 1]);
        brush.closePath();
        for (const colour of [look.getPropertyValue("--body"), value < 0 ? null : colours[Math.round(Math.min(value, 1) * last)]]) {
          if (!colour) continue;
          Object.assign(brush, { fillStyle: colour, strokeStyle: colour, lineWidth: 0.6 });
          brush.fill();
          brush.stroke();
        }
      }
      lines(at, "--ink", 0.75);
    },
    mesh(look, colour, strength, buffer, kind, indices, moved, nearer) {
      const gl = this.gl, hex = look.getPropertyValue(colour).trim();
      gl.uniform4f(this.at("plain"), ...[1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255), strength);
      gl.uniform1i(this.at("filled"), kind === gl.TRIANGLES ? 1 : 0);
      gl.uniform1f(this.at("moved"), moved);
      gl.uniform1f(this.at("nearer"), nearer);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.drawElements(kind, indices.length, gl.UNSIGNED_INT, 0);
    },
    grasp(event) {
      this.grasped = [event.clientX, event.clientY];
      event.target.setPointerCapture(event.pointerId);
    },
    drag(event) {
      if (!this.grasped) return;
      const canvas = this.$refs.canvas, [x, y] = this.grasped;
      const dx = (event.clientX - x) / canvas.clientWidth, dy = (event.clientY - y) / canvas.clientHeight;
      this.grasped = [event.clientX, event.clientY];
      if (this.above) Object.assign(this.view, { x: this.view.x + 2 * dx, y: this.view.y - 2 * dy });
      else this.tilt(4 * dx, 4 * dy);
      this.draw();
    },
    tilt(yaw, pitch) {
      this.view.yaw += yaw;
      this.view.pitch = Math.min(Math.max(this.view.pitch + pitch, -Math.PI), Math.PI);
    },
    wheel(event) {
      // without focus the wheel scrolls the page
      if (document.activeElement !== this.$refs.canvas) return;
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 500));
    },
    zoom(by) {
      this.view.zoom = Math.min(Math.max(this.view.zoom * by, 0.3), 30);
      this.draw();
    },
    pressed(event) {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (way && this.above) Object.assign(this.view, { x: this.view.x - 0.1 * way[0], y: this.view.y + 0.1 * way[1] });
      else if (way) this.tilt(0.1 * way[0], 0.1 * way[1]);
      else if (event.key === "+" || event.key === "=") this.zoom(1.2);
      else if (event.key === "-") this.zoom(1 / 1.2);
      else if (event.key === "Home") this.look(this.above);
      else if (event.key === " ") this.toggle();
      else return;
      event.preventDefault();
      this.draw();
    },
  },
};
