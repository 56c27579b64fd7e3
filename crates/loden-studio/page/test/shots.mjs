/** Pictures of all panels: `node shots.mjs ADDRESS FOLDER [FILTER]`, of the studio that docs/images/studio.py starts. */

import { join } from "node:path";
import { drawn, launched, settled } from "./browser.mjs";

const [address, folder, filter = ""] = process.argv.slice(2);
const SIZES = [[1440, 900], [1024, 768], [390, 844]];
const RESULT = ".pair-view .viewer:last-child .stage";

/** Starts a trial and waits for its pictures. */
async function tried(page, name) {
  await page.getByRole("button", { name }).click();
  await page.locator(".maker.busy").waitFor();
  await page.locator(".maker:not(.busy)").waitFor({ timeout: 120_000 });
  await page.waitForTimeout(800);
  await page.evaluate(() => document.querySelectorAll(".toast").forEach((one) => one.remove()));
}

const PANELS = {
  gallery: ["gallery", (page) => page.locator(".card img").first().waitFor()],
  originals: ["originals?m=0/twill.zip&v=10&l=44&x=20&y=12&pins=33,40 50,18", (page) => settled(page, ".stage")],
  brdf: ["originals?m=0/twill-mean.bsdf", (page) => page.waitForTimeout(2500)],
  compression: ["compression?m=0/twill.zip&c=0/twill-pvmf.loden&v=10&l=44", (page) => settled(page, ".viewer")],
  view: ["view?m=0/twill-klt.loden&gl=webgl", drawn],
  beside: ["view?m=0/twill-pvmf.loden&more=0/leather.loden&o=teapot&gl=webgl", drawn],
  around: ["view?m=0/leather.loden&o=0/knot.obj&env=0/evening.hdr&rep=6&gl=webgl", drawn],
  enlarge: ["create?m=0/twill-kmeans.loden&c=0/twill-large.loden", (page) => settled(page, RESULT)],
  exchange: ["create?m=0/twill-kmeans.loden&how=exchange&with=0/leather.loden&more=0/lacquer.loden", (page) => tried(page, "Show all pairs")],
  mix: ["create?m=0/twill-kmeans.loden&how=mix&with=0/leather.loden&amt=0.6", (page) => tried(page, "Show the steps")],
  edit: ["create?m=0/twill-kmeans.loden&how=edit&on=mask&ed=100,1.6,1,1,1,0&paint=9~14~20~30~14~50~40_5~50~12~58~24", (page) => settled(page, RESULT)],
  export: ["export?m=0/twill-pvmf.loden", (page) => page.waitForTimeout(300)],
  empty: ["compression", (page) => page.waitForTimeout(300)],
};

const browser = await launched();
for (const [width, height] of SIZES) {
  for (const theme of ["light", "dark"]) {
    for (const [name, [hash, ready]] of Object.entries(PANELS)) {
      const file = `${name}-${width}-${theme}`;
      if (!file.includes(filter)) continue;
      const context = await browser.newContext({ viewport: { width, height }, colorScheme: theme, locale: "en-GB" });
      const page = await context.newPage();
      page.on("console", (message) => message.type() === "error" && console.log(file, message.text()));
      page.on("pageerror", (error) => console.log(file, error.stack));
      await page.goto(`${address}#/${hash}`);
      page.setDefaultTimeout(60_000);
      await ready(page).catch((error) => console.log(file, error.message));
      await page.waitForTimeout(250);
      await page.screenshot({ path: join(folder, `${file}.png`) });
      await context.close();
    }
  }
}
await browser.close();
