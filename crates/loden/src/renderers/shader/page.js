"use strict";
const textures = {TEXTURES};
const shader = {SHADER};
const data = {DATA};

// The test scene that loden has rendered, too: angles in radians
const eye = {EYE};
const toLight = {TO_LIGHT};
const fieldOfView = ({FIELD_OF_VIEW} * Math.PI) / 180;
const length = (v) => Math.hypot(...v);
const turned = (v) => ({ azimuth: Math.atan2(v[1], v[0]), elevation: Math.asin(v[2] / length(v)) });
const direction = ({ azimuth, elevation }) => [
  Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation),
];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (v, factor) => v.map((x) => x * factor);

const state = {
  camera: turned(eye), distance: length(eye), light: turned(toLight), side: {SIDE},
  repeats: {REPEATS}, ball: true, second: false, surroundings: false,
};

/** What the shader needs to know: camera (eye; right, up and forward of the picture), lights, and what is shown. */
function view() {
  const back = direction(state.camera);
  const half = Math.tan(0.5 * fieldOfView);
  const right = ((v) => scaled(v, 1 / length(v)))(cross([0, 0, 1], back));
  const lights = [{ place: [...direction(state.light), 0], color: [{IRRADIANCE}, {IRRADIANCE}, {IRRADIANCE}] }];
  if (state.second) {
    lights.push({ place: [1.5, -1.2, -0.6, 1], color: [3, 2, 1] });
  }
  return {
    eye: scaled(back, state.distance), right: scaled(right, half), up: scaled(cross(back, right), half), forward: scaled(back, -1),
    side: state.side, repeats: state.repeats, ball: state.ball, surroundings: state.surroundings ? 64 : 0, lights,
  };
}

/** The bytes of a texture. */
function decoded({ name, bytes }) {
  const found = Uint8Array.from(atob(data[name] ?? ""), (letter) => letter.charCodeAt(0));
  if (found.length !== bytes) {
    throw new Error(`the texture ${name} has ${found.length} bytes, expected ${bytes}`);
  }
  return found;
}

/** Surroundings: a bright sky over a dark ground, latitude by longitude, linear RGBA. */
function sky(width, height) {
  const pixels = new Float32Array(4 * width * height);
  for (let y = 0; y < height; y++) {
    const up = Math.cos((Math.PI * (y + 0.5)) / height);
    const color = up > 0 ? [0.35 + 0.3 * (1 - up), 0.5 + 0.2 * (1 - up), 0.8] : [0.12, 0.1, 0.08];
    for (let x = 0; x < width; x++) {
      pixels.set([...color, 1], 4 * (y * width + x));
    }
  }
  return pixels;
}

{ENGINE}

async function main() {
  const canvas = document.getElementById("canvas");
  const message = document.getElementById("message");
  let draw;
  try {
    draw = await engine(canvas);
  } catch (error) {
    message.textContent = `This material cannot be shown: ${error.message}`;
    return;
  }
  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      canvas.width = canvas.height = state.side;
      draw(view());
    });
  };
  const place = {
    turn(x, y, of, sign) {
      of.azimuth += sign * 0.01 * x;
      of.elevation = Math.min(1.55, Math.max(-1.55, of.elevation + 0.01 * y));
    },
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    const isLight = event.buttons === 2 || event.shiftKey;
    place.turn(event.movementX, (isLight ? -1 : 1) * event.movementY, isLight ? state.light : state.camera, isLight ? 1 : -1);
    state.side = {SIDE} / 2;
    redraw();
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointerup", () => {
    state.side = {SIDE};
    redraw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    state.distance = Math.min(30, Math.max(1.5, state.distance * Math.exp(0.001 * event.deltaY)));
    redraw();
  });
  const repeats = document.getElementById("repeats");
  repeats.value = state.repeats;
  document.addEventListener("input", () => {
    const checked = (id) => document.getElementById(id).checked;
    Object.assign(state, {
      ball: !checked("square"), second: checked("second"), surroundings: checked("surroundings"), repeats: Number(repeats.value),
    });
    redraw();
  });
  redraw();
}

// A test draws by itself
if (!window.lodenTest) main();
