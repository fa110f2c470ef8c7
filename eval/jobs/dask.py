"""Jobs on an existing Dask cluster: SLURM, Kubernetes or a few machines under one scheduler."""

from __future__ import annotations

import ipaddress
import logging
import math
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit
from uuid import uuid4

from eventsweep.emvs.errors import InputError, heed_interrupt
from eventsweep.emvs.utils.release import install_extra
from eventsweep.eval.jobs.batches import BatchWorkers, Result, do_batch

if TYPE_CHECKING:
    from distributed import Client

_log = logging.getLogger(__name__)
FIND_S = 120.0
"""How long a scheduler that is gone is looked for."""
_CONNECT_S = 10
_LEAVE_S = 5
_COUNT_S = 1.0  # between two questions how many workers there are
_START = "start one with `dask scheduler --host 127.0.0.1`, or leave --scheduler out"


@dataclass(frozen=True)
class Cluster:
    """Where a scheduler listens, such as `tls://head:8786`, and how to talk to it.

    Attributes:
        remote: whether an unencrypted address may be another machine's.
        tls_ca: certificate of the authority, for `tls://`.
        tls_cert: this side's certificate.
        tls_key: its key.
    """

    address: str
    remote: bool = False
    tls_ca: Path | None = None
    tls_cert: Path | None = None
    tls_key: Path | None = None

    def check(self) -> None:
        """Raises unless it is an address that sends no work over a network unencrypted."""
        place = urlsplit(self.address)
        if place.scheme not in ("tcp", "tls") or not place.hostname or ":" not in place.netloc:
            raise InputError(
                f"scheduler {self.address!r}: needs tcp://ADDRESS:PORT or tls://ADDRESS:PORT"
            )
        if place.scheme == "tls":
            self._check_files()
        elif not self.remote and not _is_loopback(place.hostname):
            raise InputError(
                f"scheduler {self.address}: another machine over tcp:// is neither encrypted nor "
                "authenticated: use tls:// with --tls-ca, --tls-cert and --tls-key, an SSH tunnel "
                "to 127.0.0.1, or --remote on a network that you trust"
            )

    def _check_files(self) -> None:
        files = {"--tls-ca": self.tls_ca, "--tls-cert": self.tls_cert, "--tls-key": self.tls_key}
        for flag, path in files.items():
            if path is None or not path.is_file():
                raise InputError(f"scheduler {self.address}: needs {flag} FILE, not {path}")

    def connect(self) -> Client:
        """Opens a connection."""
        self.check()
        try:
            from distributed import Client
        except ImportError as error:
            heed_interrupt(error)
            raise InputError(
                f"--scheduler needs the library distributed: {install_extra('cluster')}"
            ) from error

        class Leaving(Client):
            """Is taken leave of by `dask_workers`, not when an interrupted command ends."""

            def __del__(self) -> None: ...

        try:
            return Leaving(
                self.address, timeout=_CONNECT_S, security=self._security(), set_as_default=False
            )
        except (OSError, ValueError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"scheduler {self.address}: not reached ({reason}): {_START}"
            ) from error

    def _security(self) -> Any:
        from distributed import Security

        if self.tls_ca is None:
            return Security()
        return Security(
            tls_ca_file=str(self.tls_ca),
            tls_client_cert=str(self.tls_cert),
            tls_client_key=str(self.tls_key),
            require_encryption=True,
        )


@contextmanager
def dask_workers(cluster: Cluster, cache: Path) -> Iterator[DaskWorkers]:
    """Connects to a cluster, and lets go of it without stopping it.

    The jobs' cache is a folder as the workers see it; best one that they share.
    """
    workers = DaskWorkers(cluster, cache)
    try:
        yield workers
    finally:
        workers.leave()


class DaskWorkers(BatchWorkers):
    """The workers of a cluster; they, and the scheduler, may come and go."""

    do = staticmethod(do_batch)

    def __init__(self, cluster: Cluster, cache: Path) -> None:
        super().__init__(cache)
        self._cluster, self._client = cluster, cluster.connect()
        self._count, self._counted_s = 0, -math.inf
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        self.lost = CancelledError, TimeoutError, CommClosedError
        self.final = (KilledWorker,)

    def leave(self) -> None:
        """Lets go of the cluster."""
        with suppress(Exception):  # a scheduler that is gone cannot be taken leave of
            self._client.close(timeout=_LEAVE_S)

    @property
    def count(self) -> int:
        """Threads of all workers that are there now, or were a second ago."""
        if time.monotonic() >= self._counted_s + _COUNT_S:
            try:
                self._count = sum(self._client.nthreads().values())
            except (OSError, RuntimeError, AttributeError):  # the last: the scheduler is gone
                self._count = 0
            self._counted_s = time.monotonic()
        return self._count

    def start(self, stage: str, parcel: bytes) -> Result:
        """Hands over a batch; the scheduler replaces a worker that dies of it.

        To Dask tasks of one key are one task, also those of two programs; and it keeps an account
        of every kind of task, which is what the key has before its number.
        """
        future: Result = self._client.submit(
            self.do, parcel, key=f"{stage}-{uuid4().hex}", pure=False
        )
        return future

    def check(self) -> None:
        """Looks for a scheduler that is gone, and takes the jobs back that it took along."""
        if self._client.status == "running":
            return
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # it shows its stack
        _log.warning("the scheduler is gone: looking for it for %g s", FIND_S)
        self.leave()
        self._client = self._found()
        self.take_back()

    def _found(self) -> Client:
        """Connects to the scheduler that was started in the place of one that is gone."""
        until_s = time.monotonic() + FIND_S
        while True:
            try:
                return self._cluster.connect()
            except InputError as error:
                if time.monotonic() >= until_s:
                    raise InputError(
                        f"the scheduler is gone, and was looked for for {FIND_S:g} s: start it "
                        "again and repeat the command; finished jobs are in the cache"
                    ) from error
                time.sleep(1)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
