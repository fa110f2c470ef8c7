"""Models that wait for ever, fill memory or crash MuJoCo are refused soon; sound ones are equal."""

import os
import time

import numpy as np
import pytest

import rover
from eventsweep.emvs.errors import InputError
from eventsweep.sim import mjcf
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.mjcf import compiled, model_of, read_spec
from refusals import refused
from sockets import plug

mujoco = import_mujoco()


def soon(words, path, seconds=10):
    began = time.monotonic()
    assert len(refused(words, model_of, path)) < 1000
    assert time.monotonic() - began < seconds


NAMED = (
    '<asset><texture type="2d" name="t" file="{}"/></asset>',
    '<asset><texture type="cube" name="t" fileright="{}"/></asset>',
    '<asset><mesh name="t" file="{}"/></asset>', '<asset><skin name="t" file="{}"/></asset>',
    '<asset><hfield name="t" size="1 1 1 1" file="{}"/></asset>', '<include file="{}"/>',
    '<asset><model name="t" file="{}"/></asset>',
)  # fmt: skip


@pytest.mark.parametrize("text", NAMED)
@pytest.mark.parametrize(("plant", "words"), [
    (os.mkfifo, "is a pipe"), (lambda path: path.symlink_to("/dev/zero"), "is a device"),
    (plug, "is a socket"), (lambda path: path.symlink_to("/proc/self/maps"), "is made up by"),
])  # fmt: skip
def test_what_a_model_names_is_a_regular_file(tmp_path, text, plant, words):
    plant(tmp_path / "thing.any")
    (tmp_path / "m.xml").write_text(f"<mujoco>{text.format('thing.any')}</mujoco>")
    soon(words, tmp_path / "m.xml")


def test_so_is_what_an_include_of_any_name_names_and_what_a_robot_does(tmp_path):
    os.mkfifo(tmp_path / "a.png")
    (tmp_path / "part.inc").write_text(f"<mujoco>{NAMED[0].format('a.png')}</mujoco>")
    (tmp_path / "m.xml").write_text('<mujoco><include file="part.inc"/></mujoco>')
    soon("a.png: is a pipe", tmp_path / "m.xml")
    os.mkfifo(tmp_path / "base.obj")
    (tmp_path / "stand.urdf").write_text(rover.URDF)
    soon("base.obj: is a pipe", tmp_path / "stand.urdf")
    os.mkfifo(tmp_path / "pipe.xml")
    soon("pipe.xml: is a pipe", tmp_path / "pipe.xml")


BALL = '<geom size=".1"/>'


@pytest.mark.parametrize(("text", "words"), [
    ('<asset><texture type="2d" name="t" builtin="flat" width="40000" height="40000"/></asset>',
     "a texture of 1600000000 values, at most 268435456"),
    ('<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 .1 .1"/></asset>',
     "a hfield of 900000000 values"),
    (f'<worldbody><replicate count="10000000">{BALL}</replicate></worldbody>',
     "stand for more than 1000000 elements"),
    ("<worldbody>" + '<replicate count="99">' * 4 + BALL + "</replicate>" * 4 + "</worldbody>",
     "stand for more than 1000000 elements"),
    ('<size memory="1T"/>', "does not compile"), ("<worldbody>" + "<body>" * 20_000, "valid MJCF"),
])  # fmt: skip
def test_a_few_words_that_ask_for_too_much(tmp_path, text, words):
    (tmp_path / "m.xml").write_text(f"<mujoco>{text}</mujoco>")
    soon(words, tmp_path / "m.xml")


def test_what_no_words_show_is_bounded_while_it_is_compiled(tmp_path, monkeypatch):
    texture = '<texture type="2d" name="t" builtin="flat" width="9000" height="9000"/>'
    (tmp_path / "m.xml").write_text(f"<mujoco><asset>{texture}</asset></mujoco>")
    monkeypatch.setattr(mjcf, "_MODEL_BYTES", 1 << 26)
    soon("m.xml: takes more than 64 MB of memory", tmp_path / "m.xml")
    copies = f'<worldbody><replicate count="20000">{BALL}</replicate></worldbody>'
    (tmp_path / "m.xml").write_text(f"<mujoco>{copies}</mujoco>")
    monkeypatch.setattr(mjcf, "_MODEL_S", 1)
    soon("m.xml: takes more than 1 s of computing", tmp_path / "m.xml")


@pytest.mark.parametrize(("text", "words"), [
    ('<worldbody><geom size="0"/></worldbody>', "m.xml: the scene does not compile"),
    ("<\u202e/>", r"m.xml is not valid MJCF .*202e"),
    (f'<asset><mesh name="a" file="{"9" * 5000}.obj"/></asset>', "m.xml: the scene does not comp"),
])  # fmt: skip
def test_what_mujoco_says_is_one_printable_line_of_its_file(tmp_path, text, words):
    (tmp_path / "m.xml").write_text(f"<mujoco>{text}</mujoco>", encoding="utf-8")
    soon(words, tmp_path / "m.xml")


def test_siblings_are_added_and_not_multiplied(tmp_path):
    copies = f'<replicate count="100" offset="0 0 1">{BALL}</replicate>' * 5
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{copies}</worldbody></mujoco>")
    assert model_of(tmp_path / "m.xml").ngeom == 500


def saved(model):
    room = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, room)
    return room.tobytes()


@pytest.mark.parametrize("write", [rover.write, rover.write_urdf])
def test_the_model_is_the_one_that_is_compiled_here(tmp_path, write):
    path = write(tmp_path)
    assert saved(model_of(path)) == saved(compiled(read_spec(path)))


def test_what_is_wrong_with_a_model_is_said_as_here(tmp_path):
    (tmp_path / "m.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(InputError) as here:
        compiled(read_spec(tmp_path / "m.xml"))
    refused(str(here.value).replace("(", r"\(").replace(")", r"\)"), model_of, tmp_path / "m.xml")
