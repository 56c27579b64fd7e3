/** Debian's Chromium without a window, with WebGL2 and WebGPU in software; see tests/python/browser.py. */

import { existsSync } from "node:fs";
import { chromium } from "playwright-core";

const PROGRAMS = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
const FLAGS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--no-first-run"];
const SOFTWARE = ["--enable-unsafe-webgpu", "--ignore-gpu-blocklist", "--enable-gpu", "--enable-features=Vulkan", "--use-vulkan=swiftshader", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

export async function launched() {
  const executablePath = process.env.CHROMIUM ?? PROGRAMS.find(existsSync);
  return chromium.launch({ executablePath, args: [...FLAGS, ...SOFTWARE] });
}

/** Waits until a page shows what its address asks for. */
export async function settled(page, selector) {
  await page.waitForFunction((chosen) => {
    const element = document.querySelector(chosen);
    return element && element.dataset.wanted && element.dataset.wanted === element.dataset.shown;
  }, selector);
}

/** Waits until all tiles of the 3D view are drawn and nothing moves any more. */
export async function drawn(page) {
  await page.waitForFunction(() => {
    const all = [...document.querySelectorAll("canvas.scene")];
    return all.length > 0 && all.every((canvas) => canvas.dataset.idle === "true");
  }, null, { timeout: 60_000 });
  // a sharp picture follows a coarse one
  await page.waitForTimeout(400);
  await page.waitForFunction(() => [...document.querySelectorAll("canvas.scene")].every((canvas) => canvas.dataset.idle === "true"), null, { timeout: 60_000 });
}

/** The pixels of the canvas of texels, RGB. */
export async function pixels(page, selector) {
  return page.evaluate((chosen) => {
    const canvas = document.querySelector(`${chosen} canvas`);
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const rgb = new Uint8Array((data.length / 4) * 3);
    for (let from = 0, to = 0; from < data.length; from += 4, to += 3) rgb.set(data.subarray(from, from + 3), to);
    return btoa(Array.from(rgb, (byte) => String.fromCharCode(byte)).join(""));
  }, selector);
}

export function stateOf(page) {
  const [panel, query] = new URL(page.url()).hash.slice(2).split("?");
  return { panel, ...Object.fromEntries(new URLSearchParams(query)) };
}
