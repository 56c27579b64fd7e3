const pageShader = `${shader}
struct View {
  eye: vec3f, side: f32, right: vec3f, repeats: f32, up: vec3f, surroundings: f32, forward: vec3f, ball: f32,
}
@group(2) @binding(0) var<uniform> view: View;

@vertex
fn corner(@builtin(vertex_index) k: u32) -> @builtin(position) vec4f {
  return vec4f(select(-1.0, 3.0, k == 1), select(-1.0, 3.0, k == 2), 0.0, 1.0);
}

@fragment
fn pixel(@builtin(position) place: vec4f) -> @location(0) vec4f {
  let at = vec2f(2.0, -2.0) * place.xy / view.side + vec2f(-1.0, 1.0);
  let ray = normalize(view.forward + at.x * view.right + at.y * view.up);
  let seen = loden_seen(view.eye, ray, view.repeats, view.ball > 0.5, vec3f(0.0), i32(view.surroundings));
  let light = clamp(seen, vec3f(0.0), vec3f(1.0));
  let bright = 1.055 * pow(light, vec3f(1.0 / 2.4)) - 0.055;
  return vec4f(select(bright, 12.92 * light, light <= vec3f(0.0031308)), 1.0);
}`;

/** A device, and the bind group of the material's textures for a pipeline. */
async function device() {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) throw new Error("this browser has no WebGPU; the export for GLSL has the same page for WebGL2");
  const device = await adapter.requestDevice();
  return device;
}

async function module(device, code) {
  const module = device.createShaderModule({ code });
  const { messages } = await module.getCompilationInfo();
  const error = messages.find(({ type }) => type === "error");
  if (error) throw new Error(`line ${error.lineNum}: ${error.message}`);
  return module;
}

/** The textures of the material, group 0. */
function bind(device, layout) {
  const entries = textures.map((texture, binding) => {
    const [width, height, layers] = texture.size;
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
    const made = device.createTexture({ size: texture.size, format: texture.format, usage });
    const bytes = decoded(texture);
    const bytesPerRow = bytes.length / (height * layers);
    device.queue.writeTexture({ texture: made }, bytes, { bytesPerRow, rowsPerImage: height }, [width, height, layers]);
    return { binding, resource: made.createView({ dimension: "2d-array" }) };
  });
  return device.createBindGroup({ layout, entries });
}

/** The layout of group 0: single precision is not filtered. */
function materialLayout(device, visibility) {
  const entries = textures.map((texture, binding) => ({
    binding, visibility, texture: { viewDimension: "2d-array", sampleType: "unfilterable-float" },
  }));
  return device.createBindGroupLayout({ entries });
}

/** Draws by WebGPU. */
async function engine(canvas) {
  const gpu = await device();
  const format = navigator.gpu.getPreferredCanvasFormat();
  const context = canvas.getContext("webgpu");
  context.configure({ device: gpu, format });
  const code = await module(gpu, pageShader);
  const visibility = GPUShaderStage.FRAGMENT;
  const materials = materialLayout(gpu, visibility);
  const lights = gpu.createBindGroupLayout({ entries: [
    { binding: 0, visibility, buffer: {} },
    { binding: 1, visibility, texture: {} },
    { binding: 2, visibility, sampler: {} },
  ] });
  const views = gpu.createBindGroupLayout({ entries: [{ binding: 0, visibility, buffer: {} }] });
  const pipeline = gpu.createRenderPipeline({
    layout: gpu.createPipelineLayout({ bindGroupLayouts: [materials, lights, views] }),
    vertex: { module: code, entryPoint: "corner" },
    fragment: { module: code, entryPoint: "pixel", targets: [{ format }] },
  });
  // The sky, with mip maps that are the sky at lower resolution
  const levels = 6;
  const surroundings = gpu.createTexture({
    size: [64, 32], mipLevelCount: levels, format: "rgba16float", usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
  });
  for (let mipLevel = 0; mipLevel < levels; mipLevel++) {
    const [width, height] = [64 >> mipLevel, 32 >> mipLevel];
    const halves = Uint16Array.from(sky(width, height), half);
    gpu.queue.writeTexture({ texture: surroundings, mipLevel }, halves, { bytesPerRow: 8 * width }, [width, height]);
  }
  const buffer = (size) => gpu.createBuffer({ size, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  const [lightBuffer, viewBuffer] = [buffer(528), buffer(64)];
  const groups = [
    bind(gpu, materials),
    gpu.createBindGroup({ layout: lights, entries: [
      { binding: 0, resource: { buffer: lightBuffer } },
      { binding: 1, resource: surroundings.createView() },
      { binding: 2, resource: gpu.createSampler({ minFilter: "linear", magFilter: "linear", mipmapFilter: "linear", addressModeU: "repeat" }) },
    ] }),
    gpu.createBindGroup({ layout: views, entries: [{ binding: 0, resource: { buffer: viewBuffer } }] }),
  ];
  return (view) => {
    const numbers = new Float32Array(132);
    view.lights.forEach(({ place, color }, k) => {
      numbers.set(place, 4 * k);
      numbers.set(color, 64 + 4 * k);
    });
    new Int32Array(numbers.buffer)[128] = view.lights.length;
    gpu.queue.writeBuffer(lightBuffer, 0, numbers);
    const { eye, side, right, repeats, up, surroundings, forward, ball } = view;
    gpu.queue.writeBuffer(viewBuffer, 0, new Float32Array([...eye, side, ...right, repeats, ...up, surroundings, ...forward, ball ? 1 : 0]));
    const encoder = gpu.createCommandEncoder();
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: context.getCurrentTexture().createView(), loadOp: "clear", storeOp: "store" }],
    });
    pass.setPipeline(pipeline);
    groups.forEach((group, k) => pass.setBindGroup(k, group));
    pass.draw(3);
    pass.end();
    gpu.queue.submit([encoder.finish()]);
  };
}

/** A positive number in half precision, as its bits. */
function half(number) {
  const bits = new Uint32Array(new Float32Array([number]).buffer)[0];
  return number < 6.2e-5 ? 0 : ((bits - 0x38000000 + 0x1000) >> 13);
}
