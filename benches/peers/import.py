"""Decoding every JPEG of a zip with libjpeg-turbo (by Pillow) on both cores, the bytes already in memory."""
import io
import json
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor

from PIL import Image, features

with zipfile.ZipFile(sys.argv[1]) as archive:
    files = [archive.read(name) for name in archive.namelist() if name.lower().endswith(".jpg")]


def decode(part):
    # Pillow releases the interpreter lock while libjpeg-turbo works
    for data in part:
        Image.open(io.BytesIO(data)).load()


for _ in range(3):
    start = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(decode, (files[0::2], files[1::2])))
    seconds = time.perf_counter() - start
    turbo = features.check_feature("libjpeg_turbo")
    print(json.dumps({"bench": "import", "seconds": round(seconds, 3), "images": len(files), "libjpeg_turbo": turbo}), flush=True)
