"""The command line: one program, a verb per stage, and `run` for all of them.

Only light modules are imported at the top: help must come at once, and numba, MuJoCo and open3d
take seconds.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter
from pydantic import BaseModel

from emvs.config import MapperConfig
from emvs.utils.outputs import check_output
from eval.config import EvalConfig, Settings, load, unread
from sim.config import SimConfig

_SIM, _MAP, _SCORE = (Group(f"{title} parameters") for title in ("Simulator", "Mapper", "Score"))
SimFlags = Annotated[SimConfig, Parameter(group=_SIM)]
MapFlags = Annotated[MapperConfig, Parameter(group=_MAP)]
ScoreFlags = Annotated[EvalConfig, Parameter(group=_SCORE)]
NO_NEGATIVE = Parameter(negative=())
"""Of a flag that has no `--no-` or `--empty-` beside it."""
Methods = Annotated[tuple[str, ...], NO_NEGATIVE]

app = App(
    name="eventsweep",
    help="Simulate, map and score event-based multi-view stereo.",
    version=lambda: f"eventsweep {version('eventsweep')}",
    default_parameter=Parameter(negative_iterable=()),
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)


@Parameter(name="*")
@dataclass(frozen=True)
class Common:
    """What every command takes."""

    force: Annotated[bool, Parameter(group="Common", negative=())] = False
    "Replace an existing output, if all that is in it was written by eventsweep."

    quiet: Annotated[bool, Parameter(group="Common", negative=())] = False
    "Print no progress and no summary."

    json: Annotated[bool, Parameter(group="Common", negative=())] = False
    "Print the summary as JSON."

    def console(self) -> Any:
        """Where progress and summaries go."""
        from eval.cli.console import Console

        return Console(quiet=self.quiet, as_json=self.json)


@Parameter(name="*")
@dataclass(frozen=True)
class Configured(Common):
    """What every command takes that has settings: all others refuse a file of them."""

    config: Annotated[Path | None, Parameter(group="Common")] = None
    "TOML file with the tables [sim], [map] and [score]; flags go before it."

    def settings(self, **flags: BaseModel) -> Settings:
        """The file joined with flags, by the tables' names; says what in the file is not read.

        Raises:
            InputError: what `eval.config.load` refuses.
        """
        wanted = load(self.config, **flags)
        for line in unread(self.config, tuple(flags)) if not self.quiet else ():
            sys.stderr.write(f"{line}\n")
        return wanted

    def inputs(self, *more: Path | None) -> tuple[Path, ...]:
        """The files that a command reads: no output may replace one of them."""
        return tuple(path for path in (self.config, *more) if path is not None)

    def check(self, out: Path, *inputs: Path | None) -> None:
        """Refuses, before anything is read, an output that --force would not replace."""
        if self.force:
            check_output(out, force=True, inputs=self.inputs(*inputs))


COMMON, CONFIGURED = Common(), Configured()
SIM, MAP, SCORE = SimConfig(), MapperConfig(), EvalConfig()


def with_values(group: Any, **values: Any) -> Any:
    """Returns a group with some values set, where they are not None."""
    set_values = {name: value for name, value in values.items() if value is not None}
    return group.model_copy(update=set_values)
