"""Jobs of the test stage, and the log of what they did."""

import pytest

from eventsweep.eval.jobs.job import Job


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log"


@pytest.fixture
def make(log):
    """A function that makes jobs of the test stage."""

    def job(name, act="write", needs=(), **more):
        facts = {"id": name, "act": act, "log": str(log), **more}
        return Job(name, "job_stages", facts, tuple(needs))

    return job
