"""A real Chromium without a window, driven by its own driver, that reaches no network."""

import base64
import os
import re
import shutil
from contextlib import contextmanager
from tempfile import TemporaryDirectory

import pytest

TOOLS = {"chromium": "chromium", "chromedriver": "chromium-driver"}
"""Programs that drive a browser, and Debian's packages that have them."""
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
)
HEIGHT = 900
"""Height of the window, pixels."""
PAPER, MARGIN = 210, 12
"""Width of a printed page, and its margins, mm."""


def need_browser():
    """Skip where there is no browser; the continuous integration must have one."""
    missing = {name: package for name, package in TOOLS.items() if shutil.which(name) is None}
    if not missing:
        return
    packages = " ".join(missing.values())
    why = f"no {', '.join(missing)} (Debian: apt-get install {packages})"
    if os.environ.get("CI"):
        pytest.fail(f"{why}; the tests in a browser must not be skipped here")
    pytest.skip(why)


@contextmanager
def browser(folder, width, dark=False, scripts=True):
    """Start a browser with a window of a width in pixels; it saves downloads into a folder."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for option in OPTIONS:
        options.add_argument(option)
    # Chromium leaves folders of its own in that for temporary files.
    with TemporaryDirectory() as scratch:
        environment = os.environ | {"TMPDIR": scratch}
        service = webdriver.ChromeService(shutil.which("chromedriver"), env=environment)
        driver = webdriver.Chrome(options=options, service=service)
        try:
            _set_up(driver, folder, width, dark, scripts)
            yield driver
        finally:
            driver.quit()


def _set_up(driver, folder, width, dark, scripts):
    size = {"width": width, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    saved = {"behavior": "allow", "downloadPath": str(folder)}
    for command, what in {
        "Emulation.setDeviceMetricsOverride": size,
        "Emulation.setEmulatedMedia": {"features": [scheme]},
        "Browser.setDownloadBehavior": saved,
        "Emulation.setScriptExecutionDisabled": {"value": not scripts},
    }.items():
        driver.execute_cdp_cmd(command, what)


def on_paper(driver):
    """Lay a page out as it is printed on A4, in a window as wide as the paper between margins."""
    width = driver.execute_script("return Math.floor(arguments[0] * 96 / 25.4)", PAPER - 2 * MARGIN)
    size = {"width": width, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    driver.execute_script("dispatchEvent(new Event('beforeprint'))")


def printed(driver):
    """Return where links and headings of a page lead in its PDF file.

    They are the numbers of rows of strings, and heights of headings over the margin in points.
    """
    options = {"preferCSSPageSize": True, "printBackground": True}
    options |= {"generateTaggedPDF": True, "generateDocumentOutline": True}
    pdf = base64.b64decode(driver.execute_cdp_cmd("Page.printToPDF", options)["data"])
    rows = [int(number) for number in re.findall(rb"/string-(\d+) \[\d+ 0 R", pdf)]
    heading = rb"/Title \((.*?)\)\s*/Dest \[\d+ 0 R /XYZ [\d.]+ ([\d.]+)"
    heights = {
        name.decode(): float(height) - MARGIN * 72 / 25.4
        for name, height in re.findall(heading, pdf)
    }
    return rows, heights


def console(driver):
    """Return what the page has written to the browser's console."""
    return [entry["message"] for entry in driver.get_log("browser")]
