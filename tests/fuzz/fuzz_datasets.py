"""Fuzzes the readers of data sets: `python tests/fuzz/fuzz_datasets.py [N ...]`.

As `fuzz_events.py`, whose process, damages and bounds it uses: of a sound miniature one file is
damaged or taken away, everything that a reader offers is read, and the end is a sound recording or
an `InputError` of one line that names a file of it. What is taken away must be missed.
"""

import copy
import json
import re
import shutil
import sys
from pathlib import Path

# Run as a program, too: what it shares with the tests lies beside its folder.
SHARED = "helpers", "helpers/recordings", "helpers/simulation", "reference"
sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in SHARED]

import numpy as np
import yaml

import calibration_files as single
import dataset_files
import dataset_world as world
import fuzz_events
import rover
from eventsweep.emvs.data.image_stores import frame_cameras
from eventsweep.emvs.data.poses import read_poses, write_kitti, write_tum
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import dsec, open_recording
from eventsweep.emvs.datasets.custom import read_descriptor, read_hand_eye
from eventsweep.emvs.datasets.dsec import rectification_of
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import calibration_writers as rigs
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.formats.calibration_values import parsed
from eventsweep.emvs.utils.output_manifest import NAME as MARKER
from eventsweep.scoring import score_trajectory
from eventsweep.sim.mjcf import model_of
from eventsweep.sim.sensor_presets import read_preset

SPARE = {
    "rectify_map.h5", "images.txt", "frame_00000000.png", "hand_eye.yaml", MARKER,
    "plane_depth_gt.h5", "dataset_depth.npz", "dataset_extrinsics.npz", "calib_results_imu.txt",
}  # fmt: skip
"""What a recording may lack: hand-eye where poses are then the first camera's; whose it is."""
MODEL = {"tumvie": "kb4", "tumvie-vio": "kb4", "mvsec": "kb4", "m3ed": "kb4", "evimo2": "kb4"}
FRAMES = {
    "vector-frames": ("*_camera/*", "calib/*_regular_*", "calib/*joint*"),
    "m3ed-frames": ("*_data.h5",),
}  # fmt: skip
"""Files of a layout's frame cameras."""
LAYOUTS = ("dsec", "tumvie", "tumvie-vio", "mvsec", "rosbag1", "evt3")
FOLDERS = ("sequence", *LAYOUTS, *dataset_files.SINGLE, *dataset_files.WRITERS, *FRAMES)
T_ON_IMU = {"T_cam_imu": single.TURN.tolist()}
OTHERS = {
    "ros": single.lens_of_ros(baseline_m=0.1), "pair": single.lens_of_ros(single.TURN),
    "euroc": single.euroc(single.TURN), "aslam": single.aslam(np.eye(4), single.TURN),
    "dv": single.dv(), "imu-chain": {k: v | T_ON_IMU for k, v in single.chain().items()},
    "message": {
        "height": 48, "width": 64, "distortion_model": "plumb_bob", "D": [-0.1, 0.01, 0, 0, 0],
        "K": [50.0, 0, 32, 0, 51, 24, 0, 0, 1],
    },
}  # fmt: skip
"""Calibrations as other programs write them."""
RIGS = ("kalibr", "basalt", "rig", "opencv", "cam_to_cam", "hand_eye", "marker", *OTHERS)
TABLES = {
    "named": "time_us;qw;qx;qy;qz;z;y;x\n{t};{qw};{q[0]};{q[1]};{q[2]};{p[2]};{p[1]};{p[0]}\n",
    "euroc-poses": "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], "
    "q_RS_x [], q_RS_y [], q_RS_z []\n{t}000,{p[0]},{p[1]},{p[2]},{qw},{q[0]},{q[1]},{q[2]}\n",
    "kitti": "",
}
"""A header, and a line per pose."""
POSES = ("tum", "csv", "scored", *TABLES)
MAKERS = {
    "mjcf": (rover.write, model_of), "urdf": (rover.write_urdf, model_of),
    "descriptor": (
        '[[events]]\nfile = "e.csv"\ncolumns = {x = "u", y = "v", t = "t", p = "on"}\n'
        '[poses]\nfile = "p.txt"\nunit = "s"\ntime_offset_us = 5\n'
        '[calibration]\nfile = "c.yaml"\ncameras = ["cam0"]\n',
        read_descriptor,
    ),
    "preset": (
        "contrast_threshold_pos = 0.2\nrefractory_period_us = 100\n[sensor]\n"
        "shot_pair_rate_hz = 0.1\nleak_rate_hz = 0.1\n", read_preset,
    ),
}  # fmt: skip
TEXTS = (*POSES, *MAKERS)
KINDS = [
    *FOLDERS, *RIGS, *(f"{kind}+values" for kind in RIGS), *TEXTS,
    *(f"{kind}+words" for kind in TEXTS),
]  # fmt: skip
ODD_WORDS = (
    "nan", "inf", "-1", "0", "1e308", "-1e-320", "1e30", "99999999", "2147483648", "9" * 25,
    "9" * 5000, "x", "", "..", "\u202e", "1_0", "0x10", "１２", "true",
)  # fmt: skip
ODD = (
    None, True, "", "x", [], {}, [[]], {"a": 1}, -1, 0, 1e-320, 1e308, 10**30, 10**400,
    float("nan"), float("inf"), [1, "2", None], [[1, 2], [3]], {1: 2}, "9" * 5000, list(range(5)),
)  # fmt: skip


def made(folder, kind):
    """A sound miniature: the folder or file to open."""
    kind = kind.removesuffix("-frames")
    cameras = 1 if kind in dataset_files.SINGLE else 2
    ours = world.write_sequence(folder / "ours", MODEL.get(kind, "radtan"), cameras, steps=120)
    sequence, out = Sequence.open(ours), folder / "sound"
    if kind == "sequence":
        return ours
    if kind in dataset_files.WRITERS:
        dataset_files.WRITERS[kind](sequence, out)
    elif kind in dataset_files.SINGLE:
        dataset_files.SINGLE[kind](sequence, out)
    else:
        world.rewritten(ours, out, kind.split("-")[0])
    if kind == "tumvie-vio":
        mocap = next(out.glob("*/mocap_data.txt"))
        mocap.rename(mocap.with_name("vio_poses.txt"))
        next(out.glob("mocap-imu*")).unlink()
    return out


def opened_at(folder):
    """What `map` is given: a bag is opened itself, with what lies beside it; one of two folders."""
    inner = ("bag", "rosbag", "left_camera/sfm/eval/plane_000000")
    return next((place for name in inner if (place := folder / name).is_dir()), folder)


def recording_begun(folder, kind):
    """An example: one file of the folder damaged, or taken away."""
    source, target = made(folder, kind), folder / "damaged"
    read = read_frames if kind in FRAMES else read_everything
    read(source)

    def example(rng):
        shutil.copytree(source, target)
        found = (path for name in FRAMES.get(kind, ("**/*",)) for path in target.glob(name))
        files = sorted(path for path in found if path.is_file())
        file = files[int(rng.integers(0, len(files)))]
        gone = rng.random() < 0.15
        file.unlink() if gone else file.write_bytes(fuzz_events.damaged(file.read_bytes(), rng))
        try:
            read(target)
            assert not gone or file.name in SPARE, f"{file.name} is not missed"
            return True
        except InputError as error:
            fuzz_events.assert_proper(error, target)
            return None
        finally:
            shutil.rmtree(target)

    return example


def read_everything(folder):
    """All that a mapper, `info` and the scores ask for; what comes must be sound."""
    found = open_recording(opened_at(folder))
    assert np.isfinite(found.trajectory.at(found.trajectory.t_us)).all()
    for k, camera in enumerate(found.rig.cameras):
        assert np.isfinite(found.rig.T_body_cam[k]).all()
        first, last = found.event_span_us(k)
        assert 0 <= first <= last
        for e in (found.events(k, 0, 1 << 60), found.events(k, first, first + 1000)):
            assert (np.diff(e.t_us) >= 0).all()
            assert not len(e) or (e.x.max() < camera.width_px and e.y.max() < camera.height_px)
        found.frame(k, first)
        for t_us in getattr(found, "truth_times_us", lambda _: [])(k)[:50]:
            depth_m = found.truth_view_depth_m(k, int(t_us))
            assert depth_m.shape == (camera.height_px, camera.width_px)
            assert (depth_m[np.isfinite(depth_m)] > 0).all()
    read_frames(folder)


def read_frames(folder):
    """All pictures of frame cameras, with places, times and lenses."""
    for seen in frame_cameras(open_recording(opened_at(folder))):
        assert np.isfinite(seen.T_body_cam).all()
        assert (np.diff(seen.pictures.t_us) > 0).all()
        for index in range(min(len(seen.pictures.t_us), 50)):
            photo = seen.photo(index)
            assert photo.start_us <= photo.end_us
            assert photo.image.dtype == np.uint8
            assert photo.image.shape == (seen.camera.height_px, seen.camera.width_px)


def file_begun(folder, kind):
    """An example: a damaged calibration or text of poses."""
    source, read = sound_file(folder, kind.partition("+")[0])
    target = folder / f"damaged{source.suffix}"
    read(source)

    def example(rng):
        if "+" in kind:
            make = with_odd_values if kind.endswith("+values") else with_odd_words
            target.write_text(make(source, rng), encoding="utf-8")
        else:
            target.write_bytes(fuzz_events.damaged(source.read_bytes(), rng))
        try:
            read(target)
            return True
        except InputError as error:
            fuzz_events.assert_proper(error, target)
            return None

    return example


def odd(values, rng, choices=ODD):
    """A copy with one to three of its values, or whole branches, replaced by odd ones."""
    values = copy.deepcopy(values)
    for _ in range(int(rng.integers(1, 4))):
        places = list(containers(values))
        inside = places[int(rng.integers(0, len(places)))]
        keys = list(inside) if isinstance(inside, dict) else list(range(len(inside)))
        if keys:
            key = keys[int(rng.integers(0, len(keys)))]
            if rng.random() < 0.2:
                del inside[key]
            else:
                inside[key] = copy.deepcopy(choices[int(rng.integers(0, len(choices)))])
    return values


def with_odd_values(path, rng):
    """A calibration's text with odd values."""
    values = odd(parsed(path), rng)
    return json.dumps(values) if path.suffix == ".json" else yaml.safe_dump(values)


def with_odd_words(path, rng):
    """A text with one to three of its words replaced, by odd ones or by others of its own."""
    parts = re.split(r"([-+.\w]+)", path.read_text())
    for _ in range(int(rng.integers(1, 4))):
        at, other = (1 + 2 * int(k) for k in rng.integers(0, len(parts) // 2, 2))
        odd_word = ODD_WORDS[int(rng.integers(0, len(ODD_WORDS)))]
        parts[at] = odd_word if rng.random() < 0.7 else parts[other]
    return "".join(parts)


def containers(values):
    """All mappings and lists in it, itself the first."""
    yield values
    inner = values.values() if isinstance(values, dict) else values
    for value in inner:
        if isinstance(value, dict | list) and value:
            yield from containers(value)


def sound_file(folder, kind):
    """A sound file of a kind, and what reads it."""
    for kinds, make in ((OTHERS, sound_other), (TABLES, sound_table), (MAKERS, sound_made)):
        if kind in kinds:
            return make(folder, kind)
    rig = world.rig_of("kb4")
    trajectory = world.trajectory_of(rig)
    path = folder / ("f.json" if kind in ("basalt", "rig", "marker") else "f.yaml")
    match kind:
        case "kalibr" | "basalt" | "rig" | "opencv":
            rigs.WRITERS[kind](path, rig)
            return path, checked_rig
        case "cam_to_cam":
            for side in ("left", "right"):
                (folder / "events" / side).mkdir(parents=True)
            dsec.write_calibration(folder, rig)
            path = folder / "calibration" / "cam_to_cam.yaml"
            return path, lambda p: (checked_rig(p), rectification_of(p))
        case "hand_eye":
            path.write_text(yaml.safe_dump({"T_body_cam": rig.T_body_cam[1].tolist()}))
            return path, lambda p: sane(read_hand_eye(p))
        case "marker":
            values = rigs.basalt(rig.cameras, rig.T_body_cam)
            values["value0"]["T_imu_marker"] = rigs.pose_values(rig.T_body_cam[1])
            path.write_text(json.dumps(values))
            return path, lambda p: sane(read_hand_eye(p, p))
        case "tum":
            write_tum(path, trajectory)
            return path, lambda p: sane(read_poses(p))
        case "scored":
            write_tum(path, trajectory)
            return path, lambda p: sane_scores(score_trajectory(p, trajectory))
    write_tum(path, trajectory)
    path.write_text("t,x,y,z\n" + path.read_text().replace(" ", ","))
    return path, lambda p: sane(read_poses(p, "s", -5))


def sound_other(folder, kind):
    """A calibration of another program, and what reads it; of a pair the second file is sound."""
    path = folder / ("f.json" if kind == "dv" else "f.yaml")
    single.written(path, OTHERS[kind])
    if kind != "pair":
        return path, checked_rig
    right = single.written(folder / "right.yaml", single.lens_of_ros(single.TURN, 0.1))
    return path, lambda p: checked_rig([p, right])


def sound_made(folder, kind):
    """A model or a table of settings, and what reads it."""
    make, read = MAKERS[kind]
    if callable(make):
        return make(folder), read
    (path := folder / "f.toml").write_text(make)
    return path, read


def sound_table(folder, kind):
    """Poses under a header that names their columns, or as KITTI has them, and what reads them."""
    path, read = folder / "f.csv", lambda p: sane(read_poses(p))
    trajectory = world.trajectory_of(world.rig_of("kb4"))
    if kind == "kitti":
        times = [f"{t_us / 1e6:.6f}\n" for t_us in trajectory.t_us]
        path.with_name("times.txt").write_text("".join(times))
        write_kitti(path, trajectory)
        return path, read
    head, line = TABLES[kind].split("\n", 1)
    columns = (trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw)
    rows = (line.format(t=t, p=p, q=q, qw=q[3]) for t, p, q in zip(*columns, strict=True))
    path.write_text("\n".join([head, *rows]))
    return path, read


def checked_rig(path):
    """A rig that can be used: finite lenses and rigid places."""
    for camera in (rig := read_rig(path)).cameras:
        assert camera.width_px <= 20_000
        camera.project([0.1, 0.1, 1.0])
    sane(np.stack(rig.T_body_cam))


def sane_scores(found):
    """Refuses numbers that are infinite, negative or without a cause undefined."""
    for name, value in found.values.items():
        assert not np.isinf(value), name
        assert not value < 0 or name == "scale", name
        assert not np.isnan(value) or name not in ("ate_rmse", "time_covered"), name
    assert found.values["time_covered"] <= 100.000001


def sane(found):
    """Refuses what is not finite."""
    values = found if isinstance(found, np.ndarray) else found.at(found.t_us)
    assert np.isfinite(values).all()


def begin(folder, kind):
    """What one example of a kind does."""
    return (recording_begun if kind in FOLDERS else file_begun)(Path(folder), kind)


if __name__ == "__main__":
    words = sys.argv[1:] or ["100"]
    raise SystemExit(fuzz_events.main(*words, kinds=KINDS, begin=begin))
