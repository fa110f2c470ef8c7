"""What tables say of themselves: names, order and unit of columns, and times that cannot be."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.data.headers import column_of, fields_of, finer_unit, impossible
from eventsweep.emvs.data.poses import read_poses, write_kitti
from eventsweep.emvs.errors import InputError
from refusals import refused

T_S, PLACE, QUAT_XYZW = (1.5, 1.75, 2.25), (0.25, -0.5, 2.0), (0.1, 0.7, -0.1, 0.7)
NAMED = {"t": "1.5", "x": "0.25", "y": "-0.5", "z": "2", **dict(zip(
    ("qx", "qy", "qz", "qw"), map(str, QUAT_XYZW), strict=True))}  # fmt: skip
ROLES = tuple(NAMED)
SCALE = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}


def poses(path, text, unit=None, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return read_poses(path, unit)


def rows(order=ROLES, unit="s", gap=" ", extra=(), base_s=0):
    """Three poses, the columns in an order, beside them others."""
    lines = []
    for t_s in T_S:
        values = dict(NAMED, t=f"{round((base_s + t_s) * SCALE[unit])}" if unit != "s" else t_s)
        lines.append(gap.join([str(values[role]) for role in order] + list(extra)))
    return "\n".join(lines) + "\n"


def assert_right(trajectory, base_s=0):
    assert (trajectory.t_us - 10**6 * base_s).tolist() == [1_500_000, 1_750_000, 2_250_000]
    assert np.allclose(trajectory.positions_m, PLACE)
    assert np.allclose(np.abs(trajectory.quats_xyzw @ QUAT_XYZW), 1)


QW_FIRST = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
EUROC = (
    "#timestamp{}, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z []{}\n"
)
MORE = ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]"
PATHS = [f"pose.position.{c}" for c in "xyz"] + [f"pose.orientation.{c}" for c in "xyzw"]
HEADERS = {
    "tum": ("# ground truth\n# file: 'a_b.bag'\n# timestamp tx ty tz qx qy qz qw\n", ROLES, "s"),
    "our own": ("# t_s x_m y_m z_m qx qy qz qw (T_world_body)\n", ROLES, "s"),
    "with a label": ("# T_world_cam: t x y z qx qy qz qw\n", ROLES, "s"),
    "qw first": ("timestamp,x,y,z,qw,qx,qy,qz\n", QW_FIRST, "s"),
    "qw first, comment": ("# Format: t x y z qw qx qy qz\n", QW_FIRST, "s"),
    "qw first, percent": ("% t px py pz q_w q_x q_y q_z\n", QW_FIRST, "s"),
    "ns in brackets": ("#timestamp [ns],x,y,z,qx,qy,qz,qw\n", ROLES, "ns"),
    "us in parentheses": ("# time(us) x y z qx qy qz qw\n", ROLES, "us"),
    "µs": ("# timestamp [µs] px[m] py[m] pz[m] qx qy qz qw\n", ROLES, "us"),
    "ms in the name": ("time_ms;pos_x;pos_y;pos_z;qx;qy;qz;qw\n", ROLES, "ms"),
    "nsec": ("timestamp_nsec x y z qx qy qz qw\n", ROLES, "ns"),
    "any order": ("qz qy qx qw z y x t_us\n", ROLES[::-1][1:2] + ROLES[::-1][2:4] + ("qw",)
                  + ROLES[::-1][4:], "us"),
    "euroc, silent": (EUROC.format("", ""), QW_FIRST, "ns"),
    "euroc": (EUROC.format(" [ns]", ""), QW_FIRST, "ns"),
    "quoted": ('"t","x","y","z","qx","qy","qz","qw"\n', ROLES, "s"),
    "tabs": ("t\tx\ty\tz\tqx\tqy\tqz\tqw\n", ROLES, "s"),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_headers_of_the_field(tmp_path, name, encoding):
    head, order, unit = HEADERS[name]
    gap = next((c for c in ",;\t" if c in head), " ")
    assert_right(poses(tmp_path / "p", head + rows(order, unit, gap), encoding=encoding))
    assert_right(poses(tmp_path / "p", (head + rows(order, unit, gap)).replace("\n", "\r\n")))


def test_columns_beside_a_pose_are_passed_over(tmp_path):
    text = EUROC.format("", MORE) + rows(
        QW_FIRST, "ns", ",", ["1", "-2", "3e-5", "4"], 1_400_000_000
    )
    assert_right(poses(tmp_path / "p", text), 1_400_000_000)
    ros = "%time,field.header.seq,field.header.stamp,field.header.frame_id,"
    text = ros + ",".join(f"field.{name}" for name in PATHS) + "\n"
    for k, line in enumerate(rows(unit="ns", gap=",").splitlines()):
        stamp, _, rest = line.partition(",")
        text += f"{10**9 + k},{k},{stamp},map,{rest}\n"
    assert_right(poses(tmp_path / "p", text))
    text = ",secs,nsecs," + ",".join(PATHS) + "\n"
    for k, (t_s, line) in enumerate(zip(T_S, rows(gap=",").splitlines(), strict=True)):
        text += f"{k},{int(t_s)},{int(1e9 * (t_s % 1))},{line.partition(',')[2]}\n"
    assert_right(poses(tmp_path / "p", text))


@given(
    st.permutations(ROLES), st.sampled_from(list(SCALE)), st.sampled_from(" ,;\t"), st.booleans()
)
def test_every_order_is_read_by_its_header(tmp_path_factory, order, unit, gap, is_comment):
    path = tmp_path_factory.mktemp("poses") / "p"
    names = [f"t_{unit}" if role == "t" else role for role in order]
    head = "# " * is_comment + gap.join(names) + "\n"
    assert_right(poses(path, head + rows(order, unit, gap)))


@pytest.mark.parametrize(("head", "unit", "words"), [
    ("t_ns x y z qx qy qz qw\n", "s", "its header counts time in ns, the setting in s"),
    ("# t [us] x y z qx qy qz qw\n", "ns", "its header counts time in us"),
    ("timestamp,x,y,z,q0,q1,q2,q3\n", None, "lacks qx, qy, qz, qw"),
    ("# timestamp tx ty tz q0 q1 q2 q3\n", None, "lacks qx, qy, qz, qw"),
    ("t,x,y,z,roll,pitch,yaw,w\n", None, "lacks qx"),
    ("t,t_ns,x,y,z,qx,qy,qz\n", None, "lacks qw|t twice"),
    ("t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n", None, "x_mm.*not read here"),
    ("t_min,x,y,z,qx,qy,qz,qw\n", None, "lacks t"),
    ("t x y z qx qy qz qw v\n", None, "names 9 columns, its first row has 8"),
    ("a b c d e f g h\n", None, "lacks t"),
])  # fmt: skip
def test_headers_that_contradict_are_refused(tmp_path, head, unit, words):
    refused([words, tmp_path / "p"], poses, tmp_path / "p", head + rows(), unit)


@pytest.mark.parametrize("head", [
    "", "# of a camera\n", "Trajectory of the left camera\n", "# x y z\n\n", "% MATLAB\n",
    "# poses of the body in the world, as the motion capture system gave them\n",
])  # fmt: skip
def test_words_that_name_no_columns_leave_the_order_alone(tmp_path, head):
    assert_right(poses(tmp_path / "p", head + rows()))
    assert_right(poses(tmp_path / "p", head + rows(gap=", ")))


def test_a_text_in_another_encoding_is_named(tmp_path):
    for encoding in ("utf-16", "utf-32"):
        refused("UTF-16 or UTF-32; save it as UTF-8", poses, tmp_path / "p", rows(), None, encoding)


def stamps(times):
    return "".join(f"{t} 0 0 0 0 0 0 1\n" for t in times)


@pytest.mark.parametrize(("times", "unit"), [
    (range(0, 390_000_000, 10_000_000), "ns"),  # 39 poses of six years, if they were seconds
    (range(0, 390_000, 10_000), "us"), (range(0, 39_000_000, 1_000_000), "ns"),
    (range(1_600_000_000_000, 1_600_000_000_900, 10), "ms"),
    (range(1_600_000_000_000_000, 1_600_000_000_900_000, 10_000), "us"),
    ((1_403_715_524_907_143_168, 1_403_715_524_912_143_104), "ns"), ((0, 10**9), "ns"),
])  # fmt: skip
@pytest.mark.parametrize("form", ["{}", "{}.0", "{:e}"])
def test_times_that_cannot_be_seconds_are_refused_with_the_unit_that_can(
    tmp_path, times, unit, form
):
    text = stamps(form.format(t) for t in times) if form != "{:e}" else stamps(
        f"{t:.18e}" for t in times)  # fmt: skip
    said = refused(f"set unit to {unit!r}", poses, tmp_path / "p", text, "")
    assert f"# t_{unit} x y z qx qy qz qw" in said
    assert "set unit" not in refused("if it counts", poses, tmp_path / "p", text)
    expected = [round(t * 1e6 / SCALE[unit]) for t in times]
    assert poses(tmp_path / "p", text, unit).t_us.tolist() == expected
    cure = poses(tmp_path / "p", f"# t_{unit} x y z qx qy qz qw\n{text}")
    assert cure.t_us.tolist() == expected


@pytest.mark.parametrize("times", [
    (0, 0.01, 0.02), (1_600_000_000.5, 1_600_000_000.51), (86_400 * 300.0, 86_400 * 300 + 1),
    (0, 60), (0, 30, 60, 90), (-5, 0, 5), (1.45e9, 1.45e9 + 1), (7,), (0, 0.005, 3000, 3000.005),
])  # fmt: skip
def test_times_since_boot_or_1970_open_without_doubt(tmp_path, times):
    assert poses(tmp_path / "p", stamps(times)).t_us.tolist() == [round(1e6 * t) for t in times]


def test_the_first_pose_of_a_repeated_time_is_kept_and_a_note_says_so(tmp_path):
    text = "1 0 0 0 0 0 0 1\n1 9 9 9 0 0 0 1\n2 1 0 0 0 0 0 1\n2 9 9 9 0 0 0 1\n3 0 0 0 0 0 0 1\n"
    found = poses(tmp_path / "p", text)
    assert found.positions_m[:, 0].tolist() == [0, 1, 0]
    assert found.notes == ("2 of 5 poses repeat the time before them: the first of each is kept",)
    assert found.times(np.eye(4)).notes == found.notes
    refused("does not come after", poses, tmp_path / "p", stamps([1, 1, 1]))
    refused("does not come after", poses, tmp_path / "p", stamps([1, 2, 1]))
    refused("does not come after", poses, tmp_path / "p", stamps([1, 2, 3]), "ns")


def test_kitti_rows_take_their_times_from_beside_them(tmp_path):
    before = poses(tmp_path / "p", rows())
    write_kitti(tmp_path / "00.txt", before)
    refused("put a file times.txt", read_poses, tmp_path / "00.txt")
    (tmp_path / "times.txt").write_text("".join(f"{t:e}\n" for t in T_S))
    assert_right(read_poses(tmp_path / "00.txt"))
    (tmp_path / "times.txt").write_text("1.5\n")
    refused("1 times for 3 poses", read_poses, tmp_path / "00.txt")
    (tmp_path / "00.txt").write_text("1 0 0 0 0 2 0 0 0 0 1 0\n")
    refused("pose 0 is no rotation", read_poses, tmp_path / "00.txt")


@pytest.mark.parametrize(("name", "role", "unit"), [
    ("t", "t", ""), ("t_us", "t", "us"), ("%time", "t", ""), ("Time Stamp", "t", ""),
    ("field.header.stamp", "t", ""), ("header.stamp.secs", "secs", ""), ("x@1280", "x", ""),
    ("stamp.nanosec", "nsecs", ""), ("timestamp [ns]", "t", "ns"), ("x_px", "x", "px"),
    ("q_RS_w []", "qw", ""), ("p_RS_R_x [m]", "x", "m"), ("tx", "x", ""), ("qw", "qw", ""),
    ("field.pose.pose.orientation.w", "qw", ""), ("field.transform.translation.z", "z", ""),
    ("v_RS_R_x [m s^-1]", "", "m s^-1"), ("twist.linear.x", "", ""), ("b_w_RS_S_x", "", ""),
    ("polarity", "p", ""), ("exposure_time", "", ""), ("t_s", "t", "s"), ("Unnamed: 0", "", ""),
    ("vx", "", ""), ("wx", "", ""), ("dt", "", ""), ("", "", ""), ("q0", "", ""),
])  # fmt: skip
def test_names_of_the_field(name, role, unit):
    assert column_of(name)[1:] == (role, unit)


@given(st.text(max_size=40))
def test_no_name_ends_in_anything_but_a_column(name):
    assert column_of(name).role in ("", "secs", "nsecs", "p", *ROLES)


@given(st.text(max_size=200), st.sampled_from(["utf-8", "utf-8-sig"]))
def test_any_text_is_poses_or_one_line(tmp_path_factory, text, encoding):
    path = tmp_path_factory.mktemp("poses") / "p"
    lines = text.encode(encoding, "replace") + b"\n" + rows().encode()
    path.write_bytes(lines)
    said = f"{path}"
    try:
        assert len(read_poses(path)) >= 1
    except InputError as error:
        said = str(error)
    assert said.startswith(str(path))
    assert "\n" not in said


def test_fields_and_units():
    assert fields_of("1, 2;3") == ["1", "2", "3"]
    assert fields_of("1,,3,") == ["1", "", "3"]
    assert fields_of("1 2, 3\t4") == ["1", "2", "3", "4"]
    assert [impossible(10**6 * t) for t in (0, 1.6e9, 10**8, -5)] == [""] * 4
    assert impossible(1_600_000_000 * 10**9).startswith("the year 526")
    for coarse, fine in itertools.pairwise(SCALE):
        assert finer_unit(1.6e9 * SCALE[fine], coarse) == fine


@pytest.mark.parametrize("word", ["1e13", "1e200", "-1e308"])
def test_no_position_is_beyond_reason(tmp_path, word):
    text = rows().replace(" 0.25 ", f" {word} ")
    refused("pose 0 is 1e.* m away, at most 1e.12", poses, tmp_path / "p.txt", text)


@pytest.mark.parametrize("word", ["1e308", "9" * 5000])
@pytest.mark.parametrize("role", ROLES)
def test_numbers_beyond_a_floats_range_are_refused_without_a_warning(tmp_path, role, word):
    lines = "".join(
        " ".join(str(NAMED[r]) if r != role else word for r in ROLES) + "\n" for _ in T_S
    )
    refused(".", poses, tmp_path / "p.txt", lines)
