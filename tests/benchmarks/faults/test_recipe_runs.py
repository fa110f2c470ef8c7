"""The recipe is the page's, an edit compiles anew what it reaches, and the table adds up."""

import ast
import json
import shlex

import numpy as np
import pytest

import recipe_child
import recipe_runs
from planted_faults import PACKAGES, ROOT, Fault
from recipe_runs import GATE, GREEN, MAPPED, MISSED, NO_EFFECT, ONCE, PLANTED, RED, UNCHANGED


def test_the_recipe_is_that_of_the_page():
    text = (ROOT / recipe_runs.PAGE).read_text(encoding="utf-8")
    assert f"```sh\n{ONCE}{MAPPED}" in text
    assert f"```sh\n{GATE} --junit gate.xml\n```" in text


def test_every_named_fault_and_every_change_of_nothing_can_be_made():
    for one in (*PLANTED, *(one for one in UNCHANGED if one.file)):
        text = (ROOT / one.file).read_text(encoding="utf-8")
        after = one.applied(text)
        same = ast.dump(ast.parse(after)) == ast.dump(ast.parse(text))
        assert after != text
        assert not same or one in UNCHANGED
    assert len(UNCHANGED) == 10


def test_in_one_process_the_first_case_is_held_before_the_second_is_mapped():
    (first, early), (second, whole) = json.loads(recipe_runs._lines())
    typed = [shlex.split(line)[1:] for line in MAPPED.replace("\\\n", "").splitlines()]
    assert [*first, *second] == typed
    assert [words[0] for words in first] == ["map", "score"]
    assert whole == shlex.split(GATE)[1:]
    assert early == [*shlex.split(GATE.replace(" --result planes-maps", ""))[1:], "--case", "desk"]


@pytest.mark.parametrize(("edited", "anew"), [
    ("emvs/dsi/rays_kernels.py", {"rays_kernels"}),
    ("emvs/dsi/fusion_kernels.py", {"fusion_kernels", "focus_kernels"}),
    ("emvs/dsi/rays.py", set()),
])  # fmt: skip
def test_only_kernels_that_an_edit_reaches_are_compiled_anew(tmp_path, edited, anew):
    for package in PACKAGES:
        for path in (ROOT / package).glob("**/*_kernels.py"):
            copied = tmp_path / path.relative_to(ROOT)
            copied.parent.mkdir(parents=True, exist_ok=True)
            copied.write_bytes(path.read_bytes())
    assert recipe_runs.reached(tmp_path) == set()
    fault = tmp_path / edited
    fault.write_text((ROOT / edited).read_text("utf-8") + "# edited\n", encoding="utf-8")
    assert recipe_runs.reached(tmp_path) == anew


def test_the_digest_is_of_arrays_and_scores_and_of_no_clock(tmp_path):
    for name, value, seconds in (("a", 1.0, 1), ("b", 1.0, 2), ("c", 1.0 + 2**-52, 1)):
        folder = tmp_path / name
        folder.mkdir()
        np.savez(folder / "depth.npz", depth_m=np.array([value]))
        (folder / "map.json").write_text(json.dumps({"seconds": seconds}))
    one, same, other = (recipe_child.digest(tmp_path / name) for name in "abc")
    assert one == same != other


class Told(recipe_runs.Bench):
    """A bench that knows what is red, and what has an effect."""

    def __init__(self, work, red, effect):
        super().__init__(work)
        self._red, self._effect = red, effect

    def prepare(self):
        pass

    def unchanged(self, one):
        return GREEN, "", 90.0 if one.is_cold else 40.0

    def planted(self, edit):
        return (RED, "desk", 20.0) if edit.name in self._red else (GREEN, "", 40.0)

    def beyond(self, edit):
        return (MISSED, "one fisheye") if edit.name in self._effect else (NO_EFFECT, "")


def test_what_changes_nothing_is_no_fault_and_the_table_adds_up(tmp_path, monkeypatch):
    faults = tuple(Fault(name, "a.py", "a", "b") for name in ("x", "y", "z", "w"))
    monkeypatch.setattr(recipe_runs, "PLANTED", faults)
    monkeypatch.setattr(recipe_runs, "drawn", lambda _seed, _areas: [])
    bench = Told(tmp_path, {"x", "y"}, {"z"})
    recipe_runs.judge_all(bench, 0)
    text = recipe_runs.table(bench.verdicts())
    assert "| named | 4 | 2 | 1 | 1 |\n" in text
    assert "| together | 4 | 2 | 1 | 1 |\n" in text
    assert "Red: 67 % of those with an effect. Green: 10 of 10 variants" in text
    assert "CPU time: 40 s, with nothing compiled 90 s." in text
    assert text.endswith("Missed:\n\n- z (one fisheye)\n")
    lines = (tmp_path / "verdicts.jsonl").read_text()
    recipe_runs.judge_all(bench, 0)
    assert (tmp_path / "verdicts.jsonl").read_text() == lines
