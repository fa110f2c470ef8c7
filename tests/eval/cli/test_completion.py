"""Completion, as the shells do it: verbs, flags, and names from the registries."""

import os
import shutil
import subprocess
import sys
from functools import cache

import pytest

from eventsweep.eval.cli.main import app, main
from places import ROOT
from refusals import command_refused

ASKED = {
    "ru": {"run"}, "run --map.pl": {"--map.planes"}, "run rpg-m": {"rpg-monitor"},
    "run desk --sim.sensor.pre": {"--sim.sensor.preset"}, "map x --device cu": {"cuda"},
    "map x --method Alg1/m": {"Alg1/min", "Alg1/max"}, "run desk --rig tumvie-": {"tumvie-kb4"},
    "suite qui": {"quick"}, "study pose-r": {"pose-rate"}, "list su": {"suites"},
}  # fmt: skip
BASH = """
. ~/.bashrc
while read -r -a COMP_WORDS; do
    COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMPREPLY=()
    _eventsweep
    echo "${COMPREPLY[*]}"
done
"""
FISH = """
while read line
    echo (complete -C "$line" | string split -f 1 \\t)
end
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A home in which completion is installed for every shell, with `eventsweep` on the path."""
    home = tmp_path_factory.mktemp("home")
    program = home / "bin" / "eventsweep"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m eventsweep "$@"\n')
    program.chmod(0o755)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(home))
        patch.setattr(app, "generate_completion", cache(app.generate_completion))
        for shell in ("bash", "zsh", "fish") * 2:  # the second time changes nothing
            assert main(["completion", shell, "--quiet"]) == 0
    return home


def shell_in(home, *command, asked=""):
    found = shutil.which(command[0])
    if found is None:
        pytest.skip(f"no {command[0]} here")
    path = f"{home / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        [found, *command[1:]], input=asked, env={**os.environ, "HOME": str(home), "PATH": path},
        capture_output=True, text=True, check=True, timeout=120,
    ).stdout  # fmt: skip


@pytest.mark.parametrize(
    "command",
    [pytest.param(("bash", "--norc", "-c", BASH), marks=pytest.mark.slow), ("fish", "-c", FISH)],
)
def test_a_shell_completes_verbs_flags_and_names(home, command):
    asked = "".join(f"eventsweep {words}\n" for words in ASKED)
    answers = shell_in(home, *command, asked=asked).splitlines()
    found = {words: set(answer.split()) for words, answer in zip(ASKED, answers, strict=True)}
    assert found == ASKED


def test_zsh_knows_the_program_once_its_completion_is_on(home):
    said = shell_in(home, "zsh", "-f", "-c", ". ~/.zshrc; autoload -Uz compinit; compinit -u -D; "
        "echo $_comps[eventsweep]; autoload +X _cyclopts_eventsweep")  # fmt: skip
    assert said.strip() == "_cyclopts_eventsweep"


def test_the_script_is_installed_once_or_printed_and_the_shell_is_found(home, monkeypatch, capsys):
    for name in (".bashrc", ".zshrc"):
        lines = [line for line in (home / name).read_text().splitlines() if line[:1] != "#"]
        assert len(lines) == 1
    monkeypatch.setenv("HOME", str(home))
    assert main(["completion", "fish", "--print"]) == 0
    assert "complete -c eventsweep" in capsys.readouterr().out
    for name in ("BASH_VERSION", "ZSH_VERSION", "FISH_VERSION"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("cyclopts.completion.detect.detect_shell", lambda: "powershell")
    assert "not bash, zsh or fish" in command_refused(capsys, "completion")


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_start_up_file_is_replaced_as_a_whole_and_keeps_what_it_says(
    tmp_path, monkeypatch, shell
):
    """Written into, it would be cut by a kill or a full disk."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(app, "generate_completion", lambda **_: "a script")
    place, name = tmp_path / "dotfiles", tmp_path / f".{shell}rc"
    place.write_text("of somebody")
    place.chmod(0o640)
    name.symlink_to(place)
    with place.open() as before:  # holds the old file: its number is not given to another
        assert main(["completion", shell, "--quiet"]) == 0
        assert place.stat().st_ino != os.fstat(before.fileno()).st_ino
        assert before.read() == "of somebody"
    assert name.is_symlink()
    assert place.stat().st_mode & 0o777 == 0o640
    assert "of somebody" in place.read_text().splitlines()
