"""The far end of a serial line: a pseudo-terminal that a test writes to as a device would."""

import os
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread

import pytest

from cnnum.drivers import serial_array
from cnnum.drivers.serial_port import SerialPort
from cnnum.drivers.serve import serve, write_all
from cnnum.frame import Frame

WAIT = 20.0  # s that a thread may take before a test gives up; none comes near it


class Device:
    """The far end of a pseudo-terminal, which an array's firmware would write to."""

    def __init__(self, link: Path, opened: Event) -> None:
        opened.clear()
        self._opened = opened
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self._link, self._name = link, os.ttyname(self._slave)
        link.unlink(missing_ok=True)
        link.symlink_to(self._name)
        self._threads: list[Thread] = []
        self._plugged = True

    def write(self, data: bytes) -> None:
        """Write from a thread, once the port is open: opening drops earlier bytes."""
        self._start(lambda: write_all(self.master, data))

    def serve(self, sent: list[Frame], rate: float) -> None:
        self._start(lambda: serve(sent, self.master, rate))

    def _start(self, work: Callable[[], object]) -> None:
        def when_open() -> None:
            if self._opened.wait(WAIT):
                work()

        self._threads.append(Thread(target=when_open))
        self._threads[-1].start()

    def written(self) -> None:
        for thread in self._threads:
            thread.join(WAIT)
            assert not thread.is_alive()

    def unplug(self) -> None:
        self.written()
        if self._plugged:
            self._plugged = False
            # first the link: another test may get the number of a terminal that is closed
            if self._link.is_symlink() and self._link.readlink() == Path(self._name):
                self._link.unlink()
            os.close(self._slave)
            os.close(self.master)


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "ttyTAXEL"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Event:
    """Set whenever a port has been opened."""
    event = Event()

    class Watched(SerialPort):
        def __init__(self, path: str, baud: int) -> None:
            super().__init__(path, baud)
            event.set()

    monkeypatch.setattr(serial_array, "SerialPort", Watched)
    return event


@pytest.fixture
def plug(link: Path, opened: Event) -> Callable[[], Device]:
    """Plugs a new device in at the same port."""
    return lambda: Device(link, opened)


@pytest.fixture
def device(link: Path, opened: Event) -> Iterator[Device]:
    device = Device(link, opened)
    yield device
    opened.set()
    device.unplug()
