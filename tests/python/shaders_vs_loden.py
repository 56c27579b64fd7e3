"""Compares materials exported as shaders with our own evaluation and pictures.

Usage: python shaders_vs_loden.py [LODEN] [--all], the path of the built program. Without --all, a few codecs only are tried: a browser
that draws by software takes many minutes for all.

The page of each export is loaded in a headless Chromium. Its shader is evaluated at random points and directions, into a
texture of floating-point numbers by WebGL2 and into a buffer by WebGPU, and compared with `loden eval`. The page
itself is opened from disk, and its first picture compared with the one that loden wrote beside it.
"""

import base64
import json
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image

import browser
import exports

POINTS = 3200
LIGHTS = [15, 45, 75]
TARGETS = ["glsl", "wgsl"]
# the camera of the test scene
EYE = [0.0, -5.0, 2.0]
PICTURED = ["pvmf", "klt", "median-cut"]
# codecs that are always tried, each a kind of recipe
TRIED = ["analytic", "klt", "median-cut", "pvmf"]
TRIED_IN_THREE = ["klt"]
# codecs that are not exported
REFUSED = ["neural"]
# mean absolute difference of pictures, as a fraction of full scale, away from the silhouette
PICTURE_TOLERANCE = 0.002

# The script of the page, without its own drawing
COMMON = """
<!doctype html><meta charset="utf-8">
<canvas id="canvas"></canvas>
<script>
window.lodenTest = true;
{SCRIPT}
const post = (result) => fetch("/result", { method: "POST", body: JSON.stringify(result) });
const encoded = (numbers) => btoa(Array.from(new Uint8Array(numbers.buffer), (byte) => String.fromCharCode(byte)).join(""));
(async () => {
  try {
    const queries = new Float32Array(await (await fetch("queries.bin")).arrayBuffer());
    await post({ values: encoded(await evaluated(queries)) });
  } catch (error) {
    await post({ error: String(error.stack ?? error) });
  }
})();
</script>
"""

WEBGL = """
async function evaluated(queries) {
  const count = queries.length / 8;
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("no floating-point framebuffers");
  const program = compiled(gl, vertexShader, `#version 300 es
${shader}
uniform highp sampler2D queries;
out vec4 value;
void main() {
  vec4 first = texelFetch(queries, ivec2(0, int(gl_FragCoord.y)), 0);
  vec4 second = texelFetch(queries, ivec2(1, int(gl_FragCoord.y)), 0);
  value = vec4(loden_apparent(first.xy, vec3(first.zw, second.x), second.yzw), 1.0);
}`);
  gl.useProgram(program);
  bind(gl, program);
  const table = (unit, width, data) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, count, 0, gl.RGBA, gl.FLOAT, data);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return made;
  };
  table(4, 2, queries);
  gl.uniform1i(gl.getUniformLocation(program, "queries"), 4);
  gl.activeTexture(gl.TEXTURE3);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  gl.uniform1i(gl.getUniformLocation(program, "loden_surroundings"), 3);
  const target = table(5, 1, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, 1, count);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const values = new Float32Array(4 * count);
  gl.readPixels(0, 0, 1, count, gl.RGBA, gl.FLOAT, values);
  if (gl.getError()) throw new Error("WebGL reports an error");
  return values;
}
"""

WEBGPU = """
async function evaluated(queries) {
  const count = queries.length / 8;
  const gpu = await device();
  const code = await module(gpu, `${shader}
@group(2) @binding(0) var<storage, read> queries: array<f32>;
@group(2) @binding(1) var<storage, read_write> values: array<vec4f>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
  let q = 8 * id.x;
  if (id.x < ${count}) {
    let wi = vec3f(queries[q + 2], queries[q + 3], queries[q + 4]);
    let wo = vec3f(queries[q + 5], queries[q + 6], queries[q + 7]);
    values[id.x] = vec4f(loden_apparent(vec2f(queries[q], queries[q + 1]), wi, wo), 1.0);
  }
}`);
  const visibility = GPUShaderStage.COMPUTE;
  const materials = materialLayout(gpu, visibility);
  const none = gpu.createBindGroupLayout({ entries: [] });
  const buffers = gpu.createBindGroupLayout({ entries: [
    { binding: 0, visibility, buffer: { type: "read-only-storage" } }, { binding: 1, visibility, buffer: { type: "storage" } },
  ] });
  const layout = gpu.createPipelineLayout({ bindGroupLayouts: [materials, none, buffers] });
  const pipeline = gpu.createComputePipeline({ layout, compute: { module: code, entryPoint: "main" } });
  const buffer = (size, usage) => gpu.createBuffer({ size, usage });
  const asked = buffer(queries.byteLength, GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST);
  const answered = buffer(16 * count, GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC);
  const read = buffer(16 * count, GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST);
  gpu.queue.writeBuffer(asked, 0, queries);
  const encoder = gpu.createCommandEncoder();
  const pass = encoder.beginComputePass();
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, bind(gpu, materials));
  pass.setBindGroup(1, gpu.createBindGroup({ layout: none, entries: [] }));
  pass.setBindGroup(2, gpu.createBindGroup({ layout: buffers, entries: [
    { binding: 0, resource: { buffer: asked } }, { binding: 1, resource: { buffer: answered } },
  ] }));
  pass.dispatchWorkgroups(Math.ceil(count / 64));
  pass.end();
  encoder.copyBufferToBuffer(answered, 0, read, 0, 16 * count);
  gpu.queue.submit([encoder.finish()]);
  await read.mapAsync(GPUMapMode.READ);
  return new Float32Array(read.getMappedRange().slice(0));
}
"""

# Evaluates the node material of three.js; alpha is the number of the query, since the order of rows depends on the back end
THREE = """
<!doctype html><meta charset="utf-8">
<script type="importmap">
{ "imports": { "three/webgpu": "/three/build/three.webgpu.js", "three/tsl": "/three/build/three.tsl.js" } }
</script>
<script type="module">
import * as THREE from "three/webgpu";
import { Fn, float, int, ivec2, screenCoordinate, textureLoad, vec3, vec4 } from "three/tsl";
import { functions, load, loadTextures } from "{FOLDER}/material.js";

const post = (result) => fetch("/result", { method: "POST", body: JSON.stringify(result) });
const encoded = (numbers) => btoa(Array.from(new Uint8Array(numbers.buffer), (byte) => String.fromCharCode(byte)).join(""));

async function evaluated(renderer) {
  const queries = new Float32Array(await (await fetch("/queries.bin")).arrayBuffer());
  const [width, height] = [16, queries.length / 8 / 16];
  const { apparent } = functions(await loadTextures("{FOLDER}/"));
  const table = new THREE.DataTexture(queries, 2 * width, height, THREE.RGBAFormat, THREE.FloatType);
  table.needsUpdate = true;
  const material = new THREE.NodeMaterial();
  material.fragmentNode = Fn(() => {
    const x = int(screenCoordinate.x).toVar();
    const y = int(screenCoordinate.y).toVar();
    const a = textureLoad(table, ivec2(x.mul(int(2)), y)).toVar();
    const b = textureLoad(table, ivec2(x.mul(int(2)).add(int(1)), y)).toVar();
    return vec4(apparent(a.xy, vec3(a.z, a.w, b.x), b.yzw), float(y.mul(int(width)).add(x)));
  })();
  const target = new THREE.RenderTarget(width, height, { type: THREE.FloatType, depthBuffer: false });
  renderer.setRenderTarget(target);
  new THREE.QuadMesh(material).render(renderer);
  const pixels = await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height);
  renderer.setRenderTarget(null);
  return pixels;
}

/** The test scene: a ball with z as its axis, seen by its camera, under its light. */
async function drawn(renderer) {
  const { eye, toLight, irradiance, fieldOfView, repeats, side } = {SCENE};
  const [columns, rows] = [512, 256];
  const geometry = new THREE.PlaneGeometry(1, 1, columns, rows);
  const { position, normal, uv } = geometry.attributes;
  for (let k = 0; k < position.count; k++) {
    const [u, v] = [uv.getX(k), uv.getY(k)];
    const [phi, theta] = [2 * Math.PI * u, Math.PI * (1 - v)];
    const at = [Math.sin(theta) * Math.cos(phi), Math.sin(theta) * Math.sin(phi), Math.cos(theta)];
    position.setXYZ(k, ...at);
    normal.setXYZ(k, ...at);
    uv.setXY(k, 2 * u, v);
  }
  const material = await load("{FOLDER}/");
  material.repeats.value.set(repeats, repeats);
  const scene = new THREE.Scene();
  scene.add(new THREE.Mesh(geometry, material));
  const light = new THREE.DirectionalLight(0xffffff, irradiance);
  light.position.set(...toLight);
  scene.add(light);
  const camera = new THREE.PerspectiveCamera(fieldOfView, 1, 0.1, 100);
  camera.up.set(0, 0, 1);
  camera.position.set(...eye);
  camera.lookAt(0, 0, 0);
  const target = new THREE.RenderTarget(2 * side, 2 * side, { type: THREE.FloatType });
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const pixels = await renderer.readRenderTargetPixelsAsync(target, 0, 0, 2 * side, 2 * side);
  return pixels;
}

try {
  const renderer = new THREE.WebGPURenderer({ forceWebGL: {WEBGL} });
  await renderer.init();
  const isWebGL = renderer.backend.isWebGLBackend === true;
  if (isWebGL !== {WEBGL}) throw new Error("the other back end was chosen");
  await post({ values: encoded({DRAW} ? await drawn(renderer) : await evaluated(renderer)) });
} catch (error) {
  await post({ error: String(error.stack ?? error) });
}
</script>
"""

# Draws the page's first view at four times its size, by the page's own code, and shows the mean of 4 x 4 pixels
DRAWN = """
<pre id="result"></pre>
<script>
(async () => {
  const show = (result) => {
    const text = JSON.stringify(result);
    if (location.protocol === "file:") document.getElementById("result").textContent = text;
    else fetch("/result", { method: "POST", body: text });
  };
  try {
    const canvas = document.createElement("canvas");
    state.side *= 4;
    canvas.width = canvas.height = state.side;
    const light = {LIGHT};
    if (light) state.light = turned(light);
    (await engine(canvas))(view());
    const small = document.createElement("canvas");
    small.width = small.height = canvas.width;
    const flat = small.getContext("2d");
    flat.drawImage(canvas, 0, 0);
    const { data } = flat.getImageData(0, 0, canvas.width, canvas.height);
    const side = canvas.width / 4, mean = new Float32Array(3 * side * side);
    const linear = (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
    const table = Float32Array.from({ length: 256 }, (_, k) => linear(k / 255) / 16);
    for (let y = 0; y < canvas.width; y++)
      for (let x = 0; x < canvas.width; x++)
        for (let c = 0; c < 3; c++)
          mean[3 * ((y >> 2) * side + (x >> 2)) + c] += table[data[4 * (y * canvas.width + x) + c]];
    const bytes = new Uint8Array(mean.buffer);
    let text = "";
    for (let k = 0; k < bytes.length; k += 30000) text += String.fromCharCode(...bytes.subarray(k, k + 30000));
    show({ values: btoa(text) });
  } catch (error) {
    show({ error: String(error.stack ?? error) });
  }
})();
</script>
"""


def unit(theta, phi):
    theta, phi = np.radians(theta.astype(np.float64)), np.radians(phi.astype(np.float64))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def script_of(folder):
    return re.search(r"<script>\n(.*)\n</script>", (folder / "index.html").read_text(), re.S).group(1)


def tolerance(folder):
    """Three times the difference that the export states for half precision at other points, and single precision."""
    return 3 * json.loads((folder / "material.json").read_text())["half_precision"]["largest"] + 1e-5


def queries_of(points):
    queries = np.concatenate([points[:, 4:6], unit(points[:, 0], points[:, 1]), unit(points[:, 2], points[:, 3])], -1)
    return queries.astype("<f4").tobytes()


def evaluated(folder, points, evaluate):
    (folder / "queries.bin").write_bytes(queries_of(points))
    (folder / "test.html").write_text(COMMON.replace("{SCRIPT}", script_of(folder) + evaluate))
    values = browser.result_of(folder, "test.html")["values"]
    return np.frombuffer(base64.b64decode(values), "<f4").reshape(-1, 4)[:, :3]


def by_three(folder, name, webgl, draw):
    """What three.js makes of the node material in a folder of `folder`: values of the queries, or a picture."""
    scene = (folder / name / "index.html").read_text()
    number = lambda pattern: json.loads(re.search(pattern, scene).group(1))
    facts = {
        "eye": number(r"const eye = (.*);"),
        "toLight": number(r"const toLight = (.*);"),
        "irradiance": number(r"color: \[([\d.]*),"),
        "fieldOfView": number(r"const fieldOfView = \((.*) \* Math.PI"),
        "repeats": number(r"repeats: (.*), ball"),
        "side": number(r"light: turned\(toLight\), side: (\d*)"),
    }
    text = THREE.replace("{FOLDER}", f"/{name}").replace("{WEBGL}", json.dumps(webgl)).replace("{DRAW}", json.dumps(draw))
    (folder / "three.html").write_text(text.replace("{SCENE}", json.dumps(facts)))
    values = np.frombuffer(base64.b64decode(browser.result_of(folder, "three.html")["values"]), "<f4").reshape(-1, 4)
    if draw:
        side = 2 * facts["side"]
        picture = values.reshape(side, side, 4)[::-1 if webgl else 1, :, :3]
        return picture.reshape(facts["side"], 2, facts["side"], 2, 3).mean((1, 3))
    ordered = np.empty((len(values), 3), np.float32)
    ordered[values[:, 3].astype(int)] = values[:, :3]
    return ordered


def linear(picture):
    picture = np.asarray(picture.convert("RGB"), np.float64) / 255
    return np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)


def sun(angle):
    """The direction of a light at an angle from the viewer."""
    eye = np.array(EYE) / np.linalg.norm(EYE)
    side = np.cross(eye, [0, 0, 1])
    return np.cos(np.radians(angle)) * eye + np.sin(np.radians(angle)) * side / np.linalg.norm(side)


def ours(program, folder, name, angle):
    """The test scene under another light, by loden."""
    (folder / "scene.toml").write_text(f"""
[camera]
position = {EYE}
target = [0, 0, 0]
up = [0, 0, 1]
field-of-view = 28
[material.m]
file = "{name}.loden"
[[light]]
kind = "directional"
direction = {sun(angle).tolist()}
irradiance = {np.pi}
[[shape]]
kind = "sphere"
material = "m"
uv-scale = 4
mapping = {{ kind = "sphere", centre = [0, 0, 0], axis = [0, 0, 1] }}
""")
    command = [program, "render", "--scene", folder / "scene.toml", "-o", folder / "ours.png", "--size", "512x512", "--spp", "16", "--force", "-q"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / "ours.png"


def drawn(folder, light):
    """The first picture of a page, or the same under another light; a page of WebGL2 is opened from disk."""
    page = (folder / "index.html").read_text()
    assert "http" not in re.sub(r"const data = .*", "", page), "the page asks the network for something"
    script = DRAWN.replace("{LIGHT}", json.dumps(light))
    text = page.replace("<script>\n", "<script>\nwindow.lodenTest = true;\n", 1).replace("</html>", script + "</html>")
    (folder / "drawn.html").write_text(text)
    # the virtual clock of a page from disk does not wait for WebGPU
    result = browser.result_of(folder, "drawn.html") if "webgpu" in page else browser.document_of(folder / "drawn.html")
    return np.frombuffer(base64.b64decode(result["values"]), "<f4")


def check_page(program, folder, name, target, lights):
    """Compares pictures of a page with ours."""
    made = folder / f"{name}-{target}"
    compare_picture(made / "ball.png", f"{name}, {target}: first picture of the page", drawn(made, None))
    for angle in lights:
        picture = ours(program, folder, name, angle)
        compare_picture(picture, f"{name}, {target}: light at {angle} degrees", drawn(made, sun(angle).tolist()))


def compare_picture(path, name, theirs):
    """Compares a picture in linear light with one of loden's, away from the silhouette."""
    ours = linear(Image.open(path))
    theirs, side = np.clip(theirs.reshape(ours.shape), 0, 1), ours.shape[0]
    y, x = np.mgrid[:side, :side] + 0.5
    radius = np.tan(np.arcsin(1 / np.linalg.norm(EYE))) / np.tan(np.radians(14)) * side / 2
    inside = np.hypot(x - side / 2, y - side / 2) < 0.85 * radius
    difference = np.abs(ours - theirs)[inside].mean()
    print(f"{name}: mean {ours[inside].mean():.4f}, mean difference from loden's picture {difference:.5f}")
    assert ours[inside].mean() > 0.01 and difference < PICTURE_TOLERANCE, name


def main():
    words = [word for word in sys.argv[1:] if word != "--all"]
    program, all_of_them = words[0] if words else "target/release/loden", "--all" in sys.argv
    if browser.found() is None:
        print("skipped: shaders in a browser, as there is no Chromium")
        return
    run = lambda *words: subprocess.run([program, *words, "-q"], check=True, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run("acquire", "twill", "--size", "24", "--spp", "4", "-o", folder / "twill.zip")
        points = exports.random_points(POINTS, 2)
        for name in exports.methods(program):
            if name in REFUSED or not (all_of_them or name in TRIED):
                continue
            run("compress", folder / "twill.zip", "--method", name, "-o", folder / f"{name}.loden")
            values = exports.values_of(program, folder, f"{name}.loden", points)
            np.save(folder / f"{name}.npy", values)
            check_values(run, folder, name, folder / f"{name}.loden", points, values)
        check_values(run, folder, "ward", exports.WARD, points, exports.apparent_of_ward(program, folder, points))
        pages = [(name, target) for name in PICTURED for target in TARGETS]
        for name, target in pages if all_of_them else pages[::3]:
            check_page(program, folder, name, target, LIGHTS if all_of_them else LIGHTS[-1:])
        check_three(program, folder, points, all_of_them)


def check_values(run, folder, name, material, points, values):
    """Compares the values of the exported functions with those of loden."""
    for target in TARGETS:
        evaluate = {"glsl": WEBGL, "wgsl": WEBGPU}[target]
        out = folder / f"{name}-{target}"
        run("export", material, "--to", target, "-o", out)
        error = np.abs(evaluated(out, points, evaluate) - values)
        print(f"{name}, {target}: largest difference {error.max():.1e}, mean {error.mean():.1e}, of values up to {values.max():.2f}")
        assert error.max() < tolerance(out), name


def check_three(program, folder, points, all_of_them):
    """Compares the node material of three.js, by both of its back ends."""
    library = pathlib.Path("target/three/node_modules/three").absolute()
    if not library.is_dir():
        print(f"skipped: the node material of three.js, as there is no {library}")
        return
    (folder / "three").symlink_to(library)
    (folder / "queries.bin").write_bytes(queries_of(points))
    names = sorted(path.stem for path in folder.glob("*.loden"))
    for name in names if all_of_them else TRIED_IN_THREE:
        subprocess.run([program, "export", folder / f"{name}.loden", "--to", "three", "-o", folder / f"{name}-three", "-q"], check=True, stdout=subprocess.DEVNULL)
        values = np.load(folder / f"{name}.npy")
        for webgl in (True, False):
            back_end = "WebGL2" if webgl else "WebGPU"
            error = np.abs(by_three(folder, f"{name}-three", webgl, False) - values)
            print(f"{name}, three.js by {back_end}: largest difference {error.max():.1e}, mean {error.mean():.1e}")
            assert error.max() < tolerance(folder / f"{name}-three"), name
            if name in PICTURED and (webgl or all_of_them):
                picture = by_three(folder, f"{name}-three", webgl, True)
                compare_picture(folder / f"{name}-three" / "ball.png", f"{name}, three.js by {back_end}: ball", picture)


main()
