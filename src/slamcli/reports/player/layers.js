// SPDX-License-Identifier: MIT
// What is drawn, one class for each layer: draw(pen, camera, moment, look). A moment is a time and where the robot was then.

// The colours of time are those of map.png, those of residuals those of report.html.
const TIME = [[41, 5, 147], [114, 1, 168], [164, 35, 148], [202, 71, 120], [229, 107, 93], [249, 149, 65]];
const TIME_DARK = [[104, 110, 250], [152, 90, 245], [196, 80, 200], [222, 90, 140], [240, 120, 95], [250, 165, 75]];
const RESIDUALS = [["#56b4e9", "to 5 cm, 0.5°"], ["#0072b2", "to 10 cm, 1°"], ["#e69f00", "to 25 cm, 2.5°"], ["#d55e00", "above"]];
const UNMEASURED = 9;
const HEIGHT = [[48, 60, 160], [40, 130, 190], [60, 175, 130], [170, 195, 60], [235, 140, 50], [200, 60, 50]];

function mixed(colours, share) {
  const place = Math.max(0, Math.min(0.9999, share)) * (colours.length - 1), low = Math.floor(place), rest = place - low;
  return `rgb(${colours[low].map((value, i) => Math.round(value + rest * (colours[low + 1][i] - value))).join(",")})`;
}

const wrapped = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

class MapLayer {
  constructor(facts, arrays) {
    this.map = facts.map;
    this.growth = new Growth(facts.map.width, facts.map.height, arrays.cells, arrays.first_seen, facts.poses);
  }

  restyle(look) { this.growth.colour(look.free, look.occupied); }

  draw(pen, camera, moment) {
    const { map } = this, size = map.resolution_m * camera.scale;
    const canvas = this.growth.canvas(moment.count, size * camera.dots);
    const [x, y, yaw] = map.origin;
    pen.save();
    pen.translate(camera.px(x), camera.py(y));
    pen.rotate(-yaw);
    // A reduced map may be a cell wider than the map, to the right and below.
    const factor = 2 ** Math.round(Math.log2(map.width / canvas.width));
    pen.imageSmoothingEnabled = size * camera.dots < 1;
    pen.drawImage(canvas, 0, -map.height * size, canvas.width * factor * size, canvas.height * factor * size);
    pen.restore();
  }
}

class CloudLayer {
  constructor(arrays) {
    this.points = arrays.cloud;
    this.heights = arrays.cloud_height; // uint8, in increasing order, so that the highest is drawn last
    this.shown = null;
  }

  restyle() { this.shown = null; }

  draw(pen, camera) {
    const key = [camera.x, camera.y, camera.scale, camera.width, camera.height].join();
    if (this.shown !== key) {
      this.shown = key;
      this.canvas ||= document.createElement("canvas");
      this.canvas.width = camera.canvas.width;
      this.canvas.height = camera.canvas.height;
      const own = this.canvas.getContext("2d"), { points, heights } = this;
      own.scale(camera.dots, camera.dots);
      const size = Math.max(heights.length < 30000 ? 2 : 1, Math.min(4, 0.02 * camera.scale));
      let height = -1;
      for (let i = 0; i < heights.length; i++) {
        if (heights[i] !== height) own.fillStyle = mixed(HEIGHT, (height = heights[i]) / 255);
        own.fillRect(camera.px(points[2 * i]) - size / 2, camera.py(points[2 * i + 1]) - size / 2, size, size);
      }
    }
    pen.save();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.canvas, 0, 0);
    pen.restore();
  }
}

// Strokes a line through points [from, to) of a flat array, skipping what is nearer than a pixel and a half to the last.
function trace(pen, camera, points, stride, from, to, tip) {
  let lastX = camera.px(points[from * stride]), lastY = camera.py(points[from * stride + 1]);
  pen.moveTo(lastX, lastY);
  for (let i = from + 1; i < to; i++) {
    const x = camera.px(points[i * stride]), y = camera.py(points[i * stride + 1]);
    if (Math.abs(x - lastX) + Math.abs(y - lastY) < 1.5 && i + 1 < to) continue;
    pen.lineTo(x, y);
    lastX = x;
    lastY = y;
  }
  if (tip) pen.lineTo(camera.px(tip[0]), camera.py(tip[1]));
}

const PIECES = 64; // of the trajectory, one colour each

class PathLayer {
  constructor(facts, arrays) {
    this.poses = arrays.pose;
    this.bounds = Array.from({ length: PIECES + 1 }, (_, i) => (i < PIECES ? Math.max(0, countUpTo(arrays.time, (i / PIECES) * facts.duration_s) - 1) : arrays.time.length));
  }

  draw(pen, camera, moment, look) {
    pen.lineWidth = 2;
    for (let piece = 0; piece < PIECES; piece++) {
      const from = this.bounds[piece], to = Math.min(this.bounds[piece + 1] + 1, moment.count);
      if (from >= moment.count) break;
      pen.strokeStyle = mixed(look.time, piece / (PIECES - 1));
      pen.beginPath();
      trace(pen, camera, this.poses, 3, from, to, to === moment.count ? moment.pose : null);
      pen.stroke();
    }
  }
}

class TruthLayer {
  constructor(arrays) {
    Object.assign(this, { times: arrays.truth_time, points: arrays.truth });
  }

  draw(pen, camera, moment, look) {
    const count = countUpTo(this.times, moment.time);
    if (count < 1) return;
    pen.strokeStyle = look.truth;
    pen.lineWidth = 5;
    pen.globalAlpha = 0.45;
    pen.beginPath();
    trace(pen, camera, this.points, 2, 0, count);
    pen.stroke();
    pen.globalAlpha = 1;
    pen.lineWidth = 1.6;
    pen.beginPath();
    pen.arc(camera.px(this.points[2 * count - 2]), camera.py(this.points[2 * count - 1]), 5, 0, 7);
    pen.stroke();
  }
}

class ScanLayer {
  constructor(facts, arrays) {
    Object.assign(this, { times: arrays.scan_time, offsets: arrays.scan_offset, points: arrays.scan_point, unit: facts.scan_unit_m, origin: facts.scan_origin_m });
  }

  draw(pen, camera, moment, look) {
    const scan = countUpTo(this.times, moment.time) - 1;
    if (scan < 0) return;
    pen.fillStyle = look.scan;
    const size = Math.max(2, Math.min(5, 0.05 * camera.scale));
    for (let i = this.offsets[scan]; i < this.offsets[scan + 1]; i++) {
      const x = camera.px(this.points[2 * i] * this.unit + this.origin[0]), y = camera.py(this.points[2 * i + 1] * this.unit + this.origin[1]);
      pen.fillRect(x - size / 2, y - size / 2, size, size);
    }
  }
}

// Between two processed scans the particles are carried along with the robot; the next scan moves and weighs each on its own.
class ParticleLayer {
  constructor(facts, arrays) {
    Object.assign(this, { times: arrays.particle_time, poses: arrays.particle, weights: arrays.particle_weight });
    this.count = facts.particles;
  }

  draw(pen, camera, moment, look, poseAt) {
    const step = countUpTo(this.times, moment.time) - 1;
    if (step < 0) return;
    const [x0, y0, yaw0] = poseAt(this.times[step]), [x1, y1, yaw1] = moment.pose;
    const dx = Math.cos(yaw0) * (x1 - x0) + Math.sin(yaw0) * (y1 - y0), dy = -Math.sin(yaw0) * (x1 - x0) + Math.cos(yaw0) * (y1 - y0), turn = wrapped(yaw1 - yaw0);
    let most = 0;
    for (let i = 0; i < this.count; i++) most = Math.max(most, this.weights[step * this.count + i]);
    pen.strokeStyle = pen.fillStyle = look.particle;
    const tick = Math.max(7, Math.min(22, 0.25 * camera.scale));
    for (let i = 0; i < this.count; i++) {
      const weight = this.weights[step * this.count + i], at = 3 * (step * this.count + i);
      if (!(weight > 0)) continue;
      const yaw = this.poses[at + 2], c = Math.cos(yaw), s = Math.sin(yaw);
      const x = camera.px(this.poses[at] + c * dx - s * dy), y = camera.py(this.poses[at + 1] + s * dx + c * dy);
      const radius = 0.9 + 2.3 * Math.sqrt(weight / most);
      pen.globalAlpha = 0.8;
      pen.beginPath();
      pen.arc(x, y, radius, 0, 7);
      pen.fill();
      pen.globalAlpha = 0.55;
      pen.lineWidth = 1;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + tick * Math.cos(yaw + turn), y - tick * Math.sin(yaw + turn));
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }
}

class NodeLayer {
  constructor(arrays) {
    Object.assign(this, { times: arrays.node_time, points: arrays.node });
  }

  draw(pen, camera, moment, look) {
    const count = countUpTo(this.times, moment.time);
    pen.fillStyle = look.node;
    let lastX = NaN, lastY = NaN;
    for (let i = 0; i < count; i++) {
      const x = camera.px(this.points[2 * i]), y = camera.py(this.points[2 * i + 1]);
      if (Math.abs(x - lastX) + Math.abs(y - lastY) < 2) continue;
      pen.fillRect(x - 1.5, y - 1.5, 3, 3);
      lastX = x;
      lastY = y;
    }
  }
}

// Edges of one kind, in the order in which they came to be.
class EdgeLayer {
  constructor(arrays, kind) {
    const chosen = [];
    for (let i = 0; i < arrays.edge_kind.length; i++) if (arrays.edge_kind[i] === kind) chosen.push(i);
    this.times = Float64Array.from(chosen, (i) => arrays.edge_time[i]);
    this.ends = Int32Array.from(chosen.flatMap((i) => [arrays.edge[2 * i], arrays.edge[2 * i + 1]]));
    this.points = arrays.node;
    this.classes = Uint8Array.from(chosen, (i) => arrays.edge_class[i]);
    this.loops = kind === 1;
  }

  stroke(pen, camera, from, to, wanted) {
    pen.beginPath();
    for (let i = from; i < to; i++) {
      if (wanted !== undefined && this.classes[i] !== wanted) continue;
      const a = 2 * this.ends[2 * i], b = 2 * this.ends[2 * i + 1];
      pen.moveTo(camera.px(this.points[a]), camera.py(this.points[a + 1]));
      pen.lineTo(camera.px(this.points[b]), camera.py(this.points[b + 1]));
    }
    pen.stroke();
  }

  draw(pen, camera, moment, look) {
    const count = countUpTo(this.times, moment.time);
    if (!this.loops) {
      pen.strokeStyle = look.edge;
      pen.lineWidth = 1;
      this.stroke(pen, camera, 0, count);
      return;
    }
    pen.lineWidth = 1.2;
    const alpha = Math.min(0.85, Math.max(0.2, 9 / Math.sqrt(count + 1))); // thousands must not hide the map
    pen.globalAlpha = alpha;
    for (const found of [...RESIDUALS.keys(), UNMEASURED]) {
      pen.strokeStyle = found === UNMEASURED ? look.closure : RESIDUALS[found][0];
      this.stroke(pen, camera, 0, count, found);
    }
    // What was closed a moment ago stands out.
    pen.lineWidth = 2.6;
    pen.globalAlpha = Math.min(1, alpha + 0.3);
    pen.strokeStyle = look.closure;
    this.stroke(pen, camera, countUpTo(this.times, moment.time - moment.flash), count);
    pen.globalAlpha = 1;
  }
}

class SubmapLayer {
  constructor(arrays) {
    Object.assign(this, { begun: arrays.submap_begun, finished: arrays.submap_finished, outlines: arrays.submap });
  }

  draw(pen, camera, moment, look) {
    const count = countUpTo(this.begun, moment.time);
    pen.strokeStyle = look.submap;
    for (const open of [false, true]) {
      pen.lineWidth = open ? 2.2 : 0.9;
      pen.globalAlpha = open ? 0.9 : 0.28;
      pen.beginPath();
      for (let i = 0; i < count; i++) {
        if ((this.finished[i] > moment.time) !== open || Number.isNaN(this.outlines[8 * i])) continue;
        for (let corner = 0; corner < 5; corner++) {
          const at = 8 * i + 2 * (corner % 4), x = camera.px(this.outlines[at]), y = camera.py(this.outlines[at + 1]);
          if (corner) pen.lineTo(x, y); else pen.moveTo(x, y);
        }
      }
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }
}

class RobotLayer {
  draw(pen, camera, moment, look) {
    const [x, y, yaw] = moment.pose, size = Math.max(9, Math.min(26, 0.35 * camera.scale));
    pen.save();
    pen.translate(camera.px(x), camera.py(y));
    pen.rotate(-yaw);
    pen.beginPath();
    pen.moveTo(size, 0);
    pen.lineTo(-0.75 * size, 0.65 * size);
    pen.lineTo(-0.4 * size, 0);
    pen.lineTo(-0.75 * size, -0.65 * size);
    pen.closePath();
    pen.fillStyle = look.robot;
    pen.strokeStyle = look.rim;
    pen.lineWidth = 2;
    pen.globalAlpha = moment.held ? 0.35 : 1;
    pen.fill();
    pen.stroke();
    pen.restore();
  }
}
