"""A GPU as one of the core's devices: refused in time, part of a job's key, the same fusions."""

from types import SimpleNamespace

import pytest

from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import key_of
from eventsweep.eval.stages import simulate
from eventsweep.eval.suite.definition import read
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.plugins.cuda import device
from eventsweep.plugins.cuda import fusion_kernels as cuda_kernels
from refusals import command_refused
from small_suite import case, suite_text


def suite_on(folder, name):
    """A suite whose second mapper runs on a device."""
    mappers = {
        "default": {"methods": ["Alg1/H", "EMVS/cam0"], "planes": 30},
        "other": {"methods": ["Alg1/H"], "device": name},
    }
    file = folder / "suite.toml"
    file.write_text(suite_text(case("wall", mappers=list(mappers)), mappers=mappers))
    return read(file)


def test_a_gpu_that_is_not_there_is_refused_before_the_first_job(tmp_path, monkeypatch):
    suite = suite_on(tmp_path, "cuda")
    monkeypatch.setattr(device, "missing", lambda: "it is gone")
    with pytest.raises(InputError, match="device cuda cannot be used: it is gone"):
        suite_jobs(suite, ("wall",), (0,))


def test_a_map_by_the_gpu_is_another_job_than_one_by_the_cpu(tmp_path, monkeypatch):
    monkeypatch.setattr(device, "missing", lambda: None)
    monkeypatch.setattr(device, "gpu", lambda: SimpleNamespace(name="some GPU"))
    parameters = []
    for name in ("cpu", "cuda"):
        suite = suite_on(tmp_path, name)
        (score,) = suite_jobs(suite, ("wall",), (0,))
        parameters.append([need.parameters for need in score.needs])
    here, there = parameters
    assert here[:3] == there[:3]  # the sequence, and two windows by the other mapper
    assert all(key_of(one) != key_of(other) for one, other in zip(here[3:], there[3:], strict=True))
    assert len(here) == 5


def test_a_run_without_its_gpu_is_refused_before_it_simulates(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(device, "missing", lambda: "it is gone")
    monkeypatch.setattr(simulate, "simulate_scene", None)
    arguments = ["run", "planes", "--out", tmp_path / "o", "--device", "cuda"]
    assert "device cuda cannot be used: it is gone" in command_refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_both_back_ends_have_the_same_means_in_the_same_order():
    row = fusion_kernels._mean_row.py_func
    names = [name for name in row.__code__.co_names if name.startswith("_")]
    there = [getattr(mean, "py_func", mean) for mean in cuda_kernels.MEANS]
    assert [getattr(mean, "__name__", mean) for mean in there] == names
    assert len(names) == len(fusion_kernels.CODES)
