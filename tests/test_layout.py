"""House rules that a reader would otherwise have to remember."""

import ast
import subprocess
import sys

import pytest

from places import ROOT

FOLDERS = ("emvs", "sim", "scenes", "eval", "eventsweep", "tests")
SOURCES = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]


def rebinds_eval(node: ast.AST) -> bool:
    """Whether a statement makes the name `eval` mean the package, or calls the builtin."""
    if isinstance(node, ast.Import):
        return any(alias.name.split(".")[0] == "eval" and not alias.asname for alias in node.names)
    if isinstance(node, ast.ImportFrom):
        return any((alias.asname or alias.name) == "eval" for alias in node.names)
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "eval"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_builtin_eval_is_left_alone(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not [node.lineno for node in ast.walk(tree) if rebinds_eval(node)]


@pytest.mark.parametrize(
    "text", ["import eval", "import eval.scoring.metrics", "from x import eval", "eval('1')"]
)
def test_the_rule_itself_sees_each_way(text):
    assert any(rebinds_eval(node) for node in ast.walk(ast.parse(text)))


@pytest.mark.parametrize(
    "heavy", ["numpy", "numba", "mujoco", "open3d", "cv2", "matplotlib", "h5py"]
)
def test_the_command_line_imports_nothing_heavy(heavy):
    """Help must come at once."""
    code = f"import eval.cli.main, sys; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_mapper_does_not_load_open3d_or_mujoco():
    code = "import emvs.mapper, sys; sys.exit('open3d' in sys.modules or 'mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
