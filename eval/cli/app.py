"""What all verbs share: the program, flags that several of them take, and groups of settings.

Only light modules are imported at the top: help must come at once, and numba, MuJoCo and open3d
take seconds.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import Group, Parameter
from pydantic import BaseModel

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError, one_line
from eventsweep.emvs.utils.plugins import DEVICES, TRACKERS, points
from eventsweep.eval.cli import names
from eventsweep.eval.cli.help import HELP_FLAGS, RARE, Program, readable
from eventsweep.eval.config import EvalConfig, Settings, TrajectoryConfig, load, unread
from eventsweep.sim.config import SimConfig

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Console

SIM_GROUP, _MAP, _SCORE, _TRAJECTORY, JOBS, COMMON_GROUP = map(
    Group.create_ordered,
    ("Simulator parameters", "Mapper parameters", "Score parameters", "Trajectories",
     "Where jobs run", "Common"),
)  # fmt: skip
SimFlags = Annotated[SimConfig, Parameter(group=SIM_GROUP), RARE]
MapFlags = Annotated[MapperConfig, Parameter(group=_MAP), RARE]
ScoreFlags = Annotated[EvalConfig, Parameter(group=_SCORE), RARE]
TrajectoryFlags = Annotated[TrajectoryConfig, Parameter(name="*", group=_TRAJECTORY), RARE]
NO_NEGATIVE = Parameter(negative=())
"""Of a flag that has no `--no-` or `--empty-` beside it."""
Methods = Annotated[tuple[str, ...], Parameter(negative=(), completer=names.method_names)]
if TYPE_CHECKING:
    Poses: TypeAlias = str
    Device: TypeAlias = str
else:  # what plug-ins bring is known when the program starts
    Poses = Literal["true", *(point.name for point in points(TRACKERS))]
    Device = Literal["cpu", *(point.name for point in points(DEVICES)), "auto"]
DeviceName = Annotated[Device | None, RARE]
Scenes = Annotated[tuple[str, ...], Parameter(negative=(), completer=names.scenes)]
Scene = Annotated[str, Parameter(completer=names.scenes)]
RigName = Annotated[str | None, Parameter(completer=names.rigs)]
SuiteName = Annotated[str, Parameter(completer=names.suites)]
Predictions = Annotated[tuple[str, ...], Parameter(negative=())]
AllowSkipped = Annotated[bool, NO_NEGATIVE, RARE]
Force = Annotated[
    bool,
    Parameter(
        group=COMMON_GROUP,
        negative=(),
        help="Replace an existing output; files of yours, or that it reads, are kept beside it.",
    ),
]

app = Program(
    name="eventsweep",
    help="Simulate, map and score event-based multi-view stereo.",
    version=lambda: f"eventsweep {version('eventsweep')}",
    help_flags=HELP_FLAGS,
    default_parameter=Parameter(negative_iterable=(), show_default=readable),
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)


@Parameter(name="*")
@dataclass(frozen=True)
class Quiet:
    """What every command takes that prints no facts, only what it has written."""

    quiet: Annotated[bool, Parameter(group=COMMON_GROUP, negative=())] = False
    "Print no progress and no summary."

    json = False

    def console(self) -> Console:
        """Where progress and summaries go."""
        from eventsweep.eval.cli.console import Console

        return Console(quiet=self.quiet, as_json=self.json)


@Parameter(name="*")
@dataclass(frozen=True)
class Common(Quiet):
    """What every command takes that prints a summary."""

    json: Annotated[bool, Parameter(group=COMMON_GROUP, negative=())] = False
    "Print the summary as JSON, and no progress."


@Parameter(name="*")
@dataclass(frozen=True)
class Configured(Common):
    """What every command takes that has settings: all others refuse a file of them."""

    config: Annotated[Path | None, Parameter(group=COMMON_GROUP)] = None
    "TOML file with the tables [sim], [map] and [score]; flags override it."

    def settings(self, **flags: BaseModel) -> Settings:
        """The file joined with flags, by the tables' names; says what in the file is not read."""
        wanted = load(self.config, **flags)
        for line in unread(self.config, tuple(flags)) if not self.quiet else ():
            sys.stderr.write(f"{one_line(line)}\n")
        return wanted


QUIET, COMMON, CONFIGURED = Quiet(), Common(), Configured()
SIM, MAP, SCORE, TRAJECTORY = SimConfig(), MapperConfig(), EvalConfig(), TrajectoryConfig()


def command_line() -> str:
    """The command that runs, as pages show it."""
    return " ".join(["eventsweep", *sys.argv[1:]])


def with_values(group: Any, **values: Any) -> Any:
    """Returns a group with some values set, where they are not None."""
    set_values = {name: value for name, value in values.items() if value is not None}
    return group.model_copy(update=set_values)


def check_skipping(config: MapperConfig, *, allowed: bool) -> None:
    """Refuses --allow-skipped where there is one window, which cannot be skipped."""
    if allowed and not config.slides:
        raise InputError(
            "--allow-skipped without sliding windows: add --map.window-s or --map.window-events, "
            "or leave it out"
        )
