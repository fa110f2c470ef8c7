#!/usr/bin/env bash
# What a new user of the library meets: the wheel alone in an empty environment. Called by
# fresh_machine.sh, in the root folder of a bare machine, from the checkout.
#
# System libraries that are missing must be named, in one line, by the error that they cause; they
# are then installed as it says.
set -euo pipefail

# A bright square that moves, for `events`.
FRAMES='
from pathlib import Path
from PIL import Image
Path("frames").mkdir()
for k in range(5):
    picture = Image.new("L", (64, 48), 40)
    picture.paste(200, (4 * k, 10, 4 * k + 16, 30))
    picture.save(f"frames/{k}.png")
'
home=/root/user
aside=/root/aside

say() { printf 'wheel: %s\n' "$*" >&2; }

install() {
    { apt-get update -qq &&
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@"; } \
        >"$home/apt.log" 2>&1 || { cat "$home/apt.log"; return 1; }
}

# Builds the wheel, and takes the first examples of the documentation out of it.
prepare() {
    install python3-venv
    python3 -m venv /root/build
    /root/build/bin/pip install --quiet mypy
    /root/build/bin/pip wheel --quiet --no-deps --wheel-dir "$home" .
    python3 - "$home" <<'PYTHON'
import re
import sys
from pathlib import Path

home = Path(sys.argv[1])
block = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
api = block.findall(Path("docs/api.md").read_text(encoding="utf-8"))
tutorial = block.findall(Path("docs/tutorial.md").read_text(encoding="utf-8"))
(home / "first.py").write_text(api[0], encoding="utf-8")
(home / "tutorial.py").write_text("\n".join(tutorial), encoding="utf-8")
PYTHON
}

# Runs a command, installs what its last line says is missing, and runs it again.
with_libraries() {
    local packages
    until "$@" 2>"$home/errors"; do
        packages=$(tail -n 1 "$home/errors" | grep -oE 'apt-get install [a-z0-9 .+-]+' || true)
        [ -n "$packages" ] || { cat "$home/errors"; return 1; }
        say "$1 said, in $(wc -l <"$home/errors") line(s): $(tail -n 1 "$home/errors")"
        # shellcheck disable=SC2086 # a list of packages
        install ${packages#apt-get install }
    done
    say "works: $*"
}

main() {
    mkdir -p "$home"
    prepare
    mv "$PWD" "$aside"
    # shellcheck disable=SC2064 # the folder of now
    trap "cd / && mv $aside $PWD" EXIT
    cd "$home"
    python3 -m venv env
    env/bin/pip install --quiet ./*.whl
    with_libraries env/bin/eventsweep list >/dev/null
    with_libraries env/bin/eventsweep run desk --seconds 0.1 --out run --quiet
    with_libraries env/bin/python first.py
    # The tutorial's script goes on from its commands.
    with_libraries env/bin/eventsweep simulate boxes --out boxes-sequence --seconds 0.2 --quiet
    with_libraries env/bin/python tutorial.py
    # Each plug-in once: verbs, methods, checks and devices that come by entry points.
    with_libraries env/bin/eventsweep check boxes-sequence --quiet
    with_libraries env/bin/eventsweep realism boxes-sequence boxes-sequence --out realism --quiet
    with_libraries env/bin/eventsweep simulate desk --out desk-sequence --quiet
    with_libraries env/bin/eventsweep track desk-sequence --out tracked --quiet
    with_libraries env/bin/eventsweep map boxes-sequence --out learned --method Learned/H --quiet
    with_libraries env/bin/python -c "$FRAMES"
    with_libraries env/bin/eventsweep events frames --out frames-events --rate-hz 100 --quiet
    with_libraries env/bin/eventsweep archive make quick --out frozen --case plain --seeds 0 --quiet
    with_libraries env/bin/eventsweep map boxes-sequence --out auto --device auto --quiet
    /root/build/bin/mypy --strict --config-file= --python-executable env/bin/python tutorial.py first.py
}

main "$@"
