"""Command `twin`: its subcommands in order, and its exit codes."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Sequence
from copy import copy
from itertools import pairwise
from typing import Annotated, Any, TextIO

import typer

from twin import version_of
from twin.commands.batch import reproduce, study_app, suite_app
from twin.commands.info import check, list_, schema
from twin.commands.memory import (
    EXIT_BAD_INPUT,
    EXIT_CLOSED_PIPE,
    EXIT_DONE,
    EXIT_FELL_SHORT,
    EXIT_INTERRUPTED,
    EXIT_OUR_FAULT,
    Interrupted,
    check_memory,
    describe_lack,
    is_interrupted,
    raise_on_signals,
    run_in_child,
)
from twin.commands.new import app as new
from twin.commands.run import environment, render, run
from twin.commands.track import detections, evaluate, export, track
from twin.commands.view import view
from twin.messages import TrackerLog, sentence

app = typer.Typer(
    name="twin",
    help="Describe a room, its people and its sensors; get what the sensors would report, the truth, and any tracker's score.",
    add_completion=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def _twin(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    if version:
        typer.echo(f"roomtwin {version_of('roomtwin')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


app.command(epilog="Example: twin run lab-five-people --tracker laser-imm --seed 3 --set background=none")(run)
app.command(epilog="Example: twin render lab-five-people --duration 10 --out out/ten-seconds")(render)
app.command(epilog="Example: twin track walk.bag --tracker laser-imm --rig rig.yaml --out out/walk")(track)
app.command(epilog="Example: twin detections out/library-hall-0/recording.mcap --tracker sort --out seen.csv")(
    detections
)
app.command(epilog="Example: twin evaluate out/lab-five-people-0/truth.csv out/lab-five-people-0/tracks/laser-imm.csv")(
    evaluate
)
app.command(epilog="Example: twin export out/lab-five-people-0 --format mot --out out/lab-mot")(export)
app.command(name="list", epilog="Example: twin list rooms; twin list trackers --cite")(list_)
app.command(epilog="Example: twin schema > scenario.schema.json")(schema)
app.command(epilog="Example: twin check; twin check office.xml office.yaml; twin check my_lab:Mine")(check)
app.add_typer(new, name="new")
app.add_typer(suite_app, name="suite")
app.add_typer(study_app, name="study")
app.command(epilog="Example: twin environment home-three-people --out out/home.npz")(environment)
app.command(epilog="Example: twin reproduce laser-fisheye-imm --seeds 10 --jobs 2")(reproduce)
app.command(
    epilog="Example: twin view everyday --people --out people.png; twin view everyday --video people.mp4 --to 20"
)(view)


def main() -> None:
    """Run the command line; every exit has its code (see docs/concepts/results.md)."""
    if (code := run_in_child()) is not None:
        sys.exit(code)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal of another encoding shows missing characters as escapes
            stream.reconfigure(errors="backslashreplace")  # pyright: ignore[reportAttributeAccessIssue]
    try:
        code = _code_of_run()
        code = _code_of_output(code)
        sys.stderr.flush()
    except BrokenPipeError:
        code = EXIT_CLOSED_PIPE
        _discard(sys.stdout)
        _discard(sys.stderr)
    except OSError:  # stderr cannot be written, and nothing can be said
        code = EXIT_BAD_INPUT
        _discard(sys.stderr)
    sys.exit(code)


def _code_of_output(code: int) -> int:
    """Write what is left on stdout; return the exit code: that of bad input where a success has lost its output."""
    lost = "output: is closed" if getattr(sys.stdout, "has_lost", False) else ""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        lost = f"output: {error.strerror}"
        _discard(sys.stdout)
    if lost and code in (EXIT_DONE, EXIT_FELL_SHORT):
        _end_with(f"{lost}, and what was printed is lost; a file, pipe or terminal that can be written is expected")
        return code or EXIT_BAD_INPUT
    return code


def _discard(stream: TextIO) -> None:
    """Send what a stream still holds nowhere: Python would report it again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _code_of_run() -> int:
    # Matrices are small: threads of BLAS would only disturb the work beside them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Images are rendered through EGL here, whatever the user's other programs use.
    os.environ["MUJOCO_GL"] = "disable"
    TrackerLog.install()
    raise_on_signals()
    try:
        code = _code_of_command()
    except Interrupted:
        code = EXIT_INTERRUPTED
    if is_interrupted() and code != EXIT_DONE:
        code = EXIT_INTERRUPTED
    if code == EXIT_INTERRUPTED:
        sys.stderr.write("twin: interrupted; no file was left half-written under its final name\n")
    return code


def _code_of_command() -> int:
    try:
        check_memory()
        _check_arguments(sys.argv[1:])
        # a shell expands `--out ~/x`, and leaves `--out=~/x` and what is quoted
        sys.argv[1:] = [re.sub(r"^(--[a-z-]+=)?~(?=/|$)", _home, each) for each in sys.argv[1:]]
        code = _app_of(sys.argv[1:])(standalone_mode=False)
        return code if isinstance(code, int) else EXIT_DONE  # typer's for Ctrl-C is EXIT_INTERRUPTED
    except BrokenPipeError:
        raise
    except SystemExit as error:
        if isinstance(error.__context__, BrokenPipeError):  # typer's exit for it
            raise error.__context__ from None
        raise
    except Exception as error:
        return EXIT_INTERRUPTED if is_interrupted() else _code_of_error(error)


def _code_of_error(error: Exception) -> int:
    """Describe an error on stderr; return its exit code."""
    from trackers.errors import InputError, PlugInError

    if isinstance(error, InputError):
        return _end_with(describe_lack(error) or str(error))
    if isinstance(error, PlugInError):
        return _end_with(str(error), EXIT_FELL_SHORT)
    if (lack := describe_lack(error)) is not None:
        return _end_with(lack)
    if isinstance(error, OSError) and (fault := _describe_path_error(error)):
        return _end_with(fault)
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):  # a usage error of click's
        return _end_with(_describe_usage_error(error))
    return _report_internal_error(error)


def _app_of(arguments: Sequence[str]) -> typer.Typer:
    """Return the app with only the command that is called, all if none is: typer prepares the options of each it holds."""
    called, name = copy(app), next(iter(arguments), "")
    called.registered_commands = [
        each for each in app.registered_commands if name == (each.name or getattr(each.callback, "__name__", None))
    ]
    called.registered_groups = [each for each in app.registered_groups if name == each.name]
    return called if called.registered_commands or called.registered_groups else app


def _describe_usage_error(error: Any) -> str:
    """Describe a usage error of click; for an unknown command, name the valid ones."""
    text = error.format_message().replace("Value error, ", "")
    if unread := re.fullmatch(
        r"(?is)Invalid value for '?(.+?)'?: (?:path|file|directory) '(.*)' is not readable\.?", text
    ):
        named = f"{unread[1]} {unread[2]}" if unread[1].startswith("-") else unread[2]
        return f"{named}: cannot be read ({os.strerror(errno.EACCES)}); a path that this user may read is expected"
    if text.startswith("No such option"):
        return f"{text.rstrip('.')}; `{_called(error)} --help` lists the valid ones"
    if text.startswith("No such command"):
        return f"{text} Valid are {', '.join(error.ctx.command.list_commands(error.ctx))}"
    if not text.startswith(("Got unexpected extra argument", "Missing argument")):
        return text
    command = error.ctx.command
    path = _called(error)
    has_out = any("--out" in each.opts for each in command.params)
    remedy = ", and --out names what is written" if has_out and text.startswith("Got") else ""
    field = re.search(r"\((\S+=\S*)\)", text)
    if field is not None and any("--set" in each.opts for each in command.params):
        remedy = f", and --set {field[1]} changes a field"
    usage = " ".join([path, *command.collect_usage_pieces(error.ctx)]).replace("{", "").replace("}", "")
    return f"{text.rstrip('.')}; `{usage}` is expected{remedy}"


def _called(error: Any) -> str:
    """Return the command of a usage error as it is typed."""
    return re.sub(r"^.*\btwin\b", "twin", error.ctx.command_path)


_UNWRITABLE = (
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EROFS, errno.ENOTDIR, errno.EISDIR
)  # fmt: skip


def _describe_path_error(error: OSError) -> str | None:
    """Describe an error of a path that cannot exist or be written; None for any other system error."""
    if error.errno == errno.ENOENT and error.filename is None:  # of os.getcwd
        return "the current folder is not there any more; one that exists is expected"
    if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
        return f"{error.filename}: {error.strerror}; the path of a file or folder is expected"
    if error.errno not in _UNWRITABLE:
        return None
    named = re.sub(r"(^|/)\.([^/]+)\.\d+\.partial$", r"\1\2", str(error.filename or "output"))  # by its name when whole
    if error.errno in (errno.EACCES, errno.ENOTDIR, errno.EISDIR):  # of reading or writing
        return f"{named}: {error.strerror}; a path that this user may read, or write where it is an output, is expected"
    return f"{named}: {error.strerror}; a folder that can be written, with space, is expected"


def _check_arguments(arguments: Sequence[str]) -> None:
    """Raise InputError for an argument that is empty, since an empty path would mean the current folder, or a dash."""
    from trackers.errors import InputError

    for before, argument in pairwise(["", *arguments]):
        option, _, value = argument.partition("=") if argument.startswith("--") else ("", "", argument)
        if value not in ("", "-") or (not value and option and not argument.endswith("=")):
            continue
        named = option or (before if before.startswith("-") else f"after {before or 'twin'!r}")
        if value:
            raise InputError(
                f"{named}: '-' names no file here, neither stdin nor stdout; the name of a file is expected"
            )
        raise InputError(f"{named}: an argument is empty; a name, path or value is expected")


def _home(start: re.Match[str]) -> str:
    """Return the start of an argument that is a path, with the home folder for `~`. Raises InputError without one."""
    from trackers.errors import InputError

    home = os.path.expanduser("~")
    if home == "~":
        raise InputError(f"{start[0]}: this user ({os.getuid()}) has no home folder; another path is expected")
    return (start[1] or "") + home


def _end_with(message: str, code: int = EXIT_BAD_INPUT) -> int:
    sys.stderr.write(f"twin: {sentence(message)}\n")
    return code


def _report_internal_error(error: Exception) -> int:
    import traceback

    traceback.print_exception(error)
    sys.stderr.write("twin: this is a fault of ours; please report it with the lines above and the scenario file\n")
    return EXIT_OUR_FAULT


if __name__ == "__main__":
    main()
