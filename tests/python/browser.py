"""Runs pages in Debian's or another Chromium, without a window and without the network.

As a program, it exits with status 1 if there is none.
"""

import functools
import html
import http.server
import json
import re
import shutil
import subprocess
import sys
import tempfile
import threading

FLAGS = ["--headless=new", "--no-sandbox", "--disable-background-networking", "--disable-component-update", "--no-first-run"]
# Software renderers for WebGL2 and WebGPU alike
SOFTWARE = ["--enable-unsafe-webgpu", "--ignore-gpu-blocklist", "--enable-gpu", "--enable-features=Vulkan", "--use-vulkan=swiftshader", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def found():
    """The program; None if there is none."""
    return next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)


class Server(http.server.ThreadingHTTPServer):
    """Serves a folder, and takes the result that a page posts."""

    def __init__(self, folder):
        self.result, self.done = None, threading.Event()
        super().__init__(("127.0.0.1", 0), functools.partial(Handler, directory=folder))


class Handler(http.server.SimpleHTTPRequestHandler):
    def do_POST(self):
        self.server.result = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        self.server.done.set()

    def log_message(self, *_):
        pass


def result_of(folder, page, seconds=300):
    """What a page of a folder posts to /result: JSON, in which "error" is raised."""
    server = Server(str(folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        url = f"http://127.0.0.1:{server.server_port}/{page}"
        command = [found(), *FLAGS, *SOFTWARE, f"--user-data-dir={profile}", "--remote-debugging-port=0", url]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as browser:
            done = server.done.wait(seconds)
            browser.terminate()
            try:
                browser.wait(20)
            except subprocess.TimeoutExpired:
                browser.kill()
    server.shutdown()
    assert done, f"{page} posted nothing in {seconds} s"
    result = json.loads(server.result)
    assert "error" not in result, f"{page}: {result['error']}"
    return result


def document_of(path, seconds=120):
    """What a page that is opened from disk writes to <pre id="result">: JSON, in which "error" is raised."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [found(), *FLAGS, *SOFTWARE, f"--user-data-dir={profile}", "--virtual-time-budget=20000", "--dump-dom", f"file://{path}"]
        text = subprocess.run(command, capture_output=True, text=True, timeout=seconds).stdout
    found_text = re.search(r'<pre id="result">(.*?)</pre>', text, re.S)
    assert found_text, text[-2000:]
    result = json.loads(html.unescape(found_text.group(1)))
    assert "error" not in result, f"{path}: {result['error']}"
    return result


if __name__ == "__main__":
    sys.exit(found() is None)
