"""An installed package's methods are there by name; one that fails is named."""

import subprocess
import sys

import pytest

from tiers import often

GOOD = """
from eventsweep.emvs.methods import register
from eventsweep.emvs.methods.method import Method

def offer():
    register(Method.from_function("Theirs/last", lambda votes: votes[-1, -1], "the last camera"))
"""


def install(folder, module: str) -> None:
    """A package as an installer leaves it: a module, and metadata with its entry point."""
    (folder / "theirs.py").write_text(module)
    info = folder / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[eventsweep.methods]\nlast = theirs:offer\n")


def methods(folder, asked: str):
    code = (
        "from eventsweep.emvs.methods import methods_by_name; "
        f"print([m.name for m in methods_by_name(({asked!r},), 2)])"
    )
    return subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_a_method_of_an_installed_package_is_there_by_name(tmp_path):
    install(tmp_path, GOOD)
    assert methods(tmp_path, "Theirs/last").stdout == "['Theirs/last']\n"


def test_methods_of_ours_do_not_load_strangers(tmp_path):
    install(tmp_path, "raise OSError")
    assert methods(tmp_path, "Alg1/H").stdout == "['Alg1/H']\n"


FAILING = ["raise ImportError('no torch')", "def offer():\n    raise KeyError('no torch')", ""]


@pytest.mark.parametrize("module", often(FAILING[:1], FAILING))
def test_a_package_that_fails_is_named(tmp_path, module):
    install(tmp_path, module)
    error = methods(tmp_path, "Theirs/last").stderr.splitlines()[-1]
    assert error.startswith(
        "eventsweep.emvs.errors.InputError: theirs: its methods (last = theirs:offer)"
    )
    assert error.endswith("fix or uninstall it")
