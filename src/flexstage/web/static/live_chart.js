// A chart that follows what is measured: it asks the server for what it lacks, and draws it.
import { Points, axes, clipped, envelope, extent, keptRange, line, loop, readable, written } from "live_drawing";

const PERIOD = 45; // from one question to the next [ms]
const SLOW = 1000; // the same for spectra [ms]
const PATIENCE = 1500; // after a question without an answer [ms]
const GAP = 0.5; // without a sample for longer than this, a curve is broken [s]
const READ = 200; // from one text to the next [ms]
const MARGIN = { left: 74, right: 14, top: 10, bottom: 46, between: 16 };
const MODES = { time: "Time", loop: "Loop", spectrum: "Spectrum" };
const LENGTHS = { loop: [1, 2, 5, 10, 30, 60], spectrum: [10, 60, 300, 600] };

export default {
  template: `
    <div role="group" :aria-label="says">
      <div class="live-tools">
        <div v-if="modes.length > 1" class="live-choice" role="group" aria-label="What is shown">
          <button v-for="m in modes" type="button" :aria-pressed="String(mode === m)" @click="show(m)">{{ called(m) }}</button>
        </div>
        <div v-if="mode === 'time'" class="live-choice" role="group" aria-label="Window">
          <button v-for="w in windows" type="button" :aria-pressed="String(follows && length === w)" @click="choose(w)">{{ lasting(w) }}</button>
        </div>
        <template v-if="mode === 'loop'">
          <label>x <select v-model.number="loopX" @change="keep()"><option v-for="(c, k) in channels" :value="k">{{ c.name }}</option></select></label>
          <label>y <select v-model.number="loopY" @change="keep()"><option v-for="(c, k) in channels" :value="k">{{ c.name }}</option></select></label>
        </template>
        <label v-if="mode !== 'time'">last <select v-model.number="lengths[mode]" @change="keep()"><option v-for="s in lengthsOf(mode)" :value="s">{{ lasting(s) }}</option></select></label>
        <button type="button" @click="toggle()">{{ follows ? "Pause" : "Follow" }}</button>
        <span class="muted small" ref="where"></span>
      </div>
      <canvas ref="canvas" tabindex="0" role="application" aria-roledescription="chart" :aria-label="described"
        @keydown="pressed" @wheel="turned" @pointerdown="down" @pointermove="moved" @pointerup="up" @pointercancel="up"
        @pointerleave="left" @dblclick="followAgain()"></canvas>
      <ul class="live-readout" ref="readout">
        <li v-for="(c, k) in channels"><button type="button" :aria-pressed="String(!hidden.includes(k))" @click="hide(k)">
          <span class="swatch" aria-hidden="true" :style="{ background: 'var(--data' + (k % 6) + ')' }"></span>
          <span>{{ c.name }}</span> <span class="number value">–</span> <span>{{ c.unit }}</span></button></li>
      </ul>
      <p class="hidden-title" role="status">{{ told }}</p>
    </div>`,
  props: { address: String, channels: Array, rate: Number, seconds: Number, windows: Array, says: String, begins: String, pair: Array, view: Object },
  data() {
    const usual = {
      mode: this.begins,
      length: this.windows[0],
      loopX: this.pair[0],
      loopY: this.pair[1],
      lengths: { loop: 5, spectrum: 60 },
      hidden: [],
    };
    return { ...usual, ...this.view, follows: true, told: "" };
  },
  computed: {
    modes() {
      return Object.keys(MODES).filter((mode) => mode !== "loop" || this.channels.length > 1);
    },
    panels() {
      const found = new Map();
      this.channels.forEach((channel, index) => {
        if (!found.has(channel.quantity)) found.set(channel.quantity, { ...channel, shown: [] });
        if (!this.hidden.includes(index)) found.get(channel.quantity).shown.push({ ...channel, index });
      });
      const panels = [...found.values()];
      return panels.some((panel) => panel.shown.length) ? panels.filter((panel) => panel.shown.length) : panels.slice(0, 1);
    },
    described() {
      const names = this.channels.filter((_, k) => !this.hidden.includes(k)).map((channel) => channel.name);
      const what = this.mode === "loop" ? `${this.channels[this.loopY].name} over ${this.channels[this.loopX].name}` : names.join(", ");
      const keys = this.mode === "time" ? ", arrows move, plus and minus zoom, Shift with an arrow reads a value, Home follows again" : "";
      return `${this.says}: ${MODES[this.mode]} of ${what}. Space pauses${keys}. The values stand below.`;
    },
  },
  created() {
    this.points = new Points(this.channels.length);
    this.got = null; // what the last answer said, and what was asked
    this.ranges = new Map();
    this.frames = this.answers = this.end = this.readAt = 0;
    this.busy = this.gone = false;
    this.cursor = this.pointer = this.dragged = this.wrong = null;
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
    called: (mode) => MODES[mode],
    lengthsOf: (mode) => LENGTHS[mode],
    lasting: (seconds) => (seconds < 60 ? `${seconds} s` : seconds < 3600 ? `${seconds / 60} min` : `${seconds / 3600} h`),

    // what is asked

    question() {
      const { mode, follows, got } = this;
      const length = mode === "time" ? this.length : this.lengths[mode];
      const asked = new URLSearchParams({ mode, length });
      if (!follows) asked.set("end", this.end);
      const goesOn = follows && got?.follows && got.mode === mode && got.length === length && this.points.count > 1;
      if (goesOn) {
        asked.set("generation", got.generation);
        asked.set("tier", got.tier);
        // the last bin may have become fuller
        asked.set("after", this.points.times[this.points.last - (got.step > 0 ? 1 : 0)]);
      }
      return { address: `${window.path_prefix ?? ""}${this.address}?${asked}`, length, mode, follows, goesOn };
    },
    /** Ask for what is lacking, draw it, and ask again: never twice at once, and not where nobody looks. */
    async ask() {
      clearTimeout(this.timer);
      if (this.gone || this.busy || document.hidden) return;
      const began = performance.now();
      const question = this.question();
      this.busy = true;
      let wait = PERIOD;
      try {
        const answer = await fetch(question.address);
        if (question.mode === "spectrum" && this.mode === "spectrum") wait = SLOW;
        if (answer.status !== 200) wait = PATIENCE;
        else if (answer.headers.get("content-type").startsWith("text/")) this.wrong = await answer.text();
        else this.take(await answer.arrayBuffer(), question);
      } catch {
        wait = PATIENCE;
      }
      this.busy = false;
      if (this.gone) return;
      if (this.looksOther()) {
        await new Promise((frame) => requestAnimationFrame(frame));
        this.draw();
      } else this.read();
      const other = !this.follows && this.question().address !== question.address;
      if (this.follows || other || wait === PATIENCE) this.timer = setTimeout(() => this.ask(), other ? 0 : Math.max(wait - (performance.now() - began), 0));
    },
    take(buffer, question) {
      const [generation, tier, step, newest, begin, , count, both, origin] = new Float64Array(buffer, 0, 9);
      const channels = this.channels.length;
      const size = count * channels;
      const values = new Float64Array(buffer, 72, channels);
      const times = new Float64Array(buffer, 72 + 8 * channels, count);
      const low = new Float32Array(buffer, 72 + 8 * (channels + count), size);
      const high = both ? new Float32Array(buffer, 72 + 8 * (channels + count) + 4 * size, size) : low;
      if (!question.goesOn || this.got.generation !== generation || this.got.tier !== tier) this.points.clear();
      this.points.add(times, low, high);
      if (question.mode !== "spectrum") this.points.dropBefore(begin - step);
      this.got = { ...question, generation, tier, step, newest, begin, origin, values };
      this.wrong = null;
      this.answers += 1;
    },
    /** Whether a picture drawn now would differ from the last one. */
    looksOther() {
      const { points, got } = this;
      const at = points.last * points.channels;
      const now = [points.count, points.low.subarray(at, at + points.channels), points.high.subarray(at, at + points.channels)];
      const place = got && Math.round((got.newest / got.length) * this.$refs.canvas.width);
      const looks = [this.wrong, this.mode, this.follows, place, ...now].join();
      const other = looks !== this.looks;
      this.looks = looks;
      return other;
    },

    // what is drawn

    relook() {
      const style = getComputedStyle(this.$el);
      const colour = (name) => style.getPropertyValue(name).trim();
      const data = [0, 1, 2, 3, 4, 5].map((k) => colour(`--data${k}`));
      this.look = { font: `12px ${style.fontFamily}`, ink: colour("--ink"), muted: colour("--muted"), grid: colour("--grid"), data };
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
      const drawn = this.got?.mode === this.mode && !this.wrong;
      if (this.mode === "loop") this.drawLoop(context, whole, drawn);
      else if (this.mode === "spectrum") this.drawSpectrum(context, whole, drawn);
      else this.drawTime(context, whole, drawn, scale);
      const titles = JSON.stringify(this.titles);
      if (canvas.dataset.axes !== titles) canvas.dataset.axes = titles;
      this.frames += 1;
      this.read();
    },
    /** Draw a panel for each quantity, with a common axis below. */
    drawPanels(context, whole, x, key, yOf, curves) {
      const each = (whole.height - MARGIN.between * (this.panels.length - 1)) / this.panels.length;
      this.panels.forEach((panel, row) => {
        const box = { ...whole, top: whole.top + row * (each + MARGIN.between), height: each };
        const name = `${key} ${panel.quantity}`;
        const y = yOf(panel, this.ranges.get(name));
        this.ranges.set(name, [y.low, y.high]);
        const below = row === this.panels.length - 1;
        const { toX, toY } = axes(context, box, below ? x : { ...x, title: "" }, y, this.look);
        this.titles.push({ axis: `y${row + 1}`, title: y.title }, ...(below ? [{ axis: "x", title: x.title }] : []));
        clipped(context, box, () => curves(panel, box, toX, toY));
      });
    },
    /** The times of the window, and in what they are shown. */
    times() {
      const end = this.follows ? this.got?.newest || 0 : this.end;
      const [unit, seconds] = this.length > 120 ? ["min", 60] : ["s", 1];
      return { begin: end - this.length, end, unit, seconds, origin: this.got?.origin || 0 };
    },
    drawTime(context, whole, drawn, scale) {
      const { begin, end, unit, seconds, origin } = this.times();
      const step = this.got?.step || 0;
      const gap = Math.max(GAP, 5 / this.rate, 1.5 * step);
      // before the first sample there is no time to mark
      const x = { low: (begin - origin) / seconds, high: (end - origin) / seconds, title: `Time [${unit}]`, least: 0 };
      this.plot = whole;
      if (this.pointer !== null) this.cursor = this.timeAt(this.pointer);
      const yOf = (panel, kept) => {
        const [low, high] = keptRange(kept, ...extent(this.points, drawn ? panel.shown : [], begin, end));
        return { low, high, title: titled(panel.label, panel.unit) };
      };
      this.drawPanels(context, whole, x, "time", yOf, (panel, box, toX, toY) => {
        const place = (time) => toX((time - origin) / seconds);
        for (const { index, factor } of drawn ? panel.shown : []) {
          const given = [context, this.points, index, factor, this.look.data[index % 6], place, toY, gap];
          if (step > 0) envelope(...given, step, scale);
          else line(...given);
        }
        this.drawCursor(context, box, place);
      });
    },
    drawCursor(context, box, place) {
      if (this.cursor === null) return;
      const at = place(this.cursor);
      if (this.dragged && !this.dragged.pans) {
        context.globalAlpha = 0.15;
        context.fillStyle = this.look.ink;
        context.fillRect(place(this.dragged.time), box.top, at - place(this.dragged.time), box.height);
        context.globalAlpha = 1;
      }
      context.strokeStyle = this.look.ink;
      context.lineWidth = 1;
      context.strokeRect(at, box.top - 2, 0, box.height + 4);
    },
    drawSpectrum(context, whole, drawn) {
      const { times, first, last, count } = this.points;
      const shown = drawn && count > 1;
      const x = { low: shown ? times[first] : 1, high: shown ? times[last] : this.rate / 2, title: "Frequency [Hz]", log: true };
      const yOf = (panel) => {
        const [low, high] = extent(this.points, shown ? panel.shown : [], -Infinity, Infinity);
        const [least, most] = high > 0 ? [Math.max(low, 1e-6 * high), high] : [0.1, 1];
        const title = titled(panel.label, `${panel.unit}/√Hz`);
        return { low: 10 ** Math.floor(Math.log10(least)), high: 10 ** Math.ceil(Math.log10(1.01 * most)), title, log: true };
      };
      this.drawPanels(context, whole, x, "spectrum", yOf, (panel, box, toX, toY) => {
        for (const { index, factor } of shown ? panel.shown : []) line(context, this.points, index, factor, this.look.data[index % 6], toX, toY, Infinity);
      });
    },
    drawLoop(context, box, drawn) {
      const [across, up] = [this.channels[this.loopX], this.channels[this.loopY]];
      const axis = (channel, index) => {
        const key = `loop ${channel.name}`;
        const [low, high] = keptRange(this.ranges.get(key), ...extent(this.points, drawn ? [{ ...channel, index }] : [], -Infinity, Infinity));
        this.ranges.set(key, [low, high]);
        return { low, high, title: titled(channel.name, channel.unit) };
      };
      const [x, y] = [axis(across, this.loopX), axis(up, this.loopY)];
      this.titles = [{ axis: "x", title: x.title }, { axis: "y", title: y.title }];
      const { toX, toY } = axes(context, box, x, y, this.look);
      if (drawn) clipped(context, box, () => loop(context, this.points, [this.loopX, this.loopY], [across.factor, up.factor], this.look.data[this.loopY % 6], toX, toY));
    },
    /** Write the values at the cursor, or the newest, as text. */
    read() {
      const now = performance.now();
      if (now - this.readAt < READ || !this.$refs.readout) return;
      this.readAt = now;
      const { points, cursor, wrong } = this;
      const held = cursor !== null && points.count > 0;
      const at = held ? points.nearest(cursor) : 0;
      this.$refs.readout.querySelectorAll(".value").forEach((value, index) => {
        const place = at * points.channels + index;
        const read = held ? [points.low[place], points.high[place]] : [this.got?.values[index] ?? NaN];
        const text = [...new Set(read.map((v) => readable(this.channels[index].factor * v)))].join(" … ");
        if (value.textContent !== text) value.textContent = text;
      });
      const where = held ? `at ${written(points.times[at] - this.got.origin, 0.001)} s` : "";
      this.$refs.where.textContent = wrong ?? (points.count ? where : "no samples yet");
    },

    // what a person does

    /** Draw and ask anew; what is shown stays so after a reload. */
    keep() {
      const { mode, length, loopX, loopY, lengths, hidden } = this;
      this.$emit("view", { mode, length, loopX, loopY, lengths: { ...lengths }, hidden: [...hidden] });
      this.renew();
    },
    renew() {
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
      const nearer = (a, b) => (Math.abs(b - this.length) < Math.abs(a - this.length) ? b : a);
      this.length = this.windows.reduce(nearer);
      this.told = "follows";
      this.keep();
    },
    toggle() {
      if (!this.follows) return this.followAgain();
      this.halt();
      this.renew();
    },
    halt() {
      if (!this.follows) return;
      this.end = this.got?.newest || 0;
      this.follows = false;
      this.told = "paused";
    },
    show(mode) {
      if (mode === this.mode) return;
      this.mode = mode;
      this.cursor = this.pointer = this.wrong = null;
      this.follows = true;
      this.keep();
    },
    hide(index) {
      this.hidden = this.hidden.includes(index) ? this.hidden.filter((k) => k !== index) : [...this.hidden, index];
      this.keep();
    },
    /** Show another while, and stay there. */
    lookAt(begin, end) {
      if (!this.got) return;
      this.halt();
      const length = Math.min(Math.max(end - begin, 4 / this.rate), this.seconds);
      this.end = Math.min(0.5 * (begin + end + length), this.got.newest);
      this.length = length;
      const from = this.end - length - this.got.origin;
      this.told = `${written(from, 0.01)} s to ${written(from + length, 0.01)} s`;
      this.renew();
    },
    zoom(factor, about) {
      const { begin, end } = this.times();
      this.lookAt(about + (begin - about) * factor, about + (end - about) * factor);
    },
    pressed(event) {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const { begin, end } = this.times();
      const by = 0.1 * (end - begin);
      const middle = this.cursor ?? 0.5 * (begin + end);
      const moved = (sign) => (event.shiftKey ? this.point(sign) : this.lookAt(begin + sign * by, end + sign * by));
      const inTime = { "+": () => this.zoom(0.5, middle), "=": () => this.zoom(0.5, middle), "-": () => this.zoom(2, middle) };
      Object.assign(inTime, { Home: () => this.followAgain(), ArrowLeft: () => moved(-1), ArrowRight: () => moved(1) });
      const actions = { " ": () => this.toggle(), ...(this.mode === "time" ? inTime : {}) };
      if (!(event.key in actions)) return;
      event.preventDefault();
      event.stopPropagation();
      actions[event.key]();
    },
    /** Move the cursor by a part of the width, and say what is there. */
    point(sign) {
      const { begin, end } = this.times();
      this.halt();
      this.pointer = null;
      this.cursor = Math.min(Math.max((this.cursor ?? 0.5 * (begin + end)) + 0.02 * sign * (end - begin), begin), end);
      this.readAt = 0;
      this.draw();
      const lines = [...this.$refs.readout.querySelectorAll("li")];
      this.told = `${this.$refs.where.textContent}: ${lines.map((read) => read.textContent.trim()).join(", ")}`;
    },
    timeAt(place) {
      const { begin } = this.times();
      return begin + ((place - this.plot.left) / this.plot.width) * this.length;
    },
    turned(event) {
      // a wheel over a chart that nobody has chosen scrolls the page
      if (this.mode !== "time" || !(event.ctrlKey || document.activeElement === this.$refs.canvas)) return;
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.timeAt(event.offsetX));
    },
    down(event) {
      if (this.mode !== "time" || event.button !== 0 || !this.got) return;
      this.$refs.canvas.setPointerCapture(event.pointerId);
      this.dragged = { from: event.offsetX, followed: this.follows, pans: event.shiftKey };
      this.halt();
      Object.assign(this.dragged, this.times(), { time: this.timeAt(event.offsetX) });
    },
    moved(event) {
      if (this.mode !== "time" || !this.got) return;
      if (this.dragged?.pans) {
        const by = ((this.dragged.from - event.offsetX) / this.plot.width) * this.length;
        this.lookAt(this.dragged.begin + by, this.dragged.end + by);
        return;
      }
      this.pointer = event.offsetX;
      this.draw();
    },
    up(event) {
      const { dragged } = this;
      this.dragged = null;
      if (!dragged || dragged.pans) return;
      const other = this.timeAt(event.offsetX);
      if (event.type === "pointerup" && Math.abs(event.offsetX - dragged.from) > 6) this.lookAt(Math.min(dragged.time, other), Math.max(dragged.time, other));
      else {
        // a click alone chooses the chart, for the wheel and the keys
        this.follows = dragged.followed;
        this.renew();
      }
    },
    left() {
      if (this.dragged || this.cursor === null) return;
      this.cursor = this.pointer = null;
      this.readAt = 0;
      this.draw();
    },
  },
};

function titled(label, unit) {
  return unit ? `${label} [${unit}]` : label;
}
