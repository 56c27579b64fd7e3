/** A measured material for three.js, written by loden. */
import * as THREE from "three/webgpu";
import {
  Break, Fn, If, Loop, abs, acos, atan, bool, clamp, cos, cross, dFdx, dFdy, dot, exp, float, floor, int, inverseSqrt, ivec2, ivec3, ivec4,
  length, log, max, min, mix, normalView, normalize, positionView, positionViewDirection, pow, select, sign, sin, sqrt, tan, textureLoad,
  uniform, uv, vec2, vec3, vec4,
} from "three/tsl";

/** The function apparent(uv, wi, wo): pi times the BRDF times the cosine of the light. wi and wo are unit vectors to light and viewer in the
 * frame of the surface: x where u grows, y where v grows, z the normal. Textures are THREE.DataArrayTexture. */
export function functions(textures) {

// Texels have addresses: along rows, then row by row, then layer by layer.
const texel = (bank, name, width, height) =>
  Fn(([address]) => {
    const row = address.div(int(width)).toVar();
    const layer = row.div(int(height)).toVar();
    return textureLoad(bank, ivec2(address.sub(row.mul(int(width))), row.sub(layer.mul(int(height))))).depth(layer);
  }).setLayout({ name, type: "vec4", inputs: [{ name: "address", type: "int" }] });

const loden_number = texel(textures.numbers, "loden_number", {numbers_WIDTH}, {numbers_HEIGHT});
const loden_byte = texel(textures.indices, "loden_byte", {indices_WIDTH}, {indices_HEIGHT});
const loden_exact = texel(textures.directions, "loden_exact", {directions_WIDTH}, {directions_HEIGHT});
