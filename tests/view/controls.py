"""What tests do on the page, and what they see of its picture."""
import json
import time

REST = "globalThis.conurb && conurb.shown && conurb.shown.last && !conurb.shown.moving"


def rest(browser, seconds=120):
    """Waits until the camera rests and its picture is complete."""
    time.sleep(0.3)
    browser.wait(f"{REST} && conurb.shown.id >= conurb.picture.latest", seconds)


# A number of the picture on the canvas that changes with it, and how much of it is not black.
LOOK = """(() => { const c = document.createElement('canvas'); c.width = 64; c.height = 48;
    const x = c.getContext('2d'); x.drawImage(document.getElementById('view'), 0, 0, 64, 48);
    const d = x.getImageData(0, 0, 64, 48).data; let sum = 0, lit = 0;
    for (let i = 0; i < d.length; i += 4) { sum = (sum * 31 + (d[i] >> 3) * 3 + (d[i + 1] >> 3) * 5
      + (d[i + 2] >> 3)) % 1000003;
      lit += d[i] + d[i + 1] + d[i + 2] > 24; } return [sum, lit / (64 * 48)]; })()"""


def look(browser):
    browser.run("new Promise((yes) => requestAnimationFrame(() => requestAnimationFrame(yes)))")
    return browser.run(LOOK)


def pose(browser):
    return browser.run("conurb.camera.state()")


def choose(browser, label, value):
    """Sets the control with that label, as a user would."""
    browser.run(f"""(() => {{ const label = [...document.querySelectorAll('label')].find((l) => l.textContent.trim() ===
        {json.dumps(label)}); const e = document.getElementById(label.htmlFor); e.value = {json.dumps(value)};
        e.dispatchEvent(new Event('input')); e.dispatchEvent(new Event('change')); }})()""")
