"""A headless Chromium that opens a page from its file; what needs it is skipped where there is none."""

import shutil
import time
from contextlib import contextmanager

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_PATIENCE_S = 120.0  # a page that never gets there fails; a busy machine does not


def require_browser():
    """Skip without Chromium or playwright; else playwright's module and Chromium's path. Ask before a page is built."""
    api = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install casadi_contact[test]")
    executable = next((found for name in _NAMES if (found := shutil.which(name))), None)
    if executable is None:
        pytest.skip("no Chromium on the path")
    return api, executable


@contextmanager
def opened(path, *flags):
    """A tab with the page at `path` and what it complained of, in a browser with more flags."""
    api, executable = require_browser()
    with api.sync_playwright() as playwright:
        # As it draws by itself without a graphics card: WebGL by SwiftShader, all else by the processor.
        arguments = ["--no-sandbox", "--enable-unsafe-swiftshader", *flags]
        browser = playwright.chromium.launch(executable_path=executable, args=arguments)
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        tab.set_default_timeout(1000.0 * _PATIENCE_S)
        complaints, asked = [], []
        tab.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(path.as_uri())
        yield tab, complaints, asked
        browser.close()


def until(tab, condition):
    """Wait until an expression is true in the page: by asking, for the page's policy forbids code made of text."""
    end = time.monotonic() + _PATIENCE_S
    while not tab.evaluate(condition):
        assert time.monotonic() < end, f"{condition} did not come true"
        tab.wait_for_timeout(20)
