"""A real browser without a screen, for the tests of pages; where there is none, they are skipped and say so."""

import shutil
from pathlib import Path

import pytest

MISSING = "pages are not opened: no chromium and chromedriver here (Debian: apt-get install chromium chromium-driver)"


def chromium():
    """Return a headless Chromium that keeps what its console says; skip where there is none."""
    selenium = pytest.importorskip("selenium.webdriver")
    binary, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
    if binary is None or driver is None:
        pytest.skip(MISSING)
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = binary
    for argument in (
        "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--window-size=1280,900",
    ):  # fmt: skip
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return selenium.Chrome(options=options, service=Service(driver))


def opened(browser, path, *, width=1280, colours="light"):
    """Open a page, in a window of this width; the console is emptied."""
    browser.get_log("browser")
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    features = [
        {"name": "prefers-color-scheme", "value": colours}, {"name": "prefers-reduced-motion", "value": "reduce"},
    ]  # fmt: skip
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": features})
    browser.get(Path(path).resolve().as_uri())
    return browser


# The ratio of contrast of WCAG 2.2 between each text and what lies behind it, as [ratio, text, what it is].
CONTRASTS = """
const parsed = (colour) => (colour.match(/[\\d.]+/g) || []).map(Number);
const luminance = ([r, g, b]) => [r, g, b]
  .map((c) => c / 255).map((c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
  .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
const behind = (node) => {
  if (node.closest && node.closest(".node.coloured")) {
    return parsed(getComputedStyle(node.closest(".node").querySelector("rect")).fill);
  }
  for (let at = node; at; at = at.parentElement) {
    const colour = parsed(getComputedStyle(at).backgroundColor);
    if (colour.length === 3 || colour[3] > 0) return colour;
  }
  return [255, 255, 255];
};
const found = [];
const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (texts.nextNode()) {
  const node = texts.currentNode.parentElement, text = texts.currentNode.textContent.trim();
  if (!text || ["SCRIPT", "NOSCRIPT", "STYLE", "OPTION", "title"].includes(node.tagName)) continue;
  if (!node.getClientRects().length) continue;
  const style = getComputedStyle(node);
  const ink = parsed(node.namespaceURI.endsWith("svg") ? style.fill : style.color);
  const lights = [luminance(ink), luminance(behind(node))].sort((a, b) => b - a);
  const what = node.tagName + "." + (node.getAttribute("class") || "");
  found.push([(lights[0] + 0.05) / (lights[1] + 0.05), text.slice(0, 40), what]);
}
return found;
"""
