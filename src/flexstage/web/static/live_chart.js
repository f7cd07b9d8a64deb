// A live chart: it requests new data from the server, and draws them.
import { Points, axes, clipped, envelope, extent, stableRange, line, loop, polarAxes, polarCurve, readable, written } from "live_drawing";

const PERIOD = 45; // between two requests [ms]
const SLOW = 1000; // between two requests of spectra [ms]
const PATIENCE = 1500; // after a failed request [ms]
const GAP = 0.5; // longest interval between samples that a curve bridges [s]
const READ = 200; // between two updates of the values [ms]
const MARGIN = { left: 74, right: 14, top: 10, bottom: 46, between: 16 };
const MODES = { polar: "Polar", time: "Time", loop: "Loop", spectrum: "Spectrum" };
const LENGTHS = { loop: [1, 2, 5, 10, 30, 60], spectrum: [10, 60, 300, 600] };

export default {
  template: `
    <div role="group" :aria-label="caption">
      <div class="live-tools">
        <div v-if="modes.length > 1" class="live-choice" role="group" aria-label="Kind of chart">
          <button v-for="m in modes" type="button" :aria-pressed="String(mode === m)" @click="show(m)">{{ titleOf(m) }}</button>
        </div>
        <div v-if="mode === 'time'" class="live-choice" role="group" aria-label="Window">
          <button v-for="w in windows" type="button" :aria-pressed="String(follows && length === w)" @click="choose(w)">{{ durationText(w) }}</button>
        </div>
        <template v-if="mode === 'loop'">
          <label>x <select v-model.number="loopX" @change="keep()"><option v-for="(c, k) in channels" :value="k">{{ c.name }}</option></select></label>
          <label>y <select v-model.number="loopY" @change="keep()"><option v-for="(c, k) in channels" :value="k">{{ c.name }}</option></select></label>
        </template>
        <label v-if="lengthsOf(mode)">last <select v-model.number="lengths[mode]" @change="keep()"><option v-for="s in lengthsOf(mode)" :value="s">{{ durationText(s) }}</option></select></label>
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
      <p class="hidden-title" role="status">{{ announcement }}</p>
    </div>`,
  props: { address: String, channels: Array, rate: Number, seconds: Number, windows: Array, caption: String, begins: String, pair: Array, angle: Number, view: Object },
  data() {
    const defaults = {
      mode: this.begins,
      length: this.windows[0],
      loopX: this.pair[0],
      loopY: this.pair[1],
      lengths: { polar: this.seconds, loop: 5, spectrum: 60 },
      hidden: [],
    };
    return { ...defaults, ...this.view, follows: true, announcement: "" };
  },
  computed: {
    modes() {
      if (this.angle >= 0) return ["polar", "time"];
      return ["time", "loop", "spectrum"].filter((mode) => mode !== "loop" || this.channels.length > 1);
    },
    panels() {
      const byQuantity = new Map();
      this.channels.forEach((channel, index) => {
        if (!byQuantity.has(channel.quantity)) byQuantity.set(channel.quantity, { ...channel, shown: [] });
        if (!this.hidden.includes(index)) byQuantity.get(channel.quantity).shown.push({ ...channel, index });
      });
      const panels = [...byQuantity.values()];
      return panels.some((panel) => panel.shown.length) ? panels.filter((panel) => panel.shown.length) : panels.slice(0, 1);
    },
    described() {
      const names = this.channels.filter((_, k) => !this.hidden.includes(k)).map((channel) => channel.name);
      const what = this.mode === "loop" ? `${this.channels[this.loopY].name} over ${this.channels[this.loopX].name}` : names.join(", ");
      const keys = this.mode === "time" ? ", arrows move, plus and minus zoom, Shift with an arrow reads a value, Home follows again" : "";
      return `${this.caption}: ${MODES[this.mode]} of ${what}. Space pauses${keys}. The values are listed below.`;
    },
  },
  created() {
    this.points = new Points(this.channels.length);
    this.latest = null; // the last answer, with its request
    this.ranges = new Map();
    this.frames = this.answers = this.end = this.readAt = 0;
    this.isBusy = this.isRemoved = false;
    this.cursor = this.pointer = this.dragged = this.message = null;
  },
  mounted() {
    this.$el.live = this;
    this.observers = [new ResizeObserver(() => this.draw()), new MutationObserver(() => this.restyle())];
    this.observers[0].observe(this.$refs.canvas);
    this.observers[1].observe(document.body, { attributes: true, attributeFilter: ["class"] });
    this.wake = () => this.ask();
    document.addEventListener("visibilitychange", this.wake);
    this.restyle();
    this.ask();
  },
  unmounted() {
    this.isRemoved = true;
    clearTimeout(this.timer);
    this.observers.forEach((observer) => observer.disconnect());
    document.removeEventListener("visibilitychange", this.wake);
  },
  methods: {
    titleOf: (mode) => MODES[mode],
    lengthsOf: (mode) => LENGTHS[mode],
    durationText: (seconds) => (seconds < 60 ? `${seconds} s` : seconds < 3600 ? `${seconds / 60} min` : `${seconds / 3600} h`),

    // requests

    request() {
      const { mode, follows, latest } = this;
      const length = mode === "time" ? this.length : this.lengths[mode];
      const query = new URLSearchParams({ mode, length });
      if (!follows) query.set("end", this.end);
      const continues = follows && latest?.follows && latest.mode === mode && latest.length === length && this.points.count > 1;
      if (continues) {
        query.set("generation", latest.generation);
        query.set("tier", latest.tier);
        // the last bin may be incomplete
        query.set("after", this.points.times[this.points.last - (latest.step > 0 ? 1 : 0)]);
      }
      return { address: `${window.path_prefix ?? ""}${this.address}?${query}`, length, mode, follows, continues };
    },
    /** Request new data, draw them and repeat: one request at a time, and none while the page is hidden. */
    async ask() {
      clearTimeout(this.timer);
      if (this.isRemoved || this.isBusy || document.hidden) return;
      const began = performance.now();
      const request = this.request();
      this.isBusy = true;
      let wait = PERIOD;
      try {
        const answer = await fetch(request.address);
        if (request.mode === "spectrum" && this.mode === "spectrum") wait = SLOW;
        if (answer.status !== 200) wait = PATIENCE;
        else if (answer.headers.get("content-type").startsWith("text/")) this.message = await answer.text();
        else this.take(await answer.arrayBuffer(), request);
      } catch {
        wait = PATIENCE;
      }
      this.isBusy = false;
      if (this.isRemoved) return;
      if (this.hasChanged()) {
        await new Promise((frame) => requestAnimationFrame(frame));
        this.draw();
      } else this.read();
      const other = !this.follows && this.request().address !== request.address;
      if (this.follows || other || wait === PATIENCE) this.timer = setTimeout(() => this.ask(), other ? 0 : Math.max(wait - (performance.now() - began), 0));
    },
    take(buffer, request) {
      const [generation, tier, step, newest, begin, , count, both, origin] = new Float64Array(buffer, 0, 9);
      const channels = this.channels.length;
      const size = count * channels;
      const values = new Float64Array(buffer, 72, channels);
      const times = new Float64Array(buffer, 72 + 8 * channels, count);
      const low = new Float32Array(buffer, 72 + 8 * (channels + count), size);
      const high = both ? new Float32Array(buffer, 72 + 8 * (channels + count) + 4 * size, size) : low;
      if (!request.continues || this.latest.generation !== generation || this.latest.tier !== tier) this.points.clear();
      this.points.add(times, low, high);
      if (request.mode !== "spectrum") this.points.dropBefore(begin - step);
      this.latest = { ...request, generation, tier, step, newest, begin, origin, values };
      this.message = null;
      this.answers += 1;
    },
    /** Return whether the chart would differ from the last drawing. */
    hasChanged() {
      const { points, latest } = this;
      const at = points.last * points.channels;
      const now = [points.count, points.low.subarray(at, at + points.channels), points.high.subarray(at, at + points.channels)];
      const place = latest && Math.round((latest.newest / latest.length) * this.$refs.canvas.width);
      const looks = [this.message, this.mode, this.follows, place, ...now].join();
      const other = looks !== this.looks;
      this.looks = looks;
      return other;
    },

    // drawing

    restyle() {
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
      const hasData = this.latest?.mode === this.mode && !this.message;
      if (this.mode === "polar") this.drawPolar(context, whole, hasData);
      else if (this.mode === "loop") this.drawLoop(context, whole, hasData);
      else if (this.mode === "spectrum") this.drawSpectrum(context, whole, hasData);
      else this.drawTime(context, whole, hasData, scale);
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
    /** The times of the window, and their unit. */
    times() {
      const end = this.follows ? this.latest?.newest || 0 : this.end;
      const [unit, seconds] = this.length > 120 ? ["min", 60] : ["s", 1];
      return { begin: end - this.length, end, unit, seconds, origin: this.latest?.origin || 0 };
    },
    drawTime(context, whole, hasData, scale) {
      const { begin, end, unit, seconds, origin } = this.times();
      const step = this.latest?.step || 0;
      const gap = Math.max(GAP, 5 / this.rate, 1.5 * step);
      // no ticks before the first sample
      const x = { low: (begin - origin) / seconds, high: (end - origin) / seconds, title: `Time [${unit}]`, least: 0 };
      this.plot = whole;
      if (this.pointer !== null) this.cursor = this.timeAt(this.pointer);
      const yOf = (panel, previous) => {
        const [low, high] = stableRange(previous, ...extent(this.points, hasData ? panel.shown : [], begin, end));
        return { low, high, title: titled(panel.label, panel.unit) };
      };
      this.drawPanels(context, whole, x, "time", yOf, (panel, box, toX, toY) => {
        const place = (time) => toX((time - origin) / seconds);
        for (const { index, factor } of hasData ? panel.shown : []) {
          const properties = [context, this.points, index, factor, this.look.data[index % 6], place, toY, gap];
          if (step > 0) envelope(...properties, step, scale);
          else line(...properties);
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
    drawSpectrum(context, whole, hasData) {
      const { times, first, last, count } = this.points;
      const shown = hasData && count > 1;
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
    drawLoop(context, box, hasData) {
      const [across, up] = [this.channels[this.loopX], this.channels[this.loopY]];
      const axis = (channel, index) => {
        const key = `loop ${channel.name}`;
        const [low, high] = stableRange(this.ranges.get(key), ...extent(this.points, hasData ? [{ ...channel, index }] : [], -Infinity, Infinity));
        this.ranges.set(key, [low, high]);
        return { low, high, title: titled(channel.name, channel.unit) };
      };
      const [x, y] = [axis(across, this.loopX), axis(up, this.loopY)];
      this.titles = [{ axis: "x", title: x.title }, { axis: "y", title: y.title }];
      const { toX, toY } = axes(context, box, x, y, this.look);
      if (hasData) clipped(context, box, () => loop(context, this.points, [this.loopX, this.loopY], [across.factor, up.factor], this.look.data[this.loopY % 6], toX, toY));
    },
    /** Draw the channels of one quantity over the channel of the angle, outwards from the circle of zero. */
    drawPolar(context, box, hasData) {
      const { quantity, label, unit } = this.channels.find((_, index) => index !== this.angle);
      const curves = this.channels.map((channel, index) => ({ ...channel, index }));
      const shown = curves.filter((c) => c.quantity === quantity && !this.hidden.includes(c.index));
      const [low, high] = extent(this.points, hasData ? shown : [], -Infinity, Infinity);
      const titles = [this.channels[this.angle].label, titled(label, unit)];
      this.titles = titles.map((title, k) => ({ axis: "xy"[k], title }));
      const place = polarAxes(context, { ...box, left: 0, width: box.width + MARGIN.left + MARGIN.right }, Math.max(-low, high, 0), titles, this.look);
      for (const { index, factor } of hasData ? shown : []) polarCurve(context, this.points, this.angle, index, factor, this.look.data[index % 6], place);
    },
    /** Write the values at the cursor, or the newest values, as text. */
    read() {
      const now = performance.now();
      if (now - this.readAt < READ || !this.$refs.readout) return;
      this.readAt = now;
      const { points, cursor, message } = this;
      const hasCursor = cursor !== null && points.count > 0;
      const at = hasCursor ? points.nearest(cursor) : 0;
      this.$refs.readout.querySelectorAll(".value").forEach((value, index) => {
        const place = at * points.channels + index;
        const read = hasCursor ? [points.low[place], points.high[place]] : [this.latest?.values[index] ?? NaN];
        const text = [...new Set(read.map((v) => readable(this.channels[index].factor * v)))].join(" … ");
        if (value.textContent !== text) value.textContent = text;
      });
      const where = hasCursor ? `at ${written(points.times[at] - this.latest.origin, 0.001)} s` : "";
      this.$refs.where.textContent = message ?? (points.count ? where : "no samples yet");
    },

    // input

    /** Draw and request anew, and save the settings for a reload. */
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
      this.announcement = "live";
      this.keep();
    },
    toggle() {
      if (!this.follows) return this.followAgain();
      this.halt();
      this.renew();
    },
    halt() {
      if (!this.follows) return;
      this.end = this.latest?.newest || 0;
      this.follows = false;
      this.announcement = "paused";
    },
    show(mode) {
      if (mode === this.mode) return;
      this.mode = mode;
      this.cursor = this.pointer = this.message = null;
      this.follows = true;
      this.keep();
    },
    hide(index) {
      this.hidden = this.hidden.includes(index) ? this.hidden.filter((k) => k !== index) : [...this.hidden, index];
      this.keep();
    },
    /** Show another interval, and stop following. */
    lookAt(begin, end) {
      if (!this.latest) return;
      this.halt();
      const length = Math.min(Math.max(end - begin, 4 / this.rate), this.seconds);
      this.end = Math.min(0.5 * (begin + end + length), this.latest.newest);
      this.length = length;
      const from = this.end - length - this.latest.origin;
      this.announcement = `${written(from, 0.01)} s to ${written(from + length, 0.01)} s`;
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
    /** Move the cursor by a part of the width, and announce the values. */
    point(sign) {
      const { begin, end } = this.times();
      this.halt();
      this.pointer = null;
      this.cursor = Math.min(Math.max((this.cursor ?? 0.5 * (begin + end)) + 0.02 * sign * (end - begin), begin), end);
      this.readAt = 0;
      this.draw();
      const lines = [...this.$refs.readout.querySelectorAll("li")];
      this.announcement = `${this.$refs.where.textContent}: ${lines.map((read) => read.textContent.trim()).join(", ")}`;
    },
    timeAt(place) {
      const { begin } = this.times();
      return begin + ((place - this.plot.left) / this.plot.width) * this.length;
    },
    turned(event) {
      // a wheel over a chart without focus scrolls the page
      if (this.mode !== "time" || !(event.ctrlKey || document.activeElement === this.$refs.canvas)) return;
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.timeAt(event.offsetX));
    },
    down(event) {
      if (this.mode !== "time" || event.button !== 0 || !this.latest) return;
      this.$refs.canvas.setPointerCapture(event.pointerId);
      this.dragged = { from: event.offsetX, followed: this.follows, pans: event.shiftKey };
      this.halt();
      Object.assign(this.dragged, this.times(), { time: this.timeAt(event.offsetX) });
    },
    moved(event) {
      if (this.mode !== "time" || !this.latest) return;
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
        // a click gives the chart the focus, for the wheel and the keys
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
