/** Pictures of all panels: `node shots.mjs ADDRESS FOLDER [FILTER]`, of a studio that has twill.zip and some forms of it. */

import { join } from "node:path";
import { drawn, launched, settled } from "./browser.mjs";

const [address, folder, filter = ""] = process.argv.slice(2);
const SIZES = [[1440, 900], [1024, 768], [390, 844]];
const PANELS = {
  gallery: ["gallery", (page) => page.locator(".card img").first().waitFor()],
  originals: ["originals?m=0/twill.zip&v=10&l=44&x=20&y=12", (page) => settled(page, ".stage")],
  brdf: ["originals?m=0/ggx.bsdf", (page) => page.waitForTimeout(2500)],
  compression: ["compression?m=0/twill.zip&c=0/twill-pvmf4.loden&v=10&l=44", (page) => settled(page, ".viewer")],
  view: ["view?m=0/twill-pvmf4.loden&gl=webgl", drawn],
  beside: ["view?m=0/twill-pvmf4.loden&more=0/twill-klt-0.03.loden&o=teapot&gl=webgl", drawn],
  create: ["create?m=0/twill.zip", (page) => page.waitForTimeout(600)],
  export: ["export?m=0/twill-pvmf4.loden", (page) => page.waitForTimeout(300)],
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
      await ready(page).catch((error) => console.log(file, error.message));
      await page.waitForTimeout(250);
      await page.screenshot({ path: join(folder, `${file}.png`) });
      await context.close();
    }
  }
}
await browser.close();
