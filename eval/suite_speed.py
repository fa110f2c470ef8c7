"""Measures the mapper's speed on one sequence of a suite's run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from emvs.config import MapperConfig
from eval.jobs.cache import Cache
from eval.jobs.job import SEQUENCE, entry
from eval.speed_ratio import map_ratios
from eval.suite import Suite
from eval.suite_jobs import suite_jobs
from eval.suite_rows import SuiteResult


def with_speed(result: SuiteResult, suite: Suite, cache: Path) -> SuiteResult:
    """The result, with the ratio of the suite's speed case; unchanged if that was not run."""
    seeds = [sample.seed for sample in result.samples if sample.case == suite.speed_case]
    if suite.speed_case is None or not seeds:
        return result
    (score,) = suite_jobs(suite, [suite.speed_case], seeds[:1])
    sequence, mapping = score.needs[:2]
    path = entry(sequence, Cache(cache)).path / SEQUENCE
    config = MapperConfig.model_validate(mapping.parameters["map"])
    return replace(result, speed={suite.speed_case: map_ratios(path, config)})
