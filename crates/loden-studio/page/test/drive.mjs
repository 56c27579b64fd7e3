/** Uses the studio as a person does and writes down what it showed: `node drive.mjs ADDRESS FOLDER`. What it prints is compared
 * with the library by tests/python/studio_vs_loden.py. */

import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { drawn, launched, pixels, settled, stateOf } from "./browser.mjs";

const [address, folder] = process.argv.slice(2);
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const browser = await launched();
const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, locale: "en-GB", acceptDownloads: true });
await context.grantPermissions(["clipboard-read", "clipboard-write"], { origin: address.replace(/\/$/, "") });
const page = await context.newPage();
page.setDefaultTimeout(120_000);
const elsewhere = [];
const problems = [];
page.on("request", (request) => {
  if (!/^(blob|data):/.test(request.url()) && !request.url().startsWith(address)) elsewhere.push(request.url());
});
// what the server refuses on purpose below is no problem of the page
page.on("console", (message) => message.type() === "error" && !message.text().includes("422") && problems.push(message.text()));
page.on("pageerror", (error) => problems.push(String(error.stack ?? error)));
const result = { images: [], violations: [], views: {} };

/** Serious faults of accessibility on the page as it is. */
async function audit(name) {
  // colours are those of the page at rest
  await page.evaluate(() => {
    const ends = (one) => one.effect.getComputedTiming().endTime !== Infinity;
    return Promise.all(document.getAnimations().filter(ends).map((one) => one.finished));
  });
  await page.evaluate(axe);
  const found = await page.evaluate(() => window.axe.run(document, { resultTypes: ["violations"] }));
  for (const one of found.violations) {
    if (["serious", "critical"].includes(one.impact)) result.violations.push(`${name}: ${one.id}: ${one.nodes.map((node) => node.target.join(" ")).slice(0, 3).join("; ")}`);
  }
}

async function noteImage() {
  await settled(page, ".stage");
  const { v, l } = stateOf(page);
  result.images.push({ v: Number(v), l: Number(l), rgb: await pixels(page, ".stage") });
}

// the gallery
const began = Date.now();
await page.goto(address);
await page.locator(".card img").first().waitFor();
result.firstPicture = Date.now() - began;
result.cards = await page.locator(".card strong").allTextContents();
await audit("gallery");

// originals: a link, a step by keyboard, a drag, undo, a reload
await page.goto(`${address}#/originals?m=0/twill.zip&v=10&l=20`);
await noteImage();
const pad = page.locator(".pad").first();
await pad.focus();
await page.keyboard.press("ArrowRight");
await page.waitForFunction(() => !location.hash.includes("l=20"));
await noteImage();
const box = await pad.boundingBox();
await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
await page.mouse.down();
await page.mouse.move(box.x + 0.3 * box.width, box.y + 0.35 * box.height, { steps: 8 });
await page.mouse.up();
await noteImage();
await page.keyboard.press("Control+z");
await page.waitForTimeout(100);
await noteImage();
await page.reload();
await noteImage();
await page.locator(".stage").click({ position: { x: 300, y: 300 } });
await page.locator(".texel-body .numbers").waitFor();
await page.waitForFunction(() => document.querySelector(".numbers").textContent.length > 5);
result.texel = { ...stateOf(page), text: await page.locator(".numbers").textContent() };
// its values beside those of another texel
await page.getByRole("button", { name: "Keep for comparison" }).click();
await page.locator(".stage").click({ position: { x: 200, y: 260 } });
await page.waitForFunction(() => document.querySelectorAll(".slice .kept").length > 0 && document.querySelectorAll(".texel-marks .texel-box").length === 1);
result.compared = { pins: stateOf(page).pins, dots: await page.locator(".slice .kept").count() };
await audit("originals");

// between measured directions, of a compressed material
await page.goto(`${address}#/originals?m=0/pvmf.loden&how=between&la=33,45&va=20,100`);
await page.waitForFunction(() => document.querySelector(".stage")?.dataset.shown?.startsWith("0/pvmf.loden"));
await settled(page, ".stage");
result.between = await pixels(page, ".stage");

// compression: the chart, a new point, a cancelled job
await page.goto(`${address}#/compression?m=0/twill.zip`);
await page.locator(".chart .point").first().waitFor();
result.pointsBefore = await page.locator(".chart .point").count();
await page.getByRole("button", { name: "Compress", exact: true }).click();
await page.waitForFunction((before) => document.querySelectorAll(".chart .point").length > before, result.pointsBefore);
result.points = await page.locator(".chart .point").evaluateAll((all) => all.map((one) => one.getAttribute("aria-label")));
await page.locator(".chart .point[data-id='0/pvmf.loden']").dispatchEvent("click");
await page.waitForFunction(() => location.hash.includes("c=0/pvmf.loden"));
await settled(page, ".viewer");
result.caption = await page.locator(".compare figcaption").last().textContent();
result.reconstruction = { ...stateOf(page), rgb: await pixels(page, ".compare:nth-child(2)") };
await audit("compression");
await page.keyboard.press("1");
await page.getByRole("button", { name: "Simulate a sample" }).click();
await page.locator("dialog").getByRole("radio", { name: "256" }).click();
await page.locator("dialog").getByRole("button", { name: "Start" }).click();
// a dialog keeps the keys to itself
await page.locator("dialog").waitFor({ state: "hidden" });
await page.keyboard.press("j");
await audit("jobs");
const job = page.locator(".job").first();
await job.getByRole("button", { name: "Cancel" }).click();
await job.getByText("Cancelled").waitFor();
result.cancelled = await job.textContent();
await page.keyboard.press("Escape");

// a damaged file
const damaged = join(folder, "damaged.zip");
writeFileSync(damaged, "PK\x03\x04 and nothing else");
await page.locator("input[type=file]").setInputFiles(damaged);
await page.locator(".toast.problem").waitFor();
result.damaged = await page.locator(".toast.problem").textContent();

// the 3D view by both interfaces
for (const gl of ["webgl", ""]) {
  await page.goto(`${address}#/view?m=0/pvmf.loden${gl ? `&gl=${gl}` : ""}`);
  if (result.views.webgl) await page.reload();
  await drawn(page);
  const tile = await page.locator(".tile").boundingBox();
  await page.mouse.move(tile.x + 300, tile.y + 300);
  await page.mouse.down();
  await page.mouse.move(tile.x + 360, tile.y + 270, { steps: 3 });
  await page.mouse.up();
  await drawn(page);
  await page.getByRole("radio", { name: "Lamp alone" }).click();
  await page.getByRole("button", { name: "Copy scene file" }).click();
  await page.getByText("Copied").last().waitFor();
  const name = gl || "webgpu";
  await page.evaluate(() => document.querySelectorAll(".tile-name, .toast").forEach((one) => one.remove()));
  await page.locator("canvas.scene").screenshot({ path: join(folder, `${name}.png`) });
  const scene = await page.evaluate(() => navigator.clipboard.readText());
  writeFileSync(join(folder, `${name}.toml`), scene);
  result.views[name] = await page.locator(".status").textContent();
}
await audit("view");

// a mesh of one's own within surroundings
await page.goto(`${address}#/view?m=0/pvmf.loden&o=0/solid.obj&env=0/sky.png&turn=40&gl=webgl`);
await page.reload();
await drawn(page);
await page.getByRole("radio", { name: "Lamp alone" }).click();
await page.getByRole("button", { name: "Copy scene file" }).click();
await page.getByText("Copied").last().waitFor();
await page.evaluate(() => document.querySelectorAll(".tile-name, .toast").forEach((one) => one.remove()));
await page.locator("canvas.scene").screenshot({ path: join(folder, "around.png") });
writeFileSync(join(folder, "around.toml"), await page.evaluate(() => navigator.clipboard.readText()));
result.views.around = await page.locator(".status").textContent();
await audit("surroundings");

// the path tracer in place, and the file that opens from disk
await page.getByRole("radio", { name: "16", exact: true }).click();
await page.getByRole("button", { name: "Render with the path tracer" }).click();
await page.locator(".rendered").waitFor();
await page.getByRole("button", { name: "Back to the live view" }).waitFor();
const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Save as one HTML file" }).click()]);
await download.saveAs(join(folder, "single.html"));

// new materials: painted texels are recoloured, seen at once, and kept
const ended = (name) => page.waitForFunction((made) => location.hash.includes(`c=0/${made}`), name);
const [left, right] = [".pair-view .viewer:first-child .stage", ".pair-view .viewer:last-child .stage"];
await page.goto(`${address}#/create?m=0/rows.loden&how=edit&on=mask&ed=120,1,1,1,1,1`);
await page.locator(left).waitFor();
await page.waitForFunction((chosen) => document.querySelector(chosen)?.dataset.shown, left);
const canvas = await page.locator(`${left} canvas.texels`).first().boundingBox();
await page.mouse.move(canvas.x + 0.3 * canvas.width, canvas.y + 0.3 * canvas.height);
await page.mouse.down();
await page.mouse.move(canvas.x + 0.6 * canvas.width, canvas.y + 0.4 * canvas.height, { steps: 5 });
await page.mouse.up();
await settled(page, right);
result.preview = await pixels(page, right);
result.painted = stateOf(page).paint;
await audit("create");
await page.getByRole("button", { name: "Start" }).click();
await ended("rows-edited.loden");
await settled(page, right);
result.edited = await pixels(page, right);

// exchanged, mixed by the slider, enlarged while one looks on
await page.goto(`${address}#/create?m=0/rows.loden&how=exchange&with=0/leather.loden`);
await page.getByRole("button", { name: "Show all pairs" }).click();
await page.locator(".maker:not(.busy)").waitFor();
await page.getByText("rows: patterns").waitFor();
await page.getByRole("button", { name: "Start" }).click();
await ended("rows-exchanged.loden");
await page.goto(`${address}#/create?m=0/rows.loden&how=mix&with=0/leather.loden&amt=0.3`);
await page.getByRole("button", { name: "Show the steps" }).click();
await page.locator(".maker:not(.busy)").waitFor();
await page.getByText("faded between").waitFor();
await settled(page, right);
const faded = await pixels(page, right);
await page.getByRole("slider", { name: /From this one/ }).fill("0.7");
await page.waitForTimeout(100);
result.slid = faded !== (await pixels(page, right));
await page.getByRole("button", { name: "Start" }).click();
await ended("rows-mixed.loden");
await page.goto(`${address}#/create?m=0/rows.loden&how=enlarge`);
for (const side of ["Width", "Height"]) await page.getByRole("radiogroup", { name: side }).getByRole("radio", { name: "128" }).click();
await page.getByRole("button", { name: "Start" }).click();
await page.getByText("in the making").waitFor();
await ended("rows-large.loden");
await settled(page, right);
await page.locator(right).hover({ position: { x: 200, y: 200 } });
await page.locator(`${left} .texel-marks .texel-box`).waitFor();
result.made = (await (await page.request.get(`${address}api/jobs`)).json()).filter((one) => one.phase === "done" && /^rows-/.test(one.title)).map(({ title, command, pictures }) => ({ title, command, pictures }));

// an export as a download
await page.goto(`${address}#/export?m=0/pvmf.loden`);
const target = page.locator(".target", { has: page.getByRole("heading", { name: "glsl", exact: true }) });
await target.getByRole("button", { name: "Export" }).click();
const [archive] = await Promise.all([page.waitForEvent("download"), target.getByRole("button", { name: "Save" }).click()]);
await archive.saveAs(join(folder, "export.zip"));
await audit("export");

// the page of one file, from disk and without the server
const single = await context.newPage();
single.on("console", (message) => message.type() === "error" && problems.push(message.text()));
single.on("pageerror", (error) => problems.push(String(error.stack ?? error)));
single.on("request", (request) => !/^(blob|data|file):/.test(request.url()) && elsewhere.push(request.url()));
await single.goto(`file://${join(folder, "single.html")}`);
await single.waitForTimeout(3000);
await single.locator("canvas").screenshot({ path: join(folder, "single.png") });
Object.assign(result, { elsewhere, problems });
console.log(JSON.stringify(result));
await browser.close();
