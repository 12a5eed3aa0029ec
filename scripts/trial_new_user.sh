#!/usr/bin/env bash
# A new user's first quarter of an hour: in an empty folder, with nothing but the wheel of PHRT, a scene, a heuristic, five lines
# changed in it, a picture by it, a comparison with it; then it is broken on purpose, in every way that comes to mind.
#
#   scripts/trial_new_user.sh [--checkout | --online] [FOLDER]
#
# Every command is printed before it runs, and what it says after it; the script fails where one does not leave as it should.
#   --checkout  PHRT as the interpreter has it, instead of its wheel: quick, as its kernels are compiled already
#   --online    an environment with nothing in it: pip fetches what PHRT needs. Else it sees what the interpreter has, and no network
#   FOLDER      an empty folder, which is kept; by default one that is gone afterwards
# PYTHON names the interpreter; by default that of .venv.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
python=${PYTHON:-$root/.venv/bin/python}
from=wheel
case ${1:-} in
    --checkout) from=checkout; shift ;;
    --online) from=online; shift ;;
esac
if [ $# -gt 0 ]; then
    mkdir -p "$1" && cd "$1"
else
    folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT && cd "$folder"
fi
[ -z "$(ls -A)" ] || { echo "$PWD is not empty" >&2; exit 2; }

say() { printf '\n# %s\n' "$*"; }

try() { # the exit code to expect, then a command
    local wanted=$1 code=0
    shift
    printf '$ %s\n' "$*"
    "$@" 2>&1 || code=$?
    [ "$code" = "$wanted" ] || { printf 'it left with %s, and not with %s\n' "$code" "$wanted" >&2; exit 1; }
    [ "$code" = 0 ] || printf '(exit code %s)\n' "$code"
}

expect() { # a text that the last lines of a command must have said: expect TEXT CODE COMMAND...
    local text=$1 said
    shift
    said=$(try "$@") || { printf '%s\n' "$said"; exit 1; }
    printf '%s\n' "$said"
    case $said in *"$text"*) ;; *) printf 'it does not say: %s\n' "$text" >&2; exit 1 ;; esac
}

edit() { # sed expressions on the heuristic, kept for later
    sed -i "$@" phrt-nearest/phrt_nearest.py
}

say "An environment of its own, and PHRT in it ($from)"
offline=()
if [ $from = online ]; then
    "$python" -m venv env
    "$root/.venv/bin/python" -m pip wheel --quiet --no-deps -w wheels "$root"
    env/bin/python -m pip install --quiet "$(echo "$PWD"/wheels/phrt-*.whl)[bench]" pytest
else
    offline=(--no-index --no-deps --no-build-isolation)
    "$python" -m venv --without-pip env
    echo "import site; site.addsitedir('$("$python" -c 'import sysconfig; print(sysconfig.get_paths()["purelib"])')')" \
        >"$(echo env/lib/python*/site-packages)/here.pth"
    if [ $from = wheel ]; then
        "$python" -m pip wheel --quiet "${offline[@]}" -w wheels "$root"
        "$python" -m pip --python env/bin/python install --quiet "${offline[@]}" --force-reinstall wheels/phrt-*.whl
    fi
    printf '#!%s\nfrom phrt.cli.main import main\n\nif __name__ == "__main__":\n    main()\n' "$PWD/env/bin/python" >env/bin/phrt
    printf '#!/bin/sh\nexec "%s" -m pip --python "%s" "$@"\n' "$python" "$PWD/env/bin/python" >env/bin/pip
    printf '#!/bin/sh\nexec "%s" -m pytest -p no:dash -p no:cacheprovider "$@"\n' "$PWD/env/bin/python" >env/bin/pytest
    chmod +x env/bin/phrt env/bin/pip env/bin/pytest
fi
PATH=$PWD/env/bin:$PATH
pip_install() { try 0 pip install --quiet --disable-pip-version-check "${offline[@]}" "$@"; }

say "Something to look at"
try 0 phrt --version
try 0 phrt new scene room
try 0 phrt render room.yaml -o room.png --size 192x108

say "A heuristic of one's own: five lines are changed"
try 0 phrt new heuristic nearest
cp phrt-nearest/phrt_nearest.py before.py
edit -e '1s/what is large and near is traced first/what is near and in the middle is traced first/' \
    -e 's/falling area \/ distance \*\* power, mandatory/falling center_closeness \/ distance ** power, mandatory/' \
    -e 's/"What is large and near first."/"What is near and in the middle first."/' \
    -e 's/"""By falling area \/ distance/"""By falling center_closeness \/ distance/' \
    -e 's/score = candidates.area \//score = candidates.center_closeness \//'
changed=$(diff before.py phrt-nearest/phrt_nearest.py | grep -c '^>' || true)
diff before.py phrt-nearest/phrt_nearest.py || true
[ "$changed" = 5 ] || { echo "$changed lines were changed, and not 5" >&2; exit 1; }
pip_install -e ./phrt-nearest
expect "phrt-nearest" 0 phrt plugins --kind heuristic
expect "What is near and in the middle first." 0 phrt plugins show nearest
(cd phrt-nearest && expect "2 passed" 0 pytest -q) || exit 1
expect "rays" 0 phrt render room.yaml -o nearest.png --size 192x108 --heuristic nearest --budget 6000rays
try 0 sed -i 's/^heuristics: \[/heuristics: [nearest, /' room_bench.yaml
expect "nearest" 0 phrt bench room_bench.yaml -o out/room --quiet

say "A slip of the pen: an option that cannot be, a name that is not there"
expect "option 'power' is -1, allowed: float >= 0.0 <= 8.0" 2 phrt render room.yaml -o x.png --heuristic nearest -H power=-1
expect "Did you mean 'nearest'?" 2 phrt render room.yaml -o x.png --heuristic nearst

say "It names an item that does not exist: the picture is finished without it, or it is an error with --strict"
cp phrt-nearest/phrt_nearest.py good.py
edit -e 's/return next((item for item in self.queue.*/return 100_000/'
expect "heuristic 'nearest' of phrt-nearest" 0 phrt render room.yaml -o broken.png --size 192x108 --heuristic nearest
expect "heuristic 'nearest' of phrt-nearest" 2 phrt render room.yaml -o x.png --size 192x108 --heuristic nearest --strict
(cd phrt-nearest && expect "breaks its contract" 1 pytest -q) || exit 1
cp good.py phrt-nearest/phrt_nearest.py

say "It raises: in a comparison its cells fail, with the reason, and the others go on"
edit -e 's/score = .*/raise RuntimeError("I have not thought of that")/'
expect "I have not thought of that" 1 phrt bench room_bench.yaml -o out/raises --quiet
cp good.py phrt-nearest/phrt_nearest.py

say "It cannot even be imported: everything else works, and only asking for it is an error"
edit -e '/^import numpy/s/.*/import nunpy as np/'
expect "plugin 'phrt-nearest' was left out: ModuleNotFoundError: No module named 'nunpy'" 0 phrt plugins --kind tracer
expect "No module named 'nunpy'" 2 phrt render room.yaml -o x.png --heuristic nearest
expect "No module named 'nunpy'" 2 phrt plugins show nearest
expect "No module named 'nunpy'" 0 phrt render room.yaml -o fine.png --size 64x36 --heuristic gain --budget 800rays
cp good.py phrt-nearest/phrt_nearest.py

say "It is written for a later PHRT"
edit -e 's/factory, NearestOptions)/factory, NearestOptions, api_version=9)/'
expect "needs plugin API 9" 2 phrt render room.yaml -o x.png --heuristic nearest
cp good.py phrt-nearest/phrt_nearest.py

say "Mended, it works again; taken away, it is gone"
try 0 phrt render room.yaml -o again.png --size 192x108 --heuristic nearest --budget 6000rays
try 0 cmp nearest.png again.png
try 0 pip uninstall --quiet --yes phrt-nearest
expect "there is no heuristic 'nearest'" 2 phrt render room.yaml -o x.png --heuristic nearest
say "Done: everything said what it should."
