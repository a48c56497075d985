"""Headless Chromium over its DevTools protocol: a page, its scripts, and pictures of it."""

import base64
import json
import shutil
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

WAIT = 30.0  # s; a busy machine takes a few

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)


class Browser:
    """A page in a browser of its own."""

    def __init__(self, folder: Path) -> None:
        self._process = subprocess.Popen(
            [
                CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                "--remote-debugging-port=0", f"--user-data-dir={folder}", "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._held = ExitStack()
        self._number = 0
        self._socket = self._connect(folder)

    def _connect(self, folder: Path) -> Any:
        from urllib.request import urlopen

        from websockets.sync.client import connect

        marker, deadline = folder / "DevToolsActivePort", time.monotonic() + WAIT
        while not marker.exists() or not marker.read_text().strip():
            assert time.monotonic() < deadline, "the browser did not start"
            time.sleep(0.05)
        port = marker.read_text().split()[0]
        with urlopen(f"http://127.0.0.1:{port}/json") as answer:
            (page, *_) = [one for one in json.load(answer) if one["type"] == "page"]
        address = page["webSocketDebuggerUrl"]
        return self._held.enter_context(connect(address, max_size=1 << 26, proxy=None))

    def call(self, method: str, **params: Any) -> Any:
        """Call a method of the protocol and return its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=WAIT))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def open(self, address: str) -> None:
        self.call("Page.enable")
        self.call("Page.navigate", url=address)
        self.until("typeof view === 'object' && document.readyState === 'complete'")

    def value(self, script: str) -> Any:
        """Return the value of an expression in the page."""
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True,
                           awaitPromise=True)  # fmt: skip
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def until(self, script: str) -> Any:
        """Wait for an expression in the page to be true, and return it."""
        deadline = time.monotonic() + WAIT
        while not (found := self.value(script)):
            assert time.monotonic() < deadline, f"never true: {script}"
            time.sleep(0.05)
        return found

    def size(self, width: int, height: int = 900, *, dark: bool = False) -> None:
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=width < 600)  # fmt: skip
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[theme])

    def picture(self, path: Path) -> bytes:
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=True)
        data = base64.b64decode(shot["data"])
        path.write_bytes(data)
        return data

    def close(self) -> None:
        self._held.close()
        self._process.terminate()
        self._process.wait(WAIT)
