"""What tests do on the page, and what they see of its picture."""
import json
import time

REST = "globalThis.conurb && conurb.shown && conurb.shown.last && !conurb.shown.moving"


def rest(browser, seconds=300):
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


def pixels(browser, width=106, height=95):
    """The canvas, made smaller: its width and height, and red, green, blue and alpha of each pixel."""
    browser.run("new Promise((yes) => requestAnimationFrame(() => requestAnimationFrame(yes)))")
    return width, height, browser.run(f"""(() => {{ const c = document.createElement('canvas'); c.width = {width};
        c.height = {height}; const x = c.getContext('2d'); x.imageSmoothingQuality = 'high';
        x.drawImage(document.getElementById('view'), 0, 0, {width}, {height});
        return [...x.getImageData(0, 0, {width}, {height}).data]; }})()""")


def pose(browser):
    return browser.run("conurb.camera.state()")


# Texts whose contrast with what is behind them is below 4.5 (WCAG 2.2, AA), each with its ratio. Over the picture both
# a black and a white one are assumed.
FAINT = """(() => {
    const parse = (text) => { const n = text.match(/[\\d.]+/g).map(Number), k = text.startsWith('rgb') ? 1 : 255;
      return [n[0] * k, n[1] * k, n[2] * k, n[3] ?? 1]; };
    const light = (c) => c.slice(0, 3).map((v) => v / 255)
      .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
      .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const over = (a, b) => [0, 1, 2].map((i) => a[i] * a[3] + b[i] * (1 - a[3]));
    const behind = (e) => { const layers = [];
      for (; e && e.id !== 'scene'; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor);
        if (c[3] > 0) layers.push(c); if (c[3] === 1) break; }
      return [[0, 0, 0], [255, 255, 255]].map((base) => layers.reduceRight((b, a) => over(a, b), base)); };
    // The compass has a label; its N is white on the needle's red, 5 to 1.
    return [...document.querySelectorAll('body *')].filter((e) => !e.disabled && !/option|title/i.test(e.tagName) &&
      !e.closest('#compass') &&
      [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()) && e.getClientRects().length)
      .map((e) => { const style = getComputedStyle(e), c = parse(e instanceof SVGElement ? style.fill : style.color);
        const ratio = Math.min(...behind(e).map((b) => {
          const [x, y] = [light(over(c, b)), light(b)]; return (Math.max(x, y) + 0.05) / (Math.min(x, y) + 0.05); }));
        return [e.textContent.trim().slice(0, 30), +ratio.toFixed(2)]; })
      .filter(([, ratio]) => ratio < 4.5); })()"""


def faint(browser):
    """FAINT, with each panel open."""
    found = []
    for tab in ("look", "light", "photos", "map", "path", "training"):
        browser.run(f"document.getElementById('tab-{tab}').click()")
        time.sleep(0.2)
        found += browser.run(FAINT)
    return found


def choose(browser, label, value):
    """Sets the control with that label, as a user would."""
    browser.run(f"""(() => {{ const label = [...document.querySelectorAll('label')].find((l) => l.textContent.trim() ===
        {json.dumps(label)}); const e = document.getElementById(label.htmlFor); e.value = {json.dumps(value)};
        e.dispatchEvent(new Event('input')); e.dispatchEvent(new Event('change')); }})()""")
