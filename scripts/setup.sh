# shellcheck shell=bash
# Sourced by the other scripts: makes .venv beside the sources and installs the project in it, once. Its argument names an
# extra of the project, or is "": without one bash would hand on what the script itself was given.
# A stamp holds the hash of pyproject.toml, so that a second call costs nothing until the dependencies change.
cd "$(dirname "${BASH_SOURCE[0]}")/.."
project_extra="${1:-}"
python=""
for candidate in python3 python3.11 python3.12 python3.13; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        python="$candidate"
        break
    fi
done
if [ -z "$python" ]; then
    echo "Python 3.11 or newer is needed, with its venv module: on Debian, apt-get install python3 python3-venv" >&2
    exit 1
fi
if ! .venv/bin/python -m pip --version >/dev/null 2>&1 && ! "$python" -m venv --clear .venv; then
    rm -rf .venv # Debian without python3-venv leaves half of one behind
    echo "No virtual environment could be made: on Debian, apt-get install python3-venv" >&2
    exit 1
fi
stamp=".venv/installed${project_extra:+-$project_extra}"
wanted="$(sha256sum pyproject.toml | cut -d' ' -f1)"
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ] && [ "$(cat .venv/installed-dev 2>/dev/null)" != "$wanted" ]; then
    echo "Installing the project into .venv (a minute or two, once) ..." >&2
    .venv/bin/python -m pip install --quiet --editable ".${project_extra:+[$project_extra]}" >&2
    echo "$wanted" > "$stamp"
fi

# EGL is a system library: pip cannot bring it.
if ! .venv/bin/python -c 'import ctypes; ctypes.CDLL("libEGL.so.1")' 2>/dev/null; then
    line="apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1-mesa-dri"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "Installing the EGL libraries ..." >&2
        sh -c "$line" >&2
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
        echo "Installing the EGL libraries with sudo ..." >&2
        sudo sh -c "$line" >&2
    else
        echo "Rendering needs EGL. Type this, then run the script again:" >&2
        echo "    sudo sh -c '$line'" >&2
        exit 1
    fi
fi
