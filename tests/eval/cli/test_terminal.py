"""No character that data holds commands a terminal: in results, errors, bars, tables and notes."""

import io
import json
import logging
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError, visible
from eventsweep.eval.cli.console import Console, Terminal, dim, table
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.cli.streams import standard_streams
from eventsweep.eval.progress import Bars

EVIL = "a\x1b[2J\x1b]0;pwn\x07\x9b2J\u202e\u2066[red][/none]\r\b\udcff"
BAD = "\x1b\x07\x9b\u202e\u2066\r\b\udcff"
SHOWN = r"a\u001b[2J\u001b]"  # `rich` leaves bells and the like out


class Stream(io.StringIO):
    """A terminal, or what a terminal's program is piped into."""

    def __init__(self, *, terminal):
        super().__init__()
        self.isatty = lambda: terminal


@pytest.fixture(params=[True, False], autouse=True)
def terminal(request, monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    return request.param


def said(terminal, say, **settings):
    """What a command writes, and its exit code."""
    out, err = Stream(terminal=terminal), Stream(terminal=terminal)
    with redirect_stdout(out), redirect_stderr(err):
        with standard_streams(), exit_code() as code:
            say(Console(**{"quiet": False, "as_json": False} | settings))
        assert (sys.stdout, sys.stderr) == (out, err)
    return out.getvalue(), err.getvalue(), code.value


def results(console):
    console.result({"name": EVIL}, [f"{EVIL}: 3 events", dim(EVIL), table(EVIL, [EVIL], [[EVIL]])])


def noted(console):
    console.warn(EVIL)
    console.progress.say(EVIL)


def barred(console):
    with console.progress.stage(EVIL, 1) as update:
        update(1, EVIL)


def logged(_console):
    logging.lastResort.emit(logging.makeLogRecord({"msg": EVIL}))


def refusing(_console):
    raise InputError(f"the name is {EVIL}")


@pytest.mark.parametrize("say", [results, noted, barred, logged, refusing])
def test_what_data_holds_is_shown_and_commands_nothing(terminal, say):
    out, err, code = said(terminal, say)
    assert code == (2 if say is refusing else 0)
    assert SHOWN in out + err
    for command in ("\x1b[2J\x1b]", "\x1b]0", *BAD[1:]):
        assert command not in out + err or (command == "\r" and say is barred)


@pytest.mark.parametrize("say", [
    lambda console: console.result({}, ["a\nb", dim("a\nb")]), lambda console: console.warn("a\nb"),
    lambda console: console.progress.say("a\nb"), lambda console: console.wrote(Path("a\nb")),
    lambda console: console.result({}, [table("a\nb", ["c"], [])]),
])  # fmt: skip
def test_a_name_of_two_lines_does_not_break_a_line(terminal, say):
    out, err, _ = said(terminal, say)
    assert r"a\nb" in out + err
    assert "a\nb" not in out + err


def test_json_stays_json(terminal):
    out, _, _ = said(terminal, results, as_json=True)
    assert json.loads(out) == {"name": EVIL}
    assert not set(BAD) & set(out)


def test_a_cell_stays_in_its_row_and_our_own_styles_stay(terminal):
    def say(console):
        console.result(None, [table("t", ["a"], [["x\nsound"]])])
        Terminal(force_terminal=True).print(dim("faint"))

    out, _, _ = said(terminal, say)
    assert "x sound" in out
    assert "\x1b[2mfaint\x1b[0m" in out


def test_brackets_in_a_title_are_no_markup(terminal):
    def say(_console):
        with Bars().stage("[/none]", 1) as update:
            update(1, "[/none]")

    assert said(terminal, say)[1].count("[/none]") >= 2


@given(st.text(alphabet=st.characters()))
def test_what_cannot_be_printed_is_written_as_json_writes_it(text):
    seen = visible(text)
    assert all(c.isprintable() or c in "\t\n" or ord(c) > 0x9F for c in seen)
    assert visible(seen) == seen
    if "\\u" not in text:
        parts = re.split(r"(\\u[0-9a-f]{4})", seen)
        assert "".join(json.loads(f'"{p}"') if p[:2] == "\\u" else p for p in parts) == text
