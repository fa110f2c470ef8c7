"""All that is tuned in a check: the limits of each finding, and the numbers behind its rules.

A number stands here with its name, value, unit and meaning; a reason names where it comes from.
Page `check` shows the limits, page `studies` what hurts a map.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from eventsweep.plugins.diagnose.sharpness import Level

Verdict = Literal["good", "doubtful", "wrong"]
Range = tuple[float, float]


class Limits(NamedTuple):
    """What a check tolerates, and what it says of the rest.

    Attributes:
        unit: of the value; empty for a share or a ratio.
        usual: least and largest value that is good.
        possible: least and largest value that is not wrong.
        suspect: what is odd, in a word or two.
        meaning: for a map, and what may be the reason.
    """

    unit: str
    usual: Range
    possible: Range
    suspect: str
    meaning: str

    def verdict(self, value: float) -> Verdict:
        """Of a value."""
        return verdict_of(value, self.usual, self.possible)


def verdict_of(value: float, usual: Range, possible: Range) -> Verdict:
    """Of a value by what is usual and what is possible; NaN is wrong."""
    if not possible[0] <= value <= possible[1]:
        return "wrong"
    return "good" if usual[0] <= value <= usual[1] else "doubtful"


def _most(usual: float, possible: float) -> tuple[Range, Range]:
    """Of a value that should be small."""
    return (-np.inf, usual), (-np.inf, possible)


def _least(usual: float, possible: float) -> tuple[Range, Range]:
    """Of a value that should be large."""
    return (usual, np.inf), (possible, np.inf)


_UNITS = "implausible motion: positions in mm or cm are read as metres, or times in another unit?"
LIMITS = {
    "events": Limits(
        "events", *_least(1, 1), "camera silent",
        "a camera without events has no votes: is it the right file and stream?",
    ),
    "events-order": Limits(
        "steps", *_most(0, 0), "events not sorted",
        "windows are cut by time: events out of order are lost or mapped twice, unless they are "
        "sorted (stable)",
    ),
    # Moving heads before textured rooms send 1 to 60 on the twins, and 1 to 30 in the recordings
    # of MVSEC and TUM-VIE; a unit of time that is wrong is wrong by 1000.
    "events-rate": Limits(
        "Hz per pixel", (0.1, 300.0), (0.02, 1000.0), "unusual event rate",
        "times in a unit other than µs make rates 1000 times too high or too low (time_unit in "
        "recording.toml, --time-unit); or the sensor is too sensitive, or not enough",
    ),
    # 5 ms between two cameras make stereo worse than one (page `studies`).
    "events-time-step": Limits(
        "µs", *_most(500, 5000), "coarse time stamps",
        "events in one step share a pose, and clocks cannot be compared more finely; were they "
        "stamped per packet?",
    ),
    # Of the rarer polarity. Thresholds of DAVIS346 twins (0.143 against 0.225) give 0.39.
    "events-polarity": Limits(
        "", *_least(0.2, 0.02), "one polarity missing",
        "one polarity is missing or drowned in noise: half of the edges are lost; look at its "
        "column, its code (0 and 1, or -1 and 1) and the sensor's biases",
    ),
    # Columns or rows that a calibration has and no event ever reaches.
    "events-sensor": Limits(
        "", *_most(0.1, 0.2), "sensor not filled",
        "the calibration is for another sensor or resolution, x and y are exchanged, or a part of "
        "the sensor is silent",
    ),
    "hot-pixels": Limits(
        "", *_most(0.02, 0.3), "hot pixels",
        "their rays make streaks in the volume; --map.hot-pixels 10 leaves them out",
    ),
    "events-gaps": Limits(
        "", *_most(0.05, 0.3), "gaps in the events",
        "packets were lost, a camera began later or ended earlier, or nothing moved: windows there "
        "hold fewer rays (--map.start-s, --map.duration-s choose others)",
    ),
    "events-ceiling": Limits(
        "", *_most(0.2, np.inf), "event rate at its limit",
        "the sensor's bus, its event rate controller or the driver is at its limit: events are "
        "late or lost",
    ),
    "events-refractory": Limits(
        "µs", *_most(10_000, np.inf), "long refractory period",
        "pixels stay silent long after each event (a bias): fast edges leave few events",
    ),
    # Of the logarithm. Pixels are square; calibrations of data sets have fx / fy within 1 %.
    "focal-ratio": Limits(
        "", *_most(*np.log1p((0.03, 0.25)).tolist()), "focal lengths unequal",
        "pixels of event cameras are square: one of the two is wrong, or not in px; their order in "
        "files is fx fy cx cy",
    ),
    # From the middle, in halves of the image: within 0.15 in data sets.
    "principal-point": Limits(
        "half images", *_most(0.35, 0.8), "principal point off",
        "all rays point in wrong directions; 10 px cost a quarter of the accuracy. cx and cy are "
        "in px at this resolution and crop",
    ),
    # 4 deg is a 200 mm lens, 170 what a pinhole's f in mm or in widths makes.
    "field-of-view": Limits(
        "deg", (12.0, 140.0), (2.0, 170.0), "impossible field of view",
        "no lens is like that: is the focal length in px, or in mm or image widths?",
    ),
    # Pixels without a ray.
    "distortion": Limits(
        "", *_most(0.0, 0.02), "distortion folds",
        "the distortion folds the image onto itself: focal length and coefficients are not of one "
        "lens and resolution, in another order (k1 k2 p1 p2 k3), or of another model",
    ),
    # 0.5 cm in endoscopes, 0.6 m on DSEC's car, 2 m on a truck.
    "baseline": Limits(
        "m", (0.01, 1.0), (0.001, 5.0), "impossible baseline",
        "stereo depth is proportional to the baseline, in metres",
    ),
    # Angle between the optical axes, in fields of view: at 1 nothing is seen by both.
    "cameras-overlap": Limits(
        "deg", *_most(0.5, 0.9), "cameras look apart",
        "what only one camera sees cannot be fused; look at the rotations in T_body_cam",
    ),
    "rectification": Limits(
        "px", *_most(2.0, 5.0), "rows apart",
        "the two cameras see a point in different rows and cannot agree on its depth: lens, "
        "extrinsics or event files do not belong together",
    ),
    # Share of the events' time.
    "poses-coverage": Limits(
        "", *_least(0.9, 0.3), "poses and events apart",
        "events without a pose cannot vote: look at unit and clock of the times (time_unit of the "
        "events, unit and time_offset_us of the poses)",
    ),
    # 20 Hz cost 7 to 10 % on moving heads, 10 Hz are not enough (page `studies`).
    "poses-rate": Limits(
        "Hz", *_least(18.0, 9.0), "poses too rare",
        "motion between poses is assumed straight and uniform; heads need 50 Hz or more",
    ),
    # Share of steps in which a tracker that moves before and after stands still.
    "poses-frozen": Limits(
        "", *_most(0.05, 0.3), "poses frozen",
        "a tracker that loses the body repeats its last pose, while the camera moves on",
    ),
    "poses-jumps": Limits(
        "jumps", *_most(0, 0), "poses jump",
        "the tracker lost the body, or its world moved: windows across a jump show two scenes",
    ),
    # Heads: Grossman et al. 1988 have turns up to 780 deg/s; a hand throws a camera at 3 m/s and
    # 50 m/s². Cars brake with 10 m/s² and drive 50 m/s. Racing drones reach 40 m/s and 150 m/s²
    # (UZH-FPV, Delmerico et al. 2019), with 750 deg/s.
    "poses-speed": Limits("m/s", *_most(50.0, 150.0), "impossible motion", _UNITS),
    "poses-acceleration": Limits("m/s²", *_most(60.0, 200.0), "impossible motion", _UNITS),
    "poses-turning": Limits(
        "deg/s", *_most(900.0, 2500.0), "impossible motion",
        "implausible motion: order of the quaternion, unit of the times, or degrees read as "
        "radians?",
    ),
    # Noise that doubles every method's error is 3 mm and 0.15 deg per pose (page `studies`).
    "poses-noise": Limits(
        "mm", *_most(1.5, 5.0), "noisy poses", "3 mm and 0.15 deg double every method's error"
    ),
    # By which the nearest depth moves: the volume resolves one, and a tenth of the range ten.
    "parallax": Limits(
        "px", *_least(4.0, 1.0), "camera at rest",
        "without sideways motion there is no depth; if the camera did move, its poses are frozen "
        "or in another unit",
    ),
}  # fmt: skip
"""The limits of each finding that needs no mapping."""
BEFORE_MAPPING = {
    "distortion", "events", "events-rate", "events-sensor", "extrinsics missing", "field-of-view",
    "focal-ratio", "hot-pixels", "parallax", "poses-coverage", "poses-frozen", "poses-jumps",
    "poses-noise", "poses-rate", "reading",
}  # fmt: skip
"""If one of these is wrong, comparing alternatives is meaningless: none of them mends it."""

# Reading events.
BIN_US = 1000  # µs: width of a bin of rates
QUICK_PIECES, QUICK_US = 10, 100_000  # count, µs: the stretches that a quick check reads
MOST_TIMED = 200_000  # events of a stretch whose intervals are measured
ENOUGH_EVENTS = 1000  # events: with fewer there is no verdict on pixels
TYPICAL_RATE_HZ = 10.0  # Hz per pixel, from which a mistaken unit is told
HOT_RATIO = 10.0  # times its surroundings: so often a hot pixel fires
SILENCE_BINS = 20  # bins: longer rests are silences; moving heads are not still for so long
# A bus at its limit sends the same number of events in every millisecond.
CEILING_HZ, CEILING_WITHIN = 1e6, 0.02  # events/s, share: from where on, and how near the busiest
PICTURED = 500  # points: of a curve in the page

# Calibrations.
OBLONG = 0.15  # share: sensors that are less oblong do not show an exchange of cx and cy
ALIKE = 0.2  # share: how much a principal point may be less off in rows than in columns
RATIOS = (0.25, 1 / 3, 0.5, 2 / 3, 1.0, 1.5, 2.0, 3.0, 4.0)  # times: resolutions are simple ratios
FISHEYE_DEG = 220.0  # deg: the largest field of view of a fisheye
BENT = (0.6, 2.0)  # half diagonals, doubtful and wrong: how far distortion moves a corner
SEEN_PX = 0.01  # px: a distortion that moves no pixel so far gets no picture
RECTIFIED_US, SLICE_US = 400_000, 20_000  # µs: the stretch whose rows are compared, and its slices
FEWEST_ROWS, SHARE_OF_ROWS = 40, 6  # rows, share 1/6: rows needed, and how far they are shifted
CLEAR_ROWS = 0.3  # correlation: rows that agree less well allow no verdict

# Poses. Shorter steps show the noise of a tracker, longer ones blur a head's motion.
STEP_US = 50_000  # µs: the step over which motion is judged
NOISE_DEG = _most(0.08, 0.4)  # deg: noise of single poses, usual and possible
NOISE_RATE_HZ = 50.0  # Hz: poses that are rarer show motion instead of noise
TRACKERS_HZ = (3.0, 20_000.0)  # Hz: GPS has 5 or more, the fastest simulated trackers 1000
# Times those around, m/s, m/s²: a jump is longer, and faster than a body moves.
JUMP_TIMES, JUMP_SPEED, JUMP_ACCELERATION = 20.0, 5.0, 500.0
GAP_STEPS, GAP_S = 10, 0.05  # usual steps, s: a gap between poses is longer
SAMPLES = 9  # poses of a window whose parallax is measured
USUAL_WINDOW_S, MOST_WINDOWS = 0.5, 200  # s, count: windows where the mapper's are not known
# rad: angles in radians are pi at most, and three of them, taken for degrees, turn by no more.
MOST_AS_DEGREES = 3 * np.radians(np.pi)
LEAST_AS_RADIANS = 0.5  # rad: half a degree that the body turned, taken for radians
LEAST_OF_ORDERS = 0.05  # rad: of a body that turns less, another order is but another hand-eye

# Windows on which alternatives are compared.
WINDOWS, WINDOW_US, EVENTS = 3, 200_000, 25_000  # count, µs, events per camera
CANDIDATES = 24  # begins of windows among which those with the longest ways are chosen
FINE, COARSE = Level(1, 80), Level(2, 40)  # volumes: coarse ones tell what is worth a finer look
COARSE_SHARE = 0.4  # of the events, in coarse volumes
WIDEST_PX = 480  # px: pixels of a wider view are joined
NOTHING = 1e-3  # votes: the sharpness of an empty volume
TURNS_RAD_S = (0.4, 0.2, 0.1, 0.05)  # rad/s: steps of the search for a free turn
SQUINTS_DEG = (0.8, 0.4, 0.2)  # deg: steps of the search for a free turn of the second camera

# Trials of alternatives. Gains are in log sharpness.
MARGIN = 0.04  # gain that counts, of a convention
ONE_CAMERA = 1.5  # times the margins: one camera separates alternatives less well
DOUBTFUL = 0.75  # of a margin: a smaller gain is good
PROMISING = -0.05  # gain: what gains less is not looked at more closely
WORTH_ALL_WINDOWS, WORTH_FINE = 0.25, 0.4  # of the best gain: worth more windows, fine volumes
REFINEMENTS = 3  # rounds of the line search for an amount
FINE_TRIALS, FINE_SECONDS = 8, 3  # alternatives on fine volumes: as first, as second causes
# What windows gain with amounts of their own: right causes leave up to 0.03 of the gain, or 0.001;
# wrong ones 0.07 and more.
UNEVEN_SHARE, UNEVEN = 0.04, 0.002  # of the gain with a common amount, gain
LOSS = -0.02  # gain: what camera 0 alone may lose under other poses
# An amount is traded for another that far off: right causes lost 0.0012 and more, those with
# another fault gained.
FAR, AS_SHARP = 4, 0.001  # times what hurts, loss: if it costs no more, both may be wrong
WORTH_TRADING, READINGS = 0.02, 8  # loss in one window that is final; steps of the search

# What names a cause. Gains are in log sharpness.
DECISIVE = 0.1  # gain on average, half as much in each window
BEYOND_FREE = 1.5  # times what free turns gain: less may be any small fault
# Gain where the camera, or the second one on the rig, may turn freely: more, or more in a single
# window by so many times, and poses and events do not fit, before or after a cure.
LEFT, LEFT_SQUINT, LEFT_IN_ONE = 0.01, 0.03, 2.5  # gain, gain, times
# How much less well than two halves of one camera's events cameras agree after a cure, and where
# nothing helps: of 43 sound recordings one reached 0.15, the others 0.06.
DISAGREE, APART = 0.08, 0.2  # loss
NOTHING_LEFT = 0.01  # gain of free turns: with less no second convention is looked for
LIKELY, MOST_LIKELY = 0.5, 4  # of the best gain, count: what may be the cause
CLEAR = 2  # margins: what a first cure leaves over looks like a small second fault
RIVAL = 0.75  # of the gain: another cause that explains as well
BARS = 12  # alternatives in the page, the best ones
