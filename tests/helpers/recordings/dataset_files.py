"""Data sets as their publishers lay them out, written plainly, beside and not by the product.

Each function takes a sequence of ours and writes what its publisher's own tools leave on a disk:
topics, names, frames and units. What the product writes itself is not written here.
"""

import struct

import h5py
import numpy as np
import yaml
from PIL import Image
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from event_files import ros2_message, ros2_types, write_evimo2_events, write_m3ed_camera
from eventsweep.emvs.formats.calibration_writers import kalibr_chain
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera

GREY = Camera(80, 60, 70.0, 71.0, 39.5, 30.0, "radtan", (-0.1, 0.02, 1e-3, 2e-3))
"""Lens of frame cameras."""
EXPOSURE_US = 4000
LENS = {"pinhole": "plumb_bob", "radtan": "plumb_bob", "kb4": "equidistant"}
MESSAGE = 2000
EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"


class Bag:
    """A bag of either kind with the messages that event cameras' bags hold."""

    def __init__(self, path, ros2=False):
        self.ros2 = ros2
        if ros2:
            self.store = ros2_types()
            self.bag = Ros2Writer(path, version=9)
        else:
            self.store = get_typestore(Stores.ROS1_NOETIC)
            self.store.register(get_types_from_msg(EVENT, "dvs_msgs/msg/Event"))
            self.store.register(get_types_from_msg(ARRAY, "dvs_msgs/msg/EventArray"))
            self.bag = Ros1Writer(path)
        self.topics = {}

    def write(self, topic, kind, t_us, **fields):
        """One message of a standard type."""
        message = self.store.types[kind](header=self.header(t_us), **fields)
        code = self.store.serialize_cdr if self.ros2 else self.store.serialize_ros1
        self.raw(topic, kind, t_us, code(message, kind))

    def raw(self, topic, kind, t_us, data):
        if topic not in self.topics:
            self.topics[topic] = self.bag.add_connection(topic, kind, typestore=self.store)
        self.bag.write(self.topics[topic], t_us * 1000, data)

    def header(self, t_us):
        stamp = self.store.types["builtin_interfaces/msg/Time"](t_us // 10**6, t_us % 10**6 * 1000)
        header = self.store.types["std_msgs/msg/Header"]
        kept = {} if self.ros2 else {"seq": 0}
        return header(stamp=stamp, frame_id="map", **kept)

    def events(self, topic, events, size_px):
        for start in range(0, len(events), MESSAGE):
            part = events.slice(start, min(start + MESSAGE, len(events)))
            data = ros2_message(part, size_px) if self.ros2 else ros1_message(part, size_px)
            self.raw(topic, "dvs_msgs/msg/EventArray", int(part.t_us[-1]), data)

    def poses(self, topic, t_us, T_world_tracked):
        """geometry_msgs/PoseStamped."""
        types = self.store.types
        position_m, quat = se3.to_quat_xyzw(T_world_tracked)
        for t, place, turn in zip(t_us.tolist(), position_m.tolist(), quat.tolist(), strict=True):
            pose = types["geometry_msgs/msg/Pose"](
                types["geometry_msgs/msg/Point"](*place),
                types["geometry_msgs/msg/Quaternion"](*turn),
            )
            self.write(topic, "geometry_msgs/msg/PoseStamped", t, pose=pose)

    def camera_info(self, topic, camera, t_us, R=None, P=None):
        """sensor_msgs/CameraInfo; without R and P as a single camera's."""
        P = np.column_stack([camera.K, np.zeros(3)]) if P is None else P
        R = np.eye(3) if R is None else R
        terms = np.array(camera.distortion or (0.0,) * 4)
        letters = ("d", "k", "r", "p") if self.ros2 else ("D", "K", "R", "P")
        numbers = (terms, camera.K.ravel(), R.ravel(), P.ravel())
        self.write(
            topic, "sensor_msgs/msg/CameraInfo", t_us, height=camera.height_px,
            width=camera.width_px, distortion_model=LENS[camera.model], binning_x=0, binning_y=0,
            roi=self.store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
            **dict(zip(letters, numbers, strict=True)),
        )  # fmt: skip

    def __enter__(self):
        self.bag.open()
        return self

    def __exit__(self, *_):
        self.bag.close()


def ros1_message(e, size_px):
    """An EventArray as ROS1 lays it out, packed."""
    rows = np.zeros(len(e), [("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
    rows["x"], rows["y"], rows["p"] = e.x, e.y, e.p
    rows["s"], rows["ns"] = e.t_us // 10**6, e.t_us % 10**6 * 1000
    head = struct.pack("<IIII", 0, 0, 0, 0) + struct.pack("<III", size_px[1], size_px[0], len(e))
    return head + rows.tobytes()


def everything(sequence, camera):
    first, last = sequence.event_span_us(camera)
    return sequence.events(camera, first, last + 1)


def size_of(sequence):
    camera = sequence.rig.cameras[0]
    return camera.width_px, camera.height_px


def T_world_cam(sequence, camera):
    t_us = sequence.trajectory.t_us
    return sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[camera]


def write_esim(sequence, folder):
    """`out.bag`: events, poses and camera_info per camera; camera_info knows no other camera."""
    folder.mkdir()
    with Bag(folder / "out.bag") as bag:
        for k, camera in enumerate(sequence.rig.cameras):
            bag.camera_info(f"/cam{k}/camera_info", camera, 0)
            bag.poses(f"/cam{k}/pose", sequence.trajectory.t_us, T_world_cam(sequence, k))
            bag.events(f"/cam{k}/events", everything(sequence, k), size_of(sequence))
    return folder


def write_rpg(sequence, folder, ros2=False):
    """A bag of events and motion capture, with a camera chain and hand-eye beside it."""
    folder.mkdir()
    T_body_cam = sequence.rig.T_body_cam
    with Bag(folder / ("bag" if ros2 else "boxes_edited.bag"), ros2) as bag:
        t_us = sequence.trajectory.t_us
        bag.poses("/optitrack/davis_stereo", t_us, sequence.trajectory.at(t_us))
        for k, side in enumerate(("left", "right")):
            bag.events(f"/davis/{side}/events", everything(sequence, k), size_of(sequence))
    chain = yaml.safe_dump(kalibr_chain(sequence.rig))
    (folder / "camchain-stereo.yaml").write_text(chain)
    hand_eye = {"T_body_cam": T_body_cam[0].tolist()}
    (folder / "hand_eye.yaml").write_text(yaml.safe_dump(hand_eye))
    return folder / "bag" if ros2 else folder


def write_ros2(sequence, folder):
    """The same as a ROS2 bag."""
    return write_rpg(sequence, folder, ros2=True)


def write_event_camera_dataset(sequence, folder):
    """Text of one camera, radial-tangential; times in s with nine decimals."""
    folder.mkdir()
    e, camera = everything(sequence, 0), sequence.rig.cameras[0]
    rows = zip(e.t_us.tolist(), e.x.tolist(), e.y.tolist(), e.p.tolist(), strict=True)
    lines = [f"{t // 10**6}.{t % 10**6:06d}000 {x} {y} {p}\n" for t, x, y, p in rows]
    (folder / "events.txt").write_text("".join(lines))
    terms = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    numbers = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *terms)
    (folder / "calib.txt").write_text(" ".join(map(repr, numbers)) + "\n")
    position_m, quat = se3.to_quat_xyzw(T_world_cam(sequence, 0))
    poses = np.column_stack([sequence.trajectory.t_us / 1e6, position_m, quat])
    np.savetxt(folder / "groundtruth.txt", poses, fmt="%.12f")
    (folder / "images").mkdir()
    import cv2

    image = np.zeros((camera.height_px, camera.width_px), np.uint8)
    cv2.imwrite(str(folder / "images" / "frame_00000000.png"), image)
    (folder / "images.txt").write_text("0.000000 images/frame_00000000.png\n")
    return folder


def write_raw(sequence, folder):
    """Two RAW files with a `recording.toml` of the user's own, poses of the body, Kalibr chain."""
    from event_files import write_evt21

    folder.mkdir()
    for k in range(len(sequence.rig)):
        write_evt21(folder / f"{k}.raw", size_of(sequence), [everything(sequence, k)])
    (folder / "chain.yaml").write_text(yaml.safe_dump(kalibr_chain(sequence.rig)))
    position_m, quat = se3.to_quat_xyzw(sequence.trajectory.at(sequence.trajectory.t_us))
    rows = np.column_stack([sequence.trajectory.t_us / 1e3, position_m, quat])
    np.savetxt(folder / "mocap.csv", rows, fmt="%.12f", delimiter=",", header="t,x,y,z,qx,qy,qz,qw")
    hand_eye = {"T_body_cam": sequence.rig.T_body_cam[0].tolist()}
    (folder / "hand_eye.yaml").write_text(yaml.safe_dump(hand_eye))
    (folder / "recording.toml").write_text(
        '[calibration]\nfile = "chain.yaml"\n'
        '[poses]\nfile = "mocap.csv"\nunit = "ms"\nhand_eye = "hand_eye.yaml"\n'
        '[[events]]\nfile = "0.raw"\n[[events]]\nfile = "1.raw"\n'
    )
    return folder


def kalibr_values(camera):
    """Kalibr's keys for a lens."""
    model = {"pinhole": "none", "radtan": "radtan", "kb4": "equidistant"}[camera.model]
    return {
        "camera_model": "pinhole",
        "distortion_coeffs": list(camera.distortion or (0.0,) * 4),
        "distortion_model": model,
        "intrinsics": [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px],
        "resolution": [camera.width_px, camera.height_px],
    }


def gradient(camera, _T_world_cam):
    """A picture of nothing."""
    rows, columns = np.arange(camera.height_px), np.arange(camera.width_px)
    return np.add.outer(rows, columns).astype(np.uint8)


def beside(k):
    """`T_left_frame`: where the frame cameras sit in the left event camera, turned a little."""
    return se3.from_quat_xyzw([0.03 - 0.05 * k, 0.01, -0.02], np.array([0.02, -0.03, 0.01, 0.9993]))


def write_m3ed(sequence, folder, picture=gradient):
    """`plane_data.h5`, poses `Cn_T_C0` of the left camera against its first one, lidar's depth."""
    folder.mkdir()
    T_world_left, t_us = T_world_cam(sequence, 0), sequence.trajectory.t_us
    T_left = [se3.inverse(sequence.rig.T_body_cam[0]) @ T for T in sequence.rig.T_body_cam]
    with h5py.File(folder / "plane_data.h5", "w") as file:
        for k, side in enumerate(("left", "right")):
            group = file.create_group(f"prophesee/{side}")
            write_m3ed_camera(group, everything(sequence, k))
            for key, value in kalibr_values(sequence.rig.cameras[k]).items():
                group[f"calib/{key}"] = value
            group["calib/T_to_prophesee_left"] = T_left[k]
        write_ovc(file, sequence, picture)
    with h5py.File(folder / "plane_pose_gt.h5", "w") as file:
        file["Cn_T_C0"] = se3.inverse(T_world_left) @ T_world_left[0]
        file["ts"] = t_us.astype(float)
    times_us = sequence.truth_times_us(0)
    with h5py.File(folder / "plane_depth_gt.h5", "w") as file:
        depth = np.stack([sequence.truth_depth_m(0, int(t)) for t in times_us])
        depth = np.where(np.isfinite(depth), depth, np.inf).astype("f4")
        file.create_dataset("depth/prophesee/left", data=depth, chunks=(1, *depth.shape[1:]))
        file["ts"] = times_us.astype(float)
    return folder


def write_ovc(file, sequence, picture):
    """The grey pair and the colour camera: blue first."""
    file["ovc/ts"] = times_us = sequence.truth_times_us(0)
    T_world_left = sequence.trajectory.at(times_us) @ sequence.rig.T_body_cam[0]
    for k, name in enumerate(("left", "right", "rgb")):
        group, place = file.create_group(f"ovc/{name}"), beside(k)
        for key, value in kalibr_values(GREY).items():
            group[f"calib/{key}"] = value
        group["calib/T_to_prophesee_left"] = place
        images = np.stack([picture(GREY, T @ place) for T in T_world_left])[..., None]
        images = images * [[[1, 1, 1]]] if name == "rgb" else images
        images = images.astype(np.uint8)
        group.create_dataset("data", data=images, chunks=(1, *images.shape[1:]), compression="lzf")


def write_vector(sequence, folder, picture=gradient):
    """Events like DSEC's, a marker's poses, ROS's lenses, places against a frame camera."""
    (folder / "calib").mkdir(parents=True)
    T_cam0_tracked = se3.from_quat_xyzw([0.05, -0.02, 0.1], np.array([0, 0.28, 0, 0.96]))
    T_tracked_left = se3.inverse(beside(0) @ T_cam0_tracked)
    T_body_cam = sequence.rig.T_body_cam
    joint, first_us = {}, sequence.event_span_us(0)[0]
    for k, side in enumerate(("left", "right")):
        events = everything(sequence, k)
        with h5py.File(folder / f"plane1.synced.{side}_event.hdf5", "w") as file:
            write_indexed(file, events, first_us)
        values = ros_values(sequence.rig.cameras[k])
        name = f"{side}_event_camera_intrinsic_results.yaml"
        (folder / "calib" / name).write_text(yaml.safe_dump(values))
        T = T_cam0_tracked @ T_tracked_left @ se3.inverse(T_body_cam[0]) @ T_body_cam[k]
        joint[f"cam{k + 2}"] = {f"T_cam0_cam{k + 2}": T.ravel().tolist()}
    T_cam0_cam1 = se3.inverse(beside(0)) @ beside(1)
    joint["cam1"] = {"T_cam0_cam1": T_cam0_cam1.ravel().tolist()}
    path = folder / "calib" / "small_scale_joint_camera_extrinsic_results.yaml"
    path.write_text(yaml.safe_dump(joint))
    marker = {"cam0": {"T_cam_body": T_cam0_tracked.ravel().tolist()}}
    path = folder / "calib" / "camera_mocap_extrinsic_results1.yaml"
    path.write_text(yaml.safe_dump(marker))
    T_world_tracked = T_world_cam(sequence, 0) @ se3.inverse(T_tracked_left)
    rows = tum_rows(sequence.trajectory.t_us, T_world_tracked)
    head = "ground truth\ntimestamp[s] px py pz qx qy qz qw"
    np.savetxt(folder / "plane1.synced.gt.txt", rows, fmt="%.12f", header=head)
    write_regular_cameras(sequence, folder, picture)
    return folder


def write_regular_cameras(sequence, folder, picture):
    """Images named by the begin of their exposure, s, and begin and end of all."""
    times_us = sequence.truth_times_us(0)
    T_world_left = sequence.trajectory.at(times_us) @ sequence.rig.T_body_cam[0]
    for k, side in enumerate(("left", "right")):
        lens = folder / "calib" / f"{side}_regular_camera_intrinsic_results.yaml"
        lens.write_text(yaml.safe_dump(ros_values(GREY)))
        images = folder / f"plane1.synced.{side}_camera"
        images.mkdir()
        lines = ["# start and end of the exposure time[s] for each image"]
        for t_us, T in zip(times_us.tolist(), T_world_left, strict=True):
            begin, end = ((t_us + sign * EXPOSURE_US // 2) / 1e6 for sign in (-1, 1))
            lines.append(f"{begin:.6f} {end:.6f}")
            Image.fromarray(picture(GREY, T @ beside(k))).save(images / f"{begin:.6f}.png")
        (images / "timestamp.txt").write_text("\n".join(lines) + "\n")


def write_indexed(file, e, offset_us):
    """`events/*`, `ms_to_idx`, and `t_offset` as an array of one."""
    t_us = e.t_us - offset_us
    for name, kind in (("x", "u2"), ("y", "u2"), ("t", "u4"), ("p", "u1")):
        file[f"events/{name}"] = (t_us if name == "t" else getattr(e, name)).astype(kind)
    stamps_us = 1000 * np.arange(int(t_us[-1]) // 1000 + 1)
    file["ms_to_idx"] = np.searchsorted(t_us, stamps_us).astype("u8")
    file["t_offset"] = np.array([offset_us])


def ros_values(camera):
    """What ROS's `cameracalibrator` saves."""
    terms = list(camera.distortion or (0.0,) * 5)
    return {
        "image_width": camera.width_px, "image_height": camera.height_px,
        "camera_matrix": {"rows": 3, "cols": 3, "data": camera.K.ravel().tolist()},
        "distortion_model": LENS[camera.model],
        "distortion_coefficients": {"rows": 1, "cols": len(terms), "data": terms},
    }  # fmt: skip


def tum_rows(t_us, T):
    position_m, quat = se3.to_quat_xyzw(T)
    return np.column_stack([t_us / 1e6, position_m, quat])


def write_evimo2(sequence, folder):
    """Left and right in folders of their own, with what NumPy pickles; depth of the left in mm."""
    for k, side in enumerate(("left", "right")):
        own = folder / f"{side}_camera" / "sfm" / "eval" / "plane_000000"
        own.mkdir(parents=True)
        write_evimo2_events(own, everything(sequence, k))
        info = {"meta": evimo2_meta(sequence, k), "K": np.eye(3), "D": np.zeros(4)}
        np.savez_compressed(own / "dataset_info.npz", **info)
        position_m, quat = se3.to_quat_xyzw(sequence.rig.T_body_cam[k])
        place = {"t_rigcamera": floats("xyz", position_m), "q_rigcamera": floats("xyzw", quat)}
        np.savez_compressed(own / "dataset_extrinsics.npz", **place)
        maps = [sequence.truth_depth_m(k, int(t)) for t in sequence.truth_times_us(k)]
        stored = {f"depth_{n:010d}": np.rint(1e3 * m).astype("u2") for n, m in enumerate(maps)}
        np.savez_compressed(own / "dataset_depth.npz", **stored)
    return folder / "left_camera" / "sfm" / "eval" / "plane_000000"


def floats(names, values):
    return {name: float(value) for name, value in zip(names, values, strict=False)}


def evimo2_meta(sequence, k):
    """Poses of the camera, times of depth, the lens."""
    camera = sequence.rig.cameras[k]
    rows = tum_rows(sequence.trajectory.t_us, T_world_cam(sequence, k))
    poses = [
        {"ts": float(t), "id": 2**64 - 1, "gt_frame": "none", "cam": {"ts": float(t), "pos": {
            "t": floats("xyz", at), "q": floats("xyzw", q),
            "rpy": {"r": 0.0, "p": 0.0, "y": 0.0}}}}
        for t, at, q in ((row[0], row[1:4], row[4:]) for row in rows)
    ]  # fmt: skip
    lost = {"ts": -1.0, "id": 2**64 - 1, "11": {}}  # the motion capture saw an object alone
    terms = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)
    names = ("k1", "k2", "k3", "k4") if camera.model == "kb4" else ("k1", "k2", "p1", "p2", "k3")
    lens = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0) | floats(names, terms)
    return {
        "frames": [
            {"id": n, "ts": int(t) / 1e6, "gt_frame": f"depth_mask_{n}.png"}
            for n, t in enumerate(sequence.truth_times_us(k))
        ],
        "full_trajectory": [lost, *poses], "imu": {},
        "meta": lens | {
            "fx": camera.fx_px, "fy": camera.fy_px, "cx": camera.cx_px, "cy": camera.cy_px,
            "dist_model": "equidistant" if camera.model == "kb4" else "radtan",
            "res_x": camera.width_px, "res_y": camera.height_px, "ros_time_offset": 1606265321.5,
        },
    }  # fmt: skip


def write_eds(sequence, folder):
    """Events in columns, poses of the event camera, a chain whose `cam0` is the frame camera."""
    (folder / "00_calib_results").mkdir(parents=True)
    e, camera = everything(sequence, 0), sequence.rig.cameras[0]
    with h5py.File(folder / "events.h5", "w") as file:
        for name, values in (("x", e.x), ("y", e.y), ("t", e.t_us), ("p", e.p)):
            file.create_dataset(name, data=values, compression="gzip")
    rows = tum_rows(sequence.trajectory.t_us, T_world_cam(sequence, 0))
    np.savetxt(folder / "stamped_groundtruth.txt", rows, fmt="%.12f")
    link = se3.from_quat_xyzw([0.001, 0.002, -0.004], np.array([0.0, 0.0, 0.6, 0.8]))
    frame = kalibr_values(camera) | {"intrinsics": [766.0, 767.0, 291.0, 227.0]}
    chain = {"cam0": frame, "cam1": kalibr_values(camera) | {"T_cn_cnm1": link.tolist()}}
    chain["cam0"]["resolution"] = [640, 480]
    text = yaml.safe_dump(chain)
    (folder / "00_calib_results" / "camchain-kalibr.yaml").write_text(text)
    return folder


def write_evslam(sequence, folder, truth="groundtruth/slider_fast.tum"):
    """A bag of DVXplorers, Kalibr's chain of five cameras and an IMU, poses of the left camera."""
    for name in ("rosbag", "calibration", "groundtruth", "gt"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    sides = [f"/dvxplorer_{side}" for side in ("left", "right")]
    with Bag(folder / "rosbag" / "slider_fast.bag") as bag:
        for k, side in enumerate(sides):
            bag.events(f"{side}/events", everything(sequence, k), size_of(sequence))
        write_imu(bag, "/dvxplorer_left/imu", sequence.event_span_us(0)[0])
    topics = [f"{side}/events" for side in sides]
    topics += [f"/camera/{name}/image_rect_raw" for name in ("color", "infra1", "infra2")]
    text = yaml.safe_dump(evslam_chain(sequence.rig, topics))
    (folder / "calibration" / "calib_results_cam.txt").write_text(text)
    (folder / "calibration" / "calib_results_imu.txt").write_text("imu0:\n  update_rate: 800.0\n")
    rows = tum_rows(sequence.trajectory.t_us, T_world_cam(sequence, 0))
    if truth.endswith("_gt.txt"):  # with the camera's velocity, which nobody needs here
        rows = np.column_stack([rows, np.zeros((len(rows), 3))])
    np.savetxt(folder / truth, rows, fmt="%.9f")
    return folder / "rosbag"


def evslam_chain(rig, topics):
    """Kalibr's cameras: two of events, then three of frames, each linked with the one before."""
    step, T_cam_imu = np.eye(4), np.eye(4)
    step[0, 3], T_cam_imu[:3, 3] = 0.02, (0.01, -0.02, 0.03)
    chain = {}
    for k, topic in enumerate(topics):
        entry = kalibr_values(rig.cameras[min(k, 1)])
        if k:
            T = step if k > 1 else se3.inverse(rig.T_body_cam[1]) @ rig.T_body_cam[0]
            entry["T_cn_cnm1"], T_cam_imu = T.tolist(), T @ T_cam_imu
        entry |= {"T_cam_imu": T_cam_imu.tolist(), "timeshift_cam_imu": 0.001, "rostopic": topic}
        chain[f"cam{k}"] = entry
    return chain


def write_imu(bag, topic, t_us):
    """One sensor_msgs/Imu at rest."""
    types, nine = bag.store.types, np.zeros(9)
    vector = types["geometry_msgs/msg/Vector3"]
    bag.write(
        topic, "sensor_msgs/msg/Imu", t_us, orientation_covariance=nine,
        orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        angular_velocity=vector(0.0, 0.0, 0.0), angular_velocity_covariance=nine,
        linear_acceleration=vector(0.0, 0.0, 9.81), linear_acceleration_covariance=nine,
    )  # fmt: skip


def write_esvo2(sequence, folder):
    """A bag of DVXplorers beside ROS's lenses with `T_right_left`; true poses in another file."""
    folder.mkdir(parents=True)
    with Bag(folder / "hnu.bag") as bag:
        for k, side in enumerate(("left", "right")):
            topic = f"/dvxplorer_{side}/events"
            bag.events(topic, everything(sequence, k), size_of(sequence))
        write_imu(bag, "/dvxplorer_left/imu", sequence.event_span_us(0)[0])
    T_right_left = se3.inverse(sequence.rig.T_body_cam[1]) @ sequence.rig.T_body_cam[0]
    places = {"T_right_left": T_right_left, "T_b_c": np.eye(4)}
    for camera, side in zip(sequence.rig.cameras, ("left", "right"), strict=True):
        values = ros_values(camera) | {"camera_name": side}
        for name, T in places.items():
            values[name] = {"rows": 3, "cols": 4, "data": T[:3].ravel().tolist()}
        (folder / f"{side}.yaml").write_text(yaml.safe_dump(values))
    rows = tum_rows(sequence.trajectory.t_us, T_world_cam(sequence, 0))
    np.savetxt(folder.parent / "hnu_gt.txt", rows, fmt="%.9f")
    return folder


WRITERS = {
    "esim": write_esim, "rpg_eccv18": write_rpg, "rosbag2": write_ros2, "raw": write_raw,
    "m3ed": write_m3ed, "vector": write_vector, "evimo2": write_evimo2, "evslam": write_evslam,
}  # fmt: skip
"""Of two cameras."""
SINGLE = {"event-camera-dataset": write_event_camera_dataset, "eds": write_eds}
"""Of one camera."""
