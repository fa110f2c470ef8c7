"""Mutations change one line, the same ones every time; verdicts become a table that adds up."""

import ast
import json

import pytest

import mutation_runs
from mutations import AREAS, Mutation, candidates, drawn
from planted_faults import ROOT, broken_copy


@pytest.fixture(scope="module")
def some():
    return drawn()


@pytest.mark.slow
def test_at_least_twenty_are_drawn_of_all_areas(some):
    assert len(some) == sum(count for count, _ in AREAS.values()) >= 20
    assert {area for area, _ in some} == set(AREAS)
    assert len({mutation.digest for _, mutation in some}) == len(some)
    assert len({(mutation.file, mutation.number) for _, mutation in some}) == len(some)
    assert drawn() == some
    assert drawn(seed=1) != some


@pytest.mark.slow
def test_each_changes_what_one_line_means(some):
    for _, mutation in some:
        text = (ROOT / mutation.file).read_text(encoding="utf-8")
        after = mutation.applied(text)
        changed = [k for k, pair in enumerate(zip(*map(str.splitlines, (text, after)), strict=True))
                   if pair[0] != pair[1]]  # fmt: skip
        assert changed == [mutation.number - 1]
        assert ast.dump(ast.parse(after)) != ast.dump(ast.parse(text))


def test_every_operator_is_known(tmp_path, monkeypatch):
    lines = {
        "a + b": "a - b", "a * b": "a / b", "a < b": "a <= b", "a == b": "a != b",
        "a and b": "a or b", "not a": "a", "-a": "a", "min(a, b)": "max(a, b)", "a[b]": "a[b - 1]",
        "7": "8", "0.5": "0.55", "True": "False", "(a) >= (b)": "(a) > (b)",
    }  # fmt: skip
    body = "\n".join(f"    c = {line}" for line in lines)
    (tmp_path / "m.py").write_text(
        f'def f(a: int = 1, b=2):\n    "doc"\n{body}\n    f(c)\n    return c\n'
    )
    monkeypatch.setattr("mutations.ROOT", tmp_path)
    changed = {(mutation.before.strip(), mutation.after.strip()) for mutation in candidates("m.py")}
    (tmp_path / "guards.py").write_text(
        "def check_size(a):\n    return a < 1\n\n\ndef f(a):\n    self._check(a, 1)\n    lap(1)\n"
    )
    assert candidates("guards.py") == []
    assert changed == {*((f"c = {a}", f"c = {b}") for a, b in lines.items()), ("f(c)", "pass")}


@pytest.mark.slow
def test_a_copy_has_the_mutation_and_what_else_is_asked_for(tmp_path, some):
    mutation = some[0][1]
    copy = broken_copy(tmp_path / "copy", mutation, more=("pyproject.toml",))
    assert mutation.after in (copy / mutation.file).read_text(encoding="utf-8")
    assert (copy / "pyproject.toml").is_file()
    with pytest.raises(ValueError, match="says something else by now"):
        mutation.applied("\n" * mutation.number)


def test_the_nearest_unit_tests_come_first():
    own, every, whole, widest = mutation_runs.tests_of("sim/sensor/pixels_kernels.py")
    assert (own, whole) == ("tests/sim/sensor/test_pixels.py", "tests/sim/sensor")
    assert widest == "tests/sim"
    assert {own, "tests/sim/sensor/test_sensor.py"} <= set(every.split())
    assert mutation_runs.tests_of("eval/stages/map.py")[-2:] == [
        "tests/eval/stages",
        "tests/eval",
    ]
    every, whole = mutation_runs.tests_of("emvs/reference_view.py")
    assert "tests/emvs/test_methods.py" in every.split()
    assert whole == "tests/emvs"


class Told:
    """A judge that knows."""

    def __init__(self, quick, tests):
        self.quick, self.tests = quick, tests

    def by_quick(self, mutation):
        return self.quick.pop(mutation.digest)

    def by_tests(self, mutation):
        return self.tests.pop(mutation.digest)


def test_a_stopped_run_goes_on_and_the_table_adds_up(tmp_path, monkeypatch):
    monkeypatch.setattr(mutation_runs, "VERDICTS", tmp_path / "v.jsonl")
    order = [("mapper", Mutation("a.py", k, f"a + {k}", f"a - {k}")) for k in range(5)]
    names = [mutation.digest for _, mutation in order]
    quick = dict.fromkeys(names, ("green", "")) | {names[0]: ("red", "desk events")}
    first = {name: quick[name] for name in names[:2]}
    with pytest.raises(KeyError):
        mutation_runs.judge_all(order, Told(first, {}))
    tests = dict.fromkeys(names[2:], ("none", "")) | {names[1]: ("tests", "test_a.py::test_b")}
    judge = Told({name: quick[name] for name in names[2:]}, tests)
    mutation_runs.judge_all(order, judge)
    assert judge.quick == judge.tests == {}
    reasons = {names[2]: {"kind": "equivalent", "reason": "it is"},
               names[3]: {"kind": "unreachable", "reason": "no way"}}  # fmt: skip
    text = mutation_runs.table(mutation_runs.read(tmp_path / "v.jsonl"), reasons)
    assert "| mapper | 5 | 1 | 1 | 1 | 1 | 1 |" in text
    assert "Of 3 that change anything, `quick` sees 33 %, with the unit tests 67 %." in text
    assert "- `a.py`: `a + 4` → `a - 4`" in text


def test_every_reason_belongs_to_a_mutation_that_nothing_sees():
    reasons = json.loads(mutation_runs.REASONS.read_text(encoding="utf-8"))
    verdicts = mutation_runs.read(mutation_runs.VERDICTS)
    for digest, said in reasons.items():
        assert said["kind"] in ("equivalent", "unreachable")
        assert len(said["reason"]) > 20
        assert verdicts[digest]["seen"] in ("green", "none")
