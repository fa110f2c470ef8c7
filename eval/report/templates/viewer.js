// One pixel in all pictures of a window, with its values, and the window's point cloud.
(() => {
const unpack = async (text) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
};
const halves = (bytes) => Float32Array.from(new Uint16Array(bytes.buffer), (bits) => {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, part = bits & 1023;
  if (exponent === 31) return part ? NaN : sign * Infinity;
  return exponent ? sign * 2 ** (exponent - 15) * (1 + part / 1024) : sign * 2 ** -24 * part;
});
const setBits = (bytes) => {
  const found = [];
  for (let k = 0; k < bytes.length; k++)
    for (let bit = 0; bit < 8; bit++) if (bytes[k] >> bit & 1) found.push(8 * k + bit);
  return Uint32Array.from(found);
};
const place = (sorted, value) => {
  let low = 0, high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < value) low = middle + 1; else high = middle;
  }
  return sorted[low] === value ? low : -1;
};
const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

async function load(linked) {
  const data = JSON.parse(linked.querySelector("script").textContent);
  data.frame = data.frame && await unpack(data.frame);
  data.truth = data.truth && halves(await unpack(data.truth));
  for (const colours of ["depth_colours", "error_colours"]) data[colours] = data[colours].map(rgb);
  for (const method of data.methods) {
    method.pixels = setBits(await unpack(method.mask));
    method.depth = halves(await unpack(method.depth));
    method.votes = method.votes && halves(await unpack(method.votes));
    method.causes = method.causes && await unpack(method.causes);
  }
  const picks = [...linked.closest(".choice").querySelectorAll("input.pick")];
  data.chosen = () => {
    const position = picks.findIndex((pick) => pick.checked);
    return data.methods.find((method) => method.position === position);
  };
  return data;
}

// --- the readout ---------------------------------------------------------------------------
function words(data, pixel) {
  const method = data.chosen(), at = method ? place(method.pixels, pixel) : -1;
  const parts = [`x ${pixel % data.w}, y ${Math.floor(pixel / data.w)} px`];
  if (data.frame) parts.push(`frame ${data.frame[pixel]}`);
  const truth = data.truth ? data.truth[pixel] : 0;
  if (data.truth) parts.push(truth > 0 ? `true depth ${truth.toFixed(3)} m` : "no true depth");
  if (at < 0) return [...parts, "no depth"].join(" · ");
  parts.push(`depth ${method.depth[at].toFixed(3)} m`);
  if (truth > 0) parts.push(`error ${(100 * (method.depth[at] - truth)).toFixed(1)} cm`);
  const cause = method.causes && data.causes[method.causes[at] - 1];
  if (cause) parts.push(`off by more than a tenth, ${cause[0]}: ${cause[1]}`);
  parts.push(method.votes ? `confidence ${method.votes[at].toPrecision(3)}` : "says no confidence");
  return parts.join(" · ");
}
function cross(picture) {
  const known = picture.querySelector("i.cross");
  if (known) return known;
  const made = document.createElement("i");
  made.className = "cross";
  picture.append(made);
  return made;
}
function point(linked, pixel) {
  const data = linked.data, text = words(data, pixel);
  linked.pixel = pixel;
  const large = [...document.querySelectorAll("dialog[open]")];
  for (const picture of [...linked.querySelectorAll(".picture"), ...large.flatMap((d) => [...d.querySelectorAll(".picture")])]) {
    const mark = cross(picture);
    mark.style.left = `${100 * (pixel % data.w + .5) / data.w}%`;
    mark.style.top = `${100 * (Math.floor(pixel / data.w) + .5) / data.h}%`;
  }
  for (const readout of [linked, ...large].flatMap((box) => [...box.querySelectorAll(".readout")])) {
    readout.textContent = text;
    readout.hidden = false;
  }
  linked.cloud?.draw();
}
function follow(event) {
  const picture = event.target.closest?.(".picture");
  const linked = picture?.closest(".linked") ?? picture?.closest("dialog")?.source;
  if (!linked?.data) return;
  const box = picture.getBoundingClientRect(), { w, h } = linked.data;
  const x = Math.floor((event.clientX - box.left - picture.clientLeft) / picture.clientWidth * w);
  const y = Math.floor((event.clientY - box.top - picture.clientTop) / picture.clientHeight * h);
  if (x >= 0 && y >= 0 && x < w && y < h) point(linked, y * w + x);
}
document.addEventListener("pointermove", follow);
document.addEventListener("pointerdown", follow);

// --- the point cloud -----------------------------------------------------------------------
const START = { yaw: -.5, pitch: .28, zoom: 1 };
class Cloud {
  constructor(box, linked) {
    Object.assign(this, START, { box, linked, data: linked.data, canvas: box.querySelector("canvas") });
    this.truthPoints = this.truthCloud();
    this.setCentre();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.listen();
  }
  truthCloud() {
    const { truth, most } = this.data, known = [];
    if (!truth) return known;
    for (let k = 0; k < truth.length; k++) if (truth[k] > 0) known.push(k);
    const step = Math.max(1, known.length / most), kept = [];
    for (let k = 0; k < known.length; k += step) kept.push(known[Math.floor(k)]);
    return kept;
  }
  setCentre() {
    const method = this.data.methods[0], { truth } = this.data;
    const depths = truth ? this.truthPoints.map((k) => truth[k]) : [...method.depth];
    depths.sort((a, b) => a - b);
    const share = (part) => depths[Math.floor(part * (depths.length - 1))] ?? 1;
    this.far = Math.min(share(.98), 1.3 * this.data.range_m[1]);
    this.middle = .55 * this.far;
    this.distance = 1.4 * this.far;
  }
  project(x, y, z) {
    const { yaw, pitch } = this, zc = z - this.middle;
    const a = Math.cos(yaw) * x + Math.sin(yaw) * zc, b = -Math.sin(yaw) * x + Math.cos(yaw) * zc;
    const c = Math.cos(pitch) * y - Math.sin(pitch) * b, d = Math.sin(pitch) * y + Math.cos(pitch) * b;
    const away = d + this.distance / this.zoom;
    if (away < .02 * this.distance) return null;
    const s = this.focal / away;
    return [this.canvas.width / 2 + s * a, this.canvas.height * .6 + s * c, away];
  }
  at(pixel, depth) {
    const [fx, fy, cx, cy] = this.data.camera, { w } = this.data;
    return this.project((pixel % w - cx) / fx * depth, (Math.floor(pixel / w) - cy) / fy * depth, depth);
  }
  plot(buffer, pixel, depth, size, colour, before = 1) {
    const spot = this.at(pixel, depth);
    if (!spot) return 0;
    spot[2] *= before;
    const { width, height } = this.canvas, value = 0xff000000 | colour[2] << 16 | colour[1] << 8 | colour[0];
    const x0 = Math.round(spot[0] - size / 2), y0 = Math.round(spot[1] - size / 2);
    for (let y = Math.max(0, y0); y < Math.min(height, y0 + size); y++)
      for (let x = Math.max(0, x0); x < Math.min(width, x0 + size); x++) {
        const k = y * width + x;
        if (spot[2] < buffer.near[k]) { buffer.near[k] = spot[2]; buffer.pixels[k] = value; }
      }
    return 1;
  }
  ground() {
    const probe = getComputedStyle(this.canvas), parts = (text) => text.match(/\d+/g).slice(0, 3).map(Number);
    return [parts(probe.backgroundColor), parts(probe.color)];
  }
  draw() {
    const canvas = this.canvas, ratio = Math.min(2, window.devicePixelRatio || 1);
    if (!canvas.clientWidth) return;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    this.focal = .95 * Math.min(canvas.width, 1.6 * canvas.height);
    const context = canvas.getContext("2d"), image = context.createImageData(canvas.width, canvas.height);
    const buffer = { near: new Float32Array(canvas.width * canvas.height).fill(Infinity), pixels: new Uint32Array(image.data.buffer) };
    const [ground, ink] = this.ground();
    const drawn = this.drawTruth(buffer, ground, ink, ratio) + this.drawMethod(buffer, ratio);
    context.putImageData(image, 0, 0);
    this.drawAxis(context, ground, ink, ratio);
    this.drawMark(context, ink, ratio);
    canvas.dataset.drawn = drawn;
  }
  drawTruth(buffer, ground, ink, ratio) {
    if (!this.box.querySelector("[name=truth]")?.checked) return 0;
    const { truth, frame } = this.data, size = Math.max(1, Math.round(2 * ratio));
    let drawn = 0;
    for (const pixel of this.truthPoints) {
      // The frame's brightness, up to half of the way from paper to ink.
      const light = frame ? frame[pixel] / 255 : .5, dark = ground[0] < 128;
      const share = dark ? .12 + .34 * light : .12 + .34 * (1 - light);
      drawn += this.plot(buffer, pixel, truth[pixel], size, ground.map((g, k) => Math.round(g + share * (ink[k] - g))));
    }
    return drawn;
  }
  colourOf(pixel, depth) {
    const { range_m, truth, depth_colours, error_colours, cap_cm } = this.data;
    const byError = this.box.querySelector("[name=error]")?.checked;
    const colours = byError ? error_colours : depth_colours, [near, far] = range_m;
    if (byError && !(truth[pixel] > 0)) return [128, 128, 128];
    const share = byError ? 100 * Math.abs(depth - truth[pixel]) / cap_cm : (1 / depth - 1 / far) / (1 / near - 1 / far);
    return colours[Math.round(Math.min(1, Math.max(0, share)) * (colours.length - 1))];
  }
  drawMethod(buffer, ratio) {
    const method = this.data.chosen();
    if (!method) return 0;
    const step = Math.max(1, method.pixels.length / this.data.most), size = Math.round(2 * ratio);
    let drawn = 0;
    for (let k = 0; k < method.pixels.length; k += step) {
      const at = Math.floor(k), pixel = method.pixels[at], depth = method.depth[at];
      drawn += this.plot(buffer, pixel, depth, size, this.colourOf(pixel, depth), .99); // before the truth that it hits
    }
    return drawn;
  }
  drawAxis(context, ground, ink, ratio) {
    const power = 10 ** Math.floor(Math.log10(this.far / 3)), step = [1, 2, 5, 10].map((n) => n * power).find((n) => this.far / n <= 6);
    context.strokeStyle = context.fillStyle = `rgb(${ink})`;
    context.lineWidth = ratio;
    context.font = `${11 * ratio}px system-ui, sans-serif`;
    const [fx, fy, cx, cy] = this.data.camera, { w, h } = this.data, size = .06 * this.far;
    const corners = [[0, 0], [w, 0], [w, h], [0, h]].map(([u, v]) => [(u - cx) / fx * size, (v - cy) / fy * size, size]);
    const line = (a, b) => {
      const p = this.project(...a), q = this.project(...b);
      if (!p || !q) return;
      context.beginPath(); context.moveTo(p[0], p[1]); context.lineTo(q[0], q[1]); context.stroke();
    };
    corners.forEach((corner, k) => { line([0, 0, 0], corner); line(corner, corners[(k + 1) % 4]); });
    line([0, 0, 0], [0, 0, Math.floor(this.far / step) * step]);
    for (let z = step; z <= this.far + 1e-9; z += step) {
      line([-.012 * this.far, 0, z], [.012 * this.far, 0, z]);
      const spot = this.project(0, 0, z);
      if (!spot) continue;
      const label = [`${+z.toPrecision(3)} m`, spot[0] + 5 * ratio, spot[1] - 5 * ratio];
      context.save();
      context.strokeStyle = `rgb(${ground})`;
      context.lineWidth = 3 * ratio;
      context.strokeText(...label);
      context.restore();
      context.fillText(...label);
    }
  }
  drawMark(context, ink, ratio) {
    const pixel = this.linked.pixel, method = this.data.chosen();
    if (pixel === undefined || !method) return;
    const at = place(method.pixels, pixel), truth = this.data.truth?.[pixel];
    for (const depth of [at < 0 ? 0 : method.depth[at], truth ?? 0]) {
      const spot = depth > 0 && this.at(pixel, depth);
      if (!spot) continue;
      context.strokeStyle = `rgb(${ink})`;
      context.lineWidth = 1.5 * ratio;
      context.beginPath(); context.arc(spot[0], spot[1], 6 * ratio, 0, 7); context.stroke();
    }
  }
  turn(yaw, pitch, zoom = 1) {
    this.yaw += yaw;
    this.pitch = Math.min(1.57, Math.max(-1.57, this.pitch + pitch));
    this.zoom = Math.min(20, Math.max(.3, this.zoom * zoom));
    this.draw();
  }
  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) this.turn(-event.movementX / 180, -event.movementY / 180);
    });
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      this.turn(0, 0, 2 ** (-event.deltaY / 400));
    }, { passive: false });
    const keys = { ArrowLeft: [.1, 0], ArrowRight: [-.1, 0], ArrowUp: [0, .1], ArrowDown: [0, -.1], "+": [0, 0, 1.2], "-": [0, 0, 1 / 1.2] };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      this.turn(...keys[event.key]);
    });
    this.box.addEventListener("change", () => this.draw());
    for (const button of this.box.querySelectorAll("button"))
      button.addEventListener("click", () => {
        if (button.name === "reset") Object.assign(this, START);
        this.turn(0, 0, { closer: 1.25, farther: .8 }[button.name] ?? 1);
      });
  }
}

async function start(linked) {
  linked.data = await load(linked);
  const box = linked.querySelector(".cloud");
  if (box) linked.cloud = new Cloud(box, linked);
  linked.closest(".choice").addEventListener("change", () => {
    linked.cloud?.draw();
    if (linked.pixel !== undefined) point(linked, linked.pixel);
  });
}
if (window.DecompressionStream)
  (async () => {
    for (const linked of document.querySelectorAll(".linked")) await start(linked);
    document.documentElement.classList.add("ready");
  })();
})();
