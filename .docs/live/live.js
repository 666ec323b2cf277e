"use strict";

// The map, as in nasm.maps: one step is both kicks, x and y in turns, x on the lift.
function step(kappa, x, y) {
  for (const strength of kappa) {
    y += (strength / (2 * Math.PI)) * Math.sin(2 * Math.PI * (x - Math.floor(x)));
    x += y;
  }
  return [x, y];
}

function orbit(kappa, x, y, steps) {
  const points = [[x, y]];
  for (let n = 0; n < steps; n++) points.push(([x, y] = step(kappa, x, y)));
  return points;
}

// First step at which y is outside the window; Infinity if none up to `steps`.
function escapeTime(kappa, x, y, steps) {
  for (let n = 1; n <= steps; n++) {
    [x, y] = step(kappa, x, y);
    if (y < -2 || y > 2.3) return n;
  }
  return Infinity;
}

// Weighted Birkhoff average of the advance in x.
function rotationNumber(kappa, x, y, steps) {
  let sum = 0;
  let weights = 0;
  for (let n = 1; n < steps; n++) {
    const [next, above] = step(kappa, x, y);
    const t = n / steps;
    const weight = Math.exp(-1 / (t * (1 - t)));
    sum += weight * (next - x);
    weights += weight;
    [x, y] = [next, above];
  }
  return sum / weights;
}

// All forcings are images of those between 0 and 45 degrees, by signs and exchange.
function fold([first, second]) {
  const [large, small] = [Math.abs(first), Math.abs(second)].sort((a, b) => b - a);
  return { size: Math.hypot(large, small), angle: (Math.atan2(small, large) * 180) / Math.PI };
}

// The indices of the rays on either side of an angle.
function neighbours(angle) {
  const angles = BOUNDARY.angle;
  let right = angles.findIndex((each) => each >= angle);
  if (right < 0) right = angles.length - 1;
  return angles[right] === angle ? [right, right] : [Math.max(right - 1, 0), right];
}

// The answer proved for the triangle (with one corner at 0) or the cell around a forcing; or "".
function proved(kappa) {
  const [large, small] = kappa.map(Math.abs).sort((a, b) => b - a);
  const holds = ([a, b, c, d]) => // on the inner side of its three sides
    a * small >= b * large && large * d >= small * c && (c - a) * (small - b) >= (d - b) * (large - a);
  if (PROVED.triangles.some(holds)) return "BARRIER";
  const [column, row] = [large, small].map((each) => Math.floor(each * PROVED.n));
  const cells = PROVED.runs.some(([on, from, to]) => on === row && from <= column && column < to);
  return cells ? "TRANSPORT" : "";
}

// The proved answer, if any; otherwise compare with `lower` and `upper` of the adjacent rays.
function verdict(kappa) {
  if (proved(kappa)) return proved(kappa);
  const { size, angle } = fold(kappa);
  const rays = neighbours(angle);
  if (size <= Math.min(...rays.map((ray) => BOUNDARY.lower[ray]))) return "BARRIER";
  if (size >= Math.max(...rays.map((ray) => BOUNDARY.upper[ray]))) return "TRANSPORT";
  return "UNDECIDED";
}

const WORDS = {
  BARRIER: "A barrier exists: an invariant circle keeps orbits below it from those above.",
  TRANSPORT: "Transport is global: no circle is left.",
  UNDECIDED: "Too close to the boundary for an answer on this page; use nasm.verdict.",
};

const RANGE = 1.2; // of κ1 and κ2
const LINES = { BARRIER: "#0072b2", TRANSPORT: "#d55e00", UNDECIDED: "#777" };
let kappa = [0.3, 0.5];

function context(name) {
  const canvas = document.getElementById(name);
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.fillStyle = pen.strokeStyle = getComputedStyle(document.body).color;
  return [pen, canvas.width, canvas.height];
}

// One path for each answer, so that images which meet are not drawn twice.
function drawProved(pen, place) {
  const n = PROVED.n;
  const triangles = PROVED.triangles.map(([a, b, c, d]) => [[0, 0], [a, b], [c, d]]);
  const strips = PROVED.runs.map(([row, from, to]) =>
    [[from, row], [to, row], [to, row + 1], [from, row + 1]].map(([a, b]) => [a / n, b / n]));
  for (const [answer, shapes] of [["BARRIER", triangles], ["TRANSPORT", strips]]) {
    pen.beginPath();
    for (const shape of shapes) {
      for (const [right, up] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
        for (const [first, second] of [[0, 1], [1, 0]]) {
          // Mirror images are traversed in the opposite direction, so that their areas add up.
          const image = shape.map((point) => [right * point[first], up * point[second]]);
          if (right * up * (first ? -1 : 1) < 0) image.reverse();
          pen.moveTo(...place(image[0]));
          for (const point of image.slice(1)) pen.lineTo(...place(point));
          pen.closePath();
        }
      }
    }
    pen.globalAlpha = 0.25;
    pen.fillStyle = LINES[answer];
    pen.fill();
    pen.globalAlpha = 1;
  }
  pen.fillStyle = pen.strokeStyle;
}

function drawPlane() {
  const [pen, width, height] = context("plane");
  const place = ([a, b]) => [((a / RANGE + 1) / 2) * width, ((1 - b / RANGE) / 2) * height];
  const arc = BOUNDARY.angle.map((angle, ray) => {
    const [phi, scale] = [(angle * Math.PI) / 180, BOUNDARY.value[ray]];
    return [scale * Math.cos(phi), scale * Math.sin(phi)];
  });
  const octants = [[...arc], arc.map(([a, b]) => [b, a]).reverse()].flat();
  const quarters = [
    octants,
    octants.map(([a, b]) => [-a, b]).reverse(),
    octants.map(([a, b]) => [-a, -b]),
    octants.map(([a, b]) => [a, -b]).reverse(),
  ];
  drawProved(pen, place);
  pen.beginPath();
  for (const point of quarters.flat()) pen.lineTo(...place(point));
  pen.closePath();
  pen.stroke();
  pen.globalAlpha = 0.3;
  pen.strokeRect(0.5, 0.5, width - 1, height - 1);
  for (const [from, to] of [[[-RANGE, 0], [RANGE, 0]], [[0, -RANGE], [0, RANGE]]]) {
    pen.beginPath();
    pen.moveTo(...place(from));
    pen.lineTo(...place(to));
    pen.stroke();
  }
  pen.globalAlpha = 1;
  pen.fillStyle = LINES[verdict(kappa)];
  pen.beginPath();
  pen.arc(...place(kappa), 6, 0, 2 * Math.PI);
  pen.fill();
}

function drawPortrait() {
  const [pen, width, height] = context("portrait");
  for (let n = 0; n < 48; n++) {
    for (const [x, y] of orbit(kappa, n % 2 ? 0.5 : 0, n / 48, 500)) {
      const [right, up] = [x - Math.floor(x), y - Math.floor(y)];
      pen.fillRect(right * width, (1 - up) * height, 1, 1);
    }
  }
}

// Escapes are shown over the starts (x, y), on a square of cells.
function drawEscapes() {
  const [pen, width, height] = context("escapes");
  const cells = 64;
  const steps = 2000;
  for (let row = 0; row < cells; row++) {
    for (let column = 0; column < cells; column++) {
      const time = escapeTime(kappa, (column + 0.5) / cells, (row + 0.5) / cells, steps);
      if (time === Infinity) continue;
      const shade = Math.log(time) / Math.log(steps);
      pen.fillStyle = `hsl(${20 + 200 * shade} 70% ${40 + 30 * shade}%)`;
      pen.fillRect((column / cells) * width, (1 - (row + 1) / cells) * height, width / cells, height / cells);
    }
  }
}

function drawProfile() {
  const [pen, width, height] = context("profile");
  for (let column = 0; column < width; column += 2) {
    const omega = rotationNumber(kappa, 0, column / width, 400);
    const up = omega / 2; // ω per step of two kicks, from 0 to 2
    pen.fillRect(column, (1 - up) * height, 2, 2);
  }
}

function show() {
  const answer = verdict(kappa);
  document.getElementById("kappa1").value = kappa[0];
  document.getElementById("kappa2").value = kappa[1];
  const ray = neighbours(fold(kappa).angle)[0];
  const words = document.getElementById("verdict");
  const sure = proved(kappa) ? " This is proved." : "";
  words.textContent = `${WORDS[answer]}${sure} Last circle on this ray: ${BOUNDARY.circle[ray]}.`;
  words.style.borderColor = LINES[answer];
  history.replaceState(null, "", `#${kappa.join(",")}`);
  drawPlane();
  drawPortrait();
  setTimeout(() => {
    drawProfile();
    drawEscapes();
    document.body.dataset.state = "drawn";
  });
}

function choose(first, second) {
  if (!Number.isFinite(first) || !Number.isFinite(second)) return;
  const inside = (value) => Math.max(-RANGE, Math.min(RANGE, Number(value.toFixed(4))));
  kappa = [inside(first), inside(second)];
  show();
}

function begin() {
  const canvas = document.getElementById("plane");
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect();
    const right = (event.clientX - box.left) / box.width;
    const up = 1 - (event.clientY - box.top) / box.height;
    choose((2 * right - 1) * RANGE, (2 * up - 1) * RANGE);
  });
  for (const name of ["kappa1", "kappa2"]) {
    document.getElementById(name).addEventListener("change", () => {
      const values = ["kappa1", "kappa2"].map((each) => document.getElementById(each).valueAsNumber);
      choose(...values);
    });
  }
  const wanted = location.hash.slice(1).split(",").map(Number);
  choose(...(wanted.length === 2 && wanted.every(Number.isFinite) ? wanted : kappa));
}
