// A chart that follows what is measured: it asks the server for what it lacks, and draws it.
import { Points, axes, clipped, curve, extent, keptRange, loop, readable, written } from "live_drawing";

const PERIOD = 45; // from one question to the next [ms]
const PATIENCE = 1500; // after a question without an answer [ms]
const READ = 200; // from one text to the next [ms]
const MARGIN = { left: 70, right: 14, top: 10, bottom: 46, between: 16 };

export default {
  template: `
    <div role="group" :aria-label="says">
      <div class="live-tools">
        <div v-if="mode === 'time'" class="live-choice" role="group" aria-label="Window">
          <button v-for="w in windows" type="button" :aria-pressed="String(follows && length === w)" @click="choose(w)">{{ lasting(w) }}</button>
        </div>
        <template v-if="mode === 'loop'">
          <label>x <select v-model.number="loopX" @change="changed()"><option v-for="(c, k) in channels" :value="k">{{ c.name }}</option></select></label>
          <label>y <select v-model.number="loopY" @change="changed()"><option v-for="(c, k) in channels" :value="k">{{ c.name }}</option></select></label>
          <label>last <select v-model.number="loopLength" @change="changed()"><option v-for="s in [1, 2, 5, 10, 30, 60]" :value="s">{{ s }} s</option></select></label>
        </template>
        <button type="button" :aria-pressed="String(!follows)" @click="toggle()">{{ follows ? "Pause" : "Follow" }}</button>
        <button v-if="channels.length > 1" type="button" :aria-pressed="String(mode === 'loop')" @click="switchMode()">Loop</button>
        <span class="muted small live-where" ref="where"></span>
      </div>
      <canvas ref="canvas" tabindex="0" role="img" :aria-label="described" aria-keyshortcuts="Space ArrowLeft ArrowRight + - Home"
        @keydown="pressed" @wheel="turned" @pointerdown="down" @pointermove="moved" @pointerup="up" @pointercancel="up"
        @pointerleave="left" @dblclick="followAgain()"></canvas>
      <ul class="live-readout" ref="readout">
        <li v-for="(c, k) in channels"><button type="button" :aria-pressed="String(!hidden.includes(k))" @click="hide(k)">
          <span class="swatch" aria-hidden="true" :style="{ background: 'var(--data' + (k % 6) + ')' }"></span>
          <span>{{ c.name }}</span> <span class="number value">–</span> <span>{{ c.unit }}</span></button></li>
      </ul>
      <p class="hidden-title" role="status">{{ told }}</p>
    </div>`,
  props: { address: String, channels: Array, rate: Number, seconds: Number, windows: Array, says: String, loop: Array, view: Object },
  data() {
    const named = (name, otherwise) => Math.max(this.channels.findIndex((c) => c.name === name), otherwise);
    const usual = {
      mode: this.loop ? "loop" : "time",
      length: this.windows[0],
      loopX: this.loop ? named(this.loop[0], 0) : 0,
      loopY: this.loop ? named(this.loop[1], 0) : Math.min(1, this.channels.length - 1),
      loopLength: 5,
      hidden: [],
    };
    return { ...usual, ...this.view, follows: true, told: "" };
  },
  computed: {
    panels() {
      const found = new Map();
      this.channels.forEach((channel, index) => {
        if (!found.has(channel.quantity)) found.set(channel.quantity, { title: titled(channel.label, channel.unit), shown: [] });
        if (!this.hidden.includes(index)) found.get(channel.quantity).shown.push({ ...channel, index });
      });
      const panels = [...found.values()];
      return panels.some((panel) => panel.shown.length) ? panels.filter((panel) => panel.shown.length) : panels.slice(0, 1);
    },
    described() {
      const what = this.mode === "loop" ? `${this.channels[this.loopY].name} over ${this.channels[this.loopX].name}` : this.channels.map((c) => c.name).join(", ");
      return `${this.says}: ${what}. Space pauses, arrows move, plus and minus zoom, Home follows again; the values stand below.`;
    },
  },
  created() {
    this.points = new Points(this.channels.length);
    this.got = null; // what the last answer said
    this.ranges = new Map();
    this.frames = 0;
    this.end = 0;
    this.busy = this.gone = false;
    this.cursor = this.dragged = null;
    this.readAt = 0;
  },
  mounted() {
    this.$el.live = this;
    this.observers = [new ResizeObserver(() => this.draw()), new MutationObserver(() => this.relook())];
    this.observers[0].observe(this.$refs.canvas);
    this.observers[1].observe(document.body, { attributes: true, attributeFilter: ["class"] });
    this.wake = () => this.ask();
    document.addEventListener("visibilitychange", this.wake);
    this.relook();
    this.ask();
  },
  unmounted() {
    this.gone = true;
    clearTimeout(this.timer);
    this.observers.forEach((observer) => observer.disconnect());
    document.removeEventListener("visibilitychange", this.wake);
  },
  methods: {
    lasting: (seconds) => (seconds < 60 ? `${seconds} s` : seconds < 3600 ? `${seconds / 60} min` : `${seconds / 3600} h`),

    // what is asked

    question() {
      const looped = this.mode === "loop";
      const length = looped ? this.loopLength : this.length;
      const asked = new URLSearchParams({ length });
      if (!this.follows) asked.set("end", this.end);
      if (looped) asked.set("loop", 1);
      const same = this.got && this.got.looped === looped && this.got.length === length;
      if (this.follows && same && this.got.follows && this.points.count > 1) {
        asked.set("generation", this.got.generation);
        asked.set("tier", this.got.tier);
        // the last bin may have become fuller
        asked.set("after", this.points.times[this.points.last - (this.got.step > 0 ? 1 : 0)]);
      }
      return { address: `${window.path_prefix ?? ""}${this.address}?${asked}`, length, looped, follows: this.follows };
    },
    async ask() {
      clearTimeout(this.timer);
      if (this.gone || this.busy || document.hidden) return;
      const began = performance.now();
      const question = this.question();
      this.asked = question.address;
      this.busy = true;
      let wait = PERIOD;
      try {
        const answer = await fetch(question.address);
        if (answer.status === 200) this.take(await answer.arrayBuffer(), question);
        else wait = PATIENCE;
      } catch {
        wait = PATIENCE;
      }
      this.busy = false;
      if (this.gone) return;
      await new Promise((drawn) => requestAnimationFrame(drawn));
      this.draw();
      const stale = !this.follows && this.question().address !== this.asked;
      if (this.follows || stale || wait > PERIOD) this.timer = setTimeout(() => this.ask(), Math.max(wait - (performance.now() - began), 0));
    },
    take(buffer, question) {
      const head = new Float64Array(buffer, 0, 9);
      const [generation, tier, step, newest, begin, end, count, both, origin] = head;
      const channels = this.channels.length;
      const times = new Float64Array(buffer, 72, count);
      const low = new Float32Array(buffer, 72 + 8 * count, count * channels);
      const high = both ? new Float32Array(buffer, 72 + 8 * count + 4 * count * channels, count * channels) : low;
      const goesOn = question.address.includes("&after=") && this.got.generation === generation && this.got.tier === tier;
      if (!goesOn) this.points.clear();
      this.points.both = both > 0;
      this.points.add(times, low, high);
      this.points.dropBefore(begin - step);
      this.got = { ...question, generation, tier, step, newest, begin, end, origin };
    },

    // what is drawn

    relook() {
      const style = getComputedStyle(this.$el);
      const colour = (name) => style.getPropertyValue(name).trim();
      this.look = { font: `12px ${style.fontFamily}`, ink: colour("--ink"), muted: colour("--muted"), grid: colour("--grid"), data: [0, 1, 2, 3, 4, 5].map((k) => colour(`--data${k}`)) };
      this.draw();
    },
    draw() {
      const canvas = this.$refs.canvas;
      if (!canvas || !this.look) return;
      const scale = window.devicePixelRatio || 1;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
        canvas.width = Math.round(width * scale);
        canvas.height = Math.round(height * scale);
      }
      const context = canvas.getContext("2d");
      context.setTransform(scale, 0, 0, scale, 0, 0);
      context.clearRect(0, 0, width, height);
      const whole = { left: MARGIN.left, top: MARGIN.top, width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom };
      this.titles = [];
      if (this.mode === "loop") this.drawLoop(context, whole);
      else this.drawTime(context, whole);
      const titles = JSON.stringify(this.titles);
      if (canvas.dataset.axes !== titles) canvas.dataset.axes = titles;
      this.frames += 1;
      this.read();
    },
    /** The times of the window, in what they are shown. */
    times() {
      const end = this.follows ? this.got?.newest || 0 : this.end;
      const [unit, seconds] = this.length > 120 ? ["min", 60] : ["s", 1];
      return { begin: end - this.length, end, unit, seconds, origin: this.got?.origin || 0 };
    },
    drawTime(context, whole) {
      const { begin, end, unit, seconds, origin } = this.times();
      const x = { low: (begin - origin) / seconds, high: (end - origin) / seconds };
      const gap = Math.max(5 / this.rate, 1.5 * (this.got?.step || 0));
      const each = (whole.height - MARGIN.between * (this.panels.length - 1)) / this.panels.length;
      this.boxes = [];
      this.panels.forEach((panel, row) => {
        const box = { ...whole, top: whole.top + row * (each + MARGIN.between), height: each };
        const range = keptRange(this.ranges.get(panel.title), ...extent(this.points, panel.shown, begin, end));
        this.ranges.set(panel.title, range);
        const below = row === this.panels.length - 1;
        x.title = below ? `Time [${unit}]` : "";
        const { toX, toY } = axes(context, box, x, { low: range[0], high: range[1], title: panel.title }, this.look);
        this.titles.push({ axis: `y${row + 1}`, title: panel.title });
        if (below) this.titles.push({ axis: "x", title: x.title });
        this.toTime = (place) => begin + ((place - box.left) / box.width) * this.length;
        const place = (time) => toX((time - origin) / seconds);
        clipped(context, box, () => {
          for (const { index, factor } of panel.shown) curve(context, this.points, index, factor, this.look.data[index % 6], place, toY, gap);
          this.drawCursor(context, box, place);
        });
        this.boxes.push(box);
      });
    },
    drawCursor(context, box, place) {
      if (this.dragged && this.cursor !== null) {
        context.globalAlpha = 0.15;
        context.fillStyle = this.look.ink;
        context.fillRect(place(this.dragged.time), box.top, place(this.cursor) - place(this.dragged.time), box.height);
        context.globalAlpha = 1;
      }
      if (this.cursor === null) return;
      context.strokeStyle = this.look.ink;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(place(this.cursor), box.top);
      context.lineTo(place(this.cursor), box.top + box.height);
      context.stroke();
    },
    drawLoop(context, box) {
      const [across, up] = [this.channels[this.loopX], this.channels[this.loopY]];
      const range = (channel, index) => {
        const key = `loop ${channel.name}`;
        this.ranges.set(key, keptRange(this.ranges.get(key), ...extent(this.points, [{ index, factor: channel.factor }], -Infinity, Infinity)));
        return this.ranges.get(key);
      };
      const named = (channel) => titled(`${channel.name}: ${channel.label}`, channel.unit);
      const [x, y] = [range(across, this.loopX), range(up, this.loopY)];
      this.titles = [{ axis: "x", title: named(across) }, { axis: "y", title: named(up) }];
      const { toX, toY } = axes(context, box, { low: x[0], high: x[1], title: named(across) }, { low: y[0], high: y[1], title: named(up) }, this.look);
      clipped(context, box, () => loop(context, this.points, [this.loopX, this.loopY], [across.factor, up.factor], this.look.data[this.loopY % 6], toX, toY));
    },
    /** Write the values at the cursor, or the newest, as text. */
    read() {
      const now = performance.now();
      if (now - this.readAt < READ || !this.$refs.readout) return;
      this.readAt = now;
      const { points } = this;
      const at = this.cursor === null ? points.last : points.nearest(this.cursor);
      this.$refs.readout.querySelectorAll(".value").forEach((value, index) => {
        const { factor } = this.channels[index];
        const [low, high] = points.count ? [points.low, points.high].map((v) => readable(factor * v[at * points.channels + index])) : ["–", "–"];
        const text = low === high ? low : `${low} … ${high}`;
        if (value.textContent !== text) value.textContent = text;
      });
      this.$refs.where.textContent = !points.count ? "no samples yet" : this.cursor === null ? "" : `at ${written(points.times[at] - this.got.origin, 0.001)} s`;
    },

    // what a person does

    changed() {
      const { mode, length, loopX, loopY, loopLength, hidden } = this;
      this.$emit("view", { mode, length, loopX, loopY, loopLength, hidden });
      this.readAt = 0;
      this.draw();
      this.ask();
    },
    choose(length) {
      this.length = length;
      this.followAgain();
    },
    followAgain() {
      this.follows = true;
      if (!this.windows.includes(this.length) && this.mode === "time") this.length = this.windows.reduce((a, b) => (Math.abs(b - this.length) < Math.abs(a - this.length) ? b : a));
      this.told = `follows, ${this.lasting(this.length)}`;
      this.changed();
    },
    toggle() {
      if (!this.follows) return this.followAgain();
      this.halt();
      this.changed();
    },
    halt() {
      if (!this.follows) return;
      this.end = this.got?.newest || 0;
      this.follows = false;
      this.told = "paused";
    },
    switchMode() {
      this.mode = this.mode === "loop" ? "time" : "loop";
      this.cursor = null;
      this.points.clear();
      this.changed();
    },
    hide(index) {
      this.hidden = this.hidden.includes(index) ? this.hidden.filter((k) => k !== index) : [...this.hidden, index];
      this.changed();
    },
    /** Show another while; at the newest sample it follows again. */
    show(begin, end) {
      const newest = this.got?.newest || 0;
      const length = Math.min(Math.max(end - begin, 4 / this.rate), this.seconds);
      this.halt();
      this.length = length;
      this.end = Math.min(0.5 * (begin + end) + 0.5 * length, newest);
      this.told = `${written(this.end - length - this.got.origin, 0.01)} s to ${written(this.end - this.got.origin, 0.01)} s`;
      this.changed();
    },
    zoom(factor, about = null) {
      const { begin, end } = this.times();
      const middle = about ?? 0.5 * (begin + end);
      this.show(middle + (begin - middle) * factor, middle + (end - middle) * factor);
    },
    pressed(event) {
      if (event.ctrlKey || event.altKey || event.metaKey || this.mode === "loop" && event.key !== " ") return;
      const { begin, end } = this.times();
      const by = 0.1 * (end - begin);
      const actions = {
        " ": () => this.toggle(),
        Home: () => this.followAgain(),
        "+": () => this.zoom(0.5),
        "=": () => this.zoom(0.5),
        "-": () => this.zoom(2),
        ArrowLeft: () => (event.shiftKey ? this.point(-1) : this.show(begin - by, end - by)),
        ArrowRight: () => (event.shiftKey ? this.point(1) : this.show(begin + by, end + by)),
      };
      if (!(event.key in actions)) return;
      event.preventDefault();
      event.stopPropagation();
      actions[event.key]();
    },
    /** Move the cursor by some of the width, and say what is there. */
    point(direction) {
      const { begin, end } = this.times();
      this.halt();
      this.cursor = Math.min(Math.max((this.cursor ?? 0.5 * (begin + end)) + 0.02 * direction * (end - begin), begin), end);
      this.readAt = 0;
      this.draw();
      this.told = `${this.$refs.where.textContent}: ${[...this.$refs.readout.querySelectorAll("li")].map((line) => line.textContent.trim()).join(", ")}`;
    },
    turned(event) {
      // a wheel over a chart that nobody has chosen scrolls the page
      if (this.mode === "loop" || !(event.ctrlKey || document.activeElement === this.$refs.canvas)) return;
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.follows ? this.times().end : this.toTime(event.offsetX));
    },
    down(event) {
      if (this.mode === "loop" || event.button !== 0) return;
      this.$refs.canvas.setPointerCapture(event.pointerId);
      this.halt();
      this.dragged = { from: event.offsetX, time: this.toTime(event.offsetX), ...this.times(), pans: event.shiftKey };
    },
    moved(event) {
      if (this.mode === "loop") return;
      this.cursor = this.toTime(event.offsetX);
      if (this.dragged?.pans) {
        const by = ((this.dragged.from - event.offsetX) / this.boxes[0].width) * this.length;
        this.cursor = null;
        this.show(this.dragged.begin + by, this.dragged.end + by);
      } else if (!this.follows) this.draw();
    },
    up(event) {
      const dragged = this.dragged;
      this.dragged = null;
      if (!dragged || dragged.pans) return;
      if (Math.abs(event.offsetX - dragged.from) > 6) {
        const other = this.toTime(event.offsetX);
        this.show(Math.min(dragged.time, other), Math.max(dragged.time, other));
      } else this.changed();
    },
    left() {
      if (this.dragged) return;
      this.cursor = null;
      this.readAt = 0;
      this.draw();
    },
  },
};

function titled(label, unit) {
  return unit ? `${label} [${unit}]` : label;
}
