"""Plants faults and runs the recipe of the page `gate` with each: does it turn red?

`python tests/benchmarks recipe_runs --work out/recipe` plants those of `PLANTED` and, of a seed,
random mutations of mapper, extraction and scoring, in a copy of the packages. Where the recipe
stays green the copy also runs `recipe_child.RUNS`: a fault that changes no byte of what they write
has no effect, any other was missed. Then `UNCHANGED`: what changes nothing must stay green.
Verdicts are lines of `WORK/verdicts.jsonl`: a run that was stopped goes on where it was. With
`--page` the table is written into the page.
"""

import argparse
import hashlib
import json
import os
import re
import resource
import shutil
import signal
import statistics
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from shlex import split

from markdown_blocks import show
from mutations import drawn
from planted_faults import ROOT, Edit, Fault, broken_copy
from recipe_child import SAME
from table_code import Code, of_scenes

PAGE, MARK = "docs/gate.md", "recipe"
ONCE = """\
eventsweep simulate desk --rig oblique --seconds 0.2 --seed 0 --out desk
echo 'cam0: {camera_model: pinhole, intrinsics: [80, 80, 78, 61], resolution: [160, 120],
  distortion_model: equidistant, distortion_coeffs: [-0.05, 0.01, -0.02, 0.005]}' > fisheye.yaml
eventsweep simulate planes --rig fisheye.yaml --seconds 0.2 --seed 0 --out planes
"""
MAPPED = """\
eventsweep map desk --out desk-maps --method all --method Alg2/AtHc@4 --method Alg2/HtAc@4 \\
  --method Late/union --method Focus/A
eventsweep score desk-maps
eventsweep map planes --out planes-maps --map.window-s 0.1 --map.polarity separate \\
  --map.threshold-c 20
eventsweep score planes-maps
"""
GATE = "eventsweep gate --baseline baseline.json --result desk-maps --result planes-maps --strict"
"""The recipe, as it stands on the page."""
PLANTED = (
    Fault("depth by half a plane", "emvs/reference_view.py",
          "position.astype(np.float64)", "position.astype(np.float64) + 0.5"),
    Fault("2 % of the events skipped", "emvs/dsi/rays.py",
          "return events, events.t_us",
          "return (kept := events.take(np.arange(len(events)) % 50 > 0)), kept.t_us"),
    Fault("H as A", "emvs/dsi/fusion.py", "fusion_kernels.HARMONIC, \"harmonic mean\"",
          "fusion_kernels.ARITHMETIC, \"harmonic mean\""),
    Fault("poses half a millisecond late", "emvs/dsi/rays.py",
          "return events, events.t_us", "return events, events.t_us - 500"),
    Fault("one camera's votes doubled", "emvs/dsi/voting.py",
          "        counted, hidden = int(inside.sum())",
          "        self.votes[0] *= 1 + (camera == 0)\n"
          "        counted, hidden = int(inside.sum())"),
    Fault("threshold C by 5 %", "emvs/depth/depth_map.py",
          "config.threshold_kernel_px, config.threshold_c)",
          "config.threshold_kernel_px, 1.05 * config.threshold_c)"),
    Fault("median left out", "emvs/depth/depth_map.py",
          "position = masked_median(position, mask, config.median_px)",
          "position = position.copy()"),
)  # fmt: skip
AREAS = {
    "mapper": (14, (
        "emvs/dsi/[!f]*.py", "emvs/dsi/focus*.py", "emvs/geometry/*.py", "emvs/mapper.py",
        "emvs/reference_view.py", "emvs/windows.py",
    )),
    "fusion": (4, ("emvs/dsi/fusion.py", "emvs/dsi/fusion_kernels.py")),
    "extraction": (7, (
        "emvs/depth/depth_map.py", "emvs/depth/focus.py", "emvs/depth/neighbours_kernels.py",
    )),
    "scoring": (8, (
        "eval/scoring/metrics.py", "eval/scoring/pairing.py", "eval/scoring/pooling.py",
        "eval/scoring/regions.py", "eval/scoring/score.py",
    )),
}  # fmt: skip
"""How many mutations are drawn of each area, and its files."""
NAMED, UNCHANGED_AREA = "named", "no change"
KINDS = RED, MISSED, NO_EFFECT = "red", "missed", "no effect"
GREEN = "green"
"""What the recipe says of a fault until the broad runs were made."""
LIMIT_S = 900
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Unchanged:
    """What must change no number: an edit of the copy, or another environment.

    Attributes:
        name: what is done.
        edit: of a file's text, and which.
        environment: variables of the process.
        is_cold: whether there are no compiled kernels.
    """

    name: str
    file: str = ""
    edit: Callable[[str], str] = str
    environment: dict[str, str] = field(default_factory=dict)
    is_cold: bool = False

    def applied(self, text: str) -> str:
        """The file's text with the edit."""
        after = self.edit(text)
        if after == text:
            raise ValueError(f"{self.name}: changes nothing of {self.file}")
        return after


def _renamed(before: str, after: str) -> Callable[[str], str]:
    return lambda text: re.sub(rf"\b{before}\b", after, text)


UNCHANGED = (
    Unchanged("the code as it is"),
    Unchanged("a comment", "emvs/dsi/rays.py", lambda text: text + "# The end.\n"),
    Unchanged("lines moved down", "emvs/depth/depth_map.py", lambda text: text.replace(
        "\n\n\n", "\n\n\n\n\n")),
    Unchanged("a renamed variable", "emvs/depth/depth_map.py", _renamed("picked", "taken_from")),
    Unchanged("a renamed variable of a kernel", "emvs/dsi/voting_kernels.py",
              _renamed("right", "rightwards")),
    Unchanged("statements in another order", "emvs/depth/depth_map.py", lambda text: text.replace(
        "    masks = np.stack([m.mask for m in maps])\n"
        "    confidence = np.stack([m.confidence for m in maps])\n",
        "    confidence = np.stack([m.confidence for m in maps])\n"
        "    masks = np.stack([m.mask for m in maps])\n")),
    Unchanged("one thread", environment={"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}),
    Unchanged("four threads", environment={"NUMBA_NUM_THREADS": "4"}),
    Unchanged("a generic processor", environment={"NUMBA_CPU_NAME": "generic"}),
    Unchanged("no compiled kernels", is_cold=True),
)  # fmt: skip

WARM = tuple(one.name for one in UNCHANGED[:3])
"""Whose kernels all lie there: of these the CPU time is the recipe's."""


def code():
    """What decides the numbers of the table."""
    names = (
        "stages.simulate", "stages.map", "stages.score", "gate.baseline", "gate.compare",
        "results.series",
    )  # fmt: skip
    own = Code(
        functions=("recipe_runs:judge_all", "recipe_runs:table", "recipe_runs:Bench",
                   "recipe_child:held", "recipe_child:differs"),
        modules=tuple(f"eventsweep.eval.{name}" for name in names),
        without=("eventsweep.eval.cli",),
    )  # fmt: skip
    return {f"{PAGE}#{MARK}": own + of_scenes(("desk", "planes", "boxes"))}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder for copies; kept")
    parser.add_argument("--seed", type=int, default=55, help="of the mutations that are drawn")
    parser.add_argument("--page", type=Path, help="page with the table's marks")
    asked = parser.parse_args()
    bench = Bench(asked.work.resolve())
    judge_all(bench, asked.seed)
    show(table(bench.verdicts()), asked.page, MARK, code)


def judge_all(bench, seed):
    """Makes the baseline of the code as it is, then plants one after the other."""
    bench.prepare()
    faults = [(NAMED, fault.name, fault) for fault in PLANTED]
    faults += [
        (area, f"{edit.file}: `{edit.before.strip()}` → `{edit.after.strip()}`", edit)
        for area, edit in drawn(seed, AREAS)
    ]
    known = bench.verdicts()
    for area, name, edit in faults:
        if name not in known:
            bench.note(name, area, *bench.planted(edit))
    for one in UNCHANGED:
        if one.name not in known:
            bench.note(one.name, UNCHANGED_AREA, *bench.unchanged(one))
    known = bench.verdicts()
    for area, name, edit in faults:
        if known[name]["kind"] == GREEN:
            bench.note(name, area, *bench.beyond(edit), known[name]["cpu_s"])


class Bench:
    """A folder with a copy of the packages, sequences, kernels, and the verdicts so far."""

    def __init__(self, work):
        self.copy, self.place, self.kernels = (
            work / "run" / "copy",
            work / "place",
            work / "kernels",
        )
        self._file, self._whole = work / "verdicts.jsonl", ""

    def verdicts(self):
        """What is known, by name: the last line about each holds."""
        lines = self._file.read_text(encoding="utf-8").splitlines() if self._file.exists() else []
        return {one["name"]: one for one in map(json.loads, lines)}

    def note(self, name, area, kind, why, cpu_s):
        """Adds a verdict."""
        facts = {"name": name, "area": area, "kind": kind, "why": why, "cpu_s": round(cpu_s, 1)}
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(facts) + "\n")
        sys.stdout.write(f"{facts}\n")
        sys.stdout.flush()

    def prepare(self):
        """Sequences, the baseline, compiled kernels, and hashes of what the broad runs write."""
        self.place.mkdir(parents=True, exist_ok=True)
        broken_copy(self.copy)
        self._whole = self._version()
        if not (self.place / "baseline.json").exists():
            update = GATE.removesuffix(" --strict") + " --update --reason first"
            three = "eventsweep simulate boxes --rig trinocular --seconds 0.1 --out three\n"
            self.ran(self._shell(f"{ONCE}{three}{MAPPED}{update}\n"))
            _folded(self.place / "desk", self.place / "folded")
        if not (self.place / "broad.json").exists():
            code, said, _ = self.ran(self._child("differs(Path('.'), None)"))
            assert code == 0, said
            (self.place / "broad.json").write_text(_last(said), encoding="utf-8")

    def unchanged(self, one):
        """Whether the recipe stays green, what it says, and its CPU time, s.

        Where the time counts, with the commands as a user types them.
        """
        broken_copy(self.copy, *([one] if one.file else []))
        cold = self.kernels.with_name("cold")
        shutil.rmtree(cold, ignore_errors=True)
        kernels = {"NUMBA_CACHE_DIR": str(cold if one.is_cold else self._seeded())}
        as_typed = one.is_cold or one.name in WARM
        command = self._shell(f"{MAPPED}{GATE}\n") if as_typed else self._held()
        code, said, cpu_s = self.ran(command, {**one.environment, **kernels})
        return (RED if code else GREEN), _last(said) if code else "", cpu_s

    def planted(self, edit: Edit):
        """Whether the recipe is red with a fault, what is red first, and CPU time, s."""
        broken_copy(self.copy, edit)
        code, said, cpu_s = self.ran(self._held(), {"NUMBA_CACHE_DIR": str(self._seeded())})
        return (RED if code else GREEN), _last(said) if code else "", cpu_s

    def beyond(self, edit: Edit):
        """What a fault is that the recipe is green with: missed, by which run, or no effect."""
        broken_copy(self.copy, edit)
        broad = self._child("differs(Path('.'), json.loads(Path('broad.json').read_text()))")
        code, said, _ = self.ran(broad, {"NUMBA_CACHE_DIR": str(self._seeded())})
        same = code == 0 and _last(said) == SAME
        return (NO_EFFECT, "") if same else (MISSED, _last(said))

    def ran(self, command, more=None):
        """Exit code of a command in `place`, what it says, and its CPU time, s."""
        for name in ("desk-maps", "planes-maps"):
            shutil.rmtree(self.place / name, ignore_errors=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        paths = os.pathsep.join(map(str, (self.copy, HERE)))
        environment = {
            **os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(self.kernels),
            "GITHUB_STEP_SUMMARY": "", **(more or {}),
        }  # fmt: skip
        process = subprocess.Popen(
            command, cwd=self.place, env=environment, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            said = process.communicate(timeout=LIMIT_S)[0]
        except BaseException as error:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            said = "does not end"
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return process.returncode, said, spent_s

    def _shell(self, text):
        program = f'eventsweep() {{ "{sys.executable}" -m eventsweep "$@"; }}\n'
        return ["sh", "-ec", program + text]

    def _child(self, call, *words):
        head = "import json, sys; from pathlib import Path; from recipe_child import *; "
        return [sys.executable, "-c", head + call, *words]

    def _held(self):
        return self._child("held(json.loads(sys.argv[1]))", _lines())

    def _seeded(self):
        """The folder of kernels, with those of the copy's version that an edit leaves alone.

        A version's kernels lie in a folder of its own, named by a hash over all their files: here
        it gets links to the whole code's, but for files that the edit reaches.
        """
        own = self.kernels / self._version()
        if own.name != self._whole and not own.is_dir():
            left_out = shutil.ignore_patterns(*(f"{stem}.*" for stem in reached(self.copy)))
            whole = self.kernels / self._whole
            shutil.copytree(whole, own, ignore=left_out, copy_function=os.link)
        return self.kernels

    def _version(self):
        asked = (
            "from eventsweep.emvs.utils.kernel_cache import kernel_version; print(kernel_version())"
        )
        done = subprocess.run(
            [sys.executable, "-c", asked], env={**os.environ, "PYTHONPATH": str(self.copy)},
            cwd=self.place, capture_output=True, text=True, check=True,
        )  # fmt: skip
        return f"eventsweep-{done.stdout.strip()}"


def reached(copy):
    """Names of the modules with kernels that differ from the checkout's, or that take from such."""
    files = {path.stem: path for path in copy.glob("*/**/*_kernels.py")}
    found = {
        stem for stem, path in files.items()
        if path.read_bytes() != (ROOT / path.relative_to(copy)).read_bytes()
    }  # fmt: skip
    waiting = set(found)
    while waiting:
        name = waiting.pop()
        users = {
            stem for stem, path in files.items() if re.search(rf"\b{name}\b", path.read_text())
        }
        waiting |= users - found
        found |= users
    return found


def _last(said):
    """The last line of what a process said."""
    return (said.strip() or "no word").splitlines()[-1][-2000:]


def _lines():
    """The recipe for one process: a gate of the first case, and one of all, as JSON."""
    pairs, commands = [], []
    for line in MAPPED.replace("\\\n", "").splitlines():
        commands.append(split(line)[1:])
        if commands[-1][0] == "score":
            pairs.append(commands)
            commands = []
    gate = split(GATE)[1:]
    first = [*split(GATE.replace(" --result planes-maps", ""))[1:], "--case", "desk"]
    return json.dumps(list(zip(pairs, (first, gate), strict=True)))


def _folded(sequence, folder):
    """A copy of a sequence whose first lens folds the image's corners over."""
    shutil.copytree(sequence, folder)
    rig = json.loads((folder / "rig.json").read_text("utf-8"))
    rig["cameras"][0]["distortion"] = [-0.55, 0.06, 0.002, -0.0015]
    text = json.dumps(rig, indent=2)
    (folder / "rig.json").write_text(text, encoding="utf-8")
    manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
    listed = {"sha256": hashlib.sha256(text.encode()).hexdigest(), "bytes": len(text)}
    manifest["files"]["rig.json"] = listed
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


def table(verdicts):
    """Counts by area, the share that is found, CPU time, and what was missed."""
    by_area = {area: Counter() for area in (NAMED, *AREAS)}
    for one in verdicts.values():
        if one["area"] in by_area:
            by_area[one["area"]][one["kind"]] += 1
    total = sum(by_area.values(), Counter())
    lines = ["| Faults | Planted | Red | Missed | No effect |", "|---|--:|--:|--:|--:|"]
    for area, counts in (*by_area.items(), ("together", total)):
        cells = (area, counts.total(), *(counts[kind] for kind in KINDS))
        lines.append(f"| {' | '.join(map(str, cells))} |")
    same = [verdicts[one.name] for one in UNCHANGED]
    green = sum(one["kind"] == GREEN for one in same)
    cold_s = max(verdicts[one.name]["cpu_s"] for one in UNCHANGED if one.is_cold)
    warm_s = statistics.median(verdicts[name]["cpu_s"] for name in WARM)
    share = 100 * total["red"] / max(total["red"] + total["missed"], 1)
    lines += [
        "",
        f"Red: {share:.0f} % of those with an effect. Green: {green} of {len(same)} variants that "
        f"change nothing. CPU time: {warm_s:.0f} s, with nothing compiled {cold_s:.0f} s.",
    ]
    missed = [one for one in verdicts.values() if one["kind"] == MISSED]
    lines += ["", "Missed:", ""] if missed else []
    lines += [f"- {one['name']} ({one['why']})" for one in missed]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
