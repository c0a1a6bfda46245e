# shellcheck shell=bash
# Sourced by the other scripts: makes a virtual environment beside the sources and installs the project in it, once, with the
# versions that it was tested with (scripts/tested-versions.txt). Its argument names an extra of the project, or is "":
# without one bash would hand on what the script itself was given.
# ROOMTWIN_PYTHON names the interpreter (default: python3, else the newest of 3.11 to 3.14 that is found) or is "newest";
# ROOMTWIN_VENV names the folder of the environment (default: .venv; of "newest" .venv-VERSION). A stamp in it holds the hash
# of what was asked for, so that a second call costs nothing until the dependencies or the interpreter change.
cd "$(dirname "${BASH_SOURCE[0]}")/.."
project_extra="${1:-}"

# Print the minor version of an interpreter, as in 3.12, if it is one that the project supports and can make environments.
supported_version() {
    "$1" -c 'import sys, venv, ensurepip
if not (3, 11) <= sys.version_info < (3, 15): sys.exit(1)
print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

# List the supported interpreters, one a line and minor version: version, a space, path. The path and pyenv are searched.
supported_interpreters() {
    local root minor candidate
    root="$(pyenv root 2>/dev/null || true)"
    for minor in 3.11 3.12 3.13 3.14; do
        for candidate in "python$minor" python3 ${root:+"$root"/versions/"$minor".*/bin/python"$minor"}; do
            if [ "$(supported_version "$candidate")" = "$minor" ]; then
                echo "$minor $(command -v "$candidate")"
                break
            fi
        done
    done
}

python="${ROOMTWIN_PYTHON:-python3}"
venv="${ROOMTWIN_VENV:-.venv}"
if [ "$python" = newest ]; then
    read -r version python <<< "$(supported_interpreters | tail -n 1)"
    venv="${ROOMTWIN_VENV:-.venv-$version}"
elif ! supported_version "$python" >/dev/null; then
    if [ -n "${ROOMTWIN_PYTHON:-}" ]; then
        echo "ROOMTWIN_PYTHON: '$ROOMTWIN_PYTHON' is no Python 3.11 to 3.14 with its venv module" >&2
        exit 1
    fi
    python="$(supported_interpreters | tail -n 1 | cut -d' ' -f2-)"
fi
if [ -z "$python" ]; then
    echo "Python 3.11 to 3.14 is needed, with its venv module: on Debian, apt-get install python3 python3-venv" >&2
    exit 1
fi
has="$(supported_version "$venv/bin/python" || true)"
# An environment made with another supported interpreter stays, unless one is asked for by name.
if [ -z "$has" ] || { [ -n "${ROOMTWIN_PYTHON:-}" ] && [ "$has" != "$(supported_version "$python")" ]; }; then
    if ! "$python" -m venv --clear "$venv"; then
        rm -rf "$venv" # Debian without python3-venv leaves half of one behind
        echo "No virtual environment could be made: on Debian, apt-get install python3-venv" >&2
        exit 1
    fi
fi
stamp="$venv/installed${project_extra:+-$project_extra}"
wanted="$(cat pyproject.toml scripts/tested-versions.txt | sha256sum | cut -d' ' -f1)"
# What the extra `dev` brings is enough where no extra is asked for.
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ] &&
    { [ -n "$project_extra" ] || [ "$(cat "$venv/installed-dev" 2>/dev/null)" != "$wanted" ]; }; then
    echo "Installing the project into $venv (a minute or two, once) ..." >&2
    "$venv/bin/python" -m pip install --quiet --constraint scripts/tested-versions.txt \
        --editable ".${project_extra:+[$project_extra]}" >&2
    echo "$wanted" > "$stamp"
fi

# EGL is a system library: pip cannot bring it.
if ! "$venv/bin/python" -c 'import ctypes; ctypes.CDLL("libEGL.so.1")' 2>/dev/null; then
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
