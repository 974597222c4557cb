"""Interpreter mode of the simulated controller: statements on port 30020, as part of a program that runs."""

from __future__ import annotations

import re
import socket
import time

import pytest

from robot.simulation import SimulatedCell

HOST = "127.0.33.5"
SCALE = 4.0
ANSWER = re.compile(r"(\w+):\W+(\d+)?")  # as the manufacturer's own examples read answers


@pytest.fixture(scope="module")
def cell():
    with SimulatedCell.start("ur10e-demo", host=HOST, version="5.22", time_scale=SCALE) as simulated:
        yield simulated


def send(text, port=30002):
    with socket.create_connection((HOST, port), 2.0) as connection:
        connection.sendall(text.encode())
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4096):
            pass


class Client:
    """A client of the interpreter port."""

    def __init__(self):
        self._connection = socket.create_connection((HOST, 30020), 2.0)
        self._connection.settimeout(10.0)
        self._lines = self._connection.makefile("rw", newline="\n")

    def ask(self, statement):
        self._lines.write(statement + "\n")
        self._lines.flush()
        return self._lines.readline().rstrip("\n")

    def number(self, statement):
        found = ANSWER.match(self.ask(statement))
        assert found is not None
        assert found[1] != "discard"
        return int(found[2])

    def wait_for(self, number):
        deadline = time.monotonic() + 10.0
        while self.number("statelastexecuted") < number or self.number("stateunexecuted"):
            assert time.monotonic() < deadline, "not executed in time"
            time.sleep(0.005)

    def close(self):
        self._lines.close()
        self._connection.close()


class Out:
    """What statements tell on a socket."""

    def __init__(self):
        self._listening = socket.create_server((HOST, 0))
        self._listening.settimeout(10.0)
        self.port = self._listening.getsockname()[1]

    def accept(self):
        connection, _ = self._listening.accept()
        connection.settimeout(10.0)
        self.lines = connection.makefile("r")
        self._listening.close()
        return self

    def next(self):
        return self.lines.readline().rstrip("\n")


@pytest.fixture
def client(cell):
    """A client whose program is in interpreter mode; in `client.out` what it tells."""
    out = Out()
    send(
        f'def program():\n  socket_open("{HOST}", {out.port})\n  global count = 5\n  kept = [1, 2]\n'
        "  def double(x):\n    return 2 * x\n  end\n"
        "  def tell(x):\n    socket_send_line(to_str(x))\n  end\n"
        '  tell("begin")\n  interpreter_mode()\n  tell("after")\n  tell(count)\n  interpreter_mode(clearOnEnd=False)\n'
        '  tell("end")\nend\n'
    )
    assert out.accept().next() == "begin"
    found = Client()
    found.out = out
    yield found
    found.close()
    send("def nothing():\n  sync()\nend\n")


def test_statements_run_in_order_and_see_the_program(client):
    assert client.ask("count = count + 1") == "ack: 1: count = count + 1"
    assert client.ask("tell(double(count))") == "ack: 2: tell(double(count))"
    assert client.out.next() == "12"
    assert client.number("def triple(x): y = 3 return y * x end") == 3
    assert client.number("a = triple(2) b = [a, count] tell(b)") == 4
    assert client.out.next() == "[6, 6]"
    assert client.number("kept[0] = 9 tell(kept)") == 5
    assert client.out.next() == "[9, 2]"
    client.wait_for(5)
    assert client.ask("statelastinterpreted") == "state: 5: statelastinterpreted"
    assert client.ask("statelastexecuted") == "state: 5: statelastexecuted"
    assert client.ask("statelastcleared") == "state: 0: statelastcleared"
    assert client.ask("stateunexecuted") == "state: 0: stateunexecuted"


@pytest.mark.parametrize(
    ("statement", "why"),
    [
        ("tell(", "expected a value, not the end of the program, line 1, column 6"),
        ("tell(nobody)", "there is no variable 'nobody', line 1, column 6"),
        (
            "fly()",
            "there is no function 'fly' here (docs/simulator.md says which there are), line 1, column 1",
        ),
        ("end", "expected a value, not 'end', line 1, column 1"),
    ],
)
def test_what_is_no_statement_is_discarded_and_the_program_goes_on(client, statement, why):
    assert client.ask(statement) == f"discard: {why}: {statement}"
    client.ask("tell(1)")
    assert client.out.next() == "1"


def test_a_thread_of_a_statement_runs_on(client):
    client.ask("thread t(): while True: count = count + 1 sync() end end")
    client.ask("h = run t()")
    client.ask("sleep(0.5)")
    client.ask("kill h tell(count > 20)")
    assert client.out.next() == "True"


def test_the_mode_ends_and_the_program_goes_on_with_what_was_changed(client):
    client.number("global more = 7")
    client.number("count = 40 mine = 2")
    client.number("end_interpreter()")
    assert [client.out.next(), client.out.next()] == ["after", "40"]
    assert client.number("statelastcleared") == 3
    assert client.ask("tell(mine)").startswith("discard: there is no variable 'mine'")
    client.number("tell(more)")
    assert client.out.next() == "7"
    client.number("end_interpreter()")
    assert client.out.next() == "end"
    time.sleep(0.1)
    assert client.ask("tell(1)") == "discard: no program is running that takes statements: tell(1)"


def test_what_is_cleared_is_gone(client):
    client.number("x = 1")
    client.number("def f(): return 3 end")
    assert client.number("clear_interpreter()") == 3
    assert client.ask("f()").startswith("discard: there is no function 'f'")  # the clearing is waited for
    assert client.ask("tell(x)").startswith("discard: there is no variable 'x'")
    assert client.number("statelastcleared") == 3
    client.number("x = 2 tell(x + double(1))")
    assert client.out.next() == "4"


def test_a_buffer_is_skipped_but_what_runs_goes_on(client):
    first = client.number("sleep(1) tell(1)")
    client.wait_for(first)
    client.ask("skipped = 1 def lost(): return 2 end")
    for i in range(5):
        client.number(f"tell({i + 10})")
    assert client.number("stateunexecuted") == 6
    assert client.ask("skipbuffer").startswith("ack: ")
    assert client.ask("tell(skipped)").startswith("discard: there is no variable 'skipped'")
    assert client.ask("lost()").startswith("discard: there is no function 'lost'")
    assert client.number("stateunexecuted") == 0
    last = client.number("tell(2)")
    assert [client.out.next(), client.out.next()] == ["1", "2"]
    assert last == first + 7


def test_a_move_is_aborted(client):
    client.number("movej([0, -1.57, -1.57, -1.57, 1.57, 0], a=20, v=3)")
    client.number("before = time(0)")
    client.number("movej([2, -1.57, -1.57, -1.57, 1.57, 0], a=1, v=0.1)")  # 20 s
    client.number("now = time(0) tell(now.sec - before.sec < 10)")
    client.number("q = get_actual_joint_positions() tell(q[0] > 0.001 and q[0] < 1.9)")
    deadline = time.monotonic() + 10.0
    while client.number("stateunexecuted") > 2:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.3)
    client.ask("abort")
    assert [client.out.next(), client.out.next()] == ["True", "True"]


def test_a_statement_that_fails_ends_the_program(client):
    client.number("x = [1][4]")
    assert client.out.next() == ""  # the socket is closed
    assert client.ask("tell(1)").startswith("discard: no program")


def test_statements_that_come_before_the_mode_are_kept_if_the_program_says_so(cell):
    for flag, told in (("False", ["early", "late"]), ("True", ["late"])):
        out = Out()
        send(
            f'def program():\n  socket_open("{HOST}", {out.port})\n  socket_read_line(timeout=0)\n'
            f"  interpreter_mode(clearQueueOnEnter={flag})\nend\n"
        )
        connection, _ = out._listening.accept()
        with connection, connection.makefile("rw") as lines:
            client = Client()
            client.number('socket_send_line("early")')
            lines.write("go\n")
            lines.flush()
            time.sleep(0.1)
            client.number('socket_send_line("late")')
            assert [lines.readline().strip() for _ in told] == told
            client.close()
        out._listening.close()
    send("def nothing():\n  sync()\nend\n")


def test_interpreter_mode_is_for_the_program_itself(cell):
    out = Out()
    send(
        f'def program():\n  socket_open("{HOST}", {out.port})\n  thread t():\n    interpreter_mode()\n  end\n'
        '  run t()\n  sleep(0.5)\n  socket_send_line("never")\nend\n'
    )
    assert out.accept().next() == ""
