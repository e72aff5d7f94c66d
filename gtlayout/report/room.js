// The room in 3D. Lengths are in world units, z is up; plotly's own unit is the room's longest side.
const room = JSON.parse(document.getElementById("room-data").textContent);
const view = document.getElementById("room-view");
const middle = room.low.map((low, axis) => (low + room.high[axis]) / 2);
const sides = room.low.map((low, axis) => Math.max(room.high[axis] - low, 1e-9));
const longest = Math.max(...sides);
const unit = room.metric ? "m" : "u";
// What is not reliable is seen, but does not catch the eye.
const PALE = 0.3;
let mode = "instance";
let eye = fitted();

const checked = (id) => document.getElementById(id).checked;
// plotly reads some HTML in texts: names from files are none.
const plain = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
// As gtlayout/figures.py: a σ as large as what it is of says nothing.
const isKnown = (sigma, of) => sigma !== null && sigma < of;
const withSigma = (length, sigma) =>
  isKnown(sigma, length) ? `${length.toFixed(2)} ± ${sigma.toFixed(2)} ${unit}` : `${length.toFixed(2)} ${unit} ± unknown`;
const sigmaAt = (sigma) => (isKnown(sigma, longest) ? `σ ${sigma.toPrecision(2)} ${unit}` : "σ unknown");

// From the direction that the room is looked at from first, as near as all of its box is seen. plotly's field of view is
// 45° of the height. The corners of the box that are nearest to the eye are seldom part of the room.
function fitted() {
  const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
  const dot = (one, other) => one.reduce((sum, value, axis) => sum + value * other[axis], 0);
  const unitOf = (vector) => vector.map((value) => value / Math.max(Math.hypot(...vector), 1e-9));
  const ahead = unitOf(room.eye), right = unitOf(cross([0, 0, 1], ahead)), up = cross(ahead, right);
  const high = Math.tan(Math.PI / 8), wide = (high * view.clientWidth) / Math.max(view.clientHeight, 1);
  const needed = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => {
    const at = sides.map((side, axis) => (((corner >> axis) & 1 ? 0.5 : -0.5) * side) / longest);
    return dot(at, ahead) + Math.max(Math.abs(dot(at, up)) / high, Math.abs(dot(at, right)) / wide);
  });
  return ahead.map((value) => 0.92 * Math.max(...needed) * value);
}

// Normals point at the cameras: from behind an instance one looks through it into the room.
function seenFromInside(instance) {
  const [x, y, z] = eye.map((value, axis) => middle[axis] + value * longest);
  const [nx, ny, nz] = instance.normal;
  return nx * x + ny * y + nz * z + instance.d > 0;
}

// Shaded here, by the plane's normal: plotly's lighting takes it from triangles, and thin ones have none.
const LIGHT = [0.27, 0.53, 0.8];
function shaded(instance) {
  const share = 0.72 + 0.28 * Math.abs(instance.normal.reduce((sum, value, axis) => sum + value * LIGHT[axis], 0));
  return `rgb(${instance.color.map((channel) => Math.round(channel * share)).join()})`;
}

function brokenLines(instances) {
  return [0, 1, 2].map((axis) => instances.flatMap((instance) => instance.outline[axis]));
}

function traces() {
  const bySigma = mode === "sigma";
  const front = room.instances.filter((instance) => !checked("cut-away") || seenFromInside(instance));
  const behind = room.instances.filter((instance) => !front.includes(instance));
  const drawn = [];
  for (const instance of front) {
    const [x, y, z] = instance.vertices;
    const [i, j, k] = instance.faces;
    // Also a plain colour is a scale: plotly keeps the scale of an instance that gets a colour instead.
    const scale = bySigma ? room.sigma_scale : [shaded(instance), shaded(instance)];
    drawn.push({
      type: "mesh3d", opacity: instance.reliable ? 1 : PALE, name: instance.name, x, y, z, i, j, k, hoverinfo: "text",
      intensity: instance.sigma, cmin: 0, cmax: room.sigma_full, showscale: false,
      colorscale: scale.map((color, step) => [step / (scale.length - 1), color]),
      text: instance.sigma.map((sigma) => `${plain(instance.name)}: ${sigmaAt(sigma)}`),
      lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 },
    });
  }
  const outlines = [
    [front.filter((instance) => instance.reliable), "rgba(30,35,45,.9)", 3],
    [[...front.filter((instance) => !instance.reliable), ...behind], "rgba(128,136,150,.6)", 2],
  ];
  for (const [instances, color, width] of outlines.filter(([instances]) => instances.length > 0)) {
    const [x, y, z] = brokenLines(instances);
    drawn.push({ type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip", line: { color, width } });
  }
  const ink = getComputedStyle(document.body).color;
  if (checked("show-path")) {
    const [x, y, z] = room.path;
    drawn.push({
      type: "scatter3d", mode: "lines", x, y, z, line: { color: "#e11d8f", width: 5 }, hoverinfo: "text", text: "camera path",
    });
  }
  for (const { ends: [x, y, z], length, sigma } of checked("show-dimensions") ? room.dimensions : []) {
    const between = (ends) => [ends[0], (ends[0] + ends[1]) / 2, ends[1]];
    drawn.push({
      type: "scatter3d", mode: "lines+text+markers", x: between(x), y: between(y), z: between(z), hoverinfo: "skip",
      text: ["", withSigma(length, sigma), ""], textfont: { color: ink, size: 13 },
      line: { color: ink, width: 3 }, marker: { color: ink, size: [4, 0.1, 4] },
    });
  }
  return drawn;
}

function layout() {
  const axis = (index) => ({
    visible: false, range: [room.low[index], room.high[index]], autorange: false, showspikes: false,
  });
  const [x, y, z] = sides.map((side) => side / longest);
  const [ex, ey, ez] = eye;
  return {
    margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, uirevision: "kept",
    hoverlabel: { align: "left" },
    scene: {
      xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", aspectratio: { x, y, z }, dragmode: "turntable",
      camera: { eye: { x: ex, y: ey, z: ez }, center: { x: 0, y: 0, z: 0 }, up: { x: 0, y: 0, z: 1 } },
    },
  };
}

// Nothing before plotly has been read: then it draws what has been chosen by then.
const draw = () => window.Plotly?.react(view, traces(), layout(), { responsive: true, displayModeBar: false });

for (const button of document.querySelectorAll("button[data-mode]")) {
  button.addEventListener("click", () => {
    mode = button.dataset.mode;
    for (const other of document.querySelectorAll("button[data-mode]")) {
      other.setAttribute("aria-pressed", String(other === button));
    }
    document.getElementById("instance-legend").hidden = mode !== "instance";
    document.getElementById("sigma-legend").hidden = mode !== "sigma";
    draw();
  });
}
for (const id of ["cut-away", "show-dimensions", "show-path"]) document.getElementById(id).addEventListener("change", draw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

function start() {
  const source = document.getElementById("plotly-source");
  if (source) {
    const script = document.createElement("script");
    script.textContent = source.textContent;
    document.head.append(script);
  }
  if (!window.Plotly) {
    view.textContent = "Nothing can be drawn: plotly.min.js, which this page shares with others of its run, is not in its place.";
    return;
  }
  draw().then(() => {
    view.dataset.drawn = "yes";
    view.on("plotly_relayout", (change) => {
      const camera = change["scene.camera"];
      if (!camera) return;
      const sides = () => room.instances.map(seenFromInside).join();
      const before = sides();
      eye = ["x", "y", "z"].map((axis) => camera.eye[axis]);
      if (sides() !== before) draw();
    });
  });
}

// plotly is large: the page is to be read before it has been, so it runs after the first picture of the page.
requestAnimationFrame(() => setTimeout(start));
