// SPDX-License-Identifier: MIT
// The map as it grows: a list of pixels in the order in which they change, run forwards and backwards on a canvas of its own.

// One resolution of the map. Pixel i of the list turns from code before[i] to after[i]; ends[k] is how many have turned after pose k - 1.
class GrowthLevel {
  constructor(width, height, pixels, before, after, ends) {
    Object.assign(this, { width, height, pixels, before, after, ends, done: 0 });
    this.canvas = document.createElement("canvas");
    this.canvas.width = width;
    this.canvas.height = height;
    this.context = this.canvas.getContext("2d");
    this.image = this.context.createImageData(width, height);
    this.colours = new Uint32Array(this.image.data.buffer);
  }

  // Shows the map after `count` poses; what turned since is all that is touched.
  show(count, palette) {
    const target = this.ends[Math.max(0, Math.min(count, this.ends.length - 1))];
    const { pixels, colours, width } = this;
    const change = Math.abs(target - this.done);
    if (!change) return;
    if (change > colours.length / 16) { // finding the rectangle would take longer than copying the whole
      for (; this.done < target; this.done++) colours[pixels[this.done]] = palette[this.after[this.done]];
      while (this.done > target) colours[pixels[--this.done]] = palette[this.before[this.done]];
      this.context.putImageData(this.image, 0, 0);
      return;
    }
    let left = width, right = -1, top = this.height, bottom = -1;
    const turn = (pixel, code) => {
      colours[pixel] = palette[code];
      const y = (pixel / width) | 0, x = pixel - y * width;
      if (x < left) left = x;
      if (x > right) right = x;
      if (y < top) top = y;
      if (y > bottom) bottom = y;
    };
    for (; this.done < target; this.done++) turn(pixels[this.done], this.after[this.done]);
    while (this.done > target) turn(pixels[--this.done], this.before[this.done]);
    this.context.putImageData(this.image, 0, 0, left, top, right - left + 1, bottom - top + 1);
  }

  // Paints everything anew, as after a change of the colours.
  repaint(palette) {
    this.colours.fill(0);
    for (let i = 0; i < this.done; i++) this.colours[this.pixels[i]] = palette[this.after[i]];
    this.context.putImageData(this.image, 0, 0);
  }
}

// Codes are occupancy plus one, 0 unknown; a reduced pixel shows the most occupied of its cells, so that thin walls stay.
class Growth {
  constructor(width, height, cells, firstSeen, poses) {
    this.levels = [Growth.whole(width, height, cells, firstSeen, poses)];
    this.palette = new Uint32Array(256);
  }

  static whole(width, height, cells, firstSeen, poses) {
    const ends = new Int32Array(poses + 1);
    // What is known and was never seen by a pose that was kept belongs to the finished map.
    const when = (i) => Math.min(poses - 1, firstSeen ? (firstSeen[i] < 0 ? poses - 1 : firstSeen[i]) : 0);
    for (let i = 0; i < cells.length; i++) if (cells[i] >= 0) ends[when(i) + 1]++;
    for (let k = 0; k < poses; k++) ends[k + 1] += ends[k];
    const next = ends.slice(), total = ends[poses];
    const pixels = new Int32Array(total), after = new Uint8Array(total);
    for (let i = 0; i < cells.length; i++) {
      if (cells[i] < 0) continue;
      const place = next[when(i)]++, row = (i / width) | 0;
      pixels[place] = (height - 1 - row) * width + (i - row * width); // row 0 is the lowest y, and the last of a picture
      after[place] = cells[i] + 1;
    }
    return new GrowthLevel(width, height, pixels, new Uint8Array(total), after, ends);
  }

  static half(fine) {
    const width = (fine.width + 1) >> 1, height = (fine.height + 1) >> 1;
    const code = new Uint8Array(width * height), ends = new Int32Array(fine.ends.length);
    const pixels = new Int32Array(fine.pixels.length), before = new Uint8Array(fine.pixels.length), after = new Uint8Array(fine.pixels.length);
    let count = 0;
    for (let k = 0; k + 1 < fine.ends.length; k++) {
      for (let i = fine.ends[k]; i < fine.ends[k + 1]; i++) {
        const y = (fine.pixels[i] / fine.width) | 0, x = fine.pixels[i] - y * fine.width;
        const pixel = (y >> 1) * width + (x >> 1);
        if (fine.after[i] <= code[pixel]) continue;
        pixels[count] = pixel;
        before[count] = code[pixel];
        code[pixel] = after[count] = fine.after[i];
        count++;
      }
      ends[k + 1] = count;
    }
    return new GrowthLevel(width, height, pixels.slice(0, count), before.slice(0, count), after.slice(0, count), ends);
  }

  // The canvas after `count` poses with at least as many pixels as are shown (`pixelsPerCell` of the screen).
  canvas(count, pixelsPerCell) {
    let number = 0;
    for (let share = pixelsPerCell; share < 0.6 && number < 6; share *= 2) number++;
    while (this.levels.length <= number) this.levels.push(Growth.half(this.levels[this.levels.length - 1]));
    this.levels[number].show(count, this.palette);
    return this.levels[number].canvas;
  }

  known(count) {
    const { ends } = this.levels[0];
    return ends[Math.max(0, Math.min(count, ends.length - 1))];
  }

  // Free and occupied are colours [r, g, b]; what is between them is mixed.
  colour(free, occupied) {
    for (let code = 1; code <= 101; code++) {
      const share = (code - 1) / 100;
      const [r, g, b] = free.map((value, i) => Math.round(value + share * (occupied[i] - value)));
      this.palette[code] = (255 << 24) | (b << 16) | (g << 8) | r;
    }
    for (const level of this.levels) level.repaint(this.palette);
  }
}
