"""What the tests of this folder share: checks that go on after a failure, and screenshots."""
import os
import sys

from browser import find_chromium

failed = []


def need_chromium():
    """Ends a test that a machine without Chromium cannot run: skipped, or failed by what came before."""
    if not find_chromium() and not failed:
        print("SKIP: there is no Chromium here; apt-get install chromium")
        sys.exit(77)


def check(good, what):
    if not good:
        failed.append(what)
        print("FAILED:", what, flush=True)


def shoot(browser, name):
    """A screenshot, where the test was given a folder for them as its third argument."""
    folder = sys.argv[3] if len(sys.argv) > 3 else None
    if folder:
        os.makedirs(folder, exist_ok=True)
        browser.screenshot(f"{folder}/{name}.png")


def finish():
    print(f"{len(failed)} failed")
    sys.exit(bool(failed))
