// The solved room in 3D on a canvas, coloured by σ. Triangles are painted from back to front; z is up.

const STEP = 0.12;

export class Room {
  constructor(canvas) {
    Object.assign(this, { canvas, room: null, azimuth: 0, height: 0.7, away: 1.3 });
    let last = null;
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); last = [event.clientX, event.clientY]; });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.turn((last[0] - event.clientX) * 0.01, (event.clientY - last[1]) * 0.01);
      last = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { last = null; });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.approach(Math.exp(event.deltaY * 0.001)); }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] };
      if (event.key in turns) this.turn(...turns[event.key]);
      else if (event.key === "+" || event.key === "-") this.approach(event.key === "+" ? 0.9 : 1.1);
      else return;
      event.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  show(room) {
    if (room && !this.room) {
      const [x, y, z] = room.eye;
      Object.assign(this, { azimuth: Math.atan2(y, x), height: Math.atan2(z, Math.hypot(x, y)) });
    }
    this.room = room;
    this.draw();
  }

  turn(around, up) {
    this.azimuth += around;
    this.height = Math.min(Math.max(this.height + up, -1.5), 1.5);
    this.draw();
  }

  approach(factor) {
    this.away = Math.min(Math.max(this.away * factor, 0.6), 5);
    this.draw();
  }

  /** A function from a point of the room to [x, y, depth] on the canvas, and where the eye is. */
  projection(width, height) {
    const { low, high } = this.room;
    const center = low.map((value, axis) => (value + high[axis]) / 2);
    const size = Math.max(...low.map((value, axis) => high[axis] - value), 1e-9);
    const [ca, sa, ch, sh] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.height), Math.sin(this.height)];
    const [back, right, up] = [[ca * ch, sa * ch, sh], [-sa, ca, 0], [-ca * sh, -sa * sh, ch]];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const focal = 1.1 * Math.min(width, height);
    const eye = center.map((value, axis) => value + this.away * size * back[axis]);
    const project = (point) => {
      const off = point.map((value, axis) => (value - center[axis]) / size);
      const depth = Math.max(this.away - dot(off, back), 0.05);
      return [width / 2 + (focal * dot(off, right)) / depth, height / 2 - (focal * dot(off, up)) / depth, depth];
    };
    return { project, eye };
  }

  draw() {
    const { canvas, room } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    Object.assign(canvas, { width: width * ratio, height: height * ratio });
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    if (!room) return;
    const { project, eye } = this.projection(width, height);
    // From behind a plane one looks through it into the room.
    const seen = (one) => one.normal[0] * eye[0] + one.normal[1] * eye[1] + one.normal[2] * eye[2] + one.d > 0;
    const scale = room.sigma_scale;
    const triangles = room.instances.filter(seen).flatMap((one) => {
      const points = one.vertices[0].map((x, k) => project([x, one.vertices[1][k], one.vertices[2][k]]));
      return one.faces[0].map((i, k) => {
        const corners = [i, one.faces[1][k], one.faces[2][k]];
        const sigma = corners.reduce((sum, at) => sum + (one.sigma[at] ?? Infinity), 0) / 3;
        const share = Math.min(sigma / room.sigma_full, 1);
        return { points: corners.map((at) => points[at]), color: scale[Math.round(share * (scale.length - 1))] };
      });
    });
    const depth = ({ points }) => points[0][2] + points[1][2] + points[2][2];
    triangles.sort((a, b) => depth(b) - depth(a));
    for (const { points, color } of triangles) {
      context.beginPath();
      points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      Object.assign(context, { fillStyle: color, strokeStyle: color, lineWidth: 0.7 });
      context.fill();
      context.stroke(); // closes the hairlines between neighbours
    }
    this.lines(context, project, room.instances.filter(seen).map((one) => one.outline), "rgba(20,25,35,.85)", 1.5);
    this.lines(context, project, room.instances.filter((one) => !seen(one)).map((one) => one.outline), "rgba(128,136,150,.6)", 1);
    this.lines(context, project, [room.path], "#e11d8f", 2);
    canvas.dataset.drawn = room.number;
  }

  lines(context, project, all, color, width) {
    context.beginPath();
    for (const [x, y, z] of all) {
      x.forEach((value, k) => {
        if (value === null) return;
        const [px, py] = project([value, y[k], z[k]]);
        if (k === 0 || x[k - 1] === null) context.moveTo(px, py);
        else context.lineTo(px, py);
      });
    }
    Object.assign(context, { strokeStyle: color, lineWidth: width });
    context.stroke();
  }
}
