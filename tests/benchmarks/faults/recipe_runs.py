"""Plants faults and runs the recipe of the page `gate` with each: does it turn red?

`python tests/benchmarks recipe_runs --work out/recipe` plants those of `PLANTED` and, of a seed,
random mutations of mapper, extraction and scoring: in a copy of the packages it maps and scores one
sequence and holds the numbers against those of the code as it is, strictly. Verdicts are lines of
`WORK/verdicts.jsonl`: a run that was stopped goes on where it was.
"""

import argparse
import json
import os
import resource
import sys
from pathlib import Path

import fault_runs
from mutations import drawn
from planted_faults import Fault, broken_copy

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
        "emvs/dsi/*.py", "emvs/geometry/*.py", "emvs/mapper.py", "emvs/reference_view.py",
        "emvs/windows.py",
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
SEQUENCE = ("desk", "--rig", "oblique", "--seconds", "0.2", "--seed", "0")
METHODS = ("all", "Alg2/AtHc@4", "Alg2/HtAc@4", "Late/union")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder for copies; kept")
    parser.add_argument("--seed", type=int, default=55, help="of the mutations that are drawn")
    asked = parser.parse_args()
    verdicts = asked.work / "verdicts.jsonl"
    judge_all(asked.work.resolve(), asked.seed, verdicts)


def read(path):
    """The verdicts, in the order in which they were made."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def judge_all(work, seed, verdicts):
    """Makes the baseline of the code as it is, checks that it repeats, and plants one by one."""
    work.mkdir(parents=True, exist_ok=True)
    os.environ["NUMBA_CACHE_DIR"] = str(work / "kernels")
    copy = work / "run" / "copy"
    known = {verdict["name"] for verdict in read(verdicts)} if verdicts.exists() else set()
    if "(none)" not in known:
        broken_copy(copy)
        made(copy, work)
        update = ("--update", "--reason", "the code as it is")
        fault_runs.run(copy, "gate", "--baseline", work / "b.json", "--result", work / "m", *update)
        note(verdicts, "(none)", "", *judged(copy, work))
    planted = [("planted", fault.name, fault) for fault in PLANTED]
    planted += [
        (area, f"{edit.file}: {edit.before.strip()} -> {edit.after.strip()}", edit)
        for area, edit in drawn(seed, AREAS)
    ]
    for area, name, edit in planted:
        if name not in known:
            note(verdicts, name, area, *judged(broken_copy(copy, edit), work))


def judged(copy, work):
    """Whether the recipe is red in a copy of the packages, what comes first, and CPU time, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        made(copy, work)
        held = ("--baseline", work / "b.json", "--result", work / "m", "--strict", "--json")
        code, text = fault_runs.run(copy, "gate", *held)
        reds = [verdict for verdict in json.loads(text) if verdict["is_red"]]
        first = " ".join(reds[0][part] for part in ("method", "metric", "status")) if reds else ""
    except fault_runs.TooSlow:
        code, first = 1, "does not end"
    except AssertionError as error:
        last = (str(error).strip() or "no word").splitlines()[-1]
        code, first = 1, f"ends with: {last[:90]}"
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return code, first, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def made(copy, work):
    """Simulates once, maps and scores."""
    if not (work / "seq").is_dir():
        fault_runs.run(copy, "simulate", *SEQUENCE, "--out", work / "seq", "--quiet")
    methods = [word for method in METHODS for word in ("--method", method)]
    fault_runs.run(copy, "map", work / "seq", "--out", work / "m", *methods, "--force", "--quiet")
    fault_runs.run(copy, "score", work / "m", "--quiet")


def note(verdicts, name, area, code, first, cpu_s):
    """Adds a line about a fault."""
    facts = {
        "name": name,
        "area": area,
        "red": bool(code),
        "first": first,
        "cpu_s": round(cpu_s, 1),
    }
    with verdicts.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(facts) + "\n")
    sys.stdout.write(f"{facts}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
