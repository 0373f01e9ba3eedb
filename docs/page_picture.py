"""Takes a picture of the page of a run or a sweep, as it looks when it is opened.

    python docs/page_picture.py RUN/report.html docs/figures/page.png

Needs chromium and chromedriver (Debian: chromium, chromium-driver), and selenium and Pillow of the extra `dev`.
"""

# ruff: noqa: INP001 (a script)
from __future__ import annotations

import argparse
import base64
import shutil
from io import BytesIO
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

_COLOURS = 128


def main() -> None:
    """Open the page without a screen, let the player show a step, and write what is seen of it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--step", type=int, default=25, help="of the episode; default: 25")
    parser.add_argument("--width", type=int, default=1000)
    parser.add_argument("--height", type=int, default=928)
    parser.add_argument("--scale", type=int, default=2, help="pixels of the picture for one of the page")
    options = parser.parse_args()
    chrome = Options()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        chrome.add_argument(argument)
    driver = webdriver.Chrome(options=chrome, service=Service(shutil.which("chromedriver")))
    try:
        size = {"width": options.width, "height": options.height, "mobile": False}
        driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride", {**size, "deviceScaleFactor": options.scale}
        )
        driver.get(options.page.resolve().as_uri())
        forward = "const go = document.getElementById('forward'); for (let i = 0; i < arguments[0]; i++) go?.click();"
        driver.execute_script(forward, options.step)
        driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        taken = driver.execute_cdp_cmd("Page.captureScreenshot", {"format": "png"})
    finally:
        driver.quit()
    # A page has few colours, so that a palette halves the file and nobody sees it.
    with Image.open(BytesIO(base64.b64decode(taken["data"]))) as picture:
        picture.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE).save(
            options.picture, optimize=True
        )


if __name__ == "__main__":
    main()
