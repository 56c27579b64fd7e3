/** Requests to the server that gave the page. */

let token = document.querySelector<HTMLMetaElement>("meta[name=loden-token]")?.content ?? "";

/** What the server says of a failed request. */
export class Problem extends Error {
  constructor(message: string, readonly status: number) {
    super(message);
  }
}

export type Values = Record<string, string | number | string[] | undefined>;

/** An address with a query. */
export function address(path: string, values: Values = {}): string {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(values)) {
    for (const one of Array.isArray(value) ? value : [value]) if (one !== undefined) query.append(name, String(one));
  }
  const text = query.toString();
  return `/api/${path}${text ? `?${text}` : ""}`;
}

async function answered(path: string, values: Values, options: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(address(path, values), options);
  } catch {
    throw new Problem("", 0);
  }
  if (response.ok) return response;
  const body = await response.json().catch(() => null);
  throw new Problem(body?.error?.message ?? `${response.status} ${response.statusText}`, response.status);
}

/** Asks the page for the token of this run: a server that was started anew has another. */
export async function renew(): Promise<void> {
  const page = new DOMParser().parseFromString(await (await fetch("/")).text(), "text/html");
  token = page.querySelector<HTMLMetaElement>("meta[name=loden-token]")?.content ?? token;
}

/** Asks with the token; once more if it was that of an earlier run. */
async function authorised(method: string, path: string, values: Values, body: unknown): Promise<Response> {
  const ask = () => {
    const headers = { "content-type": "application/json", "x-loden-token": token };
    return answered(path, values, { method, headers, body: body === undefined ? null : JSON.stringify(body) });
  };
  try {
    return await ask();
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 403) throw error;
    const before = token;
    await renew();
    if (token === before) throw error;
    return ask();
  }
}

export async function get<T>(path: string, values: Values = {}): Promise<T> {
  return (await answered(path, values, {})).json();
}

/** A request that changes something. */
export async function send<T>(method: string, path: string, body?: unknown, values: Values = {}): Promise<T> {
  return (await authorised(method, path, values, body)).json();
}

export async function sendText(path: string, body: unknown): Promise<string> {
  return (await authorised("POST", path, {}, body)).text();
}

/** Uploads a file and tells how much of it has been sent. */
export function upload(file: File, progress: (share: number) => void): Promise<{ id: string; kind: string }> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", address("upload", { name: file.name }));
    request.setRequestHeader("x-loden-token", token);
    request.responseType = "json";
    request.upload.addEventListener("progress", (event) => progress(event.loaded / Math.max(event.total, 1)));
    request.addEventListener("load", () => {
      if (request.status === 200) resolve(request.response);
      else reject(new Problem(request.response?.error?.message ?? `${request.status}`, request.status));
    });
    request.addEventListener("error", () => reject(new Problem("", 0)));
    request.send(file);
  });
}

/** An image of a material: RGBA for a canvas. */
export interface Texels {
  width: number;
  height: number;
  rgba: ImageData;
  mean: number;
  largest: number;
}

export async function texels(path: string, values: Values, body?: unknown): Promise<Texels> {
  const response = body === undefined ? await answered(path, values, {}) : await authorised("POST", path, values, body);
  const [width, height] = (response.headers.get("x-size") ?? "0x0").split("x").map(Number) as [number, number];
  const rgb = new Uint8Array(await response.arrayBuffer());
  const rgba = new ImageData(width, height);
  for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) {
    rgba.data[to] = rgb[from]!;
    rgba.data[to + 1] = rgb[from + 1]!;
    rgba.data[to + 2] = rgb[from + 2]!;
    rgba.data[to + 3] = 255;
  }
  return { width, height, rgba, mean: Number(response.headers.get("x-mean")), largest: Number(response.headers.get("x-largest")) };
}

/** A picture file, as texels. */
export async function picture(path: string, values: Values = {}): Promise<Texels> {
  const bitmap = await createImageBitmap(await (await answered(path, values, {})).blob());
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext("2d")!;
  context.drawImage(bitmap, 0, 0);
  return { width: bitmap.width, height: bitmap.height, rgba: context.getImageData(0, 0, bitmap.width, bitmap.height), mean: 0, largest: 0 };
}

/** For each texel of a rearranged material the texel that it copies: column and row, in turn. */
export async function origins(m: string): Promise<{ width: number; height: number; sources: Uint16Array }> {
  const response = await answered("origins", { m }, {});
  const [width, height] = (response.headers.get("x-size") ?? "0x0").split("x").map(Number) as [number, number];
  return { width, height, sources: new Uint16Array(await response.arrayBuffer()) };
}

export async function binary(path: string, values: Values): Promise<ArrayBuffer> {
  return (await answered(path, values, {})).arrayBuffer();
}

/** Runs one request at a time; of those that come meanwhile only the last is run, so that dragging never lags behind. */
export class Scrub {
  private busy = false;
  private next: (() => Promise<void>) | null = null;

  run(work: () => Promise<void>): void {
    this.next = work;
    if (!this.busy) void this.drain();
  }

  private async drain(): Promise<void> {
    this.busy = true;
    while (this.next) {
      const work = this.next;
      this.next = null;
      await work();
    }
    this.busy = false;
  }
}
