"""Opens splats in another's viewer (npm: three, @sparkjsdev/spark) in a headless Chromium.

splats.py FILE MODULES SCREENSHOT [PATH.json [HEIGHT]]: FILE is an SPZ or a PLY, MODULES the folder of npm packages.
The camera is the first keyframe of the path, without roll; by default that of tests/flow/open.sh: 45 m south of the
origin, 40 m above it, looking north and 40 degrees down, 50 degrees high. The picture has 320 x HEIGHT pixels; 214 is
the default."""
import base64
import functools
import http.server
import json
import math
import os
import shutil
import sys
import tempfile
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "view"))
from browser import Browser, find_chromium

WIDTH, HEIGHT = 320, 214
VIEW = {"local": [0, -45, 40], "heading_deg": 0, "pitch_deg": -40, "vfov_deg": 50}
PAGE = """<!doctype html><style>body { margin: 0; background: black }</style>
<script type="importmap">{"imports": {"three": "/modules/three/build/three.module.js",
    "three/addons/": "/modules/three/examples/jsm/",
    "@sparkjsdev/spark": "/modules/@sparkjsdev/spark/dist/spark.module.js"}}</script>
<script type="module">
import * as THREE from "three"
import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark"
const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true })
renderer.setSize(%(width)d, %(height)d)
document.body.append(renderer.domElement)
const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(%(vfov)f, %(width)d / %(height)d, 0.1, 5000)
scene.add(new SparkRenderer({ renderer }))
const splats = new SplatMesh({ url: "/%(file)s" })
if ("%(file)s".endsWith(".ply")) splats.rotation.x = -Math.PI / 2  // z up
scene.add(splats)
camera.position.set(%(eye)s)
camera.lookAt(%(at)s)
await splats.initialized
window.count = splats.packedSplats?.numSplats ?? splats.numSplats
let frames = 0
const gl = renderer.getContext(), row = new Uint8Array(4 * %(width)d)
renderer.setAnimationLoop(() => {
    renderer.render(scene, camera)
    gl.readPixels(0, %(height)d / 2, %(width)d, 1, gl.RGBA, gl.UNSIGNED_BYTE, row)
    if (row.some((value, i) => i %% 4 < 3 && value > 30)) frames++
    window.frames = frames
    if (frames > 8) renderer.setAnimationLoop(null)  // without a GPU a frame takes long
})
</script>"""


class Silent(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args):
        pass


def main():
    splats, modules, screenshot = sys.argv[1:4]
    view = VIEW
    if len(sys.argv) > 4:
        with open(sys.argv[4], encoding="utf-8") as path:
            view = json.load(path)["keyframes"][0]
    height = int(sys.argv[5]) if len(sys.argv) > 5 else HEIGHT
    if not find_chromium():
        print("skipped: there is no Chromium here; apt-get install chromium")
        return 77
    folder = tempfile.mkdtemp()
    name = "splats" + os.path.splitext(splats)[1]
    shutil.copy(splats, os.path.join(folder, name))
    os.symlink(os.path.abspath(modules), os.path.join(folder, "modules"))
    heading, pitch = math.radians(view["heading_deg"]), math.radians(view["pitch_deg"])
    ahead = (math.sin(heading) * math.cos(pitch), math.cos(heading) * math.cos(pitch), math.sin(pitch))
    east, north, up = view["local"]
    with open(os.path.join(folder, "index.html"), "w", encoding="utf-8") as page:
        page.write(PAGE % {"width": WIDTH, "height": height, "file": name, "vfov": view["vfov_deg"],
                           "eye": f"{east}, {up}, {-north}",
                           "at": f"{east + ahead[0]}, {up + ahead[2]}, {-north - ahead[1]}"})
    handler = functools.partial(Silent, directory=folder)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    browser = Browser(WIDTH, height)
    try:
        browser.open(f"http://127.0.0.1:{server.server_port}/index.html")
        browser.wait("window.count", 300)
        # The viewer sorts in a thread of its own; some frames after the first that shows something all is in order.
        browser.wait("window.frames > 8", 300)
        print(f"Spark shows {browser.run('window.count')} splats")
        picture = browser.run("document.querySelector('canvas').toDataURL('image/png')")
        with open(screenshot, "wb") as file:
            file.write(base64.b64decode(picture.split(",")[1]))
        return 0
    finally:
        browser.close()
        server.shutdown()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
