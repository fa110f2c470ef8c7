"""What a suite costs, reckoned from runs of parts of it.

`python tests/benchmarks suite_cost DIR... --page docs/suite.md` writes the table of the page. Every
`suite.json` says what its jobs took, in time of processors, whenever they were done. What was not
run is reckoned from what was: another seed of a case costs as much as the case's mean. Sequences of
an archive are unpacked instead of simulated.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.suite.definition import GATED, Suite, load
from eventsweep.eval.suite.results import JobNote, read_suite
from markdown_blocks import show

MARK = "cost"
STAGES = ("simulate", "unpack", "tell", "map", "predict", "score")

Took = dict[tuple[str, str], dict[str, float]]
"""By case and seed, what each stage took, s of processors."""


def main() -> int:
    """Prints and writes the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path, nargs="+", help="what `eventsweep suite --out` wrote")
    parser.add_argument("--suite", default=GATED, help="whose cost is reckoned")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--mark", default=MARK, help="name of the page's part for it")
    asked = parser.parse_args()
    with exit_code() as code:
        suite, _ = load(asked.suite)
        jobs = {job.name: job for run in asked.runs for job in _jobs(run, suite)}
        text = table(suite, took(jobs.values())) + outcomes(jobs.values())
        show(text, asked.page, asked.mark)
    return code.value


def _jobs(run: Path, suite: Suite) -> Iterable[JobNote]:
    result = read_suite(run)
    if result.digest != suite.digest:
        raise InputError(f"{run}: a run of {result.suite} {result.digest}, not of {suite.name}")
    return result.jobs


def took(jobs: Iterable[JobNote]) -> Took:
    """Sums the jobs of every sample; one of which a job failed, or has no cost, is left out."""
    found: Took = {}
    unknown = set()
    for job in jobs:
        stage, case, seed, *_ = job.name.split("/")
        if job.failure or not job.cpu_seconds:
            unknown.add((case, seed))
        stages = found.setdefault((case, seed), dict.fromkeys(STAGES, 0.0))
        stages[stage] += job.cpu_seconds
    return {sample: stages for sample, stages in found.items() if sample not in unknown}


def outcomes(jobs: Collection[JobNote]) -> str:
    """Markdown: how many jobs there were, and how many of them failed."""
    failed = sum(bool(job.failure) for job in jobs)
    return f"\n{len(jobs)} jobs; {failed or 'none'} of them failed.\n"


def table(suite: Suite, found: Took) -> str:
    """Markdown: a line per case with what was run and what all its seeds cost, then the sum.

    Args:
        suite: the definition.
        found: what was run of it.
    """
    stages = [s for s in STAGES if any(one[s] for one in found.values())]
    lines = [
        f"| Case | seeds run | {', s | '.join(stages)}, s | all seeds, min | of it run, min |",
        "|---|" + "--:|" * (len(stages) + 3),
    ]
    total_s = run_s = 0.0
    missing = []
    for case in suite.cases:
        its = [(case, f"seed{seed}") for seed in suite.seeds]
        samples = [found[sample] for sample in its if sample in found]
        if not samples:
            missing.append(case)
            continue
        means = {stage: sum(one[stage] for one in samples) / len(samples) for stage in stages}
        all_s = sum(means.values()) * len(suite.seeds)
        its_s = sum(sum(one.values()) for one in samples)
        cells = [f"{means[stage]:.1f}" for stage in stages]
        cells += [f"{all_s / 60:.1f}", f"{its_s / 60:.1f}"]
        lines.append(f"| `{case}` | {len(samples)}/{len(suite.seeds)} | {' | '.join(cells)} |")
        total_s, run_s = total_s + all_s, run_s + its_s
    lines.append(f"| together |{' |' * (len(stages) + 1)} {total_s / 60:.0f} | {run_s / 60:.0f} |")
    end = f"\nNot run, and not in the sum: {', '.join(missing)}.\n" if missing else ""
    return "\n".join(lines) + "\n" + end


if __name__ == "__main__":
    raise SystemExit(main())
