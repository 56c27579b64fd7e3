/** What the server tells, and what all panels share. */

import { get } from "./api";

export interface Material {
  id: string;
  name: string;
  bytes: number;
  modified: number | null;
  kind?: string;
  holds?: "btf" | "compressed" | "brdf";
  width?: number;
  height?: number;
  views?: number;
  lights?: number;
  pairs?: number;
  raw_bytes?: number;
  method?: string;
  error?: number | null;
  source?: string | null;
  has_changed?: boolean;
  problem?: string;
}

export interface Details extends Material {
  listed?: boolean;
  view_degrees?: [number, number][];
  light_degrees?: [number, number][];
  missing?: [number, number][];
  encoding?: string;
  cosine?: string;
  sample_type?: string;
  facts?: Record<string, string>;
  params?: Record<string, unknown>;
  report?: { mean_abs_error: number; max_abs_error: number; psnr_db: number | null; ssim: number } | null;
  rearranged?: boolean;
  has_rows?: boolean;
  resident_bytes?: number;
  history?: string[];
  not_on_gpu?: string | null;
  warnings: string[];
}

export interface Param {
  name: string;
  unit: string;
  kind: "integer" | "real" | "color" | "choice" | "switch" | "text";
  range: [number, number] | string[] | null;
  default: string;
  doc: string;
}

export interface Entry {
  name: string;
  doc: string;
  params: Param[];
}

export interface Tables {
  version: string;
  codecs: Entry[];
  codec: string;
  syntheses: Entry[];
  synthesis: string;
  samples: Entry[];
  renderers: Entry[];
  objects: Entry[];
}

export interface Job {
  id: number;
  kind: string;
  title: string;
  command: string;
  output: string | null;
  phase: "queued" | "running" | "done" | "failed" | "cancelled";
  stage: string;
  task: string;
  fraction: number | null;
  remaining_s: number | null;
  seconds: number;
  warnings: string[];
  result: Record<string, unknown> | null;
  error: string | null;
  pictures: number;
}

/** A file of the folders that is no material. */
export interface Extra {
  id: string;
  name: string;
}

interface Listed {
  materials: Material[];
  places: string[];
  output: string;
  upload_limit: number;
}

/** The lists of the server, and those who want to know when they change. */
class Model {
  tables!: Tables;
  listed: Listed = { materials: [], places: [], output: "", upload_limit: 0 };
  extras: { meshes: Extra[]; panoramas: Extra[] } = { meshes: [], panoramas: [] };
  loaded = false;
  private details = new Map<string, Promise<Details>>();
  private listeners: (() => void)[] = [];

  async start(): Promise<void> {
    this.tables = await get<Tables>("tables");
  }

  async refresh(): Promise<void> {
    const before = new Map(this.listed.materials.map((material) => [material.id, material.modified]));
    [this.listed, this.extras] = await Promise.all([get<Listed>("materials"), get<typeof this.extras>("extras")]);
    this.loaded = true;
    for (const material of this.listed.materials) if (before.get(material.id) !== material.modified) this.details.delete(material.id);
    for (const listener of this.listeners) listener();
  }

  onChange(listener: () => void): void {
    this.listeners.push(listener);
  }

  material(id: string | undefined): Material | undefined {
    return this.listed.materials.find((material) => material.id === id);
  }

  of(...kinds: string[]): Material[] {
    return this.listed.materials.filter((material) => material.holds && kinds.includes(material.holds));
  }

  /** Compressed forms of a measurement: those that say they come from a file of its name. */
  formsOf(source: Material): Material[] {
    return this.of("compressed").filter((form) => form.source === source.name);
  }

  async detailsOf(id: string): Promise<Details> {
    let found = this.details.get(id);
    if (!found) {
      found = get<Details>("material", { m: id });
      found.catch(() => this.details.delete(id));
      this.details.set(id, found);
    }
    return found;
  }

  /** A name for a new file that is not taken. */
  freeName(stem: string, ending: string): string {
    const taken = new Set(this.listed.materials.map((material) => material.name));
    let name = `${stem}.${ending}`;
    for (let k = 2; taken.has(name); k++) name = `${stem}-${k}.${ending}`;
    return name;
  }
}

export const model = new Model();

/** A name without its ending. */
export function stem(name: string): string {
  return name.replace(/\.[^.]+$/, "");
}
