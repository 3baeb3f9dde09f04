"""A headless Chromium to look at pages with, spoken to through its own pipe."""

import base64
import fcntl
import json
import os
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

COMMAND = next(
    (
        found
        for name in ("chromium", "chromium-browser", "chromium-headless-shell", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
"""The browser, or None where there is none."""

DEADLINE_S = 120.0

_LAUNCHER = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
for end, number in zip(ends, (3, 4)):
    os.dup2(end, number)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Puts the two pipes where the browser looks for them, in a child, since this process may have threads."""


class Chromium:
    """One browser with one page.

    Parameters
    ----------
    folder : Path
        For the browser's own files.
    """

    def __init__(self, folder: Path) -> None:
        hear, self._say = _pipe()
        self._hear, speak = _pipe()
        arguments = [
            "--headless=new", "--no-sandbox", "--remote-debugging-pipe", f"--user-data-dir={folder}",
            "--enable-unsafe-swiftshader", "--no-first-run", "--disable-extensions", "--disable-sync",
            "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
            "about:blank",
        ]  # fmt: skip
        self._process = subprocess.Popen(
            [sys.executable, "-SEc", _LAUNCHER, str(hear), str(speak), str(COMMAND), *arguments],
            pass_fds=(hear, speak),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(hear)
        os.close(speak)
        self._buffer, self._n, self.events = b"", 0, []
        target = self._call("Target.getTargets")["targetInfos"][0]["targetId"]
        self._session = ""
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> "Chromium":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()
        os.close(self._say)
        os.close(self._hear)

    # ------------------------------------------------------------------- looking

    def open(self, page: Path, width: int = 1100, *, dark: bool = False, height: int = 900) -> None:
        """Load a file and wait until it is ready."""
        self.visit(page, width, dark=dark, height=height)
        self.wait(
            "document.documentElement?.dataset.ready || document.getElementById('trouble')?.hidden === false"
        )

    def visit(self, page: Path, width: int = 1100, *, dark: bool = False, height: int = 900) -> None:
        """Load a file."""
        self.events = []
        self.resize(width, dark=dark, height=height)
        self._call("Page.navigate", url=page.as_uri())

    def print_media(self, page: Path, *, dark: bool = False) -> None:
        """Load a file as it is laid out for an A4 page."""
        self.open(page, 700, dark=dark)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._call("Emulation.setEmulatedMedia", media="print", features=[scheme])

    def resize(self, width: int, *, dark: bool = False, height: int = 900) -> None:
        """Make the window this wide, and its colours light or dark."""
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._call("Emulation.setEmulatedMedia", media="", features=[scheme])

    def wait(self, expression: str) -> None:
        """Wait until an expression of JavaScript is true."""
        until = time.monotonic() + DEADLINE_S
        while not self.value(f"Boolean({expression})"):
            if time.monotonic() > until:
                raise TimeoutError(f"never true: {expression}; said: {self.complaints()}")
            time.sleep(0.05)

    def value(self, expression: str) -> Any:
        """Value of an expression of JavaScript in the page."""
        answer = self._call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:2000])
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press and let go a key, such as ``Tab``."""
        code = {"Tab": 9, "Enter": 13, " ": 32}[key]
        for kind in ("keyDown", "keyUp"):
            text = {"text": "\r" if key == "Enter" else key} if kind == "keyDown" and key != "Tab" else {}
            self._call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag the mouse from one point of the window to another."""
        steps = [
            (start[0] + (end[0] - start[0]) * k / 5, start[1] + (end[1] - start[1]) * k / 5) for k in range(6)
        ]
        self._mouse("mouseMoved", start, buttons=0)
        self._mouse("mousePressed", start)
        for step in steps:
            self._mouse("mouseMoved", step)
        self._mouse("mouseReleased", end)

    def _mouse(self, kind: str, at: tuple[float, float], buttons: int = 1) -> None:
        button = "left" if buttons else "none"
        self._call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=at[0],
            y=at[1],
            button=button,
            buttons=buttons,
            clickCount=1,
        )

    def picture(self, path: Path, *, whole: bool = True) -> None:
        """Save what the page looks like."""
        answer = self._call(
            "Page.captureScreenshot", captureBeyondViewport=whole, **(self._all() if whole else {})
        )
        path.write_bytes(base64.b64decode(answer["data"]))

    def _all(self) -> dict[str, Any]:
        size = self._call("Page.getLayoutMetrics")["cssContentSize"]
        return {"clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}}

    def n_printed_pages(self) -> int:
        """Pages of A4 that the page is printed on."""
        answer = self._call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)
        return len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(answer["data"])))

    def complaints(self) -> list[str]:
        """Errors that the page has printed or thrown, and refused requests."""
        self.value("0")
        found = []
        for event in self.events:
            what = event["params"]
            if event["method"] == "Runtime.exceptionThrown":
                found.append(json.dumps(what["exceptionDetails"])[:600])
            elif event["method"] == "Log.entryAdded" and what["entry"]["level"] == "error":
                found.append(what["entry"]["text"])
            elif event["method"] == "Runtime.consoleAPICalled" and what["type"] in (
                "error",
                "warning",
                "assert",
            ):
                found.append(json.dumps(what["args"])[:600])
        return found

    def requests(self) -> list[str]:
        """Addresses that were asked for."""
        self.value("0")
        return [
            e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"
        ]

    # ------------------------------------------------------------------ the pipe

    def _call(self, method: str, **params: Any) -> Any:
        self._n += 1
        message = {"id": self._n, "method": method, "params": params}
        if getattr(self, "_session", ""):
            message["sessionId"] = self._session
        os.write(self._say, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._n:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            if "method" in answer:
                self.events.append(answer)

    def _next(self) -> Any:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._hear], [], [], DEADLINE_S)
            if not ready:
                raise TimeoutError("no message from the browser")
            read = os.read(self._hear, 1 << 20)
            if not read:
                raise RuntimeError("the browser has ended")
            self._buffer += read
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)


def _pipe() -> tuple[int, int]:
    """Ends to read from and to write to, out of the way of the numbers that the browser wants."""
    ends = os.pipe()
    moved = tuple(fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 20) for end in ends)
    for end in ends:
        os.close(end)
    return moved[0], moved[1]
