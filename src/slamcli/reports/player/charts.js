// SPDX-License-Identifier: MIT
// Charts of the steps' statistics with a cursor at the time; a click goes there.

const short = (value) => {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return size > 0 && (size < 0.01 || size >= 1e6) ? value.toExponential(1) : Number(value.toPrecision(3)).toLocaleString("en", { maximumSignificantDigits: 3 });
};

const RIGHT = 5; // pixels beside the end, for the cursor's dot

class StepChart {
  constructor(entry, arrays, duration, seek) {
    Object.assign(this, { entry, times: arrays[entry.time], values: arrays[entry.values], duration });
    this.marks = entry.marks ? arrays[entry.marks] : null;
    this.box = document.createElement("div");
    this.box.className = "chart";
    this.box.title = entry.caption;
    const heading = document.createElement("h2");
    heading.append(entry.title, (this.readout = document.createElement("b")));
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${entry.title} over time`);
    this.box.append(heading, this.canvas);
    this.under = document.createElement("canvas");
    const go = (event) => {
      const box = this.canvas.getBoundingClientRect();
      seek(((event.clientX - box.left - this.left) / (box.width - this.left - RIGHT)) * duration);
    };
    this.left = 42;
    this.unit = /\d/.test(entry.unit) ? "" : entry.unit; // "0 to 1" is no unit
    this.canvas.addEventListener("pointerdown", (event) => { this.canvas.setPointerCapture(event.pointerId); go(event); });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && go(event));
    const finite = this.values.filter((value) => Number.isFinite(value));
    let low = Infinity, high = -Infinity;
    for (const value of finite) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    if (entry.from_zero && low > 0) low = 0;
    if (!(high > low)) high = low + 1;
    Object.assign(this, { low, high });
  }

  x(time) { return this.left + (time / this.duration) * (this.width - this.left - RIGHT); }

  y(value) { return 6 + (1 - (value - this.low) / (this.high - this.low)) * (this.height - 14); }

  // Draws the line once; the cursor comes on top of it in every frame.
  prepare(look) {
    const dots = Math.min(3, window.devicePixelRatio || 1), box = this.canvas.getBoundingClientRect();
    Object.assign(this, { dots, width: Math.max(60, box.width), height: Math.max(40, box.height) });
    for (const canvas of [this.canvas, this.under]) {
      canvas.width = Math.round(this.width * dots);
      canvas.height = Math.round(this.height * dots);
    }
    const pen = this.under.getContext("2d");
    pen.scale(dots, dots);
    pen.font = "10px system-ui,sans-serif";
    pen.fillStyle = look.soft;
    pen.textAlign = "right";
    pen.strokeStyle = look.line;
    pen.lineWidth = 1;
    for (const value of [this.low, this.high]) {
      pen.fillText(short(value), this.left - 5, this.y(value) + 3.5);
      pen.beginPath();
      pen.moveTo(this.left, this.y(value));
      pen.lineTo(this.width, this.y(value));
      pen.stroke();
    }
    pen.strokeStyle = look.soft;
    pen.beginPath();
    for (const time of this.marks || []) {
      pen.moveTo(this.x(time), this.height - 8);
      pen.lineTo(this.x(time), this.height - 2);
    }
    pen.stroke();
    this.line(pen, look);
  }

  // A column of pixels gets the range of all its values, so that no peak is lost however many steps there are.
  line(pen, look) {
    pen.strokeStyle = look.chart;
    pen.lineWidth = 1.2;
    pen.lineJoin = "round";
    pen.beginPath();
    let open = false;
    const { times, values } = this;
    for (let i = 0; i < times.length; ) {
      const column = Math.floor(this.x(times[i]) * 2);
      let low = Infinity, high = -Infinity, last = NaN;
      for (; i < times.length && Math.floor(this.x(times[i]) * 2) === column; i++) {
        if (!Number.isFinite(values[i])) continue;
        low = Math.min(low, values[i]);
        high = Math.max(high, values[i]);
        last = values[i];
      }
      if (low > high) { open = false; continue; }
      const x = column / 2;
      if (open) pen.lineTo(x, this.y(low)); else pen.moveTo(x, this.y(low));
      if (high > low) pen.lineTo(x, this.y(high));
      pen.lineTo(x, this.y(last));
      open = true;
    }
    pen.stroke();
  }

  draw(time, look) {
    const pen = this.canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.under, 0, 0);
    pen.scale(this.dots, this.dots);
    const x = this.x(time), step = countUpTo(this.times, time) - 1;
    pen.strokeStyle = look.ink;
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x, 2);
    pen.lineTo(x, this.height - 2);
    pen.stroke();
    const value = step >= 0 ? this.values[step] : NaN;
    this.readout.textContent = `${short(value)} ${this.unit}`;
    if (Number.isFinite(value)) {
      pen.fillStyle = look.chart;
      pen.beginPath();
      pen.arc(x, this.y(value), 3, 0, 7);
      pen.fill();
    }
  }
}
