"""What all tests share: the slow switch, hypothesis's profile, the reference data's place."""

import gc
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Two test processes share two cores: a thread that spins while it waits takes the other's time.
# OpenBLAS's threads always do, and cost 30 times what a product of (N, 3) points by a matrix takes.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in every run, so that nobody's change turns red by another's luck;
# HYPOTHESIS_RANDOM=1 in the environment draws new ones.
#
# Compiling a kernel can take seconds, so a deadline per example would only measure the compiler.
settings.register_profile(
    "eventsweep",
    deadline=None,
    derandomize=not os.environ.get("HYPOTHESIS_RANDOM"),
    max_examples=int(os.environ.get("HYPOTHESIS_EXAMPLES", "20")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("eventsweep")

# Tests share what they keep among themselves, and with nobody else: no textures of yesterday's code
# that a fault in the cache would pass on. Processes that this one starts inherit it.
if "EVENTSWEEP_CACHE" not in os.environ:
    _CACHE = tempfile.TemporaryDirectory(prefix="eventsweep-tests-")
    os.environ["EVENTSWEEP_CACHE"] = _CACHE.name

SHARED = Path(__file__).resolve().parents[1] / "shared"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--run-slow", action="store_true", help="also run the tests that take minutes")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--run-slow"):
        return
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(pytest.mark.skip(reason="slow: add --run-slow"))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Keeps Python's collector of cycles from looking through all tests and modules, which stay.

    While they are read it would take a quarter of the time, and a tenth of a second each time
    that it looks through everything.
    """
    gc.disable()
    yield
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings beside the project."""
    if not (SHARED / "data").exists():
        pytest.skip("no real recordings beside the project")
    return SHARED / "data"


@pytest.fixture(scope="session")
def shared_reference() -> Path:
    """The folder of golden numbers beside the project."""
    if not (SHARED / "reference").exists():
        pytest.skip("no golden numbers beside the project")
    return SHARED / "reference"


@pytest.fixture(scope="module")
def blank_figures():
    """For tests that make a page on their way to something else."""
    from blank_pictures import blank_figures

    with blank_figures():
        yield


@pytest.fixture(scope="module")
def jobs_in_this_process():
    """Jobs of suites and studies run here: a process of its own for each run takes 3 s to start."""
    from in_process import in_process

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eventsweep.eval.jobs.local.local_workers", in_process)
        yield
