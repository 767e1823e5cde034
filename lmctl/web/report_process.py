"""Makes the report of a run in a process of its own, so that a long one delays no viewer.

    python -m lmctl.web.report_process JOURNAL > report.html
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from lmctl.errors import JournalError, LmctlError
from lmctl.run.journal.run_folders import RunFolder

#: A report that takes longer is made with `lmctl report` [s], and so is one of a larger journal,
#: which would surely take longer. Nothing of a report can be sent before all of the journal is
#: read: its summary and verification come first.
MOST_S, MOST_BYTES = 120.0, 2_000_000_000

_making = asyncio.Semaphore(1)


async def report_as_html_apart(journal: Path) -> bytes:
    """The report as one HTML file. Raises JournalError where it cannot be made, or not in time."""
    command = RunFolder(journal.parent).command("report")
    by_hand = (f"`{command} -o report.html` in a terminal makes it: it has no such limit, and "
               "takes no more memory for a longer journal")
    if (size := _size(journal)) > MOST_BYTES:
        raise JournalError(
            f"the journal holds {size / 1e9:.1f} GB: its report is not made here",
            where=f"up to {MOST_BYTES / 1e9:g} GB and {MOST_S:.0f} s", hint=by_hand)
    if _making.locked():
        raise JournalError("another report is being made", hint="try again in a minute")
    async with _making:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "lmctl.web.report_process", str(journal),
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE)
        try:
            async with asyncio.timeout(MOST_S):
                page, reason = await process.communicate()
        except TimeoutError:
            raise JournalError(
                f"the report takes longer than {MOST_S:.0f} s", hint=by_hand) from None
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        if process.returncode:
            raise JournalError("no report can be made of this run",
                               where=reason.decode("utf-8", "replace").splitlines()[-3:],
                               hint="`lmctl report` in a terminal says more")
        return page


def _size(journal: Path) -> int:
    """Bytes; 0 where that is not known: what is wrong with the file, its reader tells."""
    try:
        return journal.stat().st_size
    except OSError:
        return 0


def main(journal: Path) -> int:
    """Write the report of a journal to standard output. Returns the exit code."""
    from lmctl.report.job_report import report_as_html, report_document, report_pictures
    from lmctl.report.part_report import part_report_of

    try:
        found = part_report_of(journal)
        page = report_as_html(report_document(found, report_pictures(found)))
    except LmctlError as error:
        print(error.render(), file=sys.stderr)
        return error.exit_code
    sys.stdout.buffer.write(page.encode())
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
