"""A web server of a folder that gives ranges of bytes, counts them, and can be slow or cut off.

It is a process of its own: a thread here could wait for a lock that its client holds.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.request import urlopen


class Served:
    """A server as its client sees it.

    `set` changes how it answers: `cut`, so many answers to come end in the middle; `delay_s`, what
    each waits; `whole`, whether it ignores ranges, as simple servers do.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def set(self, **values: float) -> None:
        words = "&".join(f"{name}={value}" for name, value in values.items())
        urlopen(f"{self.address}/_set?{words}").read()

    def sent(self) -> int:
        """Bytes of all bodies so far."""
        return json.loads(urlopen(f"{self.address}/_sent").read())


@contextmanager
def serving(folder: Path):
    """Serves a folder while the context lasts."""
    words = [sys.executable, __file__, str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield Served(process.stdout.readline().strip())
        finally:
            process.kill()


class RangeServer(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.folder, self.sent = folder, 0
        self.cut, self.delay_s, self.whole = 0.0, 0.0, 0.0
        self.lock = threading.Lock()


class _Handler(BaseHTTPRequestHandler):
    server: RangeServer
    protocol_version = "HTTP/1.1"

    def log_message(self, *_words: object) -> None: ...

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def do_GET(self) -> None:
        if self.path.startswith("/_set?"):
            for name, value in re.findall(r"(\w+)=([\d.]+)", self.path):
                setattr(self.server, name, float(value))
            self._reply(b"")
        elif self.path == "/_sent":
            self._reply(str(self.server.sent).encode())
        else:
            self._answer(body=True)

    def _reply(self, data: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _answer(self, *, body: bool) -> None:
        time.sleep(self.server.delay_s)
        path = self.server.folder / self.path.lstrip("/")
        if not path.is_file():
            self.send_error(404)
            return
        data = path.read_bytes()
        asked = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
        if asked and not self.server.whole:
            start, stop = int(asked[1] or 0), min(int(asked[2] or len(data)) + 1, len(data))
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {start}-{stop - 1}/{len(data)}")
            data = data[start:stop]
        else:
            self.send_response(200)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("ETag", f'"{path.stat().st_mtime_ns}"')
        self.send_header("Accept-Ranges", "bytes")
        self.end_headers()
        if body:
            self._send(data)

    def _send(self, data: bytes) -> None:
        with self.server.lock:
            cut = self.server.cut > 0
            self.server.cut -= cut
            data = data[: len(data) // 2] if cut else data
            self.server.sent += len(data)
        self.wfile.write(data)
        if cut:
            self.close_connection = True


if __name__ == "__main__":
    with RangeServer(Path(sys.argv[1])) as server:
        sys.stdout.write(f"http://127.0.0.1:{server.server_port}\n")
        sys.stdout.flush()
        server.serve_forever()
