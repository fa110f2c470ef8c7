"""How heads move: the parameters, and the values of each style.

Where values come from; [a]: the abstract or table was read, [m]: quoted from memory, not verified.

- walking speed, 1.4 m/s: 1.30 ± 0.15 m/s preferred: Kavanagh, Morrison, Barrett, Eur. J. Appl.
  Physiol. 2005 [a]
- walking steps, 2.0 Hz: 2 Hz (SD 0.13); 1.95 ± 0.19 Hz: MacDougall and Moore, J. Appl. Physiol.
  2005 [a]
- head yaw at half the step rate, yes: Grasso, Glasauer, Takei, Berthoz [a]; Grossman et al. 1988
  [a]
- head pitch against the bob, 1.6° at 4.5 cm: Hirasaki et al., Exp. Brain Res. 1999; Pozzo et al.
  1990 [m]
- bob and sway in walking, 4.5 cm, 5 cm peak to peak: Murray et al., J. Bone Joint Surg. 1964;
  Hirasaki et al. 1999 [m]
- running steps and speed, 2.8 Hz at 3.0 m/s: 2.83 steps/s at 3.0 m/s: Lieberman et al., J. Exp.
  Biol. 2015 [a]
- bob in running, 8 cm peak to peak: Cavagna et al. [m]
- head rotation in gait, below 90°/s (tested): Grossman et al., Exp. Brain Res. 1988 [a]
- vigorous shaking, 1.4–2.6 Hz, up to some 600°/s: at most 2.6 Hz, 780°/s median of the maxima in
  yaw: Grossman et al. 1988 [a]
- profile of a turn, minimum jerk: Flash and Hogan, J. Neurosci. 1985 [m]
- skate, bike, 2.6 m/s; 4.8 m/s: our choice: no published head data found
"""

from __future__ import annotations

from dataclasses import dataclass

from eventsweep.sim.motion.curves import Vector3

Band = tuple[float, float]

KNOT_HZ = 100.0  # of the generators' splines: they carry up to a fifth of it


@dataclass(frozen=True, kw_only=True)
class HeadStyle:
    """A way of moving the head. Lengths are forward, left, up; angles pitch, yaw, roll.

    Attributes:
        summary: how the head moves, in a few words.
        speed_m_s: along the way.
        path_m: corners (x, y) of the way, from the head's start; straight on after the last.
        corner_s: time over which a corner is rounded.
        step_hz: steps, pushes or pedal strokes per second; 0 for none.
        bob_m: peak to peak, up and down, once per step.
        sway_m: peak to peak, left and right, once per two steps.
        surge_m: peak to peak, forward and back, once per step.
        impact: share of the bob that the second harmonic adds (a hard foot strike).
        pitch_deg: amplitude once per step, against the bob, as the head keeps its gaze.
        yaw_deg: amplitude once per two steps, against the sway.
        roll_deg: amplitude once per two steps.
        unevenness: relative variation of the amplitudes, and of the phase in turns.
        gaze_hz: gaze shifts per second, on average; 0 for none.
        gaze_deg: standard deviation of the fixated directions, pitch and yaw.
        shift_s: duration of a vanishingly small head turn.
        shift_s_deg: how much longer it takes per degree.
        drift_m: rms of the slow wandering of the head.
        drift_deg: rms of its slow turning.
        drift_hz: band of both.
        vibration_m: rms of the fast shaking (road, wheels).
        vibration_deg: rms of its turning.
        vibration_hz: band of both.
    """

    summary: str = ""
    speed_m_s: float = 0.0
    path_m: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.0))
    corner_s: float = 1.5
    step_hz: float = 0.0
    bob_m: float = 0.0
    sway_m: float = 0.0
    surge_m: float = 0.0
    impact: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    unevenness: float = 0.05
    gaze_hz: float = 0.0
    gaze_deg: tuple[float, float] = (0.0, 0.0)
    shift_s: float = 0.3
    shift_s_deg: float = 0.006
    drift_m: Vector3 = (0.0, 0.0, 0.0)
    drift_deg: Vector3 = (0.0, 0.0, 0.0)
    drift_hz: Band = (0.1, 0.5)
    vibration_m: Vector3 = (0.0, 0.0, 0.0)
    vibration_deg: Vector3 = (0.0, 0.0, 0.0)
    vibration_hz: Band = (4.0, 10.0)


# Way and steps, angles of steps, gaze, slow drift, fast vibration
STYLES: dict[str, HeadStyle] = {
    "seated": HeadStyle(
        summary="somebody sits and looks around",
        gaze_hz=0.45, gaze_deg=(7, 18),
        drift_m=(0.02, 0.025, 0.008), drift_deg=(1.5, 2, 1),
        vibration_m=(4e-4, 4e-4, 4e-4), vibration_deg=(0.15, 0.15, 0.12), vibration_hz=(1.5, 5.0),
    ),
    "translate_1d": HeadStyle(
        summary="from side to side, hardly turning",
        drift_m=(0.004, 0.12, 0.004), drift_deg=(0.6, 0.8, 0.6), drift_hz=(0.25, 0.4),
        vibration_m=(1e-3, 1e-3, 1e-3), vibration_deg=(0.3, 0.3, 0.25), vibration_hz=(1.5, 5.0),
    ),
    "translate_3d": HeadStyle(
        summary="along all three axes, hardly turning",
        drift_m=(0.09, 0.12, 0.08), drift_deg=(1, 1.3, 1), drift_hz=(0.2, 0.4),
        vibration_m=(1e-3, 1e-3, 1e-3), vibration_deg=(0.3, 0.3, 0.25), vibration_hz=(1.5, 5.0),
    ),
    "six_dof": HeadStyle(
        summary="along and about all axes, as in a motion-capture room",
        gaze_hz=0.15, gaze_deg=(4, 9),
        drift_m=(0.1, 0.12, 0.07), drift_deg=(4, 6.5, 3.5), drift_hz=(0.22, 0.42),
        vibration_m=(2.3e-3, 2.3e-3, 2.3e-3), vibration_deg=(0.62, 0.62, 0.5),
        vibration_hz=(1.5, 5.0),
    ),
    "shake": HeadStyle(
        summary="quick turns left and right on the spot",
        unevenness=0.1,
        drift_m=(0.012, 0.012, 0.008), drift_deg=(5, 16, 4), drift_hz=(1.4, 2.6),
    ),
    "walk": HeadStyle(
        summary="walking at 1.4 m/s, two steps a second",
        speed_m_s=1.4, step_hz=2.0, bob_m=0.045, sway_m=0.05, surge_m=0.015, impact=0.1,
        pitch_deg=1.6, yaw_deg=1.8, roll_deg=1.0,
        gaze_hz=0.35, gaze_deg=(5, 12),
        drift_m=(0.01, 0.02, 0.003), drift_deg=(1.2, 2, 0.8),
    ),
    "run": HeadStyle(
        summary="running at 3 m/s, hard foot strikes",
        speed_m_s=3.0, step_hz=2.8, bob_m=0.08, sway_m=0.03, surge_m=0.02, impact=0.15,
        pitch_deg=2.6, yaw_deg=2.4, roll_deg=1.4,
        gaze_hz=0.25, gaze_deg=(4, 8),
        drift_m=(0.01, 0.03, 0.005), drift_deg=(1.2, 2, 1),
        vibration_deg=(0.1, 0.08, 0.08), vibration_hz=(6.0, 12.0),
    ),
    "skate": HeadStyle(
        summary="gliding at 2.6 m/s, one push a second",
        speed_m_s=2.6, step_hz=1.0, bob_m=0.04, sway_m=0.1, surge_m=0.06,
        pitch_deg=1.2, yaw_deg=2.5, roll_deg=1.8, unevenness=0.1,
        gaze_hz=0.3, gaze_deg=(4, 9),
        drift_m=(0.02, 0.05, 0.01), drift_deg=(1.5, 2.5, 1.2),
        vibration_m=(2e-4, 2e-4, 6e-4), vibration_deg=(0.08, 0.05, 0.05),
    ),
    "bike": HeadStyle(
        summary="cycling at 4.8 m/s over a shaking road",
        speed_m_s=4.8, corner_s=2.5, step_hz=2.4, bob_m=0.008, sway_m=0.03, surge_m=0.008,
        pitch_deg=0.4, yaw_deg=0.6, roll_deg=1.0,
        gaze_hz=0.3, gaze_deg=(4, 12),
        drift_m=(0.02, 0.06, 0.01), drift_deg=(1, 2, 1.2),
        vibration_m=(3e-4, 3e-4, 1e-3), vibration_deg=(0.12, 0.06, 0.06),
    ),
}  # fmt: skip
