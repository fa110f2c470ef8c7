"""Help: the flags that matter, all of them on request, in words; refusals that lead there."""

import io
import re
from contextlib import redirect_stdout

import pytest
from rich.console import Console

from eventsweep.eval.cli.help import ALL, readable
from eventsweep.eval.cli.main import app, main
from places import needs_plugins
from programs import COMMANDS, command
from refusals import command_refused

EVERY = sorted(COMMANDS)
MOST_FLAGS = 16


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """A terminal in which names fit on a line."""
    monkeypatch.setattr(app, "console", Console(width=200))


def printed(capsys, *words):
    assert main(list(words)) == 0
    return capsys.readouterr().out


def flags_in(text):
    """The flags that a help page has a line for."""
    lines = [line.strip("│ *") for line in text.splitlines() if line.startswith("│")]
    return set(re.findall(r"^(--[a-z][\w-]*(?:\.[\w-]+)*)(?= |$)", "\n".join(lines), re.MULTILINE))


def taken_by(verb):
    found = command(verb).assemble_argument_collection()
    return {one.name for one in found if not one.children and one.name.startswith("--")}


@pytest.fixture(scope="module")
def pages():
    """Verb -> its help, all of it, and the flags that the latter shows."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(app, "console", Console(width=200))
        for verb in EVERY:
            texts = [io.StringIO(), io.StringIO()]
            for flag, text in zip(("--help", ALL), texts, strict=True):
                with redirect_stdout(text):
                    assert main([*verb.split(), flag]) == 0
            flags = [flag for flag in command(verb)._described[1] if not flag.children]
            found[verb] = (*(text.getvalue() for text in texts), flags)
    return found


def test_help_shows_what_matters_and_help_all_the_rest(pages):
    for verb, (short, whole, _) in pages.items():
        assert flags_in(whole) == taken_by(verb), verb
        assert flags_in(short) <= flags_in(whole), verb
        assert len(flags_in(short)) <= MOST_FLAGS, verb
        hidden = len(flags_in(whole) - flags_in(short))
        assert (f"{hidden} more flags: eventsweep {verb} {ALL}\n" in short) == (hidden > 0)
        assert "more flags" not in whole, verb


@needs_plugins
@pytest.mark.parametrize("group", ["archive"])
def test_help_of_a_group_shows_its_commands(capsys, group):
    page = printed(capsys, group, "--help")
    assert printed(capsys, group) == printed(capsys, group, ALL) == page
    assert all(name.split()[1] in page for name in COMMANDS if name.startswith(f"{group} "))


UGLY = ("()", "('", "',)", "None", "[default: False]", "[default: True]", '[default: ""]')


def test_every_flag_is_explained_in_words_and_no_default_is_python(pages):
    for verb, (_, whole, flags) in pages.items():
        assert [ugly for ugly in UGLY if ugly in whole] == [], verb
        assert all(flag.show for flag in flags), verb
        unexplained = [f.name for f in flags if not (f.parameter.help or "").endswith((*".?!",))]
        assert unexplained == [], verb


@pytest.mark.parametrize(("value", "text"), [
    (None, None), (False, None), ((), None), ("", None), (True, "on"), (("all",), "all"),
    ((0.0, 0.5), "0, 0.5"), (1e-6, "1e-06"), (4500, "4500"),
])  # fmt: skip
def test_defaults_read_well(value, text):
    assert readable(value) == text


def test_the_longest_help_is_short_in_the_order_of_the_work_and_wherever_it_is_asked_for(
    capsys, monkeypatch
):
    whole = printed(capsys, "run", ALL)
    titles = re.findall(r"^╭─ (.*?) ─", whole, re.MULTILINE)
    kinds = ("Simulator", "Mapper", "Score")
    assert titles == [
        "Arguments",
        "Parameters",
        *(f"{k} parameters" for k in kinds),
        "Where jobs run",
        "Common",
    ]
    assert printed(capsys, "run", "--out", "o", "--help") == printed(capsys, "run", "-h")
    monkeypatch.setattr(app, "console", Console(width=80))
    assert len(printed(capsys, "run", "--help").splitlines()) < 60
    assert len(taken_by("run")) > 100


@pytest.mark.parametrize(("words", "told"), [
    ("run desk --out o --methd H", "run takes no flag --methd; did you mean"),
    ("run desk --out o --planes 5", "did you mean --map.planes?"),
    ("map x --out o --threshod-c 5", "did you mean --map.threshold-c?"),
    ("suite quick --out o --sedes 5", "did you mean --seeds?"),
    ("score x --workers", "score takes no flag --workers ("),
    ("run desk --out o --fast", "run takes no flag --fast ("),
    ("mop", 'Did you mean "map"?'), ("mop --help", 'Did you mean "map"?'),
])  # fmt: skip
def test_an_unknown_flag_leads_to_its_own_verb_and_a_word_that_is_none_to_the_program(
    tmp_path, monkeypatch, capsys, words, told
):
    monkeypatch.chdir(tmp_path)
    said = command_refused(capsys, *words.split())
    assert told in said
    verb = "" if "mop" in words else f" {words.split()[0]}"
    assert said.endswith(f"(`eventsweep{verb} --help` shows what there is)\n")
