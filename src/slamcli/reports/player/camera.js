// SPDX-License-Identifier: MIT
// Which part of the map is on the screen: centre in metres and pixels a metre, moved by mouse, fingers, wheel and buttons.

const FOLLOWED_M = 16; // what is shown around a robot that is followed, at most

class Camera {
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed, x: 0, y: 0, scale: 50, width: 1, height: 1, dots: 1, bounds: [-1, -1, 1, 1], whole: true, follow: false });
    this.held = new Map();
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const [px, py] = this.at(event);
      this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), px, py);
    }, { passive: false });
    canvas.addEventListener("dblclick", (event) => this.zoom(2.5, ...this.at(event)));
    canvas.addEventListener("pointerdown", (event) => {
      this.held.set(event.pointerId, this.at(event));
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.held.delete(event.pointerId));
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  moved(event) {
    const old = this.held.get(event.pointerId);
    if (!old) return;
    const now = this.at(event);
    if (this.held.size === 2) {
      const other = [...this.held.entries()].find(([id]) => id !== event.pointerId)[1];
      const gap = Math.hypot(old[0] - other[0], old[1] - other[1]);
      if (gap > 0) this.zoom(Math.hypot(now[0] - other[0], now[1] - other[1]) / gap, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    }
    const share = 1 / this.held.size; // two fingers that move together move the map once
    this.x -= ((now[0] - old[0]) * share) / this.scale;
    this.y += ((now[1] - old[1]) * share) / this.scale;
    if (this.held.size === 1 && Math.hypot(now[0] - old[0], now[1] - old[1]) > 1) this.setFollow(false);
    this.whole = false;
    this.held.set(event.pointerId, now);
    this.changed();
  }

  // Zooms by a factor so that the place below a pixel stays there.
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(4000, Math.max(0.02, this.scale * factor));
    if (!this.follow) {
      this.x += (px - this.width / 2) * (1 / this.scale - 1 / scale);
      this.y -= (py - this.height / 2) * (1 / this.scale - 1 / scale);
    }
    this.scale = scale;
    this.whole = false;
    this.changed();
  }

  setFollow(follow) {
    if (follow === this.follow) return;
    this.follow = follow;
    if (follow) {
      this.scale = Math.max(this.scale, Math.min(this.width, this.height) / FOLLOWED_M, this.fitting());
      this.whole = false;
    }
    this.changed();
  }

  fitting() {
    const [left, low, right, high] = this.bounds;
    return 0.92 * Math.min(this.width / Math.max(right - left, 0.5), this.height / Math.max(high - low, 0.5));
  }

  showAll() {
    const [left, low, right, high] = this.bounds;
    Object.assign(this, { x: (left + right) / 2, y: (low + high) / 2, scale: this.fitting(), whole: true, follow: false });
    this.changed();
  }

  // Takes the size of the canvas on the page; what was shown stays shown.
  resize() {
    const box = this.canvas.getBoundingClientRect(), dots = Math.min(3, window.devicePixelRatio || 1);
    const width = Math.max(1, box.width), height = Math.max(1, box.height);
    if (width === this.width && height === this.height && dots === this.dots) return;
    Object.assign(this, { width, height, dots });
    this.canvas.width = Math.round(width * dots);
    this.canvas.height = Math.round(height * dots);
    if (this.whole) this.showAll(); else this.changed();
  }

  px(x) { return (x - this.x) * this.scale + this.width / 2; }

  py(y) { return this.height / 2 - (y - this.y) * this.scale; }
}
