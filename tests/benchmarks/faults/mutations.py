"""Draws single-line mutations of what makes and scores depth, at random with a stated seed.

A mutation is one operator, constant, index or statement of one line, changed. What is drawn from
is what shapes a number of a ranking: not the readers of formats, the GPU's code, point clouds,
pages, caches and processes, and not lines that only refuse, notify or take the time.
"""

import ast
import hashlib
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from planted_faults import ROOT

Areas = dict[str, tuple[int, tuple[str, ...]]]
SEED = 35
AREAS: Areas = {
    "simulator": (6, (
        "sim/simulate.py", "sim/motion/curves.py", "sim/motion/head_motion.py",
        "sim/rendering/adaptive_sampling.py", "sim/rendering/lens.py",
        "sim/rendering/pixel_kernels.py", "sim/rendering/renderer.py", "sim/sensor/*.py",
    )),
    "mapper": (5, (
        "emvs/dsi/*.py", "emvs/geometry/*.py", "emvs/hot_pixels.py", "emvs/mapper.py",
        "emvs/reference_view.py", "emvs/windows.py",
    )),
    "extraction": (4, (
        "emvs/depth/depth_map.py", "emvs/depth/focus.py", "emvs/depth/precision.py",
        "emvs/depth/*_kernels.py", "plugins/learned/networks/*.py",
    )),
    "baselines": (2, ("emvs/baselines/*.py",)),
    "scoring": (2, (
        "eval/scoring/curves.py", "eval/scoring/metrics.py", "eval/scoring/pairing.py",
        "eval/scoring/pooling.py", "eval/scoring/regions.py", "eval/scoring/score.py",
        "eval/stages/score.py",
    )),
    "gate": (1, ("eval/gate/compare.py", "eval/results/series.py")),
}  # fmt: skip
"""How many are drawn of each area, about as it has lines, and its files."""
LEFT_OUT = (
    "sim/sensor/frame_camera.py", "sim/sensor/imu.py", "sim/sensor/labels.py", "emvs/dsi/device.py",
    "emvs/geometry/warp.py", "plugins/learned/networks/weights.py",
)  # fmt: skip
"""Pictures, inertial samples, labels, GPUs, other data sets' truth, reading a file of weights."""

_GUARDS = re.compile(r"_*(check|available_bytes|notice|lap)")
"""Functions that refuse bad input or too large a job, tell the user something, or take the time."""

_BINARY = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "/"}
_COMPARE = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
}  # fmt: skip
_OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Lt: "<",
    ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_NAMES = {
    "min": "max", "minimum": "maximum", "argmin": "argmax", "floor": "ceil", "sin": "cos",
    "searchsorted": "digitize", "any": "all", "zeros": "ones",
}  # fmt: skip
_SWAPPED = _NAMES | {new: old for old, new in _NAMES.items()}


@dataclass(frozen=True)
class Mutation:
    """Line `number` of `file`, from 1, says `after` instead of `before`."""

    file: str
    number: int
    before: str
    after: str

    @property
    def digest(self) -> str:
        """Of what is changed into what, wherever in the file it stands by now."""
        facts = "\n".join((self.file, self.before.strip(), self.after.strip()))
        return hashlib.sha256(facts.encode()).hexdigest()[:12]

    def applied(self, text: str) -> str:
        """The file's text with the mutation in it."""
        lines = text.splitlines(keepends=True)
        if lines[self.number - 1].rstrip("\n") != self.before:
            raise ValueError(f"{self.file}:{self.number} says something else by now")
        lines[self.number - 1] = self.after + "\n"
        return "".join(lines)


class _Change(NamedTuple):
    """Columns `start` to `end` of a line become `text`."""

    number: int
    start: int
    end: int
    text: str


def drawn(seed: int = SEED, areas: Areas = AREAS) -> list[tuple[str, Mutation]]:
    """Areas and mutations: as many as each area has, no line twice, in the order of their lots.

    Lots are hashes of seed and mutation: an edit elsewhere changes no other line's lot.
    """
    chosen = []
    for area, (count, patterns) in areas.items():
        files = sorted({path for pattern in patterns for path in ROOT.glob(pattern)})
        names = [path.relative_to(ROOT).as_posix() for path in files]
        ours = [mutation for name in names if name not in LEFT_OUT for mutation in candidates(name)]
        lines: dict[tuple[str, str], Mutation] = {}
        for mutation in sorted(ours, key=lambda mutation: _lot(seed, mutation)):
            lines.setdefault((mutation.file, mutation.before.strip()), mutation)
        chosen += [(area, mutation) for mutation in list(lines.values())[:count]]
    return sorted(chosen, key=lambda pair: _lot(seed, pair[1]))


def _lot(seed: int, mutation: Mutation) -> str:
    return hashlib.sha256(f"{seed} {mutation.digest}".encode()).hexdigest()


@cache
def candidates(name: str) -> list[Mutation]:
    """Every mutation of a file that still is Python."""
    text = (ROOT / name).read_text(encoding="utf-8")
    lines = text.splitlines()
    made = []
    for change in _changes(ast.parse(text), lines):
        line = lines[change.number - 1]
        after = line[: change.start] + change.text + line[change.end :]
        mutation = Mutation(name, change.number, line, after)
        if after != line and _is_python(mutation.applied(text)):
            made.append(mutation)
    return made


def _is_python(text: str) -> bool:
    with warnings.catch_warnings(action="ignore", category=SyntaxWarning):
        try:
            ast.parse(text)
        except SyntaxError:
            return False
    return True


def _changes(tree: ast.Module, lines: list[str]) -> Iterator[_Change]:
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef) and not _GUARDS.match(function.name):
            for statement in function.body:
                yield from _inside(statement, lines)


def _inside(node: ast.AST, lines: list[str]) -> Iterator[_Change]:
    if isinstance(node, (ast.Raise, ast.FunctionDef, ast.Import, ast.ImportFrom, ast.JoinedStr)):
        return
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return  # a doc string
    statement = node.value if isinstance(node, ast.Expr) else None
    if isinstance(statement, ast.Call) and _GUARDS.match(_name(statement.func)):
        return
    yield from _of_node(node, lines)
    for name, value in ast.iter_fields(node):
        inner = value if isinstance(value, list) else [value]
        for child in inner if name != "annotation" else ():
            if isinstance(child, ast.AST):
                yield from _inside(child, lines)


def _of_node(node: ast.AST, lines: list[str]) -> Iterator[_Change]:
    """What can be changed of one node, if it stands in one line."""
    if isinstance(node, ast.BinOp):
        yield from _operator(node.left, node.op, node.right, _BINARY.get(type(node.op)), lines)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        new = _COMPARE.get(type(node.ops[0]))
        yield from _operator(node.left, node.ops[0], node.comparators[0], new, lines)
    elif isinstance(node, ast.BoolOp):
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        yield from _between(node.values[0], node.values[1], old, new, lines)
    elif isinstance(node, ast.Constant):
        yield from _constant(node)
    elif isinstance(node, ast.Call):
        yield from _call(node.func)
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Name):
        at = node.slice
        yield _Change(at.lineno, at.col_offset, at.end_col_offset or 0, f"{at.id} - 1")
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        yield _Change(node.lineno, node.col_offset, node.operand.col_offset, "")
    elif isinstance(node, (ast.Expr, ast.Assign, ast.AugAssign)):
        yield from _dropped(node)


def _operator(
    left: ast.expr, old: ast.AST, right: ast.expr, new: str | None, lines: list[str]
) -> Iterator[_Change]:
    if new is not None:
        yield from _between(left, right, _OPERATORS[type(old)], new, lines)


def _between(
    left: ast.expr, right: ast.expr, old: str, new: str, lines: list[str]
) -> Iterator[_Change]:
    """The operator, which stands alone between its operands but for brackets."""
    if left.end_lineno != right.lineno:
        return
    first = left.end_col_offset or 0
    between = lines[right.lineno - 1][first : right.col_offset]
    if between.strip(" ()") == old:
        at = first + between.index(old)
        yield _Change(right.lineno, at, at + len(old), new)


def _constant(node: ast.Constant) -> Iterator[_Change]:
    value = node.value
    if isinstance(value, bool):
        text = str(not value)
    elif isinstance(value, int):
        text = str(value + 1)
    elif isinstance(value, float):
        text = repr(1.1 * value if value else 1.0)
    else:
        return
    yield _Change(node.lineno, node.col_offset, node.end_col_offset or 0, text)


def _call(function: ast.expr) -> Iterator[_Change]:
    name = _name(function)
    if name in _SWAPPED and function.lineno == function.end_lineno:
        end = function.end_col_offset or 0
        yield _Change(function.lineno, end - len(name), end, _SWAPPED[name])


def _name(function: ast.expr) -> str:
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _dropped(node: ast.Expr | ast.Assign | ast.AugAssign) -> Iterator[_Change]:
    """A statement whose absence breaks no name: a call, an assignment into something, or a sum."""
    targets = node.targets if isinstance(node, ast.Assign) else []
    parts = [part for target in targets for part in getattr(target, "elts", [target])]
    is_name = any(isinstance(part, ast.Name) for part in parts)
    if node.lineno == node.end_lineno and not is_name:
        yield _Change(node.lineno, node.col_offset, node.end_col_offset or 0, "pass")
