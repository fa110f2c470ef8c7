"""House rules that a reader would otherwise have to remember."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from places import ROOT

PARTS = ("emvs", "sim", "scenes", "eval")
FOLDERS = (*PARTS, "eventsweep", "tests")
SOURCES = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
# What every breach holds, and most files do not: looking through their trees takes seconds.
ALONE = re.compile(rf"(?<![\w.])(?:{'|'.join(PARTS)})\b")


def names_of(node: ast.AST) -> set[str]:
    """The modules that an import statement names, by their first parts."""
    if isinstance(node, ast.Import):
        return {alias.name.partition(".")[0] for alias in node.names}
    if isinstance(node, ast.ImportFrom) and not node.level:
        return {(node.module or "").partition(".")[0]}
    return set()


def breaks_a_rule(node: ast.AST) -> bool:
    """Whether a statement imports a part of ours past `eventsweep`, or hides or calls `eval`.

    In a checkout `import emvs` would make a second copy of every module.
    """
    if names_of(node) & set(PARTS):
        return True
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return any((alias.asname or alias.name) == "eval" for alias in node.names)
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "eval"


def test_parts_are_imported_from_the_package_and_the_builtin_eval_is_left_alone():
    assert len(SOURCES) > 500
    assert [f"{path.relative_to(ROOT)}:{line}" for path in SOURCES for line in broken(path)] == []


def broken(path: Path) -> list[int]:
    """Lines of a file that break a rule."""
    text = path.read_text(encoding="utf-8")
    nodes = ast.walk(ast.parse(text)) if ALONE.search(text) else ()
    return [node.lineno for node in nodes if breaks_a_rule(node)]


@pytest.mark.parametrize(
    "text", ["import eval", "import emvs.mapper", "from sim import rigs", "from x import eval",
             "eval('1')"],
)  # fmt: skip
def test_the_rule_itself_sees_each_way(text):
    assert ALONE.search(text)
    assert any(breaks_a_rule(node) for node in ast.walk(ast.parse(text)))


@pytest.mark.parametrize(
    "heavy", ["numpy", "numba", "mujoco", "open3d", "cv2", "matplotlib", "h5py"]
)
def test_the_command_line_imports_nothing_heavy(heavy):
    """Help must come at once."""
    code = f"import eventsweep.eval.cli.main, sys; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_mapper_does_not_load_open3d_or_mujoco():
    heavy = "'open3d' in sys.modules or 'mujoco' in sys.modules"
    code = f"import eventsweep.emvs.mapper, sys; sys.exit({heavy})"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
