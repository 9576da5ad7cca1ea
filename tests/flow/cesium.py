"""Opens 3D Tiles in CesiumJS, in a headless Chromium: the tiles load without an error, cover a part of the view, lie on
Earth where the frame says, and finer levels come when the camera comes near.

usage: cesium.py TILES CESIUM FRAME.json PICTURE.png [splats]      CESIUM: the npm package's Build/Cesium
splats: the tiles hold Gaussians, compressed by SPZ.
"""
import functools
import http.server
import json
import os
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "view"))
from browser import Browser, find_chromium

tiles, cesium, frame, picture = sys.argv[1:5]
splats = sys.argv[5:] == ["splats"]
if not find_chromium():
    print("skipped: there is no Chromium here")
    sys.exit(77)

PAGE = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<script>globalThis.CESIUM_BASE_URL = "/cesium/"</script><script src="/cesium/Cesium.js"></script>
<style>html, body, #view, #view div, canvas { margin: 0; width: 100%; height: 100%; overflow: hidden }</style>
<div id="view"></div>
<script type="module">
const widget = new Cesium.CesiumWidget("view", { baseLayer: false, skyBox: false, skyAtmosphere: false, globe: false,
    useDefaultRenderLoop: false, contextOptions: { webgl: { preserveDrawingBuffer: true } } });
const scene = widget.scene;
scene.backgroundColor = Cesium.Color.BLACK;
const set = await Cesium.Cesium3DTileset.fromUrl("/tiles/tileset.json", { maximumScreenSpaceError: 4 });
scene.renderError.addEventListener((_, error) => failures.push(String(error)));
// Frames by hand: without a window the browser may call for none. None once all is there: the processor draws them.
setInterval(() => { if (!loaded) { widget.resize(); widget.render(); } }, 100);
globalThis.failures = [];
// Splats are drawn once a worker has sorted those of all tiles.
const drawn = () => {
    const splats = set.gaussianSplatPrimitive, count = (sum, tile) => sum + tile.content.pointsLength;
    return !splats || splats.isStable && splats._numSplats === set._selectedTiles.reduce(count, 0);
};
set.tileFailed.addEventListener(e => failures.push(e.url + " " + e.message));
scene.primitives.add(set);
globalThis.near = range => {
    globalThis.loaded = false;
    const middle = set.boundingSphere;
    widget.camera.viewBoundingSphere(middle, new Cesium.HeadingPitchRange(0.6, -0.7, range * middle.radius));
    let calm = 0; // frames with nothing to load: in the first ones the finer tiles are not yet asked for
    const stop = scene.postRender.addEventListener(() => {
        calm = set.tilesLoaded && set.statistics.selected > 0 && drawn() ? calm + 1 : 0;
        if (calm > 10) { stop(); loaded = true; }
    });
};
globalThis.state = () => {
    const c = Cesium.Cartographic.fromCartesian(set.boundingSphere.center);
    const paper = document.createElement("canvas");
    paper.width = scene.canvas.width; paper.height = scene.canvas.height;
    const pen = paper.getContext("2d");
    pen.drawImage(scene.canvas, 0, 0);
    const data = pen.getImageData(0, 0, paper.width, paper.height).data, seen = new Set();
    let lit = 0;
    for (let i = 0; i < data.length; i += 4) {
        lit += data[i] + data[i + 1] + data[i + 2] > 30;
        if (i % 64 == 0) seen.add((data[i] >> 3) << 10 | (data[i + 1] >> 3) << 5 | data[i + 2] >> 3);
    }
    return { latitude: Cesium.Math.toDegrees(c.latitude), longitude: Cesium.Math.toDegrees(c.longitude),
        height: c.height, radius: set.boundingSphere.radius, selected: set.statistics.selected,
        triangles: set.statistics.numberOfTrianglesSelected,
        splats: set.gaussianSplatPrimitive ? set.gaussianSplatPrimitive._numSplats : 0,
        lit: lit * 4 / data.length, colours: seen.size, failures };
};
near(12);
</script>"""


class Handler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def translate_path(self, path):
        first, _, rest = path.split("?")[0].lstrip("/").partition("/")
        return os.path.join({"cesium": cesium, "tiles": tiles}.get(first, "/nowhere"), rest)

    def do_GET(self):
        if self.path != "/":
            return super().do_GET()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(PAGE.encode())


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=tiles))
threading.Thread(target=server.serve_forever, daemon=True).start()
browser = Browser(width=480, height=320) if splats else Browser(width=800, height=520)
try:
    browser.open(f"http://127.0.0.1:{server.server_port}/")
    browser.wait("globalThis.loaded", 240)
    far = browser.run("state()")
    browser.run("near(0.7)")
    browser.wait("loaded", 900 if splats else 240)
    close = browser.run("state()")
    browser.screenshot(picture)
finally:
    browser.close()
    server.shutdown()
origin = json.load(open(frame))["origin"]
what = "splats" if splats else "triangles"
print(f"CesiumJS shows {far['selected']} tiles of {far[what]} {what} from afar, {close['selected']} of {close[what]} "
      f"near; {100 * close['lit']:.0f} % of the view, {close['colours']} colours")
assert not far["failures"] and not close["failures"] and not browser.errors, (close["failures"], browser.errors)
assert abs(far["latitude"] - origin["latitude_deg"]) < 0.002 and abs(far["longitude"] - origin["longitude_deg"]) < 0.002
assert abs(far["height"] - origin["height_m"]) < 100, (far, origin)
assert 0 < far[what] < close[what]
assert far["lit"] > 0.002 and close["lit"] > 0.2 and close["colours"] > 30, (far, close)
