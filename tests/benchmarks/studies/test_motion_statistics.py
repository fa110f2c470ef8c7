"""Head-motion statistics: right on motions whose numbers are known, and printed as a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from eventsweep.emvs.data.poses import write_tum
from eventsweep.sim.motion.curves import sampled
from eventsweep.sim.motion.head_motion import generate
from eventsweep.sim.motion.head_styles import STYLES
from motion_statistics import main, recorded, statistics
from places import SHARED

REAL = SHARED / "data"


@dataclass(frozen=True)
class Sine:
    """A body that swings sideways at one frequency."""

    frequency_hz: float
    amplitude_m: float

    def T_world_body(self, t_s):
        pose = np.eye(4)
        pose[0, 3] = self.amplitude_m * np.sin(2 * np.pi * self.frequency_hz * t_s)
        return pose


def test_a_sine_has_the_numbers_of_a_sine():
    found, omega = statistics(Sine(1.5, 0.1), 20), 2 * np.pi * 1.5
    assert found.speed_m_s.maximum == pytest.approx(0.1 * omega, rel=1e-3)
    assert found.speed_m_s.median == pytest.approx(0.1 * omega / np.sqrt(2), rel=0.02)
    assert found.acceleration_m_s2.maximum == pytest.approx(0.1 * omega**2, rel=1e-3)
    assert found.rate_rad_s.maximum == pytest.approx(0, abs=1e-9)
    assert found.acceleration_hz == pytest.approx(1.5, abs=0.07)


def test_a_recording_has_the_statistics_of_its_motion(tmp_path):
    motion = generate("six_dof", 20, 0)
    write_tum(tmp_path / "a.txt", sampled(motion, 20, 120))
    found, exact = statistics(recorded(tmp_path / "a.txt"), 20), statistics(motion, 20)
    for name in ("speed_m_s", "acceleration_m_s2", "rate_rad_s", "angular_acceleration_rad_s2"):
        assert getattr(found, name).median == pytest.approx(getattr(exact, name).median, rel=0.02)


def test_the_command_prints_one_row_per_motion(tmp_path, capsys):
    write_tum(tmp_path / "a.tum.txt", sampled(generate("walk", 3, 0), 3, 120))
    assert main([str(tmp_path / "a.tum.txt"), "--seconds", "3"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")][2:]
    assert len(rows) == 1 + len(STYLES)
    assert rows[0].startswith("| a.tum.txt | 3 |")
    assert len({row.count("|") for row in rows}) == 1


def test_the_command_refuses_in_one_line(tmp_path, capsys):
    assert main([str(tmp_path / "none.txt")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_six_dof_moves_as_real_heads_and_hands_do():
    paths = [REAL / f"tumvie/mocap-{n}.tum.txt" for n in ("6dof", "desk")]
    paths.append(REAL / "rpg_eccv18/boxes.tum.txt")
    if not all(path.is_file() for path in paths):
        pytest.skip("needs ../shared/data, which is not part of the project")
    motions = [recorded(path) for path in paths]
    real = [statistics(motion, motion.duration_s) for motion in motions]
    ours = statistics(generate("six_dof", 60, 0), 60)
    for name in ("speed_m_s", "acceleration_m_s2", "rate_rad_s", "angular_acceleration_rad_s2"):
        for percentile in ("median", "p95"):
            values = [getattr(getattr(one, name), percentile) for one in real]
            low, high = 0.9 * min(values), 1.1 * max(values)
            assert low <= getattr(getattr(ours, name), percentile) <= high, (name, percentile)
