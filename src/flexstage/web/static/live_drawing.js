// Drawing of live charts on a canvas: points of channels, axes with ticks and titles.

/** Points of all channels in the order of time; new points are appended, old ones dropped. */
export class Points {
  constructor(channels) {
    this.channels = channels;
    this.clear();
  }

  clear() {
    this.room(4096);
    this.first = this.count = 0;
  }

  room(size) {
    this.size = size;
    this.times = new Float64Array(size);
    this.low = new Float32Array(size * this.channels);
    this.high = new Float32Array(size * this.channels);
  }

  get last() {
    return this.first + this.count - 1;
  }

  /** Append points; they replace points from the time of the first one on. */
  add(times, low, high) {
    while (this.count && times.length && this.times[this.last] >= times[0]) this.count -= 1;
    if (this.first + this.count + times.length > this.size) this.compact(times.length);
    const at = this.first + this.count;
    this.times.set(times, at);
    this.low.set(low, at * this.channels);
    this.high.set(high, at * this.channels);
    this.count += times.length;
  }

  compact(more) {
    const { times, low, high, first, count, channels } = this;
    this.room(Math.max(4096, 2 * (count + more)));
    this.times.set(times.subarray(first, first + count));
    this.low.set(low.subarray(first * channels, (first + count) * channels));
    this.high.set(high.subarray(first * channels, (first + count) * channels));
    this.first = 0;
  }

  dropBefore(time) {
    while (this.count > 1 && this.times[this.first] < time) {
      this.first += 1;
      this.count -= 1;
    }
  }

  /** The index of the point nearest to a time; -1 without points. */
  nearest(time) {
    if (!this.count) return -1;
    let low = this.first;
    let high = this.last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.times[middle] < time) low = middle;
      else high = middle;
    }
    return time - this.times[low] < this.times[high] - time ? low : high;
  }
}

/** Round positions of ticks between two values. */
export function ticks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((n) => n * power >= 0.999 * rough);
  const places = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) places.push(k * step);
  return { step, places };
}

/** A number with the digits of a step. */
export function written(value, step) {
  const digits = Math.min(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), 12);
  return value.toFixed(digits).replace(/^-(?=0(\.0*)?$)/, "").replace("-", "−");
}

/** A value with about four digits. */
export function readable(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.floor(Math.log10(Math.abs(value) || 1));
  return written(value, 10 ** Math.min(Math.max(size, -3) - 3, 0));
}

/** A stable range of values: it changes if they leave it, or need much less. */
export function stableRange(previous, low, high) {
  if (!(high >= low)) return previous ?? [0, 1];
  // a nearly constant value must not produce tick labels of ten digits
  const least = Math.max(1e-3 * Math.max(Math.abs(low), Math.abs(high)), high > low ? 1e-5 : 1e-3);
  const margin = 0.06 * Math.max(high - low, least);
  if (previous && low >= previous[0] && high <= previous[1] && high - low + 2 * margin > 0.5 * (previous[1] - previous[0])) return previous;
  const middle = 0.5 * (low + high);
  const half = 0.5 * Math.max(high - low, least) + 2 * margin;
  return [middle - half, middle + half];
}

/** Ticks of a logarithmic axis, with their labels. */
function decades(low, high) {
  const marked = [];
  const few = Math.log10(high / low) < 2.5;
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += 1)
    for (const n of [1, 2, 5]) {
      const place = n * 10 ** power;
      if (place < low || place > high || (n > 1 && !few)) continue;
      const plain = power >= -3 && power <= 5;
      marked.push([place, plain ? written(place, 10 ** power) : `${n > 1 ? `${n}·` : ""}10${raised(power)}`]);
    }
  return marked;
}

function raised(power) {
  return String(power).replace("-", "⁻").replace(/\d/g, (digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]);
}

function marks({ low, high, log, least = -Infinity }, count) {
  if (log) return decades(low, high);
  const { step, places } = ticks(low, high, count);
  return places.filter((place) => place >= least).map((place) => [place, written(place, step)]);
}

/** The function from values of an axis to pixels. */
function placing({ low, high, log }, from, to) {
  if (!log) return (value) => from + ((value - low) / (high - low)) * (to - from);
  const decade = (to - from) / Math.log(high / low);
  return (value) => from + Math.log(value / low) * decade;
}

/** Draw the axes of a panel, and return the functions from values to pixels. */
export function axes(context, box, x, y, look) {
  const [right, bottom] = [box.left + box.width, box.top + box.height];
  const [toX, toY] = [placing(x, box.left, right), placing(y, bottom, box.top)];
  context.font = look.font;
  context.lineWidth = 1;
  context.strokeStyle = look.grid;
  context.fillStyle = look.ink;
  const across = marks(x, Math.max(2, Math.min(10, box.width / 90)));
  const up = marks(y, Math.max(2, box.height / 42));
  context.beginPath();
  for (const [place] of across) {
    context.moveTo(Math.round(toX(place)) + 0.5, box.top);
    context.lineTo(Math.round(toX(place)) + 0.5, bottom);
  }
  for (const [place] of up) {
    context.moveTo(box.left, Math.round(toY(place)) + 0.5);
    context.lineTo(right, Math.round(toY(place)) + 0.5);
  }
  context.stroke();
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const [place, text] of up) context.fillText(text, box.left - 7, toY(place));
  if (x.title) {
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const [place, text] of across) context.fillText(text, toX(place), bottom + 6);
    context.fillText(x.title, box.left + box.width / 2, bottom + 24);
  }
  context.save();
  context.translate(13, box.top + box.height / 2);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(y.title, 0, 0);
  context.restore();
  context.strokeStyle = look.muted;
  context.strokeRect(box.left + 0.5, box.top + 0.5, box.width, box.height);
  return { toX, toY };
}

/** Draw with clipping to a box. */
export function clipped(context, box, draw) {
  context.save();
  context.beginPath();
  context.rect(box.left, box.top, box.width, box.height);
  context.clip();
  draw();
  context.restore();
}

/** Draw a line through the samples of a channel, interrupted at gaps. */
export function line(context, points, channel, factor, colour, toX, toY, gap) {
  const { times, low, channels } = points;
  context.strokeStyle = colour;
  context.lineWidth = 1.4;
  context.lineJoin = "bevel";
  context.beginPath();
  let before = -Infinity;
  for (let k = points.first; k <= points.last; k += 1) {
    const value = factor * low[k * channels + channel];
    if (Number.isNaN(value)) continue;
    if (times[k] - before > gap) context.moveTo(toX(times[k]), toY(value));
    else context.lineTo(toX(times[k]), toY(value));
    before = times[k];
  }
  context.stroke();
}

/** Draw the area between minima and maxima, a bar for each column of pixels. */
export function envelope(context, points, channel, factor, colour, toX, toY, gap, step, scale) {
  const { times, low, high, channels } = points;
  context.save();
  // bars on whole pixels need no antialiasing, the slowest part of a filled outline
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = colour;
  const least = Math.round(1.4 * scale);
  let [left, right, top, bottom] = [0, -1, 0, 0];
  let [before, lastTop, lastBottom] = [-Infinity, 0, 0];
  const bar = () => {
    if (right < left) return;
    const height = Math.max(Math.ceil(bottom - top), least);
    context.fillRect(left, Math.round(0.5 * (top + bottom - height)), right - left, height);
  };
  for (let k = points.first; k <= points.last; k += 1) {
    const place = k * channels + channel;
    const highest = scale * toY(factor * high[place]);
    if (Number.isNaN(highest)) continue;
    const lowest = scale * toY(factor * low[place]);
    const joined = times[k] - before <= gap;
    // bars are extended until they meet their neighbours
    const up = joined ? Math.min(highest, lastBottom) : highest;
    const down = joined ? Math.max(lowest, lastTop) : lowest;
    [before, lastTop, lastBottom] = [times[k], highest, lowest];
    const from = joined && right >= left ? right : Math.floor(scale * toX(times[k] - 0.5 * step));
    const to = Math.ceil(scale * toX(times[k] + 0.5 * step));
    if (joined && to <= right) {
      top = Math.min(top, up);
      bottom = Math.max(bottom, down);
    } else {
      bar();
      [left, right, top, bottom] = [from, to, up, down];
    }
  }
  bar();
  context.restore();
}

/** Draw one channel over another: older points are paler, a dot marks the newest. */
export function loop(context, points, [x, y], [factorX, factorY], colour, toX, toY) {
  const { low, channels, first, last, count } = points;
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 1.4;
  context.lineJoin = "round";
  const at = (k) => [toX(factorX * low[k * channels + x]), toY(factorY * low[k * channels + y])];
  const parts = [0.25, 0.55, 1.0];
  parts.forEach((alpha, part) => {
    context.globalAlpha = alpha;
    context.beginPath();
    const from = first + Math.floor((part / parts.length) * count);
    const to = Math.min(first + Math.floor(((part + 1) / parts.length) * count), last);
    for (let k = from; k <= to; k += 1) context.lineTo(...at(k));
    context.stroke();
  });
  context.globalAlpha = 1;
  if (!count) return;
  context.beginPath();
  context.arc(...at(last), 4, 0, 2 * Math.PI);
  context.fill();
}

/** Draw the circles and angles of a polar plot, and return the function from an angle [rad] and a value to pixels. */
export function polarAxes(context, box, reach, [angle, title], look) {
  const { step } = ticks(0, reach || 1, 2);
  const top = step * Math.max(Math.ceil((1.02 * reach) / step), 1);
  const [x, y] = [box.left + 0.5 * box.width, box.top + 0.5 * (box.height + 40)];
  const radius = Math.max(Math.min(0.5 * box.width - 40, 0.5 * box.height - 8), 40);
  // the circle of zero is in the middle between the centre and the edge, with room for the least value
  const distance = (value) => (radius * (value + 2 * top)) / (3 * top);
  const place = (at, value) => [x + distance(value) * Math.cos(at), y - distance(value) * Math.sin(at)];
  context.font = look.font;
  context.lineWidth = 1;
  context.strokeStyle = look.grid;
  context.fillStyle = look.ink;
  context.textBaseline = "middle";
  for (let degrees = 0; degrees < 360; degrees += 45) {
    const at = (degrees * Math.PI) / 180;
    context.beginPath();
    context.moveTo(...place(at, -top));
    context.lineTo(...place(at, top));
    context.stroke();
    context.textAlign = Math.abs(Math.cos(at)) < 0.1 ? "center" : Math.cos(at) > 0 ? "left" : "right";
    context.fillText(`${degrees}°`, x + (radius + 8) * Math.cos(at), y - (radius + 11) * Math.sin(at));
  }
  for (const value of [-top, 0, top]) {
    context.beginPath();
    context.strokeStyle = value ? look.muted : look.ink;
    context.setLineDash(value ? [] : [5, 4]);
    context.arc(x, y, distance(value), 0, 2 * Math.PI);
    context.stroke();
    context.setLineDash([]);
    const at = (112 * Math.PI) / 180;
    context.textAlign = "center";
    context.fillText(written(value, step), ...place(at, value).map((pixel, k) => pixel + (k ? 9 : 0)));
  }
  context.textAlign = "left";
  context.textBaseline = "top";
  context.fillText(`${title} over ${angle.toLowerCase()}`, box.left, box.top - 6);
  context.fillText("dashed: zero", box.left, box.top + 10);
  return place;
}

/** Draw a channel over an angle; a dot marks the newest point. */
export function polarCurve(context, points, angle, channel, factor, colour, place) {
  const { low, channels, first, last, count } = points;
  const at = (k) => place(low[k * channels + angle], factor * low[k * channels + channel]);
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 1.4;
  context.lineJoin = "bevel";
  context.beginPath();
  for (let k = first; k <= last; k += 1) context.lineTo(...at(k));
  context.stroke();
  if (!count) return;
  context.beginPath();
  context.arc(...at(last), 4, 0, 2 * Math.PI);
  context.fill();
}

/** The minimum and maximum of channels between two times, in the displayed unit. */
export function extent(points, shown, begin, end) {
  let low = Infinity;
  let high = -Infinity;
  for (const { index, factor } of shown)
    for (let k = points.first; k <= points.last; k += 1) {
      if (points.times[k] < begin || points.times[k] > end) continue;
      const place = k * points.channels + index;
      if (factor * points.low[place] < low) low = factor * points.low[place];
      if (factor * points.high[place] > high) high = factor * points.high[place];
    }
  return [low, high];
}
