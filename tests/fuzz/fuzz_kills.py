"""Kills commands at random moments: `fuzz_kills.py [KILLS] [FIRST] [COMMAND ...]`.

Each command runs in a process, with files of somebody beside its places, and is killed at a moment
that its number draws from the time that the command takes; alone, or with its workers. Half of
the time a file of somebody then appears in what is there of the output. Called again, the command
ends with 0, or says in one line that it needs `--force`, which keeps the file. Then everything is
what two runs that nobody killed have made, byte by byte but for the seconds that jobs took: nothing
of ours is left over, and nothing of somebody is lost.
"""

import os
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

# Run as a program, too: what it shares with the tests lies beside its folder, and in plug-ins.
ROOT = Path(__file__).parents[2]
SHARED = (
    "tests/helpers", "tests/helpers/recordings", "tests/reference", "plugins/ranking/tests",
    "plugins/video/tests",
)  # fmt: skip
sys.path[:0] = [str(ROOT / name) for name in SHARED]

import numpy as np
import tomli_w

import fuzz_results
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.utils.output_manifest import NAME as MANIFEST
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.eval.cli.main import main as verb
from point_world import edge_points, pinhole, stereo_rig, swinging
from small_pair import small_sequence
from small_suite import case, suite_text
from video_files import drifting, write_folder

PLANES = "--rig oblique --seconds 0.04 --out out"
RUN = "--method Alg1/H --map.planes 10"
MAP = "map rec --out out --map.window-s 0.02 --map.planes 5 --method Alg1/H --no-check"
JOBS = "--cache cache --workers 1"
ARCHIVE = f"archive make pair.toml --out made {JOBS}"
SUITE = f"suite pair.toml --no-speed {JOBS}"
GATE = "gate --baseline base.json --result ran"
UPDATED = (f"{SUITE} --out ran", f"{GATE} --update --reason new")
COMPARED = f"{GATE} --junit out/g.xml --markdown out/g.md"
# Name -> what is run; before the last, those that it needs.
COMMANDS = {
    "simulate": (f"simulate planes {PLANES}",),
    "simulate in two": (f"simulate planes --workers 2 {PLANES}",),
    "simulate anew": (f"simulate planes {PLANES}", f"simulate planes --seed 1 --force {PLANES}"),
    "run": (f"run planes {RUN} {PLANES}",),
    "run anew": (f"run planes {RUN} {PLANES}", f"run planes {RUN} {PLANES} --seed 1 --force"),
    "map": (MAP,),
    "map anew": (MAP, f"{MAP} --map.median-px 3 --force"),
    "fuse": (MAP, "fuse out"),
    "report": (MAP, "report out --tables --figures svg"),
    "score": (f"run planes {RUN} {PLANES}", "score out"),
    "events": ("events video --out out",), "convert": ("convert rec out --to dsec",),
    "convert a file": ("convert rec out.npz --to npz --stream cam0",),
    "suite": (f"{SUITE} --out out",),
    "suite anew": (f"{SUITE} --out out", f"{SUITE} --seeds 1 --out out --force"),
    "study": (f"study window-length --case planes --seeds 0 --method Alg1/H --out out {JOBS}",),
    "make": (f"archive make pair.toml --out out {JOBS}",),
    "fetch": (ARCHIVE, "archive fetch made --out out"),
    "unpack": (ARCHIVE, "archive unpack made --out out"),
    "calibrate": (
        "calibrate points --refine delay --out out --windows 5 --window-s 0.15 --events 3000",
    ),
    "submission": ("submission make theirs --suite pair.toml --out out.tar.zst",),
    "compare": (f"{SUITE} --out ran", "compare ran ran --out out"),
    "ranking": ("ranking results --out out",), "gate": (*UPDATED, COMPARED),
    "gate anew": (*UPDATED, COMPARED, f"{COMPARED} --force"),
    "baseline": UPDATED, "info": ("info rec --picture out.png",),
    "cache": (ARCHIVE, "cache --cache cache --prune 0"),
    "completion": ("completion bash",),
}  # fmt: skip
# Of somebody, and named like what the commands make on their way.
THEIRS = (
    "thesis.txt", ".out.abcdefgh.partial/thesis.txt", ".out.lock", "cache/notes.txt",
    "cache/th/thesis/entry.json", "home/.bashrc", "tmp/thesis.txt", "outer/.eventsweep-work",
)  # fmt: skip
COST = {"seconds_per_window": 0.5, "peak_memory_mb": 120.0, "hardware": "a laptop"}
SUBMITTED = {"method": "Guess", "authors": ["A. Author"], "licence": "MIT", "cost": COST}
SECONDS = re.compile(rb'("(?:cpu_s|seconds|cpu_seconds)": )[\d.e-]+')
PATIENCE_S = 120.0


@dataclass
class Ended:
    """A process that is over: its code, and what it said."""

    code: int
    said: str


@dataclass(frozen=True)
class Expected:
    """What a command finds, what it makes of it when nobody kills it, and how long that takes."""

    given: Path
    content: dict[str, bytes]
    took_s: float


def sources(place):
    """What the commands read, and what is somebody's."""
    small_sequence(place / "rec")
    world = edge_points(swinging(), stereo_rig(pinhole(120, 90, 100.0), 0.1), points=500)
    with SequenceWriter(
        place / "points", name="points", rig=world.rig, trajectory=world.trajectory, config={},
        depth_range_m=world.depth_range_m,
    ) as writer:  # fmt: skip
        for camera, events in enumerate(world.streams):
            writer.append_events(camera, events)
    (place / "results").mkdir()
    fuzz_results.ranking(place / "results")
    write_folder(place / "video", drifting(12), [0.02 * k for k in range(12)])
    (place / "pair.toml").write_text(suite_text(case("pair", rig="oblique")))
    for t_us in (10_000, 30_000):
        depth = place / "theirs" / "pair" / "seed0" / f"{t_us}.npz"
        depth.parent.mkdir(parents=True, exist_ok=True)
        np.savez(depth, depth_m=np.random.default_rng(t_us).uniform(1, 2, (120, 160)))
    (place / "theirs" / "submission.toml").write_text(tomli_w.dumps(SUBMITTED))
    for name in THEIRS:
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(f"# of somebody: {name}\n")


def start(call, said):
    """Calls in a process of its own group, whose output goes to a file; returns its number."""
    process = os.fork()
    with suppress(OSError):  # whoever of both is first
        os.setpgid(process, process)
    if process:
        return process
    code = 99
    try:
        file = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, 1)
        os.dup2(file, 2)
        code = call() or 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def command(world, words, said):
    """Starts a command of ours in a folder."""

    def call():
        os.chdir(world)
        tempfile.tempdir = os.environ["TMPDIR"] = str(world / "tmp")
        if words.startswith("completion"):  # kernels are kept in the home folder, too
            os.environ["HOME"] = str(world / "home")
        return verb([*words.split(), "--quiet"])

    return start(call, said)


def ended(process, said):
    """Waits for a process, no longer than it may take."""
    until_s = time.monotonic() + PATIENCE_S
    while not (over := os.waitpid(process, os.WNOHANG))[0]:
        if time.monotonic() > until_s:
            os.killpg(process, signal.SIGKILL)
        time.sleep(0.01)
    return Ended(os.waitstatus_to_exitcode(over[1]), Path(said).read_text(errors="replace"))


def contents(world):
    """Every file and folder: what it holds, without the seconds that jobs took."""
    return {
        str(path.relative_to(world)): steady(path)
        for path in sorted(world.rglob("*"))
        if "__pycache__" not in path.parts
    }


def steady(path):
    if path.is_symlink() or not path.is_file():
        return str(path.readlink()).encode() if path.is_symlink() else b"a folder"
    if path.name == MANIFEST:  # its hashes are compared with the files by `strangers`
        return b" ".join(sorted(re.findall(rb'"([^"]+)": \{', path.read_bytes())))
    return SECONDS.sub(rb"\1", path.read_bytes())


def expected(folder, name):
    """Runs a command twice without a kill; what it makes is the same both times."""
    *needed, last = COMMANDS[name]
    given = folder / f"given {name}"
    if not given.exists():
        prepared(folder, given, needed)
    found = []
    for _ in range(2):
        world, said = fresh(folder, given), folder / "said"
        began_s = time.monotonic()
        over = ended(command(world, last, said), said)
        took_s = time.monotonic() - began_s
        assert over.code == 0, f"{last}: {over}"
        found.append(contents(world))
    differ = differing(*found)
    assert not differ, f"{last}: two runs differ: {differ}"
    return Expected(given, found[0], took_s)


def prepared(folder, given, needed):
    """Makes sources and runs what a command needs, in the folder where it will run itself."""
    world, said = folder / "world", folder / "said"
    shutil.rmtree(world, ignore_errors=True)
    world.mkdir()
    assert ended(start(lambda: sources(world), said), said).code == 0, said.read_text()
    for words in needed:
        over = ended(command(world, words, said), said)
        assert over.code == 0, f"{words}: {over}"
    world.rename(given)


def fresh(folder, given):
    """The folder in which everything runs, as the command is to find it."""
    world = folder / "world"
    shutil.rmtree(world, ignore_errors=True)
    shutil.copytree(given, world, symlinks=True)
    return world


def differing(one, other):
    """The first few paths that only one has, or that hold something else."""
    return sorted(path for path in one.keys() | other.keys() if one.get(path) != other.get(path))[
        :8
    ]


def killed(folder, name, wanted, rng):
    """Kills a command once and calls it again; returns what is wrong, or an empty text."""
    last = COMMANDS[name][-1]
    world, said = fresh(folder, wanted.given), folder / "said"
    process, wait_s = command(world, last, said), rng.uniform(0, wanted.took_s)
    time.sleep(wait_s)
    (os.killpg if rng.random() < 0.5 else os.kill)(process, signal.SIGKILL)
    os.waitpid(process, 0)
    intruder = world / "out" / "of somebody.txt"
    if rng.random() < 0.5 and intruder.parent.is_dir():
        intruder.write_text("of somebody")
    fault = again(world, last, said, intruder) or leavings(world, wanted)
    return fault and f"{name}, after {wait_s:.3f} of {wanted.took_s:.3f} s: {fault}"


def again(world, last, said, intruder):
    """Calls a command until it comes through, doing what it asks for."""
    put = intruder.exists()
    for words in (last, last, f"{last} --force"):
        over = ended(command(world, words, said), said)
        kept = [path.read_text() for path in world.glob(f"out*/{intruder.name}")]
        if put and kept != ["of somebody"]:
            return f"the file of somebody is changed: {over}"
        if over.code == 0:
            break
        if over.code != 2 or over.said.count("\n") != 1:
            return f"ends with {over.code}: {over.said[-500:]}"
        if not ("--force" in over.said or (put and intruder.name in over.said)):
            return f"needs nothing that one can give: {over.said}"
        intruder.unlink(missing_ok=True)
        put = False
    intruder.unlink(missing_ok=True)
    for path in world.glob("out.kept-*"):  # what was not ours, or stood there when it was killed
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return "" if over.code == 0 else f"never ends with 0: {over.said}"


def leavings(world, wanted):
    """What is not as if nobody had killed the command."""
    found = contents(world)
    differ = differing(found, wanted.content)
    if differ:
        return f"not as without a kill: {differ}"
    wrong = strangers(world / "out") if f"out/{MANIFEST}" in found else []
    return f"the manifest does not know {wrong}" if wrong else ""


def main(count="100", first="0", *names):
    faults, known, names = 0, {}, names or (*COMMANDS,)
    folder = Path(tempfile.mkdtemp())
    try:
        for number in range(int(first), int(first) + int(count)):
            name = names[number % len(names)]
            known[name] = known.get(name) or expected(folder, name)
            fault = killed(folder, name, known[name], np.random.default_rng([33, number]))
            faults += bool(fault)
            sys.stdout.write(f"{number}: {fault}\n" if fault else "")
            sys.stdout.flush()
    finally:
        shutil.rmtree(folder)
    sys.stdout.write(f"{count} kills, {faults} faults\n")
    return bool(faults)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
