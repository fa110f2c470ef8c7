"""A socket among files, which no reader may wait for."""

import os
import socket
from pathlib import Path


def plug(path):
    """Makes a socket called like a file."""
    before = Path.cwd()
    os.chdir(path.parent)  # a socket's name is short
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path.name)
    os.chdir(before)
