/** Kills a studio while its page is open and a job runs, and starts it again: `node restart.mjs LODEN FOLDER PORT`. */

import { spawn } from "node:child_process";
import { readdirSync } from "node:fs";
import { launched } from "./browser.mjs";

const [program, folder, port] = process.argv.slice(2);
const begun = () =>
  new Promise((resolve) => {
    const studio = spawn(program, ["studio", folder, "--port", port, "--no-open"], { stdio: ["ignore", "pipe", "inherit"] });
    studio.stdout.once("data", () => resolve(studio));
  });
let studio = await begun();
const browser = await launched();
const page = await browser.newPage({ locale: "en-GB" });
page.setDefaultTimeout(120_000);
try {
  await page.goto(`http://127.0.0.1:${port}/#/compression?m=0/twill.zip`);
  await page.getByRole("button", { name: "Simulate a sample" }).waitFor({ state: "detached" });
  await page.keyboard.press("1");
  await page.getByRole("button", { name: "Simulate a sample" }).click();
  await page.locator("dialog").getByRole("radio", { name: "256" }).click();
  await page.locator("dialog").getByRole("button", { name: "Start" }).click();
  await page.locator(".badge:not([hidden])").waitFor();
  studio.kill("SIGKILL");
  await page.locator("body.lost").waitFor();
  studio = await begun();
  await page.locator("body:not(.lost)").waitFor();
  // the page has the token of the new run
  await page.keyboard.press("3");
  await page.getByRole("button", { name: "Compress", exact: true }).click();
  await page.getByText(/is done$/).waitFor();
  console.log(JSON.stringify(readdirSync(folder).sort()));
} finally {
  studio.kill();
  await browser.close();
}
