"""The run on fresh machines says in one line why it cannot be; the run itself takes minutes."""

import shutil
import subprocess
from pathlib import Path

import pytest

from places import TOOLS

SCRIPT = TOOLS / "checkout" / "fresh_machine.sh"


def tools_without(tmp_path: Path, names: tuple[str, ...]) -> str:
    """A search path with these tools and no others."""
    for name in names:
        program = shutil.which(name)
        if program is None:
            pytest.skip(f"no {name} here")
        (tmp_path / name).symlink_to(program)
    return str(tmp_path)


def test_without_root_or_debootstrap_it_is_skipped_in_one_line(tmp_path):
    path = tools_without(tmp_path, ("bash", "dirname", "id"))
    done = subprocess.run(
        ["bash", str(SCRIPT)], env={"PATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 77, done.stderr
    assert done.stdout.startswith("fresh machine: skipped: needs ")
    assert done.stdout.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--release"], "--release: needs the name"), (["--all"], "--all: unknown")],
)
def test_wrong_arguments_are_named_before_anything_is_made(arguments, said):
    command = ["bash", str(SCRIPT), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"fresh machine: {said}")
    assert done.stderr.count("\n") == 1
