/** Tests of what needs no browser: `node --test test/unit.mjs`. */

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { createServer } from "vite";

const server = await createServer({ server: { middlewareMode: true }, appType: "custom", logLevel: "error" });
after(() => server.close());
const { extend, painted, read, runs, written } = await server.ssrLoadModule("/src/mask.ts");

test("strokes survive their text, and what is no stroke is left out", () => {
  const strokes = [{ radius: 2.5, erases: false, points: [[3, 4], [-1, 7]] }, { radius: 1, erases: true, points: [[0, 0]] }];
  // a radius may have a fraction, as a brush of odd width has
  assert.deepEqual(read(written(strokes)), strokes);
  for (const text of ["", "3", "3~1", "x~1~2", "3~1~2~3", "-1~2~3", "3~1.5~2", "e"]) assert.deepEqual(read(text), [], text);
  assert.equal(read(`${written(strokes)}_nonsense`).length, 2);
});

test("a texel is painted where its centre is near a stroke", () => {
  const line = { radius: 1, erases: false, points: [[2, 1], [5, 1]] };
  const mask = painted([line], 8, 4);
  const rows = Array.from({ length: 4 }, (_, y) => [...mask.subarray(8 * y, 8 * y + 8)].join(""));
  assert.deepEqual(rows, ["00111100", "01111110", "00111100", "00000000"]);
  const erased = painted([line, { radius: 0, erases: true, points: [[3, 1]] }], 8, 4);
  assert.equal(erased[8 + 3], 0);
  assert.equal(mask.reduce((a, b) => a + b) - erased.reduce((a, b) => a + b), 1);
  assert.equal(painted([{ radius: 99, erases: false, points: [[-20, -20]] }], 8, 4).reduce((a, b) => a + b), 32);
});

test("runs alternate from unpainted to painted and add up to all texels", () => {
  assert.deepEqual(runs(Uint8Array.from([0, 0, 1, 1, 1, 0])), [2, 3, 1]);
  assert.deepEqual(runs(Uint8Array.from([1, 0])), [0, 1, 1]);
  assert.deepEqual(runs(new Uint8Array(5)), [5]);
});

test("points that are near to each other are one", () => {
  const stroke = { radius: 9, erases: false, points: [] };
  assert.deepEqual([[0, 0], [2, 0], [3, 0], [4, 0]].map((point) => extend(stroke, point)), [true, false, true, false]);
  assert.deepEqual(stroke.points, [[0, 0], [3, 0]]);
});
