"""`lmctl`: dispatch a command and turn what it raises into a message and an exit code.

0 done, 1 job or check failed, 2 usage, or a file or run that is not there, 3 configuration,
4 machine unreachable or in alarm, 5 stopped but resumable, 130 interrupted. A bug keeps its
traceback.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Sequence

import click

from lmctl.cli.lazy import LazyGroup
from lmctl.errors import LmctlError, UsageError

COMMANDS = {
    "demo": ("lmctl.cli.demo", "The main job: a scanned gear to a printed job log, simulated."),
    "init": ("lmctl.cli.init", "Write an example part, with its cell profile, to start from."),
    "check": ("lmctl.cli.check", "Say all that is wrong with a part file, a profile or a job."),
    "design": ("lmctl.cli.design", "Move bodies, features and mixtures of a part file in a page."),
    "plan": ("lmctl.cli.plan", "Plan a part (or a bare mesh or cloud) into a job file."),
    "show": ("lmctl.cli.show", "Show a job, a run or a part: page, pictures, .vti, coloured .ply."),
    "simulate": ("lmctl.cli.simulate", "Heat and stress of a part in service, or as it was built."),
    "optimise": ("lmctl.cli.optimise", "Choose the free numbers of a part by simulating it."),
    "run": ("lmctl.cli.run", "Run a job on the simulated machine or a real one."),
    "hold": ("lmctl.cli.operate", "Stop a run on its path, beam off; from another terminal."),
    "resume": ("lmctl.cli.operate", "End a hold."),
    "stop": ("lmctl.cli.operate", "End a run: beam and motion, then powder, then gas."),
    "override": ("lmctl.cli.operate", "Scale speed, beam and powder of a run together."),
    "refill": ("lmctl.cli.operate", "Refill a hopper in the middle of a run."),
    "height": ("lmctl.cli.operate", "Enter the height of a part whose run is held for it."),
    "status": ("lmctl.cli.operate", "Show the state of a run, and what to do about its alarms."),
    "recover": ("lmctl.cli.recover", "Go on with a part whose run was stopped, tripped or died."),
    "machine": ("lmctl.cli.machine", "Look at a machine, check it, home it, jog it, unlock it."),
    "dash": ("lmctl.cli.dash", "Serve a live page of runs, to look and to operate."),
    "jobs": ("lmctl.cli.jobs", "List job files and runs."),
    "log": ("lmctl.cli.log", "Print the log of a part over all its runs; verify its journals."),
    "report": ("lmctl.cli.report", "Write the report of a part, as HTML or PDF, to be signed."),
    "export": ("lmctl.cli.export", "Write a job for other controllers or as table; a part as 3MF."),
    "help": ("lmctl.cli.reference", "Explain a key of a file, a table of keys, or a command."),
    "schema": ("lmctl.cli.reference", "Print the JSON schema of a kind of file, for editors."),
    "completion": ("lmctl.cli.reference", "Print what makes bash, zsh or fish complete lmctl."),
    "note": ("lmctl.cli.note", "Add a reason or a disposition to the log of a run."),
}

#: New objects after which Python looks for cycles. Libraries bring more that all stay, and looking
#: through them every 700 takes a tenth of a short command's time.
_OBJECTS_A_COLLECTION = 300_000
#: Exit code after Ctrl-C.
_INTERRUPTED = 130


@click.command(
    cls=LazyGroup,
    table=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="lmctl", prog_name="lmctl")
def program() -> None:
    """From a part and its materials to a finished laser-cladding build.

    Never real hardware by default: `lmctl run` needs --sim or --machine FILE.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns the exit code; writes errors to standard error."""
    try:
        code = program.main(args=arguments, prog_name="lmctl", standalone_mode=False)
        return code if isinstance(code, int) else 0  # of a command that has called ctx.exit
    except LmctlError as error:
        click.echo(error.render(), err=True)
        return error.exit_code
    except click.exceptions.Exit as request:
        return request.exit_code
    except click.Abort:
        click.echo("interrupted", err=True)
        return _INTERRUPTED
    except click.ClickException as error:
        click.echo(_usage_error(error).render(), err=True)
        return UsageError.exit_code
    except KeyboardInterrupt:
        click.echo("interrupted", err=True)
        return _INTERRUPTED
    except BrokenPipeError:
        # The reader of our output went away (`lmctl log … | head`): that is no failure of ours,
        # but Python would complain once more while closing standard output.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _usage_error(error: click.ClickException) -> UsageError:
    """What click has to say of a command line, in the form of every other error."""
    what = error.format_message().rstrip(".")
    context = getattr(error, "ctx", None)
    command = "lmctl" if context is None else context.command_path
    hint = f"`{command} --help` shows what can be given"
    if isinstance(error, click.NoSuchOption) and error.possibilities:
        what = f"there is no option {error.option_name} here"
        from difflib import get_close_matches  # needed for mistakes only

        near = get_close_matches(error.option_name, error.possibilities, n=1, cutoff=0.0)
        hint = f"did you mean {near[0]}? {hint}"
    return UsageError(what[0].lower() + what[1:], hint=hint)


def run() -> None:
    """Entry point of the `lmctl` script; ends the process without taking it to pieces.

    Python clears every module as it ends, which for the compiler of the kernels takes longer than
    planning a small part. Exit handlers of libraries still run, before the one set here; but not
    after Ctrl-C: it may have stopped the compiler at any point, and clearing away what is half made
    has crashed the process.
    """
    code = 1  # also of an exception that comes out of `main`, once its traceback is printed

    def end_process() -> None:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except (OSError, ValueError):
            return  # Python itself then says what went wrong, and exits with 120
        os._exit(code)

    atexit.register(end_process)
    gc.set_threshold(_OBJECTS_A_COLLECTION)
    code = main()
    if code == _INTERRUPTED:
        end_process()
    sys.exit(code)


if __name__ == "__main__":
    run()
