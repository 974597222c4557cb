"""Whatever is sent to the simulated controller, it goes on, in bounded memory, and its other clients notice nothing."""

import contextlib
import random
import socket
import struct
import threading
import time
from pathlib import Path

import pytest

from robot import rtde
from robot.simulation import SimulatedCell

HOST = "127.0.0.48"
RTDE, DASHBOARD, SCRIPTS, INTERPRETER = 30004, 29999, 30002, 30020
MEGABYTE = 1 << 20

PROGRAM = """def p():
  global x = [1, 2.5, "text", True]
  thread t():
    while x[0] < 5:
      x[0] = x[0] + 1
      sync()
    end
  end
  h = run t()
  switch x[0]:
    case 1:
      movel(p[0.6, -0.1, 0.4, 2.2, -2.2, 0], a=1.2, v=0.1, r=0.01)
    default:
      speedl([0.01, 0, 0, 0, 0, 0], 0.5, 0.01)
  end
  write_output_float_register(3, norm([1, 2, 3]) / x[1])
  stopl(2)
  join h
end
"""
LINES = [
    "robotmode", "running", "PolyscopeVersion", "get serial number", "programState", "safetystatus", "load a.urp",
    "play", "stop", "pause", "unlock protective stop", "power on", "brake release", "popup hello", "close popup",
    "is in remote control", "get loaded program", "isProgramSaved", "addToLog x", "setUserRole none", "nonsense",
]  # fmt: skip


@pytest.fixture(scope="module")
def simulated():
    with SimulatedCell.start("ur10e-demo", host=HOST, start_delay=0.0) as cell:
        yield cell


class Listener:
    """A client that behaves: it is sent the controller's time, and notes each."""

    def __init__(self) -> None:
        self.socket = socket.create_connection((HOST, RTDE), 2.0)
        self.stream = rtde.PackageStream()
        self.times = []
        for asked in (rtde.ask_protocol(), rtde.ask_outputs(["timestamp"], 125.0), rtde.ask_start()):
            self.socket.sendall(asked)
            while not self.stream.feed(self.socket.recv(4096)):
                pass
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ended.is_set():
            received = self.socket.recv(4096)
            if not received:
                return
            for kind, payload in self.stream.feed(received):
                assert kind == rtde.Package.VALUES
                self.times.append(struct.unpack_from(">d", payload, 1)[0])

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.socket.close()


def memory(simulated) -> int:
    """Resident bytes of the controller."""
    status = Path(f"/proc/{simulated.process_ids['controller']}/status").read_text()
    return 1024 * int(status.split("VmRSS:")[1].split()[0])


def of_rtde(rng) -> bytes:
    """A package, or something like one."""
    names = rng.choice(
        ["timestamp", "target_q,,x", "", ",", "input_int_register_0", "a" * 3000, "speed_slider_mask"]
    )
    number = rng.choice([0.0, -1.0, 1e-300, 1e300, float("nan"), float("inf"), 125.0])
    payload = rng.choice(
        [
            b"",
            rng.randbytes(rng.randrange(200)),
            struct.pack(">d", number) + names.encode(),
            names.encode(),
            bytes([rng.randrange(256)]) + struct.pack(">d", number) * rng.randrange(20),
            struct.pack(">H", rng.randrange(1 << 16)),
        ]
    )
    kind = rng.choice([*b"VvOISPUM", rng.randrange(256)])
    size = rng.choice([3 + len(payload)] * 6 + [0, 1, 2, 3, 65535, rng.randrange(1 << 16)])
    made = struct.pack(">HB", size, kind) + payload
    return made if rng.random() < 0.8 else made[: rng.randrange(len(made) + 1)]


def of_dashboard(rng) -> bytes:
    """A line, or something like one."""
    line = rng.choice(LINES).encode()
    made = rng.choice(
        [line, line.upper(), b" " + line, line + rng.randbytes(20), rng.randbytes(60), b"\0" * 50, line * 400]
    )
    return made + rng.choice([b"\n", b"\r\n", b"", b"\n\n\n"])


def of_script(rng) -> bytes:
    """A program with something wrong: words swapped, doubled, left out or replaced, lines cut, bytes."""
    words = PROGRAM.split(" ")
    for _ in range(rng.randrange(1, 5)):
        i, j = rng.randrange(len(words)), rng.randrange(len(words))
        change = rng.randrange(5)
        if change == 0:
            words[i], words[j] = words[j], words[i]
        elif change == 1:
            words[i] = words[j]
        elif change == 2:
            words[i] = rng.choice(
                ["end", "(", ")", "[", '"', "def", "1e999", "-", "halt", "while True:", "\0"]
            )
        elif change == 3:
            words[i] = ""
        else:
            words[i] += words[j]
    made = " ".join(words).encode()
    cut = rng.random()
    if cut < 0.1:
        made = made[: rng.randrange(len(made))]
    elif cut < 0.2:
        at = rng.randrange(len(made))
        made = made[:at] + rng.randbytes(4) + made[at:]
    elif cut < 0.3:
        made = b"\n".join(rng.sample(made.split(b"\n"), 5)) + b"\n"
    return made


def of_interpreter(rng) -> bytes:
    """A line of a program, or something like one."""
    return rng.choice(
        [of_script(rng).split(b"\n")[0] + b"\n", b"abort\n", b"clear_interpreter()\n", rng.randbytes(80)]
    )


KINDS = {RTDE: of_rtde, DASHBOARD: of_dashboard, SCRIPTS: of_script, INTERPRETER: of_interpreter}


def send(rng, port, count) -> None:
    """Inputs on one connection, or on the next if the controller ends it; its answers are read now and then.

    Most connections are closed only when all of it was taken; the others at once.
    """
    left = count
    while left > 0:
        with socket.create_connection((HOST, port), 5.0) as connection, contextlib.suppress(OSError):
            for _ in range(rng.randrange(1, 6)):
                connection.setblocking(True)
                connection.settimeout(5.0)
                left -= 1
                connection.sendall(KINDS[port](rng))
                connection.setblocking(False)
                with contextlib.suppress(BlockingIOError):
                    connection.recv(65536)
            if rng.random() < 0.8:
                connection.settimeout(5.0)
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(65536):
                    pass


def attack(simulated, count, seed) -> None:
    rng = random.Random(seed)
    send(rng, RTDE, 50)  # what is loaded at first use is loaded
    before = memory(simulated)
    listener = Listener()
    try:
        done = 0
        while done < count:
            for port, part in ((RTDE, 50), (DASHBOARD, 30), (SCRIPTS, 15), (INTERPRETER, 5)):
                send(rng, port, part)
                done += part
        time.sleep(0.2)
    finally:
        alive = listener.alive
        listener.close()
    simulated.check()
    assert alive, "a client that did nothing wrong was dropped"
    assert memory(simulated) - before < 40 * MEGABYTE
    gaps = [b - a for a, b in zip(listener.times, listener.times[1:], strict=False)]
    assert min(gaps) > 0.0
    missed = sum(round(gap / 0.008) - 1 for gap in gaps)
    assert missed < 10 + 0.05 * len(gaps), "packages that a client should have had"


def test_malformed_inputs_harm_nobody(simulated):
    attack(simulated, 2000, seed=6)


@pytest.mark.soak
def test_many_malformed_inputs_harm_nobody(simulated):
    attack(simulated, 100_000, seed=7)
