"""The notebooks: public names only, outputs of this very code; and, slowly, that they run."""

import ast
import json
import re
import shutil

import matplotlib
import pytest

import eventsweep as es
from places import ROOT, needs_plugins
from run_notebooks import code_of, digest, main

FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
MOST_BYTES = 400_000
MODULES = {
    "eventsweep", "matplotlib.pyplot", "numpy", "pathlib", "subprocess", "sys", "tempfile",
}  # fmt: skip


def opened(path):
    return json.loads(path.read_text(encoding="utf-8"))


def outputs(book):
    return [out for cell in book["cells"] for out in cell.get("outputs", ())]


def nodes(book):
    return list(ast.walk(ast.parse("\n".join(code_of(book)))))


@needs_plugins
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_uses_public_names_only(path):
    code = nodes(opened(path))
    imported = {alias.name for node in code if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module for node in code if isinstance(node, ast.ImportFrom)}
    assert imported <= MODULES
    attributes = [node for node in code if isinstance(node, ast.Attribute)]
    used = {node.attr for node in attributes if ast.unparse(node.value) == "es"}
    assert len(used) > 3
    assert used - set(es.__all__) == set()
    assert {node.attr for node in attributes if node.attr[:1] == "_"} - {"__init__"} == set()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_shows_was_made_by_its_code(path, capsys):
    book = opened(path)
    assert main(["--check", str(path)]) == 0, capsys.readouterr().err
    kinds = [kind for out in outputs(book) for kind in out.get("data", ())]
    assert kinds.count("image/png") >= 2
    assert [out for out in outputs(book) if out["output_type"] == "error"] == []
    assert [out for out in outputs(book) if out.get("name") == "stderr"] == []
    assert path.stat().st_size <= MOST_BYTES


def test_outputs_of_other_code_are_noticed(tmp_path, capsys):
    copy = shutil.copy(NOTEBOOKS[0], tmp_path)
    book = opened(NOTEBOOKS[0])
    next(cell for cell in book["cells"] if cell["cell_type"] == "code")["source"] += ["\nx = 1"]
    (tmp_path / NOTEBOOKS[0].name).write_text(json.dumps(book), encoding="utf-8")
    assert digest(book) != digest(opened(NOTEBOOKS[0]))
    assert main(["--check", copy]) == 1
    assert "stale" in capsys.readouterr().err


@needs_plugins
def test_there_are_four_whose_links_lead_somewhere():
    assert len(NOTEBOOKS) == 4
    cells = [(path, cell) for path in NOTEBOOKS for cell in opened(path)["cells"]]
    links = [
        (path, to)
        for path, cell in cells if cell["cell_type"] == "markdown"
        for to in re.findall(r"\]\(([^)#]+)", "".join(cell["source"]))
    ]  # fmt: skip
    assert len(links) >= 3
    assert [to for path, to in links if not (path.parent / to).exists()] == []


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    names: dict[str, object] = {}
    for k, code in enumerate(code_of(opened(path))):
        exec(compile(code, f"{path.name}, cell {k}", "exec"), names)
