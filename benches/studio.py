"""How soon the studio shows something, how fast directions are scrubbed, and how large its page is.

Usage: python studio.py [LODEN] [ARCHIVE]: the built program, and an archive with 81 x 81 images of 256 x 256 texels, which is simulated
if there is none.

First picture: from the start of `loden studio twill.zip` to the last byte of the thumbnail, asked for as the page asks, and, if there is a
Chromium that runs already, to the thumbnail on the screen. Scrubbing: images of random pairs, one after the other, on one connection.
"""

import http.client
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import time
import zlib

PAGE = pathlib.Path("crates/loden-studio/page")
IMAGES = 500
RUNS = 5

BROWSER = """
import { launched } from "./browser.mjs";
import { spawn } from "node:child_process";
const [program, archive] = process.argv.slice(2);
const browser = await launched();
const page = await browser.newPage();
await page.goto("about:blank");
const began = performance.now();
const studio = spawn(program, ["studio", archive, "--no-open", "--json"], { stdio: ["ignore", "pipe", "inherit"] });
let text = "";
for await (const chunk of studio.stdout) {
  text += chunk;
  if (text.trimEnd().endsWith("}")) break;
}
await page.goto(JSON.parse(text).address);
await page.waitForFunction(() => document.querySelector(".card img")?.complete && document.querySelector(".card img").naturalWidth > 0);
console.log((performance.now() - began) / 1000);
studio.kill();
await browser.close();
"""


def started(program, archive):
    """The running studio and its port."""
    studio = subprocess.Popen([program, "studio", archive, "--no-open", "--json"], stdout=subprocess.PIPE, text=True)
    text = ""
    while not text.rstrip().endswith("}"):
        text += studio.stdout.readline()
    return studio, int(json.loads(text)["address"].rstrip("/").rsplit(":", 1)[1])


def fetched(connection, path):
    connection.request("GET", path)
    reply = connection.getresponse()
    content = reply.read()
    assert reply.status == 200, (path, reply.status, content[:200])
    return content


def first_picture(program, archive):
    began = time.perf_counter()
    studio, port = started(program, archive)
    try:
        connection = http.client.HTTPConnection("127.0.0.1", port)
        for path in ("/", "/app.js", "/api/tables", "/api/materials"):
            content = fetched(connection, path)
        fetched(connection, f"/api/thumbnail?m={json.loads(content)['materials'][0]['id']}")
        return time.perf_counter() - began
    finally:
        studio.terminate()
        studio.wait()


def first_on_screen(program, archive):
    """None without a Chromium or the modules of the page's tests."""
    script = PAGE / "test" / "first.tmp.mjs"
    script.write_text(BROWSER)
    try:
        done = subprocess.run(["node", script, program, archive], stdout=subprocess.PIPE, text=True, timeout=120)
        return float(done.stdout) if done.returncode == 0 else None
    finally:
        script.unlink()


def scrubbing(program, archive):
    studio, port = started(program, archive)
    try:
        connection = http.client.HTTPConnection("127.0.0.1", port)
        material = json.loads(fetched(connection, "/api/materials"))["materials"][0]
        draw = random.Random(1)
        times = []
        for _ in range(IMAGES):
            view, light = draw.randrange(material["views"]), draw.randrange(material["lights"])
            began = time.perf_counter()
            fetched(connection, f"/api/image?m={material['id']}&view={view}&light={light}")
            times.append(time.perf_counter() - began)
        peak = next(line for line in pathlib.Path(f"/proc/{studio.pid}/status").read_text().splitlines() if line.startswith("VmHWM"))
        return material, sorted(times), int(peak.split()[1]) * 1024
    finally:
        studio.terminate()
        studio.wait()


def main():
    program = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "target/release/loden").absolute()
    for names in (["app.js"], ["app.js", "three.js", "three.webgpu.js", "three.tsl.js"]):
        size = sum(len(zlib.compress((PAGE / "dist" / name).read_bytes(), 9)) for name in names)
        print(f"scripts, compressed: {size / 1000:.0f} kB ({', '.join(names)})")
    with tempfile.TemporaryDirectory() as name:
        archive = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else pathlib.Path(name) / "twill.zip"
        if not archive.exists():
            subprocess.run([program, "acquire", "twill", "--size", "256", "--spp", "1", "-o", archive, "-q"], check=True, stdout=subprocess.DEVNULL)
        times = sorted(first_picture(program, archive) for _ in range(RUNS))
        print(f"first picture: {times[0]:.2f} to {times[-1]:.2f} s in {RUNS} runs")
        screen = first_on_screen(program, archive)
        print(f"first picture on the screen: {screen:.2f} s" if screen else "first picture on the screen: no Chromium")
        material, times, peak = scrubbing(program, archive)
        size = f"{material['width']} x {material['height']} x {material['pairs']}"
        middle, late = (1000 * times[int(share * len(times))] for share in (0.5, 0.95))
        print(f"scrubbing {size}: {middle:.1f} ms in the middle, {late:.1f} ms at the 95th percentile; peak memory {peak / 1e6:.0f} MB")


main()
