"""Opens a page of `conurb export --page --live` from disk in a headless Chromium: frames a second beside those of an
empty scene, and a picture at each end of the slider of lights.
page.py FOLDER PICTURE      PICTURE-0.png and PICTURE-1.png are written"""
import os
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "view"))
from browser import Browser

folder, picture = os.path.abspath(sys.argv[1]), sys.argv[2]
browser = Browser(720, 480, dark=True)
try:
    browser.open(f"file://{folder}/live.html")
    browser.wait("typeof live !== 'undefined' && live && live.done", 300)
    for end in (0, 1):
        browser.run("(() => { const e = document.getElementById('light'); e.value = %d; "
                    "e.dispatchEvent(new Event('input')); })()" % end)
        browser.wait("live.settled", 300)
        time.sleep(0.5)
        browser.screenshot(f"{picture}-{end}.png")
    browser.run("live.picture.resize(1)")
    full, empty = (min(browser.run(f"live.measure(1, {count})") for _ in range(4)) for count in ("Infinity", 0))
    size = sum(os.path.getsize(f"{folder}/{n}") for n in os.listdir(folder))
    print(f"the page has {size / 1e6:.1f} MB; {browser.run('live.picture.order')} splats: {1 / full:.1f} frames a "
          f"second, {1 / empty:.1f} without any: {full / empty:.1f} times as long")
    assert not browser.errors, browser.errors
finally:
    browser.close()
