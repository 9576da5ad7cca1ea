"""A headless Chromium, driven by its DevTools protocol over a pipe. Python's own library only."""
import base64
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time


def find_chromium():
    """Its path, or None where it is not installed."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if shutil.which(name):
            return shutil.which(name)
    return None


class Browser:
    """One page of one browser. `errors` collects what the page throws or logs as an error."""

    def __init__(self, width=1200, height=760, dark=False, touch=False):
        self.profile = tempfile.mkdtemp(prefix="conurb-chromium-")
        to_browser, from_browser = os.pipe(), os.pipe()
        for fd in (to_browser[0], from_browser[1]):
            os.set_inheritable(fd, True)
        flags = [find_chromium(), "--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--disable-gpu-sandbox",
                 "--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader", "--no-first-run",
                 "--disable-dev-shm-usage", "--disable-background-networking", "--disable-component-update",
                 f"--user-data-dir={self.profile}", f"--window-size={width},{height}", "about:blank"]

        def place_pipes():
            # The browser reads 3 and writes 4.
            one, two = os.dup(to_browser[0]), os.dup(from_browser[1])
            os.dup2(one, 3)
            os.dup2(two, 4)

        self.process = subprocess.Popen(flags, preexec_fn=place_pipes, pass_fds=(3, 4, to_browser[0], from_browser[1]),
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        os.close(to_browser[0])
        os.close(from_browser[1])
        self.out, self.inside, self.rest = to_browser[1], from_browser[0], b""
        self.number, self.session, self.errors, self.requests = 0, None, [], []
        target = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch)
        if touch:
            self.call("Emulation.setTouchEmulationEnabled", enabled=True)
        self.call("Emulation.setEmulatedMedia",
                  features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])

    def read(self):
        while b"\0" not in self.rest:
            piece = os.read(self.inside, 1 << 20)
            if not piece:
                raise RuntimeError("the browser ended")
            self.rest += piece
        text, self.rest = self.rest.split(b"\0", 1)
        return json.loads(text)

    def note(self, message):
        method, params = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(params["exceptionDetails"])[:600])
        if method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        if method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])

    def call(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.read()
            if answer.get("id") != self.number:
                self.note(answer)
                continue
            if "error" in answer:
                raise RuntimeError(f"{method}: {answer['error']}")
            return answer["result"]

    def open(self, url):
        self.call("Page.navigate", url=url)

    def run(self, script):
        """The value of a JavaScript expression; a promise is waited for."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{script}: {json.dumps(answer['exceptionDetails'])[:600]}")
        return answer["result"].get("value")

    def wait(self, script, seconds=30):
        """Until the expression is true; returns the seconds that it took."""
        begin = time.monotonic()
        while not self.run(f"!!({script})"):
            if time.monotonic() - begin > seconds:
                raise RuntimeError(f"waited {seconds} s in vain for: {script}; errors: {self.errors}")
            time.sleep(0.02)
        return time.monotonic() - begin

    def middle(self, selector):
        box = self.run(f"(() => {{ const e = document.querySelector({json.dumps(selector)}); "
                       "e.scrollIntoView?.({block: 'nearest'}); const b = e.getBoundingClientRect(); "
                       "return [b.x + b.width / 2, b.y + b.height / 2];"
                       "})()")
        return box

    def mouse(self, kind, x, y, button="left", buttons=1, modifiers=0):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=1,
                  modifiers=modifiers)

    def click(self, where):
        x, y = self.middle(where) if isinstance(where, str) else where
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y, buttons=0)

    def drag(self, begin, end, steps=10, pause=0.02, button="left"):
        self.mouse("mousePressed", *begin, button=button)
        for i in range(1, steps + 1):
            self.mouse("mouseMoved", *(b + (e - b) * i / steps for b, e in zip(begin, end)), button=button)
            time.sleep(pause)
        self.mouse("mouseReleased", *end, button=button, buttons=0)

    def key(self, key, code=None, seconds=0.05):
        named = {"key": key, "code": code or f"Key{key.upper()}"}
        self.call("Input.dispatchKeyEvent", type="rawKeyDown", **named)
        time.sleep(seconds)
        self.call("Input.dispatchKeyEvent", type="keyUp", **named)

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        try:
            os.killpg(self.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self.process.wait()
        os.close(self.out)
        os.close(self.inside)
        shutil.rmtree(self.profile, ignore_errors=True)
