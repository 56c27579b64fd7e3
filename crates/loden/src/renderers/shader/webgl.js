const vertexShader = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0), 0.0, 1.0);
}`;

const fragmentShader = `#version 300 es
${shader}
uniform vec3 eye, right, up, forward;
uniform float side, repeats;
uniform bool ball;
uniform int surroundings;
out vec4 shown;

void main() {
  vec2 at = 2.0 * gl_FragCoord.xy / side - 1.0;
  vec3 light = loden_seen(eye, normalize(forward + at.x * right + at.y * up), repeats, ball, vec3(0.0), surroundings);
  light = clamp(light, 0.0, 1.0);
  vec3 bright = 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055;
  shown = vec4(mix(bright, 12.92 * light, vec3(lessThanEqual(light, vec3(0.0031308)))), 1.0);
}`;

/** A program; throws what the compiler says. */
function compiled(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const part = gl.createShader(kind);
    gl.shaderSource(part, text);
    gl.compileShader(part);
    gl.attachShader(program, part);
    if (!gl.getShaderParameter(part, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(part));
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

/** Binds the textures of the material to units 0 to 2. */
function bind(gl, program) {
  const formats = {
    rgba16float: [gl.RGBA16F, gl.HALF_FLOAT, Uint16Array],
    rgba8unorm: [gl.RGBA8, gl.UNSIGNED_BYTE, Uint8Array],
    rgba32float: [gl.RGBA32F, gl.FLOAT, Float32Array],
  };
  textures.forEach((texture, unit) => {
    const [inside, kind, Numbers] = formats[texture.format];
    const [width, height, layers] = texture.size;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, gl.createTexture());
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, inside, width, height, layers);
    const numbers = new Numbers(decoded(texture).buffer);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, 0, width, height, layers, gl.RGBA, kind, numbers);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.uniform1i(gl.getUniformLocation(program, `loden_${texture.name}`), unit);
  });
}

/** Draws by WebGL2. */
async function engine(canvas) {
  const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true });
  if (!gl) throw new Error("this browser has no WebGL2");
  const program = compiled(gl, vertexShader, fragmentShader);
  gl.useProgram(program);
  bind(gl, program);
  const at = (name) => gl.getUniformLocation(program, name);
  gl.activeTexture(gl.TEXTURE3);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, 64, 32, 0, gl.RGBA, gl.FLOAT, sky(64, 32));
  gl.generateMipmap(gl.TEXTURE_2D);
  gl.uniform1i(at("loden_surroundings"), 3);
  return (view) => {
    gl.viewport(0, 0, view.side, view.side);
    for (const name of ["eye", "right", "up", "forward"]) gl.uniform3fv(at(name), view[name]);
    gl.uniform1f(at("side"), view.side);
    gl.uniform1f(at("repeats"), view.repeats);
    gl.uniform1i(at("ball"), view.ball);
    gl.uniform1i(at("surroundings"), view.surroundings);
    gl.uniform1i(at("loden_lights"), view.lights.length);
    gl.uniform4fv(at("loden_places"), view.lights.flatMap((light) => light.place));
    gl.uniform3fv(at("loden_colors"), view.lights.flatMap((light) => light.color));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  };
}
