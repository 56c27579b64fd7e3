/** One material on an object, drawn by three.js with the node material that the library exports. */

import type * as Three from "three/webgpu";
import { binary, get } from "./api";
import { bytes, t } from "./texts";

type ThreeModule = typeof Three;
type Exported = { load(url: string): Promise<Three.NodeMaterial & { repeats: { value: Three.Vector2 } }> };

/** How an object is seen at first, and what lights it. */
export interface Place {
  position: [number, number, number];
  target: [number, number, number];
  field_of_view: number;
  turn: number;
  irradiance: number;
  background: number;
}

/** Where the camera is around its target, in degrees and world units, and where the light comes from. */
export interface Look {
  azimuth: number;
  elevation: number;
  distance: number;
  light: [number, number];
  repeats: number;
  /** A picture around the object instead of the light, turned about the vertical by an angle. */
  surroundings?: { id: string; turn: number } | undefined;
}

/** A module that the import map names, loaded when it is needed. */
function module<T>(name: string): Promise<T> {
  return import(/* @vite-ignore */ name) as Promise<T>;
}

const places = new Map<string, Promise<Place>>();
export function placeOf(object: string): Promise<Place> {
  if (!places.has(object)) places.set(object, get<Place>("object", { name: object }));
  return places.get(object)!;
}

/** The colour behind objects, as the server has it in linear light. */
const GROUND = 0x2a2a2a;

const radians = Math.PI / 180;

export function eye(look: Look, place: Place): [number, number, number] {
  const [a, e] = [look.azimuth * radians, look.elevation * radians];
  const [x, y, z] = place.target;
  return [x + look.distance * Math.cos(e) * Math.sin(a), y + look.distance * Math.sin(e), z + look.distance * Math.cos(e) * Math.cos(a)];
}

/** The look of an object's own camera. */
export function firstLook(place: Place): Look {
  const [x, y, z] = place.position.map((value, k) => value - place.target[k]!) as [number, number, number];
  const distance = Math.hypot(x, y, z);
  return { azimuth: Math.atan2(x, z) / radians, elevation: Math.asin(y / distance) / radians, distance, light: [42, 140], repeats: 4 };
}

/** Towards the light, y up. */
function towards([theta, phi]: [number, number]): [number, number, number] {
  const [a, b] = [theta * radians, phi * radians];
  return [Math.sin(a) * Math.cos(b), Math.cos(a), Math.sin(a) * Math.sin(b)];
}

/** What draws: the interface, and whether it does so in software. */
export interface Drawing {
  api: "webgl" | "webgpu";
  software: boolean;
  webgpu: boolean;
}

let adapter: Promise<{ found: boolean; software: boolean }> | undefined;
function webgpu(): Promise<{ found: boolean; software: boolean }> {
  adapter ??= (async () => {
    const gpu = (navigator as { gpu?: { requestAdapter(): Promise<any> } }).gpu;
    const found = await gpu?.requestAdapter().catch(() => null);
    const info = found?.info ?? {};
    const software = Boolean(info.isFallbackAdapter ?? found?.isFallbackAdapter) || /swiftshader|llvmpipe|software/i.test(`${info.vendor} ${info.architecture} ${info.description}`);
    return { found: Boolean(found), software };
  })();
  return adapter;
}

function webglInSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

async function geometryOf(three: ThreeModule, object: string, turn: number): Promise<Three.BufferGeometry> {
  const buffer = await binary("mesh", { name: object });
  const [vertices, triangles] = new Uint32Array(buffer, 0, 2) as unknown as [number, number];
  const numbers = (at: number, count: number) => new Float32Array(buffer, 8 + 4 * at, count);
  const uvs = numbers(6 * vertices, 2 * vertices);
  const [cos, sin] = [Math.cos(turn * radians), Math.sin(turn * radians)];
  for (let k = 0; k < uvs.length; k += 2) [uvs[k], uvs[k + 1]] = [uvs[k]! * cos + uvs[k + 1]! * sin, uvs[k + 1]! * cos - uvs[k]! * sin];
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(numbers(0, 3 * vertices), 3));
  geometry.setAttribute("normal", new three.BufferAttribute(numbers(3 * vertices, 3 * vertices), 3));
  geometry.setAttribute("uv", new three.BufferAttribute(uvs, 2));
  geometry.setIndex(new three.BufferAttribute(new Uint32Array(buffer, 8 + 32 * vertices, 3 * triangles), 1));
  return geometry;
}

/** A distant light: where it is, y up, and its irradiance. */
interface Lamp {
  direction: [number, number, number];
  irradiance: [number, number, number];
}

/** Lights that stand for a picture of surroundings: when all is still, and while something moves. */
const LAMPS = 16;
const FEW = 3;

/** Turned counter-clockwise about the vertical as seen from above. */
function turned([x, y, z]: [number, number, number], degrees: number): [number, number, number] {
  const [cos, sin] = [Math.cos(degrees * radians), Math.sin(degrees * radians)];
  return [x * cos + z * sin, y, z * cos - x * sin];
}

/** The longest time for a sharp picture, and what a moving one may take, milliseconds. */
const SHARP = 4000;
const MOVING = 45;

export class Stage {
  drawing: Drawing = { api: "webgl", software: false, webgpu: false };
  private renderer!: Three.WebGPURenderer;
  private scene!: Three.Scene;
  private camera!: Three.PerspectiveCamera;
  private light!: Three.DirectionalLight;
  private mesh!: Three.Mesh;
  private material!: Awaited<ReturnType<Exported["load"]>>;
  private three!: ThreeModule;
  private place!: Place;
  private object = "";
  private coarse = 0.5;
  private perPixel = 0;
  private size: [number, number] = [1, 1];
  private around: { id: string; lamps: Lamp[]; few: Lamp[]; picture: ImageBitmap; backdrop: Three.CanvasTexture; turn: number } | null = null;
  /** The picture by one light, the sum so far, what adds the one to the other and shows it. */
  private sum: { one: Three.RenderTarget; all: Three.RenderTarget; add: Three.QuadMesh; factor: Three.Vector4; show: Three.QuadMesh; black: Three.Material } | null = null;
  private ended = false;
  private busy = false;
  private wanted: { look: Look; moving: boolean } | null = null;

  private constructor(readonly canvas: HTMLCanvasElement) {}

  /** A stage for a compressed material. `say` is told what takes time. */
  static async make(canvas: HTMLCanvasElement, material: string, api: string | undefined, say: (text: string) => void): Promise<Stage> {
    const stage = new Stage(canvas);
    const found = await webgpu();
    const useGl = api === "webgl" || !found.found;
    say(t("compiling"));
    const [three, exported] = await Promise.all([module<ThreeModule>("three/webgpu"), get<{ url: string; bytes: number }>("three", { m: material })]);
    stage.three = three;
    stage.drawing = { api: useGl ? "webgl" : "webgpu", software: useGl ? webglInSoftware() : found.software, webgpu: found.found };
    stage.renderer = new three.WebGPURenderer({ canvas, antialias: true, forceWebGL: useGl });
    await stage.renderer.init();
    stage.renderer.setClearColor(GROUND);
    say(t("streaming", { size: bytes(exported.bytes) }));
    stage.material = await (await module<Exported>(`${exported.url}material.js`)).load(exported.url);
    stage.material.side = three.DoubleSide;
    stage.scene = new three.Scene();
    stage.camera = new three.PerspectiveCamera(24, 1, 0.01, 1000);
    stage.light = new three.DirectionalLight(0xffffff, 1);
    stage.scene.add(stage.light);
    say(t("compiling"));
    return stage;
  }

  async wear(object: string): Promise<void> {
    if (object === this.object) return;
    this.place = await placeOf(object);
    const geometry = await geometryOf(this.three, object, this.place.turn);
    if (this.mesh) {
      this.mesh.geometry.dispose();
      this.mesh.geometry = geometry;
    } else {
      this.mesh = new this.three.Mesh(geometry, this.material);
      this.scene.add(this.mesh);
    }
    this.object = object;
  }

  /** Loads a picture of surroundings. */
  async surround(id: string | undefined): Promise<void> {
    if (!id || this.around?.id === id) return;
    const [lamps, few, response] = await Promise.all([get<Lamp[]>("lights", { e: id, count: LAMPS }), get<Lamp[]>("lights", { e: id, count: FEW }), binary("backdrop", { e: id })]);
    const picture = await createImageBitmap(new Blob([response]));
    this.around?.backdrop.dispose();
    const backdrop = new this.three.CanvasTexture(document.createElement("canvas"));
    Object.assign(backdrop, { mapping: this.three.EquirectangularReflectionMapping, colorSpace: this.three.SRGBColorSpace });
    this.around = { id, lamps, few, picture, backdrop, turn: Number.NaN };
  }

  /** How many lights stand for surroundings when all is still. */
  get lamps(): number {
    return this.around?.lamps.length ?? 0;
  }

  /** Draws a look: coarse while moving, sharp otherwise. Only the last one that is asked for is drawn. */
  draw(look: Look, moving: boolean): void {
    this.wanted = { look, moving };
    if (!this.busy) void this.drain();
  }

  private async drain(): Promise<void> {
    this.busy = true;
    while (this.wanted && !this.ended) {
      const { look, moving } = this.wanted;
      this.wanted = null;
      await this.render(look, moving);
    }
    this.busy = false;
    if (!this.ended) this.canvas.dataset.idle = "true";
  }

  private async render(look: Look, moving: boolean): Promise<void> {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height || !this.object) return;
    this.canvas.dataset.idle = "false";
    const full = width * height * devicePixelRatio ** 2;
    const sharp = this.perPixel ? Math.min(1, Math.sqrt(SHARP / (this.perPixel * full))) : 0.5;
    const scale = moving ? Math.min(this.coarse, sharp) : sharp;
    const ratio = devicePixelRatio * scale;
    if (this.size[0] !== width || this.size[1] !== height || this.renderer.getPixelRatio() !== ratio) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.size = [width, height];
    }
    this.camera.aspect = width / height;
    // the field of view is that of the shorter side
    const half = Math.tan((this.place.field_of_view * radians) / 2);
    this.camera.fov = (2 * Math.atan(width < height ? (half * height) / width : half)) / radians;
    this.camera.position.set(...eye(look, this.place));
    this.camera.lookAt(...this.place.target);
    this.camera.updateProjectionMatrix();
    this.material.repeats.value.set(look.repeats, look.repeats);
    const began = performance.now();
    if (look.surroundings && this.around?.id === look.surroundings.id) await this.renderAround(look.surroundings.turn, moving);
    else this.renderLit(look);
    await this.finished();
    const took = performance.now() - began;
    const first = this.perPixel === 0;
    this.perPixel = Math.max(1e-7, took / (full * scale ** 2));
    if (moving) this.coarse = Math.min(1, Math.max(0.2, this.coarse * Math.min(1.3, Math.max(0.6, Math.sqrt(MOVING / Math.max(took, 1))))));
    // the first picture, for which the shader was compiled, tells nothing; later ones tell whether a sharper one is possible
    const possible = Math.min(1, Math.sqrt(SHARP / (this.perPixel * full)));
    if (!moving && (first || possible > 1.1 * scale)) this.wanted ??= { look, moving: false };
  }

  /** Draws under the one light. */
  private renderLit(look: Look): void {
    this.mesh.material = this.material;
    this.scene.background = null;
    this.light.color.setRGB(1, 1, 1);
    this.light.intensity = this.place.irradiance;
    this.light.position.set(...towards(look.light));
    this.renderer.render(this.scene, this.camera);
  }

  /** Draws in front of a picture, once for each of its lights; the pictures are added up in linear light. */
  private async renderAround(turn: number, moving: boolean): Promise<void> {
    const around = this.around!;
    const { one, all, add, factor, show, black } = await this.summing();
    const renderer = this.renderer;
    const addUp = (first: boolean, color: [number, number, number]) => {
      factor.set(...color, 1);
      renderer.setRenderTarget(one);
      renderer.render(this.scene, this.camera);
      renderer.setRenderTarget(all);
      renderer.autoClear = first;
      add.render(renderer);
      renderer.autoClear = true;
    };
    this.turnBackdrop(turn);
    renderer.setClearColor(0x000000, 0);
    this.mesh.material = black;
    this.scene.background = around.backdrop;
    addUp(true, [1, 1, 1]);
    this.mesh.material = this.material;
    this.scene.background = null;
    // three.js reads the colour of a light once a frame, so it is multiplied where the pictures are added
    this.light.color.setRGB(1, 1, 1);
    this.light.intensity = 1;
    for (const { direction, irradiance } of moving ? around.few : around.lamps) {
      this.light.position.set(...turned(direction, turn));
      addUp(false, irradiance);
    }
    renderer.setRenderTarget(null);
    show.render(renderer);
    renderer.setClearColor(GROUND);
  }

  private async summing(): Promise<NonNullable<typeof this.sum>> {
    const three = this.three;
    if (!this.sum) {
      const { texture, uniform } = await module<{ texture(map: Three.Texture): { mul(by: unknown): never }; uniform(value: Three.Vector4): unknown }>("three/tsl");
      const factor = new three.Vector4(1, 1, 1, 1);
      const one = new three.RenderTarget(1, 1, { type: three.HalfFloatType, samples: 4 });
      const all = new three.RenderTarget(1, 1, { type: three.HalfFloatType, depthBuffer: false });
      const quad = (fragmentNode: unknown, blending: Three.Blending) => {
        const material = new three.NodeMaterial();
        Object.assign(material, { fragmentNode, blending, depthTest: false, depthWrite: false });
        return new three.QuadMesh(material);
      };
      const black = new three.MeshBasicMaterial({ color: 0, side: three.DoubleSide });
      // the alpha of what is added does not matter
      const add = quad(texture(one.texture).mul(uniform(factor)), three.CustomBlending);
      Object.assign(add.material, { blendSrc: three.OneFactor, blendDst: three.OneFactor, blendEquation: three.AddEquation });
      this.sum = { one, all, add, factor, show: quad(texture(all.texture), three.NoBlending), black };
    }
    const size = this.renderer.getDrawingBufferSize(new three.Vector2());
    for (const target of [this.sum.one, this.sum.all]) target.setSize(size.x, size.y);
    return this.sum;
  }

  /** Redraws the picture so that three.js, whose middle column is +x, shows it where the path tracer does: its middle is -z. */
  private turnBackdrop(turn: number): void {
    const around = this.around!;
    if (around.turn === turn) return;
    around.turn = turn;
    const canvas = around.backdrop.image as HTMLCanvasElement;
    const { width, height } = around.picture;
    [canvas.width, canvas.height] = [width, height];
    const share = 0.25 + turn / 360;
    const left = -Math.round((share - Math.floor(share)) * width);
    const context = canvas.getContext("2d")!;
    for (const at of [left, left + width]) context.drawImage(around.picture, at, 0);
    around.backdrop.needsUpdate = true;
  }

  /** Waits until the graphics processor is done. */
  private async finished(): Promise<void> {
    const backend = this.renderer.backend as unknown as { device?: { queue: { onSubmittedWorkDone(): Promise<void> } }; gl?: WebGL2RenderingContext };
    if (backend.device) return backend.device.queue.onSubmittedWorkDone();
    const gl = backend.gl;
    const sync = gl?.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!gl || !sync) return;
    gl.flush();
    while (gl.clientWaitSync(sync, 0, 0) === gl.TIMEOUT_EXPIRED) await new Promise((resolve) => setTimeout(resolve, 4));
    gl.deleteSync(sync);
  }

  /** The picture as it is shown. */
  async picture(look: Look): Promise<Blob | null> {
    await this.render(look, false);
    if (look.surroundings) (await this.summing()).show.render(this.renderer);
    else this.renderLit(look);
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }

  end(): void {
    this.ended = true;
    this.mesh?.geometry.dispose();
    this.sum?.one.dispose();
    this.sum?.all.dispose();
    this.renderer?.dispose();
  }
}
