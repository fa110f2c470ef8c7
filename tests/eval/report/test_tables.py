"""Tables as files: whatever stands in a cell, the table stays a table."""

import csv
import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.eval.report import tables as table_files
from eventsweep.eval.report.html import Grid, GridCell, Head
from report_data import report_data

names = st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), min_size=1)


def _table(name):
    cells = GridCell(name), GridCell("1.0", 1.0, "best")
    return Grid((Head("method", text=True), Head(name)), (cells,), "c")


@given(names)
def test_csv_reads_back(name):
    rows = list(csv.reader(io.StringIO(table_files.as_csv(_table(name)), newline="")))
    assert rows == [["method", name], [name, "1.0"]]


@given(names)
def test_markdown_has_as_many_cells_as_columns(name):
    for line in table_files.as_markdown(_table(name)).removesuffix("\n").split("\n"):
        assert len(re.findall(r"(?<!\\)(?:\\\\)*\|", line)) == 3, line


@given(names)
def test_latex_has_as_many_cells_as_columns_and_no_open_command(name):
    text = table_files.as_latex(_table(name))
    body = text[text.index("\\toprule") : text.index("\\bottomrule")]
    assert len(re.findall(r"(?<!\\)&", body)) == 2
    bare = re.sub(r"\\[&%$#_{}]", "", text)
    assert bare.count("{") == bare.count("}")
    assert not re.search(r"[#%~^]", bare)
    assert bare.count("$") % 2 == 0


def test_latex_by_hand():
    heads = Head("x_1", text=True), Head("e", "%", arrow=True)
    table = Grid(heads, ((GridCell("H"), GridCell("–")),), "a & b")
    assert table_files.as_latex(table) == (
        "\\begin{table}\n\\centering\n\\caption{a \\& b}\n\\begin{tabular}{lr}\n\\toprule\n"
        "x\\_1 & e [\\%] $\\downarrow$ \\\\\n\\midrule\nH & -- \\\\\n\\bottomrule\n"
        "\\end{tabular}\n\\end{table}\n"
    )


def test_an_undefined_number_is_an_empty_cell_and_others_are_in_the_unit_of_their_heading():
    table = Grid((Head("m", text=True), Head("v")), ((GridCell("a"), GridCell("–")),))
    assert table_files.as_csv(table) == "m,v\na,\n"
    assert (table_files.in_unit(0.0625, "cm"), table_files.in_unit(0.0625, "%")) == (6.25, 0.0625)


@pytest.mark.parametrize("name", ["../up", "/root", ".hidden", "a b/c", "", "..", "<x>"])
def test_no_name_leaves_the_folder(name, tmp_path):
    paths = table_files.write_tables(tmp_path, {name: _table("x")})
    assert {path.parent for path in paths} == {tmp_path}
    assert not table_files.file_name(name).startswith(".")


def test_a_report_has_a_table_for_each_case_and_for_their_mean():
    tables = table_files.report_tables(report_data("desk", "boxes"))
    assert list(tables) == ["desk", "boxes", "ranking-mean"]
    heads, first, *_ = csv.reader(io.StringIO(table_files.as_csv(tables["desk"])))
    at = heads.index("mean error [cm] ↓")
    assert first[0] == "Alg1/H"
    # Alg1/H is off by 2 % of 0.6 to 3 m.
    assert 1.2 < float(first[at]) < 6.0
    assert "**" in table_files.as_markdown(tables["desk"])
    assert table_files.report_tables(report_data("slider", truth=False)) == {}
