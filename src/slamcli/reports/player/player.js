// SPDX-License-Identifier: MIT
// The page: a clock, what is drawn at its time, and the controls.

const $ = (id) => document.getElementById(id);
const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 200];
const LOOKS = {
  light: {
    free: [255, 255, 255], occupied: [29, 33, 41], time: TIME, stage: "#dfe4ea", truth: "#009e73", scan: "#d55e00", particle: "#7a3e9d", node: "#1d2129", edge: "#5b647066",
    closure: "#b0307a", submap: "#00794f", robot: "#d62f2f", rim: "#ffffff", soft: "#5b6470", line: "#d9dee5", ink: "#1d2129", chart: "#0072b2", resampling: "#7a3e9d", lost: "#d55e00",
  },
  dark: {
    free: [43, 49, 57], occupied: [232, 237, 243], time: TIME_DARK, stage: "#0d0f12", truth: "#35c79b", scan: "#ff9a4d", particle: "#d9a4f5", node: "#c5ccd5", edge: "#9aa4b066",
    closure: "#ff7ac0", submap: "#35c79b", robot: "#ff5a52", rim: "#0d0f12", soft: "#9aa4b0", line: "#333a43", ink: "#e4e8ed", chart: "#4aa8e0", resampling: "#d9a4f5", lost: "#ff8a47",
  },
};
const MARKS = { closure: "loop closed", resampling: "resampled", lost: "no pose" };

const clock = (seconds) => {
  const tenths = Math.round(seconds * 10), minutes = Math.floor(tenths / 600);
  const rest = `${Math.floor((tenths % 600) / 10)}`.padStart(2, "0"), hours = Math.floor(minutes / 60);
  return `${hours ? `${hours}:${`${minutes % 60}`.padStart(2, "0")}` : minutes}:${rest}.${tenths % 10}`;
};

class Player {
  constructor(facts, arrays) {
    Object.assign(this, { facts, arrays, time: 0, playing: false, speed: 1, stale: true, slowest: 0 });
    this.times = arrays.time;
    this.duration = Math.max(facts.duration_s, 1e-3);
    this.gap = facts.gap_s;
    this.camera = new Camera($("view"), () => { this.stale = true; });
    this.camera.bounds = facts.bounds_m;
    this.pen = $("view").getContext("2d");
    this.layers = this.makeLayers();
    this.charts = facts.charts.map((entry) => new StepChart(entry, arrays, this.duration, (time) => this.seek(time)));
    $("charts").append(...this.charts.map((chart) => chart.box));
    this.wanted = this.shownImage = -1;
  }

  makeLayers() {
    const { facts, arrays } = this, all = [];
    const add = (name, key, layer, shown = true) => all.push({ name, key, layer, shown });
    if (facts.map) add("Map", "occupied", new MapLayer(facts, arrays));
    if (arrays.cloud) add("Cloud", "height", new CloudLayer(arrays), !facts.map);
    if (arrays.submap) add("Submaps", "submap", new SubmapLayer(arrays));
    if (arrays.edge_kind) {
      const kinds = new Set(arrays.edge_kind);
      if (kinds.has(2)) add("Covisibility", "edge", new EdgeLayer(arrays, 2), false);
      if (kinds.has(0)) add("Edges", "edge", new EdgeLayer(arrays, 0), false);
      if (kinds.has(1)) add("Loop edges", "closure", new EdgeLayer(arrays, 1));
    }
    if (arrays.truth) add("Ground truth", "truth", new TruthLayer(arrays));
    add("Trajectory", "time", new PathLayer(facts, arrays));
    if (arrays.node) add("Nodes", "node", new NodeLayer(arrays), false);
    if (arrays.scan_time) add("Scan", "scan", new ScanLayer(facts, arrays));
    add("Robot", "robot", new RobotLayer());
    if (arrays.particle) add("Particles", "particle", new ParticleLayer(facts, arrays));
    return all;
  }

  // Where the robot is at a time: between two poses in between them, in a gap of the trajectory at the last one.
  poseAt(time) {
    const { times } = this, poses = this.arrays.pose, i = Math.max(0, countUpTo(times, time) - 1);
    const pose = [poses[3 * i], poses[3 * i + 1], poses[3 * i + 2]];
    const wait = i + 1 < times.length ? times[i + 1] - times[i] : 0;
    if (!(wait > 0) || wait > this.gap) return pose;
    const share = Math.max(0, (time - times[i]) / wait);
    for (let axis = 0; axis < 2; axis++) pose[axis] += share * (poses[3 * i + 3 + axis] - pose[axis]);
    pose[2] += share * wrapped(poses[3 * i + 5] - pose[2]);
    return pose;
  }

  moment() {
    const count = countUpTo(this.times, this.time), next = count < this.times.length ? this.times[count] : Infinity;
    const held = count > 0 && next - this.times[count - 1] > this.gap && this.time - this.times[count - 1] > this.gap / 2 && next !== Infinity;
    return { time: this.time, count, pose: this.poseAt(this.time), held, flash: Math.max(0.4, 0.4 * this.speed) };
  }

  seek(time) {
    this.time = Math.max(0, Math.min(this.duration, time));
    this.stale = true;
  }

  step(direction) {
    this.pause();
    const count = countUpTo(this.times, this.time);
    if (direction > 0) this.seek(count < this.times.length ? this.times[count] : this.duration);
    else {
      const now = this.times[count - 1];
      let i = count - 1;
      while (i >= 0 && this.times[i] >= now && now >= this.time) i--;
      this.seek(i >= 0 ? this.times[i] : 0);
    }
  }

  play() {
    if (this.time >= this.duration) this.seek(0);
    this.playing = true;
    this.told();
  }

  pause() {
    this.playing = false;
    this.told();
  }

  told() {
    $("play").setAttribute("aria-label", this.playing ? "pause" : "play");
    this.stale = true;
  }

  setSpeed(speed) {
    this.speed = SPEEDS.includes(speed) ? speed : SPEEDS.reduce((best, one) => (Math.abs(one - speed) < Math.abs(best - speed) ? one : best));
    $("speed").value = `${this.speed}`;
    this.stale = true;
  }

  faster(by) {
    this.setSpeed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(this.speed) + by))]);
  }

  restyle(theme) {
    document.documentElement.dataset.theme = theme;
    this.look = LOOKS[theme];
    for (const { layer } of this.layers) layer.restyle?.(this.look);
    this.resized();
  }

  resized() {
    this.camera.resize();
    for (const chart of this.charts) chart.prepare(this.look);
    this.drawMarks();
    this.stale = true;
  }

  frame(now) {
    const passed = Math.min(0.1, (now - (this.last ?? now)) / 1000);
    this.last = now;
    if (this.playing && passed > 0) {
      this.seek(this.time + passed * this.speed);
      if (this.time >= this.duration) this.pause();
    }
    if (this.stale) {
      const began = performance.now();
      this.stale = false;
      this.draw();
      this.slowest = Math.max(this.slowest, performance.now() - began);
    }
    requestAnimationFrame((next) => this.frame(next));
  }

  draw() {
    const { pen, camera, look } = this, moment = this.moment();
    if (camera.follow) [camera.x, camera.y] = moment.pose;
    $("follow").setAttribute("aria-pressed", `${camera.follow}`);
    pen.setTransform(camera.dots, 0, 0, camera.dots, 0, 0);
    pen.fillStyle = look.stage;
    pen.fillRect(0, 0, camera.width, camera.height);
    pen.lineJoin = pen.lineCap = "round";
    const poseAt = (time) => this.poseAt(time);
    for (const { layer, shown } of this.layers) if (shown) layer.draw(pen, camera, moment, look, poseAt);
    this.drawScale();
    for (const chart of this.charts) chart.draw(this.time, look);
    $("scrub").value = this.time;
    $("scrub").setAttribute("aria-valuetext", `${clock(this.time)} of ${clock(this.duration)}`);
    $("time").textContent = `${clock(this.time)} / ${clock(this.duration)}`;
    this.tell(moment);
    this.showImage();
  }

  tell(moment) {
    const [x, y, yaw] = moment.pose, [shiftX, shiftY] = this.facts.shift_m, degrees = ((wrapped(yaw) * 180) / Math.PI).toFixed(0);
    const lines = [`${this.facts.axes[0]} ${(x + shiftX).toFixed(2)}  ${this.facts.axes[1]} ${(y + shiftY).toFixed(2)} m  ${degrees}°`, `pose ${moment.count.toLocaleString("en")} of ${this.times.length.toLocaleString("en")}`];
    if (moment.held) lines.push("no pose here");
    $("readout").textContent = lines.join("\n");
  }

  drawScale() {
    const { camera, look } = this, pen = $("scale").getContext("2d"), dots = camera.dots;
    if ($("scale").width !== Math.round(150 * dots)) Object.assign($("scale"), { width: Math.round(150 * dots), height: Math.round(24 * dots) });
    const rough = 110 / camera.scale, power = 10 ** Math.floor(Math.log10(rough)), length = [5, 2, 1].find((m) => m * power <= rough) * power;
    pen.setTransform(dots, 0, 0, dots, 0, 0);
    pen.clearRect(0, 0, 150, 24);
    pen.strokeStyle = pen.fillStyle = look.ink;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(2, 15);
    pen.lineTo(2, 20);
    pen.lineTo(2 + length * camera.scale, 20);
    pen.lineTo(2 + length * camera.scale, 15);
    pen.stroke();
    pen.font = "11px system-ui,sans-serif";
    pen.fillText(length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`, 7, 14);
  }

  drawMarks() {
    const canvas = $("marks"), box = canvas.getBoundingClientRect(), dots = this.camera.dots, pen = canvas.getContext("2d");
    canvas.width = Math.round(box.width * dots);
    canvas.height = Math.round(box.height * dots);
    pen.scale(dots, dots);
    const inset = 8; // half of the slider's thumb
    for (const [kind, times] of Object.entries(this.facts.marks)) {
      pen.fillStyle = this.look[kind];
      pen.globalAlpha = 0.75;
      for (const time of times) pen.fillRect(inset + (time / this.duration) * (box.width - 2 * inset) - 0.6, kind === "closure" ? 1 : 6, 1.3, kind === "closure" ? 12 : 7);
    }
  }

  // The nearest image of the chosen camera; the next one is asked for when the last has come.
  showImage() {
    if (!this.facts.images) return;
    const cameraNumber = Number($("topic").value), { first, count } = this.facts.images[cameraNumber];
    const times = this.arrays.image_time.subarray(first, first + count), i = countUpTo(times, this.time);
    const nearest = i < count && (i === 0 || times[i] - this.time < this.time - times[i - 1]) ? i : i - 1;
    this.wanted = first + nearest;
    if (!this.loading && this.wanted !== this.shownImage) this.fetchImage();
  }

  fetchImage() {
    const number = this.wanted, image = $("image");
    this.loading = true;
    const done = (text) => {
      this.loading = false;
      this.shownImage = number;
      $("stamp").textContent = text;
      if (this.wanted !== number) this.fetchImage();
    };
    image.onload = () => done(`at ${clock(Math.max(0, this.arrays.image_time[number]))}`);
    image.onerror = () => done("this image cannot be read");
    image.src = imageAddress(number);
  }
}
