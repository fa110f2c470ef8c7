"""The GPU backend: in numba's simulator, and what it says where there is no GPU.

The tests of the kernels are in `cuda_*.py`. The simulator is chosen by an environment variable that
numba reads when it is imported, so they run in a process of their own. On a machine with an NVIDIA
GPU they run on it: `python -m pytest plugins/cuda/tests/cuda_*.py`.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from places import ROOT

TESTS = Path(__file__).parent
SIMULATED = {"NUMBA_ENABLE_CUDASIM": "1"}
NO_GPU = {"CUDA_VISIBLE_DEVICES": "-1"}


def run(*command, **variables):
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    return subprocess.run(
        [sys.executable, *command], env=kept | variables, cwd=ROOT, capture_output=True,
        text=True, timeout=600, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    "names", [("votes", "fold"), pytest.param(("maps",), marks=pytest.mark.slow)], ids="-".join
)
def test_in_the_simulator(names, request):
    # Without this interval a Python thread that waits for others keeps them from running.
    start = "import sys, pytest; sys.setswitchinterval(1e-5); sys.exit(pytest.main(sys.argv[1:]))"
    slow = ["--run-slow"] if request.config.getoption("--run-slow") else []
    files = [str(TESTS / f"cuda_{name}.py") for name in names]
    found = run("-c", start, "-p", "no:cacheprovider", *slow, *files, **SIMULATED)
    assert found.returncode == 0, found.stdout[-5000:]
    assert re.search(r"^\.+", found.stdout, re.MULTILINE), found.stdout


# numba brings a numba.cuda of its own, which is not the one that is asked for
WITHOUT_NUMBA_CUDA = """
import importlib.util as util
find = util.find_spec
util.find_spec = lambda name, *more: None if name == "numba_cuda" else find(name, *more)
"""


@pytest.mark.parametrize(
    ("prepared", "reason"),
    [
        (WITHOUT_NUMBA_CUDA, "numba-cuda is not installed"),
        ("", "(numba-cuda is not installed|nvidia-smi shows a GPU)"),
    ],
    ids=["numba-alone", "as-installed"],
)
def test_without_a_gpu_one_line_says_why(prepared, reason):
    asked = prepared + "from eventsweep.emvs.dsi.device import choose_device\nchoose_device('cuda')"
    found = run("-c", asked, NUMBA_ENABLE_CUDASIM="0", **NO_GPU)
    assert found.returncode == 1
    last = found.stderr.strip().splitlines()[-1]
    assert re.search(f"InputError: device cuda cannot be used: .*{reason}", last), last
    assert last.endswith("or choose device cpu")


def test_without_a_gpu_auto_takes_the_cpu_and_says_so():
    asked = (
        "from eventsweep.emvs.dsi.device import CPU, choose_device\n"
        "assert choose_device('auto') == CPU"
    )
    found = run("-c", asked, NUMBA_ENABLE_CUDASIM="0", **NO_GPU)
    assert found.returncode == 0, found.stderr
    assert "device auto took the CPU: " in found.stderr


def test_the_mapper_does_not_load_a_gpus_library():
    asked = (
        "import sys, eventsweep.emvs.mapper; assert 'eventsweep.plugins.cuda' not in sys.modules"
    )
    assert run("-c", asked).returncode == 0
