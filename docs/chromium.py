"""A headless Chromium by its DevTools pipe: for tests of the report, and for pictures of it. No library is needed."""

import base64
import itertools
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-extensions", "--mute-audio"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--remote-debugging-pipe"),
)
_PATIENCE_S = 60
"""Longest wait for a condition or an answer [s]: a loaded machine starts a browser in ten."""


def found() -> str | None:
    """Path of a Chromium of this machine."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Tab:
    """The only tab of a browser.

    Attributes
    ----------
    errors : list of str
        Messages of the console that are errors, and exceptions of scripts.
    requests : list of str
        Addresses of everything that was asked for.
    """

    def __init__(self, asks: int, answers: int) -> None:
        self._asks, self._answers, self._rest = asks, answers, b""
        self._numbers, self._session = itertools.count(1), ""
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **facts: Any) -> dict[str, Any]:
        """Ask the browser and wait for its answer."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": facts}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._asks, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                result: dict[str, Any] = answer["result"]
                return result
            self._note(answer)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            more = os.read(self._answers, 1 << 20)
            if not more:
                raise RuntimeError("the browser ended")
            self._rest += more
        line, self._rest = self._rest.split(b"\0", 1)
        message: dict[str, Any] = json.loads(line)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        kind, facts = event.get("method"), event.get("params", {})
        if kind == "Runtime.consoleAPICalled" and facts["type"] in ("error", "assert"):
            self.errors.append(" ".join(str(one.get("value", one.get("description"))) for one in facts["args"]))
        elif kind == "Runtime.exceptionThrown":
            thrown = facts["exceptionDetails"]
            self.errors.append(thrown.get("exception", {}).get("description") or thrown["text"])
        elif kind == "Log.entryAdded" and facts["entry"]["level"] == "error":
            self.errors.append(f"{facts['entry']['text']} {facts['entry'].get('url', '')}")
        elif kind == "Network.requestWillBeSent":
            self.requests.append(facts["request"]["url"])

    def look_as(self, width_px: int, height_px: int, theme: str = "light", *, touch: bool = False) -> None:
        """Set the size of the window and the theme of the system."""
        size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": touch}
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        self.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])

    def open(self, page: Path) -> None:
        """Open a page from disk, and wait until it says that it is ready."""
        self.ask("Page.navigate", url=page.resolve().as_uri())
        self.wait("document.documentElement?.dataset.ready === 'yes'")

    def run(self, script: str) -> Any:
        """Value of an expression on the page, JSON; a promise is waited for."""
        answer = self.ask("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"].get("exception", {}).get("description", script))
        return answer["result"].get("value")

    def wait(self, condition: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + _PATIENCE_S
        while not self.run(f"Boolean({condition})"):
            if time.monotonic() > end:
                raise TimeoutError(f"never true: {condition}; console: {self.errors}")
            time.sleep(0.05)

    def settle(self, expression: str) -> Any:
        """Value of an expression when it has stayed the same for half a second: animations have ended."""
        values: list[Any] = []
        end = time.monotonic() + _PATIENCE_S
        while len(values) < 6 or len({json.dumps(value) for value in values[-6:]}) > 1:
            if time.monotonic() > end:
                raise TimeoutError(f"never still: {expression}")
            values.append(self.run(expression))
            time.sleep(0.1)
        return values[-1]

    def press(self, key: str) -> None:
        """Press a key."""
        text = {"text": key} if len(key) == 1 else {}
        self.ask("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.ask("Input.dispatchKeyEvent", type="keyUp", key=key)

    def move(self, x: float, y: float) -> None:
        """Move the pointer to a place of the window."""
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def picture(self, path: Path) -> Path:
        """Write what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))
        return path


@contextmanager
def browser(program: str) -> Iterator[Tab]:
    """Start a browser with a profile of its own, and end it."""
    to_it, asks = os.pipe()
    answers, from_it = os.pipe()

    def as_three_and_four() -> None:
        for number, end in ((3, os.dup(to_it)), (4, os.dup(from_it))):
            os.dup2(end, number)  # inheritable, also where the end had this number

    with tempfile.TemporaryDirectory(prefix="chromium-") as profile:
        command = [program, *OPTIONS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=as_three_and_four, close_fds=False
        )
        os.close(to_it)
        os.close(from_it)
        try:
            yield Tab(asks, answers)
        finally:
            process.terminate()
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            os.close(asks)
            os.close(answers)
            time.sleep(0.2)  # its children still write their profile
            shutil.rmtree(profile, ignore_errors=True)
            Path(profile).mkdir(exist_ok=True)
